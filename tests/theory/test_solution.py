"""The closed loop solved: against another program, and against the law integrated."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from experiments.exactness import tracking_errors
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.figure1 import Figure1
from jaxnet.kinds.graphs.path import Path
from tests import reference
from tests.matrices import matrix_of

ATTACKED = np.array([2, 5, 8, 11])
GAIN = np.array([1.0, 3.0, 3.0])


def figure_eight(t):
    """Jets (4, 2) of the navigator."""
    position = np.array([100 * np.sin(0.2 * t), 50 * np.sin(0.4 * t)])
    velocity = 20 * np.array([np.cos(0.2 * t), np.cos(0.4 * t)])
    acceleration = np.array([-4 * np.sin(0.2 * t), -8 * np.sin(0.4 * t)])
    return np.stack([position, velocity, acceleration, [-0.04, -0.16] * velocity])


def rotating(magnitude, phases, vehicles=12):
    """`attack(t)`: jets (4, m, 2) of what is added to the attacked, turning at 0.7 rad/s."""

    def attack(t):
        signal = np.zeros((4, vehicles, 2))
        for attacked, phase in zip(ATTACKED[vehicles >= ATTACKED], phases, strict=True):
            angle = 0.7 * t + phase + np.arange(4) * np.pi / 2
            turn = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
            signal[:, attacked - 1] = magnitude * 0.7 ** np.arange(4)[:, None] * turn
        return signal

    return attack


def corruption_of(attack):
    """Jets of d when all that the attacked vehicles transmit carries the attack."""
    return lambda t, weights: np.einsum("ij,kjx->kix", weights[:, 1:], attack(t)[:3])


def start(seed, vehicles=12):
    """Jets (3, m, 2) of a fleet, far from the navigator and slow."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(-200.0, 200.0, (vehicles, 2))
    return np.stack([position, rng.normal(0.0, 0.3, (vehicles, 2)), np.zeros((vehicles, 2))])


def solved(seed, attack, weights, gain, interval):
    """Positions of the vehicles over time, by the theory."""
    own = start(seed, weights.shape[1]) - figure_eight(0.0)[:3, None]
    error = tracking_errors(own, corruption_of(attack), weights, gain, interval)
    navigator = np.stack([figure_eight(interval * n)[0] for n in range(len(weights))])
    return error + navigator[:, None]


@pytest.mark.parametrize("gain", [GAIN, np.array([2.0, 4.0, 2.5])])
@pytest.mark.parametrize("trimmed", [True, False])
def test_agrees_with_the_reference_program_while_it_trims(trimmed, gain):
    attack = rotating(10.0, [0.3, 2.0, 4.1, 5.5])

    def on_edges(t):
        added = np.zeros((4, 12, 13, 2))
        added[:, :, 1:] = attack(t)[:, None]
        return added

    weights, rule = matrix_of(Cyclic(navigator_weight=0.1), 12), {}
    if trimmed:
        rule = {"trusted": [{0}] * 12, "theta": [1] * 12}
    answer = reference.propagate(weights, figure_eight, on_edges, gain, start(1), 0.05, 400, **rule)
    if trimmed:
        changes = (np.diff(answer["kept"] > 0, axis=0)).any(axis=(1, 2)).sum()
        assert changes > 10  # otherwise one solution from 0 to the end would do as well
    found = solved(1, attack, answer["kept"], gain, 0.05)
    np.testing.assert_allclose(found, answer["positions"], rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", [Path(), Figure1(), Cyclic(navigator_weight=0.1)])
def test_agrees_with_integrating_the_law(kind):
    """The law as a vehicle applies it, to what it receives of moving neighbours, by DOP853."""
    attack, weights = rotating(10.0, [0.3, 2.0], vehicles=5), matrix_of(kind, 5)
    laplacian = np.eye(5) - weights[:, 1:]

    def law(t, flat):
        y, y0 = flat.reshape(3, 5, 2), figure_eight(t)
        added = attack(t)
        received = np.zeros((4, 5, 2))
        for k in range(4):
            others = y[k] if k < 3 else np.zeros((5, 2))
            for i in range(5):
                received[k, i] = weights[i, 0] * y0[k] + weights[i, 1:] @ (others + added[k])
        feedback = sum(gain * (y[k] - received[k]) for k, gain in enumerate(GAIN))
        jerk = np.linalg.solve(laplacian, received[3] - feedback)
        return np.stack([y[1], y[2], jerk]).ravel()

    times = np.linspace(0.0, 6.0, 7)
    run = solve_ivp(law, (0, 6), start(2, 5).ravel(), "DOP853", times, rtol=1e-11, atol=1e-10)
    held = np.broadcast_to(weights, (7, *weights.shape)).copy()
    found = solved(2, attack, held, GAIN, 1.0)
    np.testing.assert_allclose(found, run.y.T.reshape(7, 3, 5, 2)[:, 0], rtol=0, atol=1e-7)
