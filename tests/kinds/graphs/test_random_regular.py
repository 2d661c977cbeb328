"""Random regular graphs: what they are, whom a seed belongs to, and lanes that have their own."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxnet
from jaxnet.kinds.graphs.random_regular import RandomRegular
from jaxnet.model.patterns import drawn_regular
from tests.matrices import matrix_of


@given(st.integers(1, 12), st.integers(1, 11), st.integers(0, 2**32))
def test_it_is_simple_mutual_and_regular(vehicles, degree, seed):
    """The same for the same seed; the navigator's weight beside equal ones."""
    degree = min(degree, vehicles - 1)
    if degree == 0 or degree * vehicles % 2:
        return
    graph = RandomRegular(degree=degree, seed=seed, navigator_weight=0.25)
    weights = matrix_of(graph, vehicles)
    heard = weights[:, 1:] > 0
    assert not heard.diagonal().any()
    np.testing.assert_array_equal(heard, heard.T)
    assert (heard.sum(axis=1) == degree).all()
    assert (weights[:, 0] == 0.25).all()
    np.testing.assert_allclose(weights[:, 1:][heard], 0.75 / degree, rtol=1e-15)
    np.testing.assert_array_equal(matrix_of(graph, vehicles), weights)


def test_all_graphs_appear_and_none_much_more_often():
    """There are 70 labelled cubic graphs on six vertices (OEIS A002829)."""
    random = np.random.default_rng(1)
    found = Counter(drawn_regular(6, 3, random).toarray().tobytes() for _ in range(7000))
    assert len(found) == 70
    assert max(found.values()) < 2 * min(found.values())


@pytest.mark.parametrize(
    ("degree", "vehicles", "word"), [(5, 5, "less than the 5 vehicles"), (3, 5, "must be even")]
)
def test_what_cannot_be_is_said(degree, vehicles, word):
    """There is no such graph, and nobody looks for it for ever."""
    keys = {"vehicles": vehicles, "attack": "none"}
    with pytest.raises(jaxnet.ConfigError, match=word):
        jaxnet.load({"topology": {"kind": "random_regular", "degree": degree}, **keys})
