"""How far attacks spread: known networks, and on small ones every choice of retained neighbours."""

from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxnet.kinds.attacks.bias import Bias
from jaxnet.kinds.defences.trusted_trim import TrustedTrim
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.path import Path
from jaxnet.model import graph
from jaxnet.theory import spread
from jaxnet.theory.spread import scenario_gain
from tests import systems
from tests.matrices import matrix_of, slotwise, whole

ATTACKED = [2, 5, 8, 11]
CYCLIC = matrix_of(Cyclic(navigator_weight=0.1), 12)


class Network(NamedTuple):
    """A graph, its links that are attacked, carry their source's message and are trusted, as
    matrices over (listener, source), and ϑ of each.
    """

    weights: np.ndarray
    attacked: np.ndarray
    carried: np.ndarray
    trusted: np.ndarray
    theta: np.ndarray

    @property
    def retained(self):
        """Whom vehicles that trim may retain."""
        theta = dict(enumerate(self.theta.tolist(), start=1))
        network = graph.of_matrix(self.weights)
        return TrustedTrim(theta=theta).retained(network, slotwise(network, self.trusted))

    @property
    def spread(self):
        """Arguments of what theory says of it."""
        retained = self.retained
        links = (slotwise(retained.graph, each) for each in (self.attacked, self.carried))
        return retained, [tuple(links)]

    def gains(self):
        """γ, by the package."""
        retained, [links] = self.spread
        return spread.worst_gains(retained, *links)


def of(weights, attacked, channel="auto", theta=1, trusted=None, threat="adds"):
    """A network in which these vehicles are attacked, ϑ the same for all."""
    attack = Bias(vehicles=attacked, links=channel, threat=threat)
    network = graph.of_matrix(weights)
    links = whole(network, attack.attacked_links(network))
    trusts = whole(network, graph.trusted_links(network, trusted or {}))
    return Network(
        weights, links, ~(links & attack.replaces()), trusts, np.full(len(weights), theta)
    )


def hearing(sources):
    """Graph of who hears whom, with equal weights."""
    edges = [(i, j, 1.0) for i, heard in sources.items() for j in heard]
    return graph.dense(graph.weighted(len(sources), edges))


TRIO = {1: [2, 3], 2: [1, 3], 3: [1, 2]}
CUT_OFF = hearing({1: [2, 3, 4], 2: [1, 3, 4], 3: [1, 2, 4], 4: [0]})


def choices(row, trusted, theta):
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


def gains_by_trial(network):
    """Greatest `(L⁻¹ W_a 1)_i` of all choices; infinite for who may hear of one cut off.

    L is of the links that carry what their source says.
    """
    weights, attacked, carried, trusted, theta = network
    m = len(weights)
    worst = np.zeros(m)
    for rows in product(*map(choices, weights, trusted, theta)):
        kept = np.stack(rows)
        lost = np.array(graph.unreachable(graph.of_matrix(kept)), dtype=int) - 1
        tainted = np.isin(np.arange(m), lost)
        for _ in range(m):
            tainted = tainted | (kept[:, 1:][:, tainted] > 0).any(axis=1)
        worst[tainted] = np.inf
        sound = np.flatnonzero(~tainted)
        laplacian = graph.laplacian(kept * carried)[np.ix_(sound, sound)]
        gains = np.linalg.solve(laplacian, (kept * attacked).sum(axis=1)[sound])
        worst[sound] = np.maximum(worst[sound], gains)
    return worst


@st.composite
def networks(draw, vehicles=4):
    """Any graph, attacked and trusted links and ϑ; vehicles may trim, trust each other, and be cut
    off.

    The attack adds to what is sent, or replaces it.
    """
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
    attacked, trusted = attacked & (weights > 0), trusted & (weights > 0)
    theta = np.array(draw(st.lists(st.integers(0, 2), min_size=m, max_size=m)))
    return Network(weights, attacked, ~(attacked & draw(st.booleans())), trusted, theta)


@settings(max_examples=120)
@given(networks())
def test_worst_gains_are_the_greatest_of_all_choices(network):
    """Infinite ones included."""
    np.testing.assert_allclose(network.gains(), gains_by_trial(network), rtol=1e-9, atol=1e-12)


