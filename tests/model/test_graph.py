"""Graphs: the paper's, exactly, and what is said of any, against plain searches and counts."""

from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.model import graph

FLEET = range(1, 13)
PAPER = {
    "star": graph.star(12),
    "cyclic": graph.cyclic(12, 0.1),
    "path": graph.path(12),
    "figure1": graph.figure1(),
}


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


def marked(mask):
    """Pairs (i, j) marked in an array of links."""
    return {(int(i) + 1, int(j)) for i, j in np.argwhere(mask)}


def reached(heard):
    """Vehicles that a breadth-first search finds from the navigator."""
    found, queue = set(), deque([0])
    while queue:
        speaker = queue.popleft()
        new = {i for i, sources in enumerate(heard, start=1) if speaker in sources} - found
        found |= new
        queue.extend(new)
    return found


def written_out(rows, vehicles):
    """Weights from {listener: {source: weight}}."""
    weights = np.zeros((vehicles, vehicles + 1))
    for listener, row in rows.items():
        for source, weight in row.items():
            weights[listener - 1, source] = weight
    return weights


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("star", {i: {0: 1.0} for i in FLEET}),
        (
            "cyclic",
            {i: {0: 0.1, (i - 1) or 12: 0.45, i + 1 if i < 12 else 1: 0.45} for i in FLEET},
        ),
        ("path", {i: {i - 1: 1.0} for i in FLEET}),
        (
            "figure1",
            {1: {0: 1.0}, 2: {1: 1.0}, 3: {2: 1.0}, 4: {0: 0.5, 5: 0.5}, 5: {0: 0.5, 4: 0.5}},
        ),
    ],
)
def test_the_papers_graphs_have_the_papers_weights(name, rows):
    np.testing.assert_array_equal(PAPER[name], written_out(rows, len(rows)))


@given(digraphs(), st.data())
def test_listeners_share_out_one_among_their_sources_in_the_given_proportion(heard, data):
    given_weights = {link: data.draw(st.floats(1e-3, 1e3)) for link in sorted(links(heard))}
    weights = graph.weighted(5, [(i, j, w) for (i, j), w in given_weights.items()])
    assert marked(weights > 0) == links(heard)
    for i, sources in enumerate(heard, start=1):
        assert sum(weights[i - 1]) == pytest.approx(1.0 if sources else 0.0, abs=1e-14)
        for j in sources:
            for k in sources:
                ratio = given_weights[i, j] / given_weights[i, k]
                assert weights[i - 1, j] == pytest.approx(ratio * weights[i - 1, k], rel=1e-13)


@given(digraphs())
def test_unreachable_are_those_a_search_does_not_find(heard):
    found = reached(heard)
    assert graph.unreachable(weights_of(heard)) == [i for i in range(1, 6) if i not in found]


def test_a_long_detour_still_reaches():
    backwards = [(i, i + 1, 1.0) for i in range(1, 12)] + [(12, 0, 1.0)]
    assert graph.unreachable(graph.weighted(12, backwards)) == []
    assert graph.unreachable(graph.weighted(12, backwards[:-1])) == list(FLEET)


@given(digraphs(), st.frozensets(st.integers(1, 5)))
def test_attacked_links_of_each_channel(heard, attackers):
    weights = weights_of(heard)
    said = {(i, j) for i, j in links(heard) if j in attackers}
    misheard = {(i, j) for i, j in links(heard) if j == 0 and i in attackers}
    vehicles_talk = any(j > 0 for _, j in links(heard))
    assert marked(graph.attacked_links(weights, attackers, "neighbour")) == said
    assert marked(graph.attacked_links(weights, attackers, "navigator")) == misheard
    by_itself = graph.attacked_links(weights, attackers, "auto")
    assert marked(by_itself) == (said if vehicles_talk else misheard)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("star", {(2, 0), (5, 0), (8, 0), (11, 0)}),
        ("path", {(3, 2), (6, 5), (9, 8), (12, 11)}),
        ("cyclic", {(1, 2), (3, 2), (4, 5), (6, 5), (7, 8), (9, 8), (10, 11), (12, 11)}),
    ],
)
def test_attacked_links_of_the_papers_scenarios(name, expected):
    assert marked(graph.attacked_links(PAPER[name], [2, 5, 8, 11], "auto")) == expected


@given(digraphs(), st.dictionaries(st.integers(1, 5), st.frozensets(st.integers(0, 5))))
def test_trust_is_placed_only_in_what_is_heard(heard, trusted):
    marks = marked(graph.trusted_links(weights_of(heard), trusted))
    assert marks == {(i, j) for i, j in links(heard) if j == 0 or j in trusted.get(i, ())}


@given(
    digraphs(),
    st.dictionaries(st.integers(1, 5), st.frozensets(st.integers(0, 5))),
    st.tuples(*[st.integers(0, 3)] * 5),
)
def test_protected_vehicles_hear_and_trust_enough(heard, trusted, theta):
    weights = weights_of(heard)
    marks = graph.protected(weights, graph.trusted_links(weights, trusted), np.array(theta))
    for i, (sources, drops) in enumerate(zip(heard, theta, strict=True), start=1):
        believed = sources & ({0} | set(trusted.get(i, ())))
        assert marks[i - 1] == (len(sources) > 2 * drops and len(believed) >= drops)


@pytest.mark.parametrize(
    ("name", "everybody"), [("star", False), ("path", False), ("figure1", False), ("cyclic", True)]
)
def test_of_the_papers_graphs_only_the_ring_can_trim(name, everybody):
    weights = PAPER[name]
    trusted = graph.trusted_links(weights, {})
    marks = graph.protected(weights, trusted, np.ones(len(weights), dtype=int))
    assert marks.tolist() == [everybody] * len(weights)
