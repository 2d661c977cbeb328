"""Attackers that tell a path of their own, whatever they do."""

import numpy as np

import jaxnet

LINE = {"kind": "edges", "edges": [[1, 0, 1.0], [2, 1, 1.0], [3, 2, 1.0]]}
OWN = {"kind": "own_path", "vehicles": [1], "centre": [40.0, -30.0]}
OWN |= {"swing": [25.0, 10.0], "phase": 0.4}


def path(time, centre, swing, frequency, phase):
    """The attacker's path in space, (times, 2)."""
    return np.array(centre) + np.cos(frequency * time + phase)[:, None] * np.array(swing)


def test_who_hears_the_attacker_alone_follows_its_path():
    """Vehicles 2 and 3 end on the path exactly, and vehicle 1 on the navigator's."""
    keys = {"vehicles": 3, "topology": LINE, "attack": OWN, "defence": "none"}
    keys |= {"engine": "exact", "horizon": 40.0, "tail": 1.0, "save": {"trajectories": "all"}}
    keys["vehicle"] = "double_integrator"
    results = jaxnet.simulate(keys, samples=1, progress=False)
    states = results.trajectories.sel(cell=0, sample=0)["states"].values[-1, :, :2]
    told = path(np.array([40.0]), OWN["centre"], OWN["swing"], 0.7, 0.4)
    np.testing.assert_allclose(states[1:], np.tile(told, (2, 1)), atol=1e-8)
    navigator = np.asarray(results.study.config.navigator.jets(np.array(40.0)))[0]
    np.testing.assert_allclose(states[0], navigator, atol=1e-8)


def test_each_attacker_swings_about_its_own_start_with_its_own_frequency():
    """What listeners hear, from the stored signals, with a phase drawn for each attacker."""
    attack = {"kind": "own_path", "vehicles": [1, 3], "swing": [0.0, 4.0], "frequency": [0.5, 1.1]}
    keys = {"vehicle": "single_integrator", "navigator": "none", "law": "local", "engine": "exact"}
    keys |= {"gain": [1.0], "tick": 0.1, "horizon": 3.0, "tail": 0.0}
    keys |= {"vehicles": 4, "topology": "complete"}
    keys |= {"attack": attack | {"phase": 0.3}, "defence": "none", "save": {"trajectories": "all"}}
    data = jaxnet.simulate(keys, samples=1, progress=False).trajectories.sel(cell=0, sample=0)
    time, signal, starts = data["time"].values, data["attack"].values, data["states"].values[0]
    for vehicle, frequency in ((0, 0.5), (2, 1.1)):
        told = path(time, starts[vehicle], [0.0, 4.0], frequency, 0.3)
        np.testing.assert_allclose(signal[:, vehicle], told, atol=1e-9)