@settings(max_examples=40)
@given(networks())
def test_the_weights_are_fixed_where_nobody_has_a_choice(network):
    """And they are those of the only choice."""
    rows = [
        choices(*each) for each in zip(network.weights, network.trusted, network.theta, strict=True)
    ]
    found = network.retained.fixed
    if any(len(each) > 1 for each in rows):
        assert found is None
    else:
        np.testing.assert_allclose(
            graph.dense(found), np.stack([only for (only,) in rows]), rtol=1e-14
        )


def test_the_ring_that_trims():
    """2.475, attacked 2.025: a vehicle that is not attacked retains a neighbour that is, an
    attacked one not.

    With x of the attacked and y of the others, x = (0.45 / 0.55) y and y = (0.45 / 0.55) (1 + x).
    """
    gains = of(CYCLIC, ATTACKED).gains()
    expected = np.full(12, 2.475)
    expected[np.array(ATTACKED) - 1] = 2.025
    np.testing.assert_allclose(gains, expected, rtol=1e-12)


@pytest.mark.parametrize("topology", ["cyclic", "lattice"])
def test_rounds_do_not_grow_with_the_fleet(topology, monkeypatch):
    """Gains around the attacked are a ten times smaller fleet's, and fall below any number."""
    rounds, solver = [], graph.solver
    monkeypatch.setattr(graph, "solver", lambda network: rounds.append(network) or solver(network))
    keys = {"topology": topology, "defence": "trusted_trim"}
    small, large = (
        scenario_gain(systems.study(**keys, vehicles=m).cells[0].scenario).gains
        for m in (1_000, 10_000)
    )
    np.testing.assert_allclose(large[:50], small[:50], rtol=1e-9)
    assert 2 < large.max() < 3
    assert large.min() < 1e-307
    assert len(rounds) < 20


def test_a_substituted_message_ends_what_its_source_has_gathered():
    """Untrimmed paths and rings whose attacked links carry the navigator's path plus the attack.

    On the path everybody behind an attacked vehicle is off by what that one's link carries, 1. On
    the ring with x of the attacked and y of the others x = 0.9 y and y = 0.45 + 0.45 y, for of x
    nothing is sent on.
    """
    path = of(matrix_of(Path(), 12), ATTACKED, theta=0, threat="replaces").gains()
    np.testing.assert_allclose(path, [0.0, 0.0, *[1.0] * 10], rtol=1e-12)
    ring = of(CYCLIC, ATTACKED, theta=0, threat="replaces").gains()
    expected = np.full(12, 0.45 / 0.55)
    expected[np.array(ATTACKED) - 1] *= 0.9
    np.testing.assert_allclose(ring, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("heard", "trusted", "theta", "gains"),
    [
        ({3: [2, 4]}, {1: [2], 2: [1]}, 2, None),  # they hear too few to drop two
        ({3: [2, 4]}, {1: [2, 3], 2: [1, 3]}, 1, None),  # 3 keeps 4, and they keep 3
        ({3: [2, 4]}, {1: [2, 3], 2: [1, 3], 3: [2]}, 1, None),  # 3 hears too few
        ({4: [0, 1]}, TRIO, 1, [np.inf] * 4),  # 4 hears 1
        ({}, TRIO, 1, [np.inf, np.inf, np.inf, 0.0]),
    ],
)
def test_who_trusts_only_each_other_may_be_cut_off(heard, trusted, theta, gains):
    """1, 2, 3 trust each other, so all may drop 4, the navigator's only way to them."""
    sources = {1: [2, 3, 4], 2: [1, 3, 4], 3: [1, 2, 4], 4: [0]} | heard
    found = of(hearing(sources), [4], trusted=trusted, theta=theta).gains()
    assert np.isfinite(found).all() if gains is None else found.tolist() == gains


def test_a_dropped_source_may_be_cut_off():
    """1 hears 0 (the navigator), 2 and 3, trusts 0 and 3, always drops 2, infinite by itself."""
    network = of(hearing({1: [0, 2, 3], 2: [4], 3: [0], 4: [2]}), [3], trusted={1: [3]})
    assert network.gains().tolist() == [0.5, np.inf, 0.0, np.inf]
