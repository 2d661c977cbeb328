"""Steady covariance under noise: known figures, long sums, simulated lanes."""

import numpy as np
import pytest
from scipy.linalg import expm

from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.path import Path
from jaxnet.kinds.graphs.star import Star
from jaxnet.theory import noise
from tests.matrices import matrix_of

GAIN = np.array([1.0, 3.0, 3.0])


def test_known_variances():
    """Of position, velocity and acceleration, which two independent programs found; and of short ticks."""
    known = [0.00937435, 0.00312305, 0.00935354]
    np.testing.assert_allclose(np.diag(noise.steady_covariance(GAIN, 0.05)), known, rtol=2e-6)
    assert noise.steady_covariance(GAIN, 0.1)[0, 0] == pytest.approx(0.0187448, rel=3e-6)
    assert noise.steady_covariance(GAIN, 0.05, 1.0)[0, 0] == pytest.approx(0.312565, rel=2e-6)
    assert noise.steady_covariance(GAIN, 1e-3)[0, 0] == pytest.approx(0.1875e-3, rel=1e-5)


@pytest.mark.parametrize(("gain", "tick", "correlation"), [((2.0,), 0.3, 0.5), ((4.0, 1.0), 0.2, 0.05)])
def test_the_variance_is_a_long_sum(gain, tick, correlation):
    """Over all pairs of past drives, each with its impulse response and their correlation."""
    order, ticks = len(gain), 400
    companion = np.diag(np.ones(order - 1), 1)
    companion[-1] = -np.array(gain)
    flow = expm(companion * tick)
    held = np.linalg.solve(companion, (flow - np.eye(order))[:, -1])
    response = np.stack([np.linalg.matrix_power(flow, n) @ held for n in range(ticks)], axis=1)
    apart = np.abs(np.subtract.outer(np.arange(ticks), np.arange(ticks)))
    known = response @ np.exp(-apart * tick / correlation) @ response.T
    found = noise.steady_covariance(np.array(gain), tick, correlation)
    np.testing.assert_allclose(found, known, rtol=1e-9, atol=1e-12)


def test_known_factors():
    """1 and 0 on the star, i and i - 1 on the path, known figures on the ring."""
    ring, path, star = (matrix_of(graph, 12) for graph in (Cyclic(), Path(), Star()))
    np.testing.assert_allclose(noise.link_gains(star), 1.0)
    np.testing.assert_allclose(noise.link_gains(path), np.arange(1, 13))
    assert noise.link_gains(ring) == pytest.approx(np.full(12, 5.242067), abs=5e-7)
    np.testing.assert_allclose(noise.transmitter_gains(star), 0.0)
    np.testing.assert_allclose(noise.transmitter_gains(path), np.arange(12.0))
    assert noise.transmitter_gains(ring) == pytest.approx(np.full(12, 9.009307), abs=5e-7)
