"""Robustness by integer programs: small digraphs as by enumeration, larger ones as known."""

from time import monotonic

import numpy as np
import pytest

from jaxnet.theory.integer import (
    RobustnessBracket,
    degree_bracket,
    is_robust,
    robustness_bracket,
    s_bracket,
    total_bracket,
)
from jaxnet.theory.robustness import most_total, robustness
from tests.theory.test_robustness import circulant

LONG = 60.0  # s, far more than any of these programs takes


def digraph(seed):
    """Four to nine nodes, from sparse to dense."""
    rng = np.random.default_rng(seed)
    n = rng.integers(4, 10)
    return (rng.random((n, n)) < (0.15, 0.3, 0.5, 0.7, 0.9)[seed % 5]) & ~np.eye(n, dtype=bool)


def exactly(number):
    """A bracket that is closed."""
    return RobustnessBracket(number, number)


@pytest.mark.parametrize("seed", range(12))
def test_the_greatest_r_is_what_enumeration_gives(seed):
    """And bounds by degree are bounds."""
    heard = digraph(seed)
    low, high = degree_bracket(heard)
    assert low <= len(robustness(heard)) <= high
    assert robustness_bracket(heard, LONG) == exactly(len(robustness(heard)))


@pytest.mark.parametrize("seed", range(3))
def test_the_greatest_s_is_what_enumeration_gives(seed):
    """For each r and the first r of which there is none; and F of F-total attackers."""
    heard = digraph(seed)
    found = robustness(heard)
    for r, s in enumerate([*found, 0], 1):
        assert s_bracket(heard, r, LONG) == exactly(s)
        assert is_robust(heard, r, s + 1, LONG) is (s == len(heard))
    for known in (exactly(len(found)), RobustnessBracket(0, (len(heard) + 1) // 2)):
        assert total_bracket(heard, known, LONG) == exactly(most_total(found))


@pytest.mark.parametrize("n", [1, 2, 3, 8, 17, 24, 200])
def test_the_complete_graph_is_known_by_its_degree(n):
    assert robustness_bracket(~np.eye(n, dtype=bool), 0.0) == exactly((n + 1) // 2)


@pytest.mark.long
@pytest.mark.parametrize(
    ("n", "k", "r"), [(20, 4, 2), (24, 6, 3), (30, 5, 3), (25, 6, 4), (21, 4, 3)]
)
def test_larger_circulant_digraphs_are_as_robust_as_proved(n, k, r):
    assert robustness_bracket(circulant(n, k), LONG) == exactly(r)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("seconds", [-1.0, 1e-3, 0.02])
def test_a_short_time_limit_gives_true_bounds(seed, seconds):
    heard = digraph(seed)
    found = robustness(heard)
    low, high = robustness_bracket(heard, seconds)
    assert low <= len(found) <= high
    low, high = s_bracket(heard, len(found) + 1, seconds)
    assert low <= 0 <= high
    low, high = total_bracket(heard, RobustnessBracket(low=0, high=len(heard)), seconds)
    assert low <= most_total(found) <= high


@pytest.mark.long
def test_a_large_digraph_ends_near_its_time_limit():
    """The bracket holds what the degrees prove, and is open."""
    rng = np.random.default_rng(0)
    heard = (rng.random((60, 60)) < 0.5) & ~np.eye(60, dtype=bool)
    began, known = monotonic(), degree_bracket(heard)
    found = robustness_bracket(heard, 0.5)
    assert monotonic() - began < 5
    assert known.low <= found.low < found.high <= known.high
