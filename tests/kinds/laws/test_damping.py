"""Damping of a vehicle's own derivatives, compared with nobody's: exact answers.

Messages that are lost, late or continued: tests/engine/test_reference.py.
"""

import numpy as np
import pytest
from scipy.linalg import expm

import jaxnet
from jaxnet.view.text.check import check_text
from tests import rescue, systems

UNION = [(i, j) for i, j in np.argwhere(rescue.adjacency([*rescue.FIRST, *rescue.SECOND]))]


def keys(edges, **others):
    """Agents 0 to 7 on a line, at 1 to 8 m and at rest, with weights of 1."""
    return {
        "vehicles": 8,
        "vehicle": "double_integrator",
        "navigator": "none",
        "topology": {
            "kind": "edges",
            "edges": [[int(i) + 1, int(j) + 1, 1.0] for i, j in edges],
            "normalised": False,
        },
        "initial": {"position": [[x, 0.0] for x in range(1, 9)], "speed": 0.0},
        "law": {"kind": "local", "hold": False, "damping": "absolute"},
        "gain": [1.0, 3.0],
        **systems.QUIET,
        "engine": "exact",
        "horizon": 10.0,
        "tail": 0.0,
        "output_step": 10.0,
        "tick": 1.0,
        "save": {"trajectories": "all"},
    } | others


def ends(**others):
    results = jaxnet.simulate(keys(UNION, **others), samples=1, progress=False)
    return results.trajectories["states"].values[0, 0, -1]


def flow():
    """Matrix of positions and velocities, `ẍ = -L x - 3 ẋ`."""
    L = rescue.laplacian(rescue.adjacency(UNION))
    return np.block([[np.zeros((8, 8)), np.eye(8)], [-L, -3 * np.eye(8)]])


def test_agents_agree_on_the_mean_of_where_they_come_to_rest():
    """Places after 10 s, to 8 digits as published, and of a matrix exponential, to rounding."""
    published = [4.49998756, 4.50000419, 4.50000394, 4.50001062]
    published += [4.49999770, 4.49999687, 4.49999690, 4.50000221]
    found = ends()
    assert found[:, 0] == pytest.approx(published, abs=6e-9)
    start = np.concatenate([np.arange(1.0, 9), np.zeros(8)])
    exact = expm(10 * flow()) @ start
    assert np.concatenate(found[:, [0, 2]].T) == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize(("hold", "tick"), [(False, 0.1), (True, 0.1), (True, 0.9)])
def test_check_tells_how_deviations_die_out(hold, tick):
    """By the eigenvalues of the whole fleet, of which one is 1, or 0, where all agree."""
    law = {"kind": "local", "hold": hold, "damping": "absolute"}
    study = jaxnet.load(keys(UNION, law=law, tick=tick, horizon=9.0, output_step=9.0))
    told = check_text(study)
    if not hold:
        rates = np.sort(np.linalg.eigvals(flow()).real)
        assert f"stable, deviations behave as exp({rates[-2]:.4f} t)" in told
        return
    eye = np.eye(8)
    step = np.block([[eye, tick * eye], [0 * eye, eye]])
    step = step + np.vstack([tick**2 / 2 * eye, tick * eye]) @ flow()[8:]
    factors = np.linalg.eigvals(step)
    factor = np.abs(np.delete(factors, np.abs(factors - 1).argmin())).max()
    assert (factor < 1) == (tick < 0.5)
    assert ("UNSTABLE" in told) == (factor > 1)
    assert f"{factor:.4f}" in told
