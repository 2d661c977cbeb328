"""Attacked vehicles that change at given times."""

import numpy as np
from scipy.linalg import expm

import jaxnet
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
    """Each piece adds `(S(t - t_p) - S(t - t_{p+1})) L⁻¹ W_p a`, S the step response of an axis."""
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
