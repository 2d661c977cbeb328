"""What is said of any graph, against plain searches and counts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.model import graph


def digraphs(vehicles=5):
    """Any graph, given as the set of sources that each vehicle hears."""
    others = [[j for j in range(vehicles + 1) if j != i] for i in range(1, vehicles + 1)]
    return st.tuples(*(st.frozensets(st.sampled_from(each)) for each in others))


def links(heard):
    """Pairs (i, j), "i hears j"."""
    return {(i, j) for i, sources in enumerate(heard, start=1) for j in sources}


def weights_of(heard):
    """The graph in which each vehicle gives all its sources the same weight."""
    return graph.weighted(len(heard), [(i, j, 1.0) for i, j in links(heard)])


def marked(network, mask):
    """Pairs (i, j) marked in an array of a graph's links."""
    return {(int(i) + 1, int(network.sources[i, slot])) for i, slot in np.argwhere(mask)}


@given(digraphs(), st.data())
def test_listeners_share_out_one_among_their_sources_in_the_given_proportion(heard, data):
    given_weights = {link: data.draw(st.floats(1e-3, 1e3)) for link in sorted(links(heard))}
    network = graph.weighted(5, [(i, j, w) for (i, j), w in given_weights.items()])
    weights = graph.dense(network)
    assert marked(network, network.heard) == links(heard)
    for i, sources in enumerate(heard, start=1):
        assert sum(weights[i - 1]) == pytest.approx(1.0 if sources else 0.0, abs=1e-14)
        for j in sources:
            for k in sources:
                ratio = given_weights[i, j] / given_weights[i, k]
                assert weights[i - 1, j] == pytest.approx(ratio * weights[i - 1, k], rel=1e-13)


@given(digraphs())
def test_hops_are_the_powers_of_the_links_that_first_reach(heard):
    """The least n with a walk of n links from the navigator, by powers of the matrix of links."""
    step = np.zeros((6, 6), int)
    for i, j in links(heard):
        step[i, j] = 1
    walks = [np.linalg.matrix_power(step, n)[1:, 0] > 0 for n in range(1, 6)]
    expected = [next((n for n, walk in enumerate(walks, 1) if walk[i]), np.inf) for i in range(5)]
    network = weights_of(heard)
    assert graph.hops(network).tolist() == expected
    assert graph.unreachable(network) == [i for i, n in enumerate(expected, 1) if np.isinf(n)]


@given(digraphs(), st.data())
def test_the_least_of_each_listener_are_the_first_of_a_sorted_list(heard, data):
    """With ties, to the lower number."""
    values = np.array(
        data.draw(st.lists(st.integers(0, 2), min_size=30, max_size=30)), float
    ).reshape(5, 6)
    count = np.array(data.draw(st.lists(st.integers(0, 6), min_size=5, max_size=5)))
    expected = {
        (i, j)
        for i, sources in enumerate(heard, start=1)
        for j in sorted(sources, key=lambda j, i=i: (values[i - 1, j], j))[: count[i - 1]]
    }
    network = weights_of(heard)
    least = graph.least(network.heard, np.take_along_axis(values, network.sources, axis=1), count)
    assert marked(network, least) == expected


@given(digraphs(), st.dictionaries(st.integers(1, 5), st.frozensets(st.integers(0, 5))))
def test_trust_is_placed_only_in_what_is_heard(heard, trusted):
    network = weights_of(heard)
    marks = marked(network, graph.trusted_links(network, trusted))
    assert marks == {(i, j) for i, j in links(heard) if j == 0 or j in trusted.get(i, ())}


@given(digraphs())
def test_a_matrix_becomes_a_graph_and_back(heard):
    network = weights_of(heard)
    again = graph.of_matrix(graph.dense(network))
    for theirs, mine in zip(again, network, strict=True):
        np.testing.assert_array_equal(theirs, mine)
    for i, sources in enumerate(heard, start=1):
        left = max(1, *map(len, heard)) - len(sources)
        assert network.sources[i - 1].tolist() == [*sorted(sources), *[i] * left]
