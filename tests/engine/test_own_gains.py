"""Gains of each vehicle, against matrix exponentials of the whole fleet in plain NumPy."""

import numpy as np
import pytest
from scipy.linalg import expm

import jaxnet
from tests import systems

GAINS = [[1.0, 2.0], [4.0, 3.0], [0.5, 1.2], [2.0, 5.0]]
KEYS = {
    "vehicles": 4,
    "vehicle": "double_integrator",
    "gain": {"vehicles": GAINS},
    "defence": "none",
    **systems.clock(0.5, 3.0, 1.0),
    "samples": 2,
    "save": {"trajectories": "all"},
}
BIAS = {"kind": "bias", "vehicles": [2, 3], "magnitude": 4.0}
TIGHT = {"kind": "nonlinear", "rtol": 1e-10, "atol": 1e-11}


def errors_of(results):
    """E, Ė (samples, times, 2, vehicles, 2) by sample and time; attack (samples, vehicles, 2)."""
    assert (results.lanes["status"] == "ok").all()
    data = results.trajectories.sel(cell=0)
    path = np.asarray(results.study.config.navigator.jets(data["time"].values))
    states = data["states"].values
    jets = [states[..., 2 * k : 2 * k + 2] - path[k].T[:, None] for k in range(2)]
    return np.stack(jets, axis=2), data["attack"].values[:, 0]


def whole_fleet(weights, attack, start):
    """E and Ė over time: `L E'' + K_1 L E' + K_0 L E = K_0 A a`, K_k diagonal, one exponential."""
    m, hears = len(weights), weights[:, 1:]
    L, first, second = np.eye(m) - hears, *(np.diag(each) for each in np.array(GAINS).T)
    inverse = np.linalg.inv(L)
    matrix = np.zeros((2 * m + 2, 2 * m + 2))
    matrix[:m, m : 2 * m] = np.eye(m)
    matrix[m : 2 * m] = np.hstack(
        [-inverse @ first @ L, -inverse @ second @ L, inverse @ first @ hears @ attack]
    )
    state = np.vstack([start.reshape(2 * m, 2), np.eye(2)])
    times = np.arange(0, 3.01, 0.5)
    return np.stack([(expm(matrix * t) @ state)[: 2 * m].reshape(2, m, 2) for t in times])


STACKED = {"kind": "stacked", "solver": "Dopri8", "rtol": 1e-9, "atol": 1e-10}


@pytest.mark.parametrize("engine", [TIGHT, pytest.param(STACKED, marks=pytest.mark.long)])
def test_a_path_is_that_of_one_matrix_exponential(engine):
    """`E = L⁻¹ ε`, where each ε_i has the poles of its own gains."""
    results = jaxnet.simulate(
        KEYS | {"topology": "path", "attack": BIAS, "engine": engine}, progress=False
    )
    found, attack = errors_of(results)
    weights = np.eye(4, 5)
    for errors, lies in zip(found, attack, strict=True):
        np.testing.assert_allclose(errors, whole_fleet(weights, lies, errors[0]), atol=1e-6)


@pytest.mark.long
def test_equal_gains_are_one_gain():
    """With sensors' errors, trimming and an attack with false derivatives, default vehicle."""
    keys = {"vehicles": 5, "horizon": 2.0, "tail": 1.0, "samples": 2, "topology": "complete"}
    keys |= {
        "sensing": {"kind": "gaussian", "position": 0.1},
        "attack": {"kind": "spoof", "vehicles": [2]},
    }
    keys |= {"defence": {"kind": "w_msr", "F": 1}}
    one, each = (
        jaxnet.simulate(keys | {"gain": gain}, progress=False).lanes
        for gain in ([2.0, 4.0, 3.0], {"vehicles": [[2.0, 4.0, 3.0]] * 5})
    )
    for name in ("tail_mean", "tail_max", "tail_disagreement", "min_speed"):
        np.testing.assert_allclose(each[name], one[name], rtol=1e-9)
