"""Solving for the graph in force, in blocks and in one, against NumPy's own solution lane by lane."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from jaxnet.engine.plan import CONNECTED
from jaxnet.kinds import registry
from jaxnet.model import elimination, graph, hearing
from tests import matrices

GRAPHS = {
    "ring": ("cyclic", {}, 17, (9, 2)),
    "path": ("path", {}, 19, (10, 2)),
    "lattice": ("lattice", {"neighbours": 4}, 41, (9, 5)),
    "grid": ("grid", {"rows": 4, "columns": 4}, 16, (1, 16)),
    "complete": ("complete", {}, 9, (1, 9)),
}
seeds = st.integers(0, 2**32 - 1)
solve, factorised, applied = map(jax.jit, (elimination.solve, elimination.factorised, elimination.applied))


def listening(links):
    """Who hears whom, and the order of elimination."""
    sources = matrices.slots_of(links)
    heard = hearing.Hearing(
        *map(jnp.asarray, (sources, sources, sources < 0, hearing.of_transmitters(sources)))
    )
    return heard, elimination.order_of(sources, one_block=8)


def by_slot(heard, weights):
    """Weights (axes, slots, m, lanes) of matrices over links (m, n, axes, lanes)."""
    return jnp.asarray(np.moveaxis(matrices.by_slot(weights, np.asarray(heard.sources)), 2, 0))


def retained(links, seed, lanes=3):
    """Weights over any of these links for two axes and some lanes; everybody hears the navigator."""
    rng = np.random.default_rng(seed)
    shape = *links.shape, 2, lanes
    weights = rng.uniform(0.1, 1.0, shape) * (rng.random(shape) < 0.7) * links[..., None, None]
    weights[:, 0] = rng.uniform(0.05, 1.0, weights[:, 0].shape)
    return weights / weights.sum(axis=1, keepdims=True)


def known(weights, right):
    """NumPy's solution for each axis and lane."""
    laplacian = np.eye(len(weights))[None, None] - np.moveaxis(weights[:, 1:], (2, 3), (0, 1))
    return np.moveaxis(np.linalg.solve(laplacian, np.moveaxis(right, (2, 3), (0, 1))), (0, 1), (2, 3))


@pytest.mark.parametrize("name", GRAPHS)
@given(seeds)
def test_each_axis_of_each_lane_is_solved_for_the_weights_in_force(name, seed):
    """Whatever is retained of the links; blocks are filled up where vehicles do not fill them."""
    kind, keys, m, blocks = GRAPHS[name]
    links = matrices.links_of(registry.find("topology", kind)(**keys), m)
    links[:, 0] = True
    heard, order = listening(links)
    assert order.vehicles.shape == blocks
    weights = retained(links, seed)
    right = np.random.default_rng(seed).normal(size=(m, 3, 2, weights.shape[-1]))
    solution, residual = solve(order, heard, by_slot(heard, weights), jnp.asarray(right))
    np.testing.assert_allclose(solution, known(weights, right), rtol=0, atol=1e-11)
    assert (residual < 1e-12).all()
    factors, residual = factorised(order, heard, by_slot(heard, weights))
    assert (residual < 1e-12).all()
    twice = applied(order, factors, jnp.asarray(right[:, 0].swapaxes(0, 1)))
    np.testing.assert_allclose(twice.swapaxes(0, 1), known(weights, right)[:, 0], rtol=0, atol=1e-11)


def test_many_vehicles_are_solved_for_as_few_are():
    """On a ring of 384 to 1e-9, some retained."""
    links = matrices.links_of(registry.find("topology", "cyclic")(), 384)
    heard, order = listening(links)
    assert order.vehicles.shape == (192, 2)
    weights, right = retained(links, 0), np.random.default_rng(0).normal(size=(384, 1, 2, 3))
    solution, _ = solve(order, heard, by_slot(heard, weights), jnp.asarray(right))
    np.testing.assert_allclose(solution, known(weights, right), rtol=0, atol=1e-9)


heard_by_each = st.tuples(
    *(st.frozensets(st.sampled_from([j for j in range(6) if j != i])) for i in range(1, 6))
)


@given(heard_by_each)
@example(({0}, {1}, {2}, {5}, {4}))  # 4 and 5 hear only each other
@example(({0}, {0, 4, 5}, {4, 5}, {3, 5}, {3, 4}))  # 3, 4 and 5 hear only one another
@example(({0}, {1}, {2}, {3}, set()))  # 5 hears nobody
def test_the_residual_tells_whether_the_navigator_reaches_everybody(each_hears):
    edges = [(i, j, 1.0) for i, sources in enumerate(each_hears, start=1) for j in sources]
    network = graph.weighted(5, edges)
    heard, order = listening(~np.eye(5, 6, 1, dtype=bool))
    in_slots = by_slot(heard, graph.dense(network)[..., None, None])
    reached = graph.unreachable(network) == []
    assert bool(factorised(order, heard, in_slots)[1][0] < CONNECTED) == reached
    assert bool(solve(order, heard, in_slots, jnp.zeros((5, 1, 1, 1)))[1][0] < CONNECTED) == reached


@pytest.mark.parametrize("name", ["ring", "lattice", "complete"])
@given(seeds)
def test_the_residual_tells_a_cut_whatever_the_weights(name, seed):
    """Unequal weights leave L singular up to rounding only, its inverse huge but finite.

    What was cut off receives nothing of the navigator, so its part of `L⁻¹ a0` is 0 or not a number and the
    residual no less than 1. A lane beside it is solved to the same bits as beside a connected one.
    """
    kind, keys, m, _ = GRAPHS[name]
    links = matrices.links_of(registry.find("topology", kind)(**keys), m)
    heard, order = listening(links)
    rng = np.random.default_rng(seed)
    whole = links * rng.uniform(0.1, 1.0, links.shape)
    first, number = rng.integers(m), rng.integers(2, m - 1)
    lost = (first + np.arange(number)) % m
    others = np.setdiff1d(np.arange(m), lost)
    cut = whole.copy()
    cut[np.ix_(lost, [0, *(others + 1)])] = 0.0
    whole, cut = (each / each.sum(axis=1, keepdims=True) for each in (whole, cut))
    right = jnp.asarray(rng.normal(size=(m, 3, 1, 2)))
    both, one = (by_slot(heard, np.stack([whole, other], axis=-1)[:, :, None]) for other in (whole, cut))
    clean, connected = solve(order, heard, both, right)
    solution, residual = solve(order, heard, one, right)
    assert (connected < CONNECTED).all()
    assert residual[0] < CONNECTED
    assert not residual[1] < 1.0
    assert not factorised(order, heard, one)[1][1] < 1.0
    np.testing.assert_array_equal(solution[..., 0], clean[..., 0])
