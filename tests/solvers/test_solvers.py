"""Solving for the graph in force, in blocks, in one, by iteration, against NumPy's own solution."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from jaxnet.engine.plan import CONNECTED
from jaxnet.kinds import registry
from jaxnet.model import elimination, graph, hearing
from jaxnet.solvers import choice, iterative
from jaxnet.solvers.dense import Dense
from jaxnet.solvers.iterative import Iterative
from tests import matrices

GRAPHS = {
    "ring": ("cyclic", {}, 17, (9, 2)),
    "path": ("path", {}, 19, (10, 2)),
    "lattice": ("lattice", {"neighbours": 4}, 41, (9, 5)),
    "grid": ("grid", {"rows": 4, "columns": 4}, 16, None),
    "complete": ("complete", {}, 9, None),
    "small ring": ("cyclic", {}, 12, None),  # half of the fleet needs no elimination
    "odd path": ("path", {}, 9, None),
}
WIDE = {
    "random_regular": {"degree": 4, "navigator": [1, 200, 384]},
    "erdos_renyi": {"probability": 8 / 384},
}
seeds = st.integers(0, 2**32 - 1)
solve = jax.jit(lambda solver, *given: solver.solve(*given))
factorise = jax.jit(lambda solver, *given: solver.factorise(*given))
apply = jax.jit(lambda solver, *given: solver.apply(*given, None))


def listening(links):
    """Who hears whom, and the solver."""
    sources = matrices.slots_of(links)
    heard = hearing.Hearing(sources, sources, sources < 0, hearing.of_transmitters(sources))
    return jax.tree.map(jnp.asarray, heard), choice.choose_solver(sources).solver


def by_slot(heard, weights):
    """Weights (axes, slots, m, lanes) of matrices over links (m, n, axes, lanes)."""
    return jnp.asarray(np.moveaxis(matrices.by_slot(weights, np.asarray(heard.sources)), 2, 0))


def retained(links, seed, lanes=3):
    """Weights over any of these links for two axes and some lanes; all hear the navigator."""
    rng = np.random.default_rng(seed)
    shape = *links.shape, 2, lanes
    weights = rng.uniform(0.1, 1.0, shape) * (rng.random(shape) < 0.7) * links[..., None, None]
    weights[:, 0] = rng.uniform(0.05, 1.0, weights[:, 0].shape)
    return weights / weights.sum(axis=1, keepdims=True)


def known(weights, right):
    """NumPy's solution for each axis and lane."""
    laplacian = np.eye(len(weights))[None, None] - np.moveaxis(weights[:, 1:], (2, 3), (0, 1))
    return np.moveaxis(
        np.linalg.solve(laplacian, np.moveaxis(right, (2, 3), (0, 1))), (0, 1), (2, 3)
    )


@pytest.mark.parametrize("name", GRAPHS)
@given(seeds)
def test_each_axis_of_each_lane_is_solved_for_the_weights_in_force(name, seed):
    """Whatever is retained of the links; blocks are filled up where vehicles do not fill them."""
    kind, keys, m, blocks = GRAPHS[name]
    links = matrices.links_of(registry.find("topology", kind)(**keys), m)
    links[:, 0] = True
    heard, solver = listening(links)
    assert isinstance(solver, Dense) if blocks is None else solver.vehicles.shape == blocks
    weights = retained(links, seed)
    right = np.random.default_rng(seed).normal(size=(m, 3, 2, weights.shape[-1]))
    solution, residual = solve(solver, heard, by_slot(heard, weights), jnp.asarray(right))
    np.testing.assert_allclose(solution, known(weights, right), rtol=0, atol=1e-11)
    assert (residual < 1e-12).all()
    factors, residual = factorise(solver, heard, by_slot(heard, weights))
    assert (residual < 1e-12).all()
    twice = apply(solver, heard, factors, jnp.asarray(right[:, 0].swapaxes(0, 1)))
    np.testing.assert_allclose(
        twice.swapaxes(0, 1), known(weights, right)[:, 0], rtol=0, atol=1e-11
    )


def wide(name):
    """A graph of 384 vehicles that no order makes narrow, who hears whom, and what to solve by."""
    links = matrices.links_of(registry.find("topology", name)(**WIDE[name]), 384)
    heard, solver = listening(links)
    assert isinstance(solver, Iterative)
    return links, heard, solver


