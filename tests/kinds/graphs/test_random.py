"""Random graphs: how they are distributed, and lanes that have their own."""

from collections import Counter

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from jaxnet.kinds.graphs.erdos_renyi import ErdosRenyi
from jaxnet.kinds.graphs.lattice import Lattice
from jaxnet.kinds.graphs.random_regular import RandomRegular
from jaxnet.kinds.graphs.small_world import SmallWorld
from jaxnet.model import graph as graphs
from jaxnet.model.patterns import drawn_regular
from tests.matrices import matrix_of

REGULAR = [[1, 2], [1, 3], [1, 5], [2, 4], [2, 6], [3, 5], [3, 6], [4, 5], [4, 6]]


def heard(graph, vehicles):
    return matrix_of(graph, vehicles)[:, 1:] > 0


def test_links_of_erdos_renyi_are_binomial_and_independent():
    """Of 200 graphs: the number of links, of listeners' sources, and of links that are mutual."""
    drawn = np.stack([heard(ErdosRenyi(probability=0.3, seed=seed), 12) for seed in range(200)])
    assert not drawn[:, range(12), range(12)].any()
    assert stats.binomtest(int(drawn.sum()), 200 * 132, 0.3).pvalue > 0.01
    degrees = np.bincount(drawn.sum(axis=2).ravel(), minlength=12)[:8]
    expected = 2400 * stats.binom(11, 0.3).pmf(np.arange(8))
    assert stats.chisquare(degrees, expected * degrees.sum() / expected.sum()).pvalue > 0.01
    mutual = (drawn & drawn.transpose(0, 2, 1)).sum() // 2
    assert stats.binomtest(int(mutual), 200 * 66, 0.09).pvalue > 0.01


def test_a_link_of_a_small_world_is_rewired_with_the_probability():
    """The number of links stays; so many of the lattice's are gone, on average."""
    before = matrix_of(Lattice(), 100)[:, 1:] > 0
    gone = 0
    for seed in range(20):
        now = heard(SmallWorld(rewired=0.3, seed=seed), 100)
        assert not now.diagonal().any()
        np.testing.assert_array_equal(now, now.T)
        assert now.sum() == before.sum()
        gone += (before & ~now).sum() // 2
    # One in 150 falls on a place left before
    assert stats.binomtest(int(gone), 20 * 200, 0.3).pvalue > 0.01


def test_graphs_that_the_navigator_reaches_are_as_likely_as_they_are_among_them():
    """Vehicle 1 of 3 hears it, others with probability ½: all such graphs equally often."""
    graph = ErdosRenyi(probability=0.5, navigator=[1])
    random = np.random.default_rng(5)
    found = Counter(graphs.dense(graph.connected(3, random)).tobytes() for _ in range(1500))
    every = (np.array([number >> bit & 1 for bit in range(6)], bool) for number in range(64))
    possible = 0
    for bits in every:
        links = np.zeros((3, 4), bool)
        links[0, 0] = True
        links[:, 1:][~np.eye(3, dtype=bool)] = bits
        possible += not graphs.unreachable(graphs.of_matrix(links))
    assert len(found) == possible
    assert stats.chisquare(list(found.values())).pvalue > 0.01


def test_the_regular_graph_of_a_seed_stays_what_it_was():
    edges = np.argwhere(np.triu(heard(RandomRegular(degree=3, seed=5), 6))) + 1
    assert edges.tolist() == REGULAR


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
