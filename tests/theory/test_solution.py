"""The closed loop solved, against the law integrated."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from experiments.exactness import tracking_errors
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.figure1 import Figure1
from jaxnet.kinds.graphs.path import Path
from tests.matrices import matrix_of

GAIN = np.array([1.0, 3.0, 3.0])


def figure_eight(t):
    """Jets (4, 2) of the navigator."""
    position = np.array([100 * np.sin(0.2 * t), 50 * np.sin(0.4 * t)])
    velocity = 20 * np.array([np.cos(0.2 * t), np.cos(0.4 * t)])
    acceleration = np.array([-4 * np.sin(0.2 * t), -8 * np.sin(0.4 * t)])
    return np.stack([position, velocity, acceleration, [-0.04, -0.16] * velocity])


def attack(t):
    """Jets (4, 5, 2) of what is added to 2 and 5, turning at 0.7 rad/s."""
    signal = np.zeros((4, 5, 2))
    for attacked, phase in ((2, 0.3), (5, 2.0)):
        angle = 0.7 * t + phase + np.arange(4) * np.pi / 2
        turn = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        signal[:, attacked - 1] = 10.0 * 0.7 ** np.arange(4)[:, None] * turn
    return signal


@pytest.mark.parametrize("kind", [Path(), Figure1(), Cyclic(navigator_weight=0.1)])
def test_agrees_with_integrating_the_law(kind):
    """The law as a vehicle applies it, to what it receives of moving neighbours, by DOP853."""
    weights, rng = matrix_of(kind, 5), np.random.default_rng(2)
    laplacian = np.eye(5) - weights[:, 1:]
    start = np.zeros((3, 5, 2))
    start[:2] = rng.uniform(-200.0, 200.0, (5, 2)), rng.normal(0.0, 0.3, (5, 2))

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

    def corruption(t, weights):
        return np.einsum("ij,kjx->kix", weights[:, 1:], attack(t)[:3])

    times = np.linspace(0.0, 6.0, 7)
    run = solve_ivp(law, (0, 6), start.ravel(), "DOP853", times, rtol=1e-11, atol=1e-10)
    held = np.broadcast_to(weights, (7, *weights.shape)).copy()
    errors = tracking_errors(start - figure_eight(0.0)[:3, None], corruption, held, GAIN, 1.0)
    found = errors + np.stack([figure_eight(t)[0] for t in times])[:, None]
    np.testing.assert_allclose(found, run.y.T.reshape(7, 3, 5, 2)[:, 0], rtol=0, atol=1e-7)
