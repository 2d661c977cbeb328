"""Late words: known margins and lags."""

import math

import numpy as np
import pytest

from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.path import Path
from jaxnet.kinds.graphs.star import Star
from jaxnet.theory import delay
from tests.matrices import matrix_of

RING, PATH, STAR = (matrix_of(graph, 12) for graph in (Cyclic(), Path(), Star()))


def test_lags():
    """Once for each link on the way: 1 on a star, i on a path, 10 on the ring, times the delay."""
    assert delay.lags(STAR, 0.1) == pytest.approx(np.full(12, 0.1))
    assert delay.lags(PATH, 0.2) == pytest.approx(0.2 * np.arange(1, 13))
    assert delay.lags(RING, 0.1) == pytest.approx(np.full(12, 1.0))


def test_margins():
    """Known on the ring, by hand at order 1, infinite without a cycle."""
    assert delay.jerk_margin(RING, np.array([1.0, 3.0, 3.0])) == pytest.approx(0.0363729, abs=5e-8)
    assert delay.jerk_margin(RING, np.array([2.0])) == pytest.approx((1 / 0.9 - 1) / 2)
    assert delay.jerk_margin(PATH, np.array([1.0, 3.0, 3.0])) == math.inf
