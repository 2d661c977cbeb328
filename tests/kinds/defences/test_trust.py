"""Whom vehicles trust: nobody, a random share, those nearest the navigator; and what follows."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.kinds.defences.trusted_only import TrustedOnly
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.erdos_renyi import ErdosRenyi
from jaxnet.kinds.graphs.grid import Grid
from jaxnet.model.graph import dense
from tests.matrices import whole

RING = Cyclic().weights(12)


def trusts(weights, **keys):
    return whole(weights, TrustedOnly(trusted=keys).trusts(weights))


def test_nobody_is_trusted_where_none_is_said():
    """Not even the navigator, which is by default."""
    assert not TrustedOnly(trusted="none").trusts(RING).any()
    alone = np.eye(1, 13, dtype=bool).repeat(12, axis=0)
    np.testing.assert_array_equal(whole(RING, TrustedOnly().trusts(RING)), alone)


@given(st.integers(0, 2**32), st.floats(0, 1))
def test_a_share_is_that_of_each_listener_rounded(seed, share):
    """Up or down; of links, not the navigator; equal by equal seeds, and more of the same."""
    weights = ErdosRenyi(seed=seed, navigator={"share": 0.5}).weights(9)
    found = trusts(weights, share=share, seed=seed)
    heard = dense(weights) > 0
    assert not (found & ~heard).any()
    np.testing.assert_array_equal(found[:, 0], heard[:, 0])
    exact = share * heard[:, 1:].sum(axis=1)
    assert (np.abs(found[:, 1:].sum(axis=1) - exact) < 1).all()
    np.testing.assert_array_equal(trusts(weights, share=share, seed=seed), found)
    assert (trusts(weights, share=(1 + share) / 2, seed=seed) >= found).all()


def test_the_nearest_are_by_links_from_the_navigator():
    """3 × 3 grid, 1 hears it: 5 trusts 2 and 4, two links off, before 6 and 8, four links off."""
    weights = Grid(rows=3, columns=3, navigator=[1]).weights(9)
    found = [set(np.flatnonzero(row)) for row in trusts(weights, nearest=2)]
    assert found == [{0, 2}, {1, 3}, {2, 6}, {1, 5}, {2, 4}, {3, 5}, {4, 8}, {5, 7}, {6, 8}]
    first = [set(np.flatnonzero(row)) for row in trusts(weights, nearest=1)]
    assert first == [{0}, {1}, {2}, {1}, {2}, {3}, {4}, {5}, {6}]
    np.testing.assert_array_equal(trusts(weights, nearest=9), dense(weights) > 0)
    np.testing.assert_array_equal(trusts(RING, nearest=1), whole(RING, TrustedOnly().trusts(RING)))