def some_retained(links, seed, lanes=3):
    """Weights over random halves of links for two axes; all keep one nearer the navigator."""
    rng, reached = np.random.default_rng(seed), graph.hops(graph.of_matrix(links))
    nearer = np.argmax(links & (np.append(0, reached)[None] < reached[:, None]), axis=1)
    kept = links[..., None, None] & (rng.random((*links.shape, 2, lanes)) < 0.5)
    kept[np.arange(len(links)), nearer] = True
    weights = kept * rng.uniform(0.1, 1.0, kept.shape)
    return weights / weights.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("name", WIDE)
def test_a_wide_graph_is_solved_for_by_iteration(name):
    """Of 384 to 1e-9 of the greatest component, for any retained, three hear the navigator or all.

    The inverse is no greater than its bound, as tight as its vector lets it be.
    """
    links, heard, solver = wide(name)
    weights, right = some_retained(links, 1), np.random.default_rng(1).normal(size=(384, 2, 2, 3))
    right[:, 0] *= (np.arange(384) % 100 == 7)[:, None, None]  # as of few that are attacked
    right[..., 2] *= np.array([1e-170, 1e170])[None, :, None]
    exact, in_slots = known(weights, right), by_slot(heard, weights)
    scale = np.abs(exact).max(axis=0)
    solution, residual = solve(solver, heard, in_slots, jnp.asarray(right))
    np.testing.assert_allclose(np.asarray(solution) / scale, exact / scale, rtol=0, atol=1e-9)
    assert (residual < 1e-10).all()
    factors, residual = factorise(solver, heard, in_slots)
    assert (residual < CONNECTED).all()
    inverse = known(weights, np.ones((384, 1, 2, 3))).max(axis=(0, 1))
    most = (1 + iterative.CERTIFICATE) / (1 - iterative.CERTIFICATE)  # where `L v` is so near 1
    assert ((inverse <= factors.bound) & (factors.bound <= most * inverse)).all()
    twice = apply(solver, heard, factors, jnp.asarray(right[:, 1].swapaxes(0, 1)))
    twice = np.asarray(twice).swapaxes(0, 1)
    np.testing.assert_allclose(twice / scale[1], exact[:, 1] / scale[1], rtol=0, atol=1e-9)


