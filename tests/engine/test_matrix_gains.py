"""Gains by axis and gains that couple the axes, against matrix exponentials."""

import numpy as np
import pytest
from scipy.linalg import expm

import jaxnet
from tests.matrices import matrix_of

COUPLED = [[[2.0, 0.7], [-0.9, 1.5]], [[3.0, -0.4], [0.5, 3.5]]]  # k0 and k1
BY_AXIS = [[2.0, 3.0], [0.5, 1.2]]  # x, y
FLEET = 4
ATTACK = {"kind": "rotating", "vehicles": [2, 3], "magnitude": 5.0, "frequency": 1.7}


def paths(**keys):
    """Results, times and states (times, vehicles, n) of one lane."""
    keys = {"vehicle": "double_integrator", "vehicles": FLEET, "horizon": 4.0, "tail": 1.0} | keys
    keys = {"defence": "none", "attack": ATTACK, "save": {"trajectories": "all"}} | keys
    results = jaxnet.simulate(keys, progress=False)
    data = results.trajectories.sel(cell=0, sample=0)
    return results, data["time"].values, data["states"].values


def rotated(first, time, k):
    """The k-th derivative of the attacks [m]."""
    angle = 1.7 * time + k * np.pi / 2
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return 1.7**k * first @ turn.T


@pytest.mark.parametrize(
    ("engine", "gain"),
    [
        pytest.param("exact", COUPLED, id="exact-coupled"),
        pytest.param("exact", BY_AXIS, id="exact-by_axis"),
        pytest.param("nonlinear", COUPLED, id="nonlinear-coupled", marks=pytest.mark.long),
    ],
)
def test_the_closed_loop_is_a_matrix_exponential(engine, gain):
    """`ẋ = (A + B K) (x - G) + Ġ` of each vehicle, with η = (x, y, ẋ, ẏ) as the paper orders it."""
    results, times, states = paths(engine=engine, gain=gain)
    if gain is BY_AXIS:
        K = np.block([np.diag([one[k] for one in BY_AXIS]) for k in range(2)])
    else:
        K = np.block([np.array(each) for each in COUPLED])
    loop = np.block([[np.zeros((2, 2)), np.eye(2)], [-K]])
    weights = matrix_of(results.study.config.topology, FLEET)
    A = weights[:, 1:]
    effect = np.linalg.solve(np.eye(FLEET) - A, A)
    first = results.trajectories.sel(cell=0, sample=0)["attack"].values[0]

    def about(time):
        """Where the errors settle, around the navigator: (vehicles, 4)."""
        path = np.asarray(results.study.config.navigator.jets(np.asarray(time)))
        return np.concatenate(
            [path[k] + effect @ rotated(first, time, k) for k in range(2)], axis=1
        )

    free = states[0] - about(0.0)
    for time, now in zip(times, states, strict=True):
        np.testing.assert_allclose(now, about(time) + free @ expm(loop * time).T, rtol=0, atol=3e-5)


@pytest.mark.long
def test_a_multiple_of_the_identity_is_a_number():
    """Robots under trimming: gains in both forms give one motion, and one standstill."""
    keys = {"vehicle": "two_wheeled", "defence": "trusted_trim", "engine": "exact"}
    plain = paths(gain=[1.0, 3.0, 3.0], **keys)[2]
    alike = paths(gain=[[1.0, 3.0, 3.0]] * 2, **keys)[2]
    np.testing.assert_allclose(alike, plain, rtol=0, atol=1e-9)
    other = paths(gain=[[1.0, 3.0, 3.0], [2.0, 3.0, 3.0]], **keys)[2]
    assert np.abs(other - plain).max() > 1.0
    on_line = {
        "position": [[-10.0, 0.0], [90.0, 0.0], [20.0, 0.0], [0.0, 0.0]],
        "heading": 0.0,
        "speed": 5.0,
    }
    path = {"kind": "lissajous", "amplitude": [100.0, 0.0], "frequency": [0.2, 0.2]}
    keys |= {"initial": on_line, "navigator": path, "attack": ATTACK | {"magnitude": 0.0}}
    ends = [paths(gain=gain, **keys)[0].lanes for gain in ([1.0, 3.0, 3.0], [[1.0, 3.0, 3.0]] * 2)]
    assert [each["status"][0] for each in ends] == ["singular"] * 2
