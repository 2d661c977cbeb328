"""How far lies spread: known networks, and every choice of kept sets tried on small ones."""

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxnet.model import graph
from jaxnet.theory import spread

LIARS = [2, 5, 8, 11]
CYCLIC = graph.cyclic(12, 0.1)


def of(weights, liars, channel="auto", theta=1, trusted=None):
    """Arguments: graph, attacked and trusted links, ϑ the same for all."""
    attacked = graph.attacked_links(weights, liars, channel)
    return weights, attacked, graph.trusted_links(weights, trusted or {}), np.full(len(weights), theta)


def hearing(sources):
    """Graph of who hears whom, with equal weights."""
    edges = [(i, j, 1.0) for i, heard in sources.items() for j in heard]
    return graph.weighted(len(sources), edges)


TRIO = {1: [2, 3], 2: [1, 3], 3: [1, 2]}
CUT_OFF = hearing({1: [2, 3, 4], 2: [1, 3, 4], 3: [1, 2, 4], 4: [0]})


def kept_sets(row, trusted, theta):
    """Weights in force that a vehicle may come to."""
    heard = np.flatnonzero(row)
    untrusted = [j for j in heard if not trusted[j]]
    if theta == 0 or len(heard) < 2 * theta + 1 or trusted[heard].sum() < theta:
        return [row]
    rows = []
    for dropped in combinations(untrusted, min(theta, len(untrusted))):
        kept = row.copy()
        kept[list(dropped)] = 0.0
        rows.append(kept / kept.sum())
    return rows


def gains_by_trial(weights, attacked, trusted, theta):
    """Greatest `(L_res⁻¹ W_a 1)_i` of all choices; infinite for who may hear of one cut off."""
    m = len(weights)
    worst = np.zeros(m)
    for rows in product(*(kept_sets(weights[i], trusted[i], theta[i]) for i in range(m))):
        kept = np.stack(rows)
        lost = np.array(graph.unreachable(kept), dtype=int) - 1
        tainted = np.isin(np.arange(m), lost)
        for _ in range(m):
            tainted = tainted | (kept[:, 1:][:, tainted] > 0).any(axis=1)
        worst[tainted] = np.inf
        sound = np.flatnonzero(~tainted)
        laplacian = graph.laplacian(kept)[np.ix_(sound, sound)]
        gains = np.linalg.solve(laplacian, (kept * attacked).sum(axis=1)[sound])
        worst[sound] = np.maximum(worst[sound], gains)
    return worst


@st.composite
def networks(draw, vehicles=4):
    """Any graph, attacked and trusted links and ϑ; vehicles may trim, trust each other, and be cut off."""
    m = draw(st.integers(2, vehicles))
    weights = np.zeros((m, m + 1))
    trusted, attacked = np.zeros((2, m, m + 1), bool)
    share = st.sampled_from([0.0, 0.2, 0.5, 1.0, 3.0])
    for i in range(m):
        for j in range(m + 1):
            if j != i + 1:
                weights[i, j] = draw(share)
                trusted[i, j] = j == 0 or draw(st.booleans())
                attacked[i, j] = draw(st.booleans())
        if not weights[i].any():
            weights[i, 0] = 1.0
    weights /= weights.sum(axis=1, keepdims=True)
    heard = weights > 0
    theta = np.array(draw(st.lists(st.integers(0, 2), min_size=m, max_size=m)))
    return weights, attacked & heard, trusted & heard, theta


@settings(max_examples=300)
@given(networks())
def test_worst_gains_are_the_greatest_of_all_choices(network):
    """Infinite ones included."""
    np.testing.assert_allclose(spread.worst_gains(*network), gains_by_trial(*network), rtol=1e-9, atol=1e-12)


@settings(max_examples=100)
@given(networks())
def test_the_weights_are_settled_where_nobody_has_a_choice(network):
    """And they are those of the only choice."""
    weights, _, trusted, theta = network
    choices = [kept_sets(*each) for each in zip(weights, trusted, theta, strict=True)]
    found = spread.settled(weights, trusted, theta)
    if any(len(rows) > 1 for rows in choices):
        assert found is None
    else:
        np.testing.assert_allclose(found, np.stack([rows[0] for rows in choices]), rtol=1e-14)


def test_the_ring_that_trims():
    """2.475, attackers 2.025: an honest vehicle keeps its attacked neighbour, a liar an honest one.

    With x of the liars and y of the others, x = (0.45 / 0.55) y and y = (0.45 / 0.55) (1 + x).
    """
    gains = spread.worst_gains(*of(CYCLIC, LIARS))
    expected = np.full(12, 2.475)
    expected[np.array(LIARS) - 1] = 2.025
    np.testing.assert_allclose(gains, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("weights", "greatest", "mean"),
    [(graph.star(12), 1, 1 / 3), (graph.path(12), 4, 22 / 12), (CYCLIC, 90 / 29, 3)],
)
def test_untrimmed_gains_are_those_of_constant_lies(weights, greatest, mean):
    """SCIENCE O3, by arithmetic."""
    gains = spread.worst_gains(*of(weights, LIARS, theta=0))
    assert gains.max() == pytest.approx(greatest, rel=1e-12)
    assert gains.mean() == pytest.approx(mean, rel=1e-12)


def test_who_trusts_only_each_other_may_be_cut_off():
    """1, 2 and 3 trust each other and so may all drop 4, through which alone the navigator reaches them."""
    weights = hearing({1: [2, 3, 4], 2: [1, 3, 4], 3: [2, 4], 4: [0]})
    network = of(weights, [4], trusted={1: [2], 2: [1]}, theta=2)
    assert np.isfinite(spread.worst_gains(*network)).all()  # they hear too few to drop two
    network = of(weights, [4], trusted={1: [2, 3], 2: [1, 3]})
    assert np.isfinite(spread.worst_gains(*network)).all()  # 3 keeps 4, and they keep 3
    network = of(weights, [4], trusted={1: [2, 3], 2: [1, 3], 3: [2]})
    assert np.isfinite(spread.worst_gains(*network)).all()  # 3 hears too few
    network = of(hearing({1: [2, 3, 4], 2: [1, 3, 4], 3: [1, 2, 4], 4: [0, 1]}), [4], trusted=TRIO)
    assert spread.worst_gains(*network).tolist() == [np.inf] * 4  # 4 hears 1
    network = of(CUT_OFF, [4], trusted=TRIO)
    assert spread.worst_gains(*network).tolist() == [np.inf, np.inf, np.inf, 0.0]


def test_a_dropped_source_may_be_cut_off():
    """1 hears the navigator, 2 and 3, trusts 0 and 3 and always drops 2, which is infinite by itself."""
    network = of(hearing({1: [0, 2, 3], 2: [4], 3: [0], 4: [2]}), [3], trusted={1: [3]})
    assert spread.worst_gains(*network).tolist() == [0.5, np.inf, 0.0, np.inf]
