"""The linearised law, against a plain program of the paper's means of states and the exact law."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxnet
from tests.matrices import matrix_of

CIRCLE = {
    "amplitude": [40.0, 40.0],
    "frequency": [0.5, 0.5],
    "phase": [np.pi / 2, 0.0],
}  # 20 m/s, heads up
ALIKE = {"heading": np.pi / 2, "speed": 20.0}
FLEET = 4
PLACES = [[43.0, 1.0], [37.0, -2.0], [40.0, 4.0], [41.0, 0.5]]


def paths(**keys):
    """Results and states (times, vehicles, n) of one lane."""
    keys = {
        "navigator": CIRCLE,
        "vehicles": FLEET,
        "horizon": 6.0,
        "tail": 1.0,
        "defence": "none",
    } | keys
    keys = {"attack": "none", "save": {"trajectories": "all"}} | keys
    keys["initial"] = {"position": PLACES, **ALIKE} | keys.get("initial", {})
    results = jaxnet.simulate(keys, progress=False)
    data = results.trajectories.sel(cell=0, sample=0)
    return results, data["time"].values, data["states"].values


def robot(x, u):
    """Rates of a two-wheeled robot, and its jets."""
    _, _, heading, v, turn, force = x
    h, n = (
        np.array([np.cos(heading), np.sin(heading)]),
        np.array([-np.sin(heading), np.cos(heading)]),
    )
    jets = [x[:2], v * h, force * h + v * turn * n]
    third = (2 * force * turn + v * u[1]) * n + (u[0] - v * turn**2) * h
    return np.array([*(v * h), turn, force, u[1], u[0]]), [*jets, third]


def slopes(function, at):
    """The Jacobian by complex steps, exact to rounding."""
    steps = np.eye(len(at)) * 1e-30j
    return np.stack([np.imag(function(at + step)) / 1e-30 for step in steps], axis=1)


@pytest.mark.parametrize("attacked", [False, True])
def test_means_of_states_and_inputs_give_the_same_motion(attacked):
    """The plain program solves `u_i = Σ_j w_ij u_j + K (x_i - Σ_j w_ij x_j)` with lies in states
    and inputs.

    Poles are placed by hand: K makes the jets of the linearised error obey the gain.
    """
    gain, radius, rate = np.array([1.5, 3.5, 3.0]), 40.0, 0.5
    attack = {"kind": "rotating", "vehicles": [2, 3], "magnitude": 0.5, "frequency": 1.7}
    keys = {"attack": attack} if attacked else {}
    results, times, states = paths(law="linearised", gain=list(gain), **keys)
    assert results.lanes["status"].to_list() == ["ok"]
    weights = matrix_of(results.study.config.topology, FLEET)
    A, a0 = weights[:, 1:], weights[:, 0]
    first = np.zeros((FLEET, 2))
    if attacked:
        first = results.trajectories.sel(cell=0, sample=0)["attack"].values[0]

    def turned(k, time):
        angle = 1.7 * time + k * np.pi / 2
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return 1.7**k * first @ turn.T

    def field(time, flat):
        x, u0 = flat.reshape(FLEET, 6), np.zeros(2)
        heading, v = rate * time + np.pi / 2, radius * rate
        x0 = np.array(
            [radius * np.cos(rate * time), radius * np.sin(rate * time), heading, v, rate, 0.0]
        )
        to_jets = slopes(lambda each: np.concatenate(robot(each, u0)[1][:3]), x0)  # 6 × 6
        to_third = slopes(lambda each: robot(each, u0)[1][3], x0)
        psi = slopes(lambda each: robot(x0, each)[1][3], u0)
        K = np.linalg.solve(psi, -np.kron(gain, np.eye(2)) @ to_jets - to_third)
        lies = np.concatenate([turned(k, time) for k in range(3)], axis=1)  # jets of each sender
        lies = np.linalg.solve(to_jets, lies.T).T
        told_inputs = np.linalg.solve(psi, (turned(3, time) - lies @ to_third.T).T).T
        error = x - a0[:, None] * x0 - A @ (x + lies)
        right = a0[:, None] * u0 + A @ told_inputs + error @ K.T
        u = np.linalg.solve(np.eye(FLEET) - A, right)
        return np.concatenate([robot(one, inputs)[0] for one, inputs in zip(x, u, strict=True)])

    plain = solve_ivp(
        field, (0.0, 6.0), states[0].ravel(), t_eval=times, rtol=1e-9, atol=1e-9, method="DOP853"
    )
    expected = plain.y.T.reshape(len(times), FLEET, 6)
    states[..., 2] = np.unwrap(states[..., 2], axis=0)
    np.testing.assert_allclose(states, expected, rtol=0, atol=2e-5)


@pytest.mark.long
def test_the_difference_from_the_exact_law_is_of_second_order():
    """Half the error, a quarter of the difference, with noise and trimming. Far off it fails."""

    def positions(scale, places):
        """Ends and positions of both laws."""
        initial = {
            "position": places,
            "heading": np.pi / 4 + 0.2 * scale,
            "speed": 800**0.5 + scale,
        }
        keys = {
            "initial": initial,
            "navigator": "lissajous",
            "defence": "trusted_trim",
            "horizon": 30.0,
        }
        keys |= {
            "sensing": {"kind": "gaussian", "position": 0.02 * scale, "velocity": 0.02 * scale}
        }
        found = [paths(law=law, **keys) for law in ("exact", "linearised")]
        return [(results.lanes["tail_max"][0], states[..., :2]) for results, _, states in found]

    apart = []
    for scale in (1.0, 0.5, 0.25):
        (_, exact), (_, linearised) = positions(
            scale, ((np.array(PLACES) - [40.0, 0.0]) * scale).tolist()
        )
        apart.append(np.abs(exact - linearised).max())
    assert apart[0] < 1.0
    np.testing.assert_allclose(np.divide(apart[:-1], apart[1:]), 4.0, atol=0.3)
    (exact, _), (linearised, _) = positions(
        1.0, [[-500.0, 200.0], [300.0, 400.0], [0.0, 0.0], [500.0, 0.0]]
    )
    assert exact < 0.1
    assert not linearised < 10.0
