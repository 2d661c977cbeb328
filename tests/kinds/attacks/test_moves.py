"""Attackers that tell a path of their own, and may move along it."""

import numpy as np
import pytest

import jaxnet
from tests.engine.test_self_weights import subsequence

PATH = {"kind": "own_path", "centre": [3.0, -2.0], "swing": [25.0, 10.0]}
PATH |= {"frequency": 1.3, "phase": 0.4}
NOBODY_LEADS = {"navigator": "none", "law": "local", "engine": "exact", "topology": "complete"}


def told(time, order=0):
    """A derivative of the liar's path, (times, 2)."""
    turn = 1.3**order * np.cos(1.3 * np.asarray(time) + 0.4 + order * np.pi / 2)
    return (order == 0) * np.array([3.0, -2.0]) + turn[:, None] * np.array([25.0, 10.0])


def results_of(**keys):
    keys = {"horizon": 4.0, "tail": 1.0, "tick": 0.1, "save": {"trajectories": "all"}} | keys
    results = jaxnet.simulate(keys, samples=1, progress=False)
    assert results.lanes["status"].to_list() == ["ok"]
    return results


def test_a_liar_is_where_it_tells_to_be():
    """Positions, velocities, inputs, metrics of space; double integrators, nonlinear engine."""
    attack = PATH | {"vehicles": [2], "moves": "as_told"}
    keys = NOBODY_LEADS | {"vehicle": "double_integrator", "vehicles": 5, "defence": "w_msr"}
    keys |= {"engine": "nonlinear", "attack": attack, "metrics": ["min_separation"]}
    results = results_of(**keys)
    data, lane = results.trajectories.sel(cell=0, sample=0), results.lanes.iloc[0]
    states, time = data["states"].values, data["time"].values
    np.testing.assert_allclose(states[:, 1, :2], told(time), atol=1e-9)
    np.testing.assert_allclose(states[:, 1, 2:4], told(time, 1), atol=1e-9)
    np.testing.assert_allclose(data["inputs"].values[:, 1], told(time, 2), atol=1e-9)
    places = states[..., :2]
    apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1) + 1e9 * np.eye(5)
    assert lane["min_separation"] == pytest.approx(apart.min(), abs=1e-9)
    slowest = np.linalg.norm(states[..., 2:4], axis=-1).min()
    assert lane["min_speed"] == pytest.approx(slowest, abs=1e-9)
    honest = np.delete(places[-11:], 1, axis=1)
    spread = np.linalg.norm(honest[:, :, None] - honest[:, None], axis=-1).max()
    assert lane["spread"] == pytest.approx(spread, abs=1e-9)


@pytest.mark.long
def test_a_liar_drops_sources_by_its_own_place():
    """Switches under W-MSR, counted by a plain program in which the liar's state is its path."""
    keys = NOBODY_LEADS | {"vehicle": "single_integrator", "vehicles": 5, "defence": "w_msr"}
    keys |= {"gain": [0.2], "tick": 1.0, "output_step": 1.0, "horizon": 12.0, "tail": 0.0}
    starts = [[10.0, 7.0], [30.0, -20.0], [60.0, 31.0], [80.0, 2.0], [100.0, -9.0]]
    keys |= {"initial": {"position": starts}}
    keys |= {"attack": PATH | {"vehicles": [3], "moves": "as_told"}}
    results = results_of(**keys)
    x, before, switches = np.array(starts), None, 0
    for time in range(13):
        x[2] = told([time])[0]
        kept, new = [], x.copy()
        for i in range(5):
            others = np.delete(x, i, axis=0)
            pairs = zip(x[i], others.T, strict=True)
            axes = [subsequence(own, other) for own, other in pairs]
            kept.append([each for each, _ in axes])
            new[i] = x[i] - 0.2 * (x[i] - [mean for _, mean in axes])
        states = results.trajectories["states"].sel(cell=0, sample=0).values[time]
        np.testing.assert_allclose(states, x, atol=1e-9)
        switches += 0 if before is None else sum(a != b for a, b in zip(kept, before, strict=True))
        x, before = new, kept
    assert results.lanes["switches"].to_list() == [switches]


LINE = {"kind": "edges", "edges": [[1, 0, 1.0], [2, 1, 1.0], [3, 2, 1.0]]}
OWN = {"kind": "own_path", "vehicles": [1], "centre": [40.0, -30.0]}
OWN |= {"swing": [25.0, 10.0], "phase": 0.4}


def path(time, centre, swing, frequency, phase):
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
