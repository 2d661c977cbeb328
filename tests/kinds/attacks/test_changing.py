"""Attacked vehicles that change at given times."""

import numpy as np
import pytest
from scipy.linalg import expm

import jaxnet
from tests.engine.test_orders import subsequence
from tests.matrices import matrix_of

SETS = {"at": [0, 2, 4.5], "sets": [[2, 5], [8], []]}
BIAS = {"kind": "bias", "magnitude": 4.0, "direction": 0.6, "vehicles": SETS}


def paths(**keys):
    """Positions of one lane, (times, m, 2), the times [s], and the results."""
    keys = {"horizon": 8.0, "tail": 1.0, "tick": 0.1, "save": {"trajectories": "all"}} | keys
    results = jaxnet.simulate(keys, samples=1, progress=False)
    assert results.lanes["status"].to_list() == ["ok"]
    data = results.trajectories.sel(cell=0, sample=0)
    return data["states"].values[..., :2], data["time"].values, results


def test_constant_offsets_superpose_piece_by_piece():
    """Each piece adds `(S(t - t_p) - S(t - t_{p+1})) L⁻¹ W_p a` with the step response S of one axis."""
    found, times, results = paths(engine="exact", defence="none", attack=BIAS)
    (cell,) = results.study.cells
    navigator, kind = cell.scenario.navigator, cell.scenario.vehicle
    weights = matrix_of(cell.scenario.topology, 12)
    states = results.trajectories.sel(cell=0, sample=0)["states"].values[0]
    start = np.stack(kind.output_jets(states.T[:, :, None]))[..., 0]  # (3, 2, 12)
    start -= np.asarray(navigator.jets(np.zeros(1)))[:3]
    system = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -3.0, -3.0]])

    def step(time):
        return 1.0 - expm(system * time)[0, 0] if time > 0 else 0.0

    offset = 4.0 * np.array([np.cos(0.6), np.sin(0.6)])
    ends = [*SETS["at"][1:], np.inf]
    for n, time in enumerate(times):
        known = np.einsum("k,kxm->mx", expm(system * time)[0], start)
        known += np.asarray(navigator.jets(np.array(time)))[0]
        for since, until, liars in zip(SETS["at"], ends, SETS["sets"], strict=True):
            pushed = weights[:, liars].sum(axis=1)[:, None] * offset
            share = step(time - since) - step(time - until)
            known += share * np.linalg.solve(np.eye(12) - weights[:, 1:], pushed)
        np.testing.assert_allclose(found[n], known, atol=1e-8)


@pytest.mark.long
def test_mobile_liars_under_w_msr_step_by_step():
    """A plain program of single integrators on a complete graph with F = 1, by what each source sends.

    A vehicle that is attacked no more is believed with its own place again.
    """
    sets = {"at": [3, 20, 31], "sets": [[3], [5], [1]]}
    attack = {"kind": "own_path", "centre": [45.0, 0.0]}
    starts = [10.0, 30.0, 60.0, 80.0, 100.0, 55.0]
    edges = [[i, j, 1.0] for i in range(1, 7) for j in range(1, 7) if i != j]
    keys = {"vehicle": "single_integrator", "navigator": "none", "law": "local", "engine": "exact"}
    keys |= {"gain": [0.1], "tick": 1.0, "output_step": 1.0, "horizon": 60.0, "tail": 0.0}
    keys |= {"topology": {"kind": "edges", "edges": edges}, "initial": {"position": starts}}
    states, times, _ = paths(**keys, attack=attack | {"vehicles": sets}, defence="w_msr")
    x = np.array(starts)
    for now, time in zip(states[..., 0], times, strict=True):
        np.testing.assert_allclose(now, x, rtol=0, atol=1e-9)
        sent = x.copy()
        liar = [
            each
            for since, each in zip([0, *sets["at"]], [[], *sets["sets"]], strict=True)
            if time >= since
        ]
        for each in liar[-1]:
            sent[each - 1] = 45.0 + 10.0 * np.cos(0.7 * time)
        new = x.copy()
        for i in range(6):
            heard = sent[np.arange(6) != i]
            _, mean = subsequence(x[i], heard, np.ones(5), set(), 1)
            new[i] = x[i] - 0.1 * (x[i] - mean)
        x = new
