"""Vehicles of every order: engines against each other, and against plain programs of the fleet."""

import numpy as np
import pytest

import jaxnet
from jaxnet.view.text.check import check_text
from tests.matrices import matrix_of

VEHICLES = {1: "single_integrator", 2: "double_integrator"}
LIARS = [2, 5, 8, 11]


def simulated(**keys):
    """Results with trajectories, in the exact engine."""
    keys = {"engine": "exact", "horizon": 5.0, "tail": 1.0, "save": {"trajectories": "all"}} | keys
    return jaxnet.simulate(keys, progress=False)


def navigator_jets(results, times):
    """Position and three derivatives of the study's navigator, (4, 2, times)."""
    return np.asarray(results.study.config.navigator.jets(np.asarray(times)))


@pytest.mark.long  # short: order 3, tests/engine/test_exactness.py
def test_static_gains_do_not_depend_on_the_order():
    """3.0000 in the mean and 3.1034 for the worst on the ring."""
    keys = {"vehicle": "planar_quadrotor", "defence": "none", "horizon": 60.0, "samples": 2}
    keys["attack"] = {"kind": "bias", "vehicles": LIARS, "magnitude": 5.0}
    rows = jaxnet.simulate({"engine": "exact", "topology": "cyclic", **keys}, progress=False).lanes
    np.testing.assert_allclose(
        rows[["tail_mean", "tail_max"]].max() / 5.0, [3.0, 3.1034], atol=5e-5
    )


def subsequence(own, received, weights, spared, F):
    """W-MSR on one axis, and the mean of what it retains; the own value if nothing is retained."""
    equal = 1e-12 * np.maximum(
        1, np.maximum(np.abs(received), abs(own))
    )  # as the engine's comparisons
    other = [n for n in range(len(received)) if n not in spared]
    above = sorted((received[n], n) for n in other if received[n] - own > equal[n])[::-1]
    below = sorted((received[n], n) for n in other if own - received[n] > equal[n])
    dropped = {n for _, n in above[:F]} | {n for _, n in below[:F]}
    kept = [n for n in range(len(received)) if n not in dropped]
    return kept, np.dot(received[kept], weights[kept]) / weights[kept].sum() if kept else own


@pytest.mark.parametrize(
    ("share", "F", "navigator"),
    [pytest.param(1.0, 1, "all", marks=pytest.mark.long), (0.8, 2, [1, 6])],
)
def test_single_integrators_step_by_their_weights(share, F, navigator):
    """Steps of W-MSR by a plain program, with k0 = share/tick and five liars.

    With F = 2, who does not hear the navigator may retain nobody, and then stands still. Such
    vehicles soon stand at equal values, of which rounding chooses, so 100 steps are compared, to
    1e-9 m.
    """
    tick, steps = 0.05, 1000 if F == 1 else 100
    attack = {"kind": "rotating", "vehicles": [1, 4, 7, 9, 10], "magnitude": 5.0, "frequency": 0.7}
    results = simulated(
        vehicle="single_integrator",
        law="local",
        gain=[share / tick],
        attack=attack,
        defence={"kind": "w_msr", "F": F},
        topology={"kind": "lattice", "neighbours": 4, "navigator": navigator},
        horizon=steps * tick,
        output_step=tick,
        tick=tick,
    )
    data = results.trajectories.sel(cell=0, sample=0)
    states, signal = data["states"].values, data["attack"].values
    weights = matrix_of(results.study.config.topology, 12)
    path = navigator_jets(results, data["time"].values)
    x, alone = states[0].copy(), 0
    for n in range(len(states) - 1):
        sent = np.concatenate([path[0, :, n][None], x + signal[n]])
        new = x.copy()
        for i in range(12):
            heard = np.flatnonzero(weights[i])
            for axis in range(2):
                own, received, w = x[i, axis], sent[heard, axis], weights[i, heard]
                spared = {int(k) for k in np.flatnonzero(heard == 0)}
                kept, mean = subsequence(own, received, w, spared, F)
                ahead = w[[k for k in kept if k in spared]].sum() / max(w[kept].sum(), 1e-300)
                new[i, axis] = own + share * (mean - own) + tick * ahead * path[1, axis, n]
                alone += not kept
        x = new
        np.testing.assert_allclose(states[n + 1], x, rtol=0, atol=1e-12 if F == 1 else 1e-9)
    assert len(states) == steps + 1
    assert (alone > 100) == (F == 2)


def test_gains_follow_the_order():
    """Binomial gains cell by cell; other lengths are refused."""
    keys = {"engine": "exact", "attack": "none", "sweep": {"vehicle": [*VEHICLES.values(), "car"]}}
    study = jaxnet.load(keys)
    assert [cell.scenario.gain for cell in study.cells] == [[1], [1, 2], [1, 3, 3]]
    again = jaxnet.load(study, {"samples": 2})
    assert [cell.scenario.gain for cell in again.cells] == [[1], [1, 2], [1, 3, 3]]
    with pytest.raises(jaxnet.ConfigError, match="gain: single_integrator needs 1 gain, k0"):
        jaxnet.load({"engine": "exact", "vehicle": "single_integrator", "gain": [1, 3, 3]})
    with pytest.raises(jaxnet.ConfigError, match=r"gain: unstable: eigenvalues 1\+0j"):
        jaxnet.load({"engine": "exact", "vehicle": "single_integrator", "gain": [-1]})
    with pytest.raises(jaxnet.ConfigError, match="a choice of orders needs a vehicle of order 3"):
        jaxnet.load({"vehicle": "double_integrator", "engine": "exact", "attack": {"orders": [0]}})
    for gain in ([10, 4, 6, 4], [1, 4, 6, {"uniform": [0.1, 4]}]):
        with pytest.raises(jaxnet.ConfigError, match="gain: unstable"):
            jaxnet.load({"vehicle": "planar_quadrotor", "gain": gain})


def test_check_tells_whether_the_local_law_is_stable():
    """Single integrators that step too far do not agree."""
    keys = {"vehicle": "single_integrator", "engine": "exact", "law": "local", "attack": "none"}
    keys |= {"topology": "cyclic", "tick": 0.1}
    told = {gain: check_text(jaxnet.load({**keys, "gain": [gain]})) for gain in (10.0, 30.0)}
    assert "stable, deviations times 0.9000 at each tick of 0.1 s" in told[10.0]
    assert "UNSTABLE" in told[30.0]