def test_iteration_gets_to_the_leaves_of_a_tree():
    """Of one root, who alone hears the navigator; nothing comes back to who has passed it on."""
    weights = graph.dense(graph.weighted(300, [(i, i // 2, 1.0) for i in range(1, 301)]))
    heard, solver = listening(weights > 0)
    assert isinstance(solver, Iterative)
    weights, right = weights[..., None, None], np.eye(300)[:, :2, None, None]
    solution, residual = solve(solver, heard, by_slot(heard, weights), jnp.asarray(right))
    np.testing.assert_allclose(solution, known(weights, right), rtol=0, atol=1e-11)
    assert residual < CONNECTED


def test_a_lane_cut_off_is_found_by_iteration_and_changes_nothing_beside_it():
    """On either axis, or as one of two that hear only each other; other lanes keep their last bit.

    A vehicle whose weights are all 0 keeps its drive, and is not cut off.
    """
    links, heard, solver = wide("random_regular")
    whole = some_retained(links, 3, lanes=6)
    cut, right = whole.copy(), np.random.default_rng(3).normal(size=(384, 2, 2, 6))
    cut[[0, 199, 383], 0, 1, 1] = 0.0  # nobody hears the navigator
    listener = 10
    other = np.flatnonzero(links[listener, 1:])[0]
    cut[listener, :, 0, 2] = np.arange(385) == 1 + other
    cut[other, :, 0, 2] = np.arange(385) == 1 + listener
    cut[:, :, :, 4] = np.nan
    cut[listener, :, :, 5] = 0.0
    right = jnp.asarray(right)
    (clean, _), (found, residual) = (
        solve(solver, heard, by_slot(heard, each), right) for each in (whole, cut)
    )
    assert np.isinf(residual).tolist() == [False, True, True, False, True, False]
    np.testing.assert_array_equal(found[..., [0, 3]], clean[..., [0, 3]])
    (theirs, _), (factors, also) = (
        factorise(solver, heard, by_slot(heard, each)) for each in (whole, cut)
    )
    np.testing.assert_array_equal(np.isinf(also), np.isinf(residual))
    alone = right[:, 0].swapaxes(0, 1)
    clean, found = (apply(solver, heard, each, alone) for each in (theirs, factors))
    np.testing.assert_array_equal(found[..., [0, 3]], clean[..., [0, 3]])
    assert np.isnan(found[..., 4]).all()


def test_what_iteration_does_not_find_is_not_a_number():
    """A right side that is not finite; a path where each hears the farther one 999 times of 1,000.

    The inverse of the latter is greater than any number. What is beside them is found.
    """
    m, each = 200, range(1, 201)
    steep, flat = (
        [(i, i - 1, 1 - s) for i in each] + [(i, i + 1, s) for i in each[:-1]] for s in (0.999, 0.2)
    )
    both = [graph.dense(graph.weighted(m, edges)) for edges in (flat, steep)]
    heard, _ = listening(both[0] > 0)
    weights, right = np.stack(both, axis=-1)[:, :, None], np.ones((m, 2, 1, 2))
    right[3, 0, 0, 0] = np.inf
    solution, residual = solve(Iterative(), heard, by_slot(heard, weights), jnp.asarray(right))
    assert np.isnan(solution[:, :, 0]).all(axis=0).tolist() == [[True, True], [False, True]]
    exact = known(weights[..., :1], right[:, 1:, :, :1])
    np.testing.assert_allclose(solution[:, 1:, :, :1], exact, rtol=1e-11)
    assert (residual < CONNECTED).all()


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
    heard, solver = listening(~np.eye(5, 6, 1, dtype=bool))
    in_slots = by_slot(heard, graph.dense(network)[..., None, None])
    residuals = (
        factorise(solver, heard, in_slots)[1],
        solve(solver, heard, in_slots, jnp.zeros((5, 1, 1, 1)))[1],
    )
    assert [bool(each[0] < CONNECTED) for each in residuals] == [not graph.unreachable(network)] * 2


@pytest.mark.parametrize("name", ["ring", "lattice", "complete"])
@given(seeds)
def test_the_residual_tells_a_cut_whatever_the_weights(name, seed):
    """Unequal weights leave L singular up to rounding only, its inverse huge but finite.

    A lane beside it is solved to the same bits as beside a connected one.
    """
    kind, keys, m, _ = GRAPHS[name]
    links = matrices.links_of(registry.find("topology", kind)(**keys), m)
    (heard, solver), rng = listening(links), np.random.default_rng(seed)
    whole = links * rng.uniform(0.1, 1.0, links.shape)
    lost = (rng.integers(m) + np.arange(rng.integers(2, m - 1))) % m
    cut, right = whole.copy(), jnp.asarray(rng.normal(size=(m, 3, 1, 2)))
    cut[np.ix_(lost, np.setdiff1d(np.arange(m + 1), lost + 1))] = 0.0
    whole, cut = (each / each.sum(axis=1, keepdims=True) for each in (whole, cut))
    both, one = (
        by_slot(heard, np.stack([whole, other], axis=-1)[:, :, None]) for other in (whole, cut)
    )
    (clean, connected), (found, residual) = (solve(solver, heard, of, right) for of in (both, one))
    assert (connected < CONNECTED).all()
    assert residual[0] < CONNECTED
    for left in (residual, factorise(solver, heard, one)[1]):
        assert not left[1] < 1.0  # or not a number
    np.testing.assert_array_equal(found[..., 0], clean[..., 0])


@pytest.mark.parametrize("n", [1, 2, 3, 7, 12, 29, 96])
def test_eliminates_as_numpy_solves(n):
    """Of every size: few rows, a remainder, and matrices so large that done columns wait."""
    rng = np.random.default_rng(n)
    matrix = rng.uniform(-1.0, 0.0, (n, n, 2, 3)) * (~np.eye(n, dtype=bool))[:, :, None, None]
    matrix -= np.eye(n)[:, :, None, None] * (matrix.sum(axis=1, keepdims=True) - 0.1)
    right = rng.normal(size=(n, 4, 2, 3))
    found = jax.jit(elimination.eliminated)(jnp.asarray(np.concatenate([matrix, right], axis=1)))
    expected = np.linalg.solve(*(np.moveaxis(each, (2, 3), (0, 1)) for each in (matrix, right)))
    np.testing.assert_allclose(found, np.moveaxis(expected, (0, 1), (2, 3)), rtol=1e-10, atol=1e-10)


def test_the_page_has_the_sizes_that_choose_a_solver():
    """In the rows of numerics.md."""
    page = (Path(__file__).parents[2] / "docs" / "numerics.md").read_text()
    for row in (
        f"at most {choice.ONE_BLOCK} vehicles; at most {choice.LARGEST_BLOCK} with fewer than "
        f"{choice.LEAST_BLOCKS} blocks",
        f"{choice.LEAST_BLOCKS} blocks or more, of at most {choice.LARGEST_BLOCK} vehicles",
        f"{choice.LEAST_WINDOWED} such blocks or more",
    ):
        assert f" | {row} |\n" in page
