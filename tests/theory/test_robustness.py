"""Robustness by trying all sets on small digraphs, and of graphs whose robustness is known."""

import json
import re
from fractions import Fraction
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pytest

from jaxnet.theory.robustness import pairs, percolated_nodes, robustness, strong_robustness


def digraph(seed):
    """Who hears whom among two to six nodes, one row the sources of a node."""
    rng = np.random.default_rng(seed)
    n = rng.integers(2, 7)
    heard = rng.random((n, n)) < rng.uniform(0.2, 1.0)
    return heard & ~np.eye(n, dtype=bool)


def circulant(n, k):
    """Each node hears the k before it."""
    return sum(np.roll(np.eye(n, dtype=int), step, axis=0) for step in range(1, k + 1)) > 0


def by_trial(heard):
    """The same list by the definition's words, for each pair of disjoint sets."""
    n, sources = len(heard), [set(np.flatnonzero(row).tolist()) for row in heard]

    def with_r_outside(nodes, r):
        return sum(len(sources[i] - nodes) >= r for i in nodes)

    def holds(r, s):
        for sides in product((0, 1, 2), repeat=n):
            one, other = ({i for i in range(n) if sides[i] == side} for side in (1, 2))
            if one and other:
                first, second = with_r_outside(one, r), with_r_outside(other, r)
                if first < len(one) and second < len(other) and first + second < s:
                    return False
        return True

    found = [max((s for s in range(1, n + 1) if holds(r, s)), default=0) for r in range(1, n)]
    return found[: found.index(0)] if 0 in found else found


@pytest.mark.parametrize("seed", range(30))
def test_robustness_is_what_trying_all_pairs_of_sets_gives(seed):
    heard = digraph(seed)
    assert robustness(heard) == by_trial(heard)


@pytest.mark.parametrize("seed", range(10))
def test_with_one_navigator_every_graph_that_it_reaches_is_exactly_one_robust(seed):
    """It hears nobody, and all vehicles together hear one node outside."""
    rng = np.random.default_rng(seed)
    heard = digraph(seed)
    heard[0], heard[range(1, len(heard)), rng.integers(0, range(1, len(heard)))] = False, True
    assert len(robustness(heard)) == 1


@pytest.mark.parametrize(("n", "k"), [(n, k) for n in range(3, 13) for k in range(1, n)])
def test_circulant_digraphs_are_as_robust_as_proved(n, k):
    """⌈k/2⌉ for even n, ⌊k/2⌋ + 1 for odd n and even k."""
    if n % 2 == 0:
        assert len(robustness(circulant(n, k))) == -(-k // 2)
    elif k % 2 == 0:
        assert len(robustness(circulant(n, k))) == k // 2 + 1


# Graphs of the literature: `hears` lists [i, j], i hears j; `claims` is what the source says.
PUBLISHED = json.loads((Path(__file__).parent / "published_robustness.json").read_text())


@pytest.mark.parametrize("published", PUBLISHED, ids=lambda each: each["name"])
def test_published_graphs_are_as_robust_as_claimed(published):
    """The greatest s for each r, by brute force of another program, and the source's own claims."""
    found = pairs(published["hears"], published["nodes"])
    assert found == published["greatest_s_for_r"]
    claims = published["claims"]
    if claims == "exactly 1-robust":
        assert len(found) == 1
        return
    for r, s in re.findall(r"\((\d),(\d)\)", claims):
        holds = len(found) >= int(r) and found[int(r) - 1] >= int(s)
        assert holds != claims.startswith("not")


def led(seed):
    """Two to seven nodes, links among them from 1, some trusted, and leaders, not all nodes."""
    rng = np.random.default_rng(seed)
    n = rng.integers(2, 8)
    heard = (rng.random((n, n)) < rng.uniform(0.3, 1.0)) & ~np.eye(n, dtype=bool)
    hears = (np.argwhere(heard) + 1).tolist()
    trusted = [pair for pair in hears if rng.random() < 0.3]
    leaders = rng.permutation(np.arange(1, n + 1))[: rng.integers(0, n)].tolist()
    return hears, int(n), leaders, trusted


def sets_without(nodes, leaders):
    """All nonempty sets of nodes that are no leaders."""
    others = [i for i in range(1, nodes + 1) if i not in leaders]
    return [set(each) for size in range(1, len(others) + 1) for each in combinations(others, size)]


@pytest.mark.parametrize("seed", range(40))
def test_strong_robustness_of_pairs_is_what_trying_all_sets_gives(seed):
    hears, nodes, leaders, _ = led(seed)

    def outside(i, each):
        return sum(listener == i and source not in each for listener, source in hears)

    least = min(max(outside(i, each) for i in each) for each in sets_without(nodes, leaders))
    assert strong_robustness(hears, nodes, leaders) == least
    for F in (0, 1, 2):
        reached = percolated_nodes(hears, nodes, leaders, F)
        assert (reached == [*range(1, nodes + 1)]) == (least >= 2 * F + 1)


@pytest.mark.parametrize("F", [0, 1, 2, 3])
@pytest.mark.parametrize("seed", range(10))
def test_percolation_leaves_the_greatest_set_that_cannot_be_entered(seed, F):
    """No node of the set is reached from outside; all sets are tried, with and without trust."""
    hears, nodes, leaders, trusted = led(seed)
    for trust in ([], trusted):

        def share(i, each, trust=trust):
            outside = [pair for pair in hears if pair[0] == i and pair[1] not in each]
            return sum(Fraction(1, F + 1 if pair in trust else 2 * F + 1) for pair in outside)

        tried = sets_without(nodes, leaders)
        closed = [each for each in tried if all(share(i, each) < 1 for i in each)]
        left = {*range(1, nodes + 1)} - set().union(*closed)
        assert percolated_nodes(hears, nodes, leaders, F, trust) == sorted(left)


PAIR = r"hears\[{}\]: must be \[listener, source\], two nodes from 1 to 3 \(got {}\)"
LEADER = r"leaders: must be nodes from 1 to 3 \(got {}\)"
WRONG = [
    (pairs, [[[1, 2], [1, 4]], 3], PAIR.format(1, r"\[1, 4\]")),
    (pairs, [[[1, 2, 3]], 3], PAIR.format(0, r"\[1, 2, 3\]")),
    (pairs, [[[1, 2.0]], 3], PAIR.format(0, r"\[1, 2.0\]")),
    (pairs, [[[True, 2]], 3], PAIR.format(0, r"\[True, 2\]")),
    (pairs, [["12"], 3], PAIR.format(0, "'12'")),
    (pairs, [[3], 3], PAIR.format(0, "3")),
    (pairs, [[[2, 2]], 3], r"hears\[0\]: node 2 hears itself"),
    (pairs, [[], 0], r"nodes: must be at least 1 \(got 0\)"),
    (pairs, [[], 17], r"nodes: must be at most 16 \(got 17\); larger: robustness_bracket"),
    *((percolated_nodes, [[[1, 2]], 3, [bad], 1], LEADER.format(bad)) for bad in (0, 4, 1.0)),
    (strong_robustness, [[[1, 2]], 2, [1, 2]], "leaders: at least one node must be no leader"),
    (percolated_nodes, [[[1, 2]], 2, [2], -1], r"F: must be at least 0 \(got -1\)"),
    (percolated_nodes, [[[1, 2]], 2, [2], 1, [[2, 1]]], "trusted: node 2 does not hear node 1"),
]


@pytest.mark.parametrize(("function", "given", "words"), WRONG)
def test_what_is_wrong_is_named(function, given, words):
    with pytest.raises(ValueError, match=words):
        function(*given)
