"""The law: the structured solve against the equation itself and against the paper's dense one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from jaxnet.model import control, definition, graph, robot

CONNECTED = 1e-6  # what the engine takes for a reached graph

seeds = st.integers(0, 2**32 - 1)
fleets = st.sampled_from([12, 5])


class Problem:
    """A fleet in a random moment; NumPy.

    Half of each vehicle's weight goes towards the navigator along a random tree, so that ‖L⁻¹‖ stays
    under some thousands and rounding under 1e-12: the graphs are arbitrary otherwise.
    """

    def __init__(self, seed, vehicles):
        rng = np.random.default_rng(seed)
        m = self.vehicles = vehicles
        self.weights = rng.uniform(0.0, 1.0, (m, m + 1)) * (rng.random((m, m + 1)) < 0.4)
        self.weights[range(m), range(1, m + 1)] = 0.0
        total = self.weights.sum(axis=1, keepdims=True)
        self.weights *= 0.5 / np.where(total > 0, total, 1.0)
        order = rng.permutation(m) + 1
        for place, i in enumerate(order):
            parent = rng.choice([0, *order[:place]])
            self.weights[i - 1, parent] += 1.0 - self.weights[i - 1].sum()
        self.state = rng.uniform(-10.0, 10.0, (m, 6))
        self.state[:, :2] *= 20.0
        speed = 10.0 ** rng.uniform(-3.0, np.log10(50.0), m)
        self.state[:, robot.SPEED] = speed * rng.choice([-1.0, 1.0], m)
        self.navigator = rng.normal(0.0, 30.0, (4, 2))
        self.corruption = rng.normal(0.0, 10.0, (4, m, 2))
        rates = rng.uniform(0.3, 3.0, 2), rng.uniform(0.0, 3.0)
        roots = [-rates[0][0], *(-rates[0][1] + 1j * np.array([1, -1]) * rates[1])]
        self.gain = np.real(np.poly(roots))[:0:-1].copy()

    def arrays(self):
        """What the law is given."""
        parts = (self.state, self.weights, self.navigator, self.corruption, self.gain)
        return [jnp.asarray(part) for part in parts]

    def received_error(self):
        """`ε^(k) = L y^(k) - a0 ⊗ y_0^(k) - d^(k)`, k = 0, 1, 2."""
        jets = np.asarray(robot.output_jets(jnp.asarray(self.state)))
        laplacian = np.eye(self.vehicles) - self.weights[:, 1:]
        told = self.weights[:, :1] * self.navigator[:3, None]
        return np.stack([laplacian @ y for y in jets]) - told - self.corruption[:3]

    def told_third(self):
        """`a0 ⊗ y_0‴ + d‴`."""
        return self.weights[:, :1] * self.navigator[3] + self.corruption[3]

    def in_jerks(self, inputs):
        """σ and Ψu."""
        state = jnp.asarray(self.state)
        entry = np.einsum("ixy,iy->ix", robot.decoupling(state), np.asarray(inputs))
        return np.asarray(robot.drift(state)), entry


@jax.jit
def structured(state, weights, navigator, corruption, gain):
    """`u` as the engine finds it."""
    own = robot.output_jets(state)
    desired = control.desired_signal(own, navigator, corruption, weights)
    inverse, _ = control.invert_laplacian(weights)
    return robot.inputs_for(state, control.desired_jerk(own, desired, inverse, gain))


dense = jax.jit(definition.inputs)
invert = jax.jit(control.invert_laplacian)


@given(seeds, fleets)
def test_structured_solve_satisfies_the_equation_of_the_law(seed, vehicles):
    """`(L ⊗ I)(σ + Ψu) = a0 ⊗ y_0‴ + d‴ - (k0 ε + k1 ε̇ + k2 ε̈)`, relative to its greatest term."""
    problem = Problem(seed, vehicles)
    drift, entry = problem.in_jerks(structured(*problem.arrays()))
    jerk = drift + entry
    left = jerk - problem.weights[:, 1:] @ jerk
    feedback = sum(k * e for k, e in zip(problem.gain, problem.received_error(), strict=True))
    right = problem.told_third() - feedback
    scale = max(np.abs(term).max() for term in (drift, entry, right))
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-11 * scale)


@given(seeds, fleets)
def test_structured_solve_is_the_papers_dense_one(seed, vehicles):
    """Compared as [u_1, v u_2], relative to the greatest jerk in the fleet.

    `u_2` is a jerk divided by v, so an error of rounding in it is 1/v times as large; and u is what is
    left of jerks, σ up to v ω² = 5000, that each vehicle's equation shares with its neighbours'.
    """
    problem = Problem(seed, vehicles)
    state, weights, *_, gain = problem.arrays()
    stacked = dense(
        state,
        weights,
        jnp.asarray(problem.told_third()),
        jnp.asarray(problem.received_error()),
        gain,
    )
    solved = structured(*problem.arrays())
    drift, entry = problem.in_jerks(solved)
    scale = max(np.abs(drift).max(), np.abs(entry).max())
    difference = np.array(solved - stacked)
    difference[:, 1] *= problem.state[:, robot.SPEED]
    assert np.abs(difference).max() < 1e-9 * scale


def test_desired_signal_is_a_weighted_mean_of_what_is_heard():
    """Written out for one listener: 0.25 of the navigator, 0.75 of vehicle 2, and the lies."""
    weights = jnp.asarray(graph.weighted(2, [(1, 0, 1.0), (1, 2, 3.0), (2, 0, 1.0)]))
    own = jnp.arange(12.0).reshape(3, 2, 2)
    navigator = jnp.full((4, 2), 100.0)
    z = control.desired_signal(own, navigator, jnp.full((4, 2, 2), 0.5), weights)
    expected = [[27.0, 27.75], [30.0, 30.75], [33.0, 33.75], [25.5, 25.5]]
    np.testing.assert_allclose(z[:, 0], expected, rtol=1e-15)


@pytest.mark.parametrize("vehicles", [12, 5])
def test_closed_loop_of_the_default_gain_has_nothing_but_minus_one(vehicles):
    """(𝐀 + 𝐁𝐊 + I)³ = 0 in whole numbers: computed eigenvalues of multiplicity 3 prove little."""
    shifted = np.asarray(definition.closed_loop(jnp.array([1.0, 3.0, 3.0]), vehicles))
    shifted = shifted + np.eye(6 * vehicles)
    assert not np.linalg.matrix_power(shifted, 3).any()
    assert np.linalg.matrix_power(shifted, 2).any()


@given(seeds)
def test_closed_loop_has_each_root_of_the_gain_twice_a_vehicle(seed):
    rng = np.random.default_rng(seed)
    slow, fast = rng.uniform(0.3, 1.0), rng.uniform(1.5, 4.0)
    pair = -rng.uniform(0.3, 4.0) + 1j * rng.uniform(0.5, 3.0)
    for roots in ([-slow, pair, pair.conjugate()], [-slow, -fast, -fast - 1.0]):
        gain = jnp.asarray(np.real(np.poly(roots))[:0:-1].copy())
        eigenvalues = np.linalg.eigvals(np.asarray(definition.closed_loop(gain, 5)))
        counts = [(np.abs(eigenvalues - root) < 1e-9).sum() for root in roots]
        assert counts == [10, 10, 10]


@given(seeds, fleets)
def test_inverse_laplacian_of_a_reached_graph(seed, vehicles):
    weights = Problem(seed, vehicles).weights
    inverse, residual = invert(jnp.asarray(weights))
    assert residual < 1e-11
    laplacian = np.eye(vehicles) - weights[:, 1:]
    np.testing.assert_allclose(laplacian @ inverse, np.eye(vehicles), atol=1e-11)
    assert (np.asarray(inverse) > -1e-11).all()  # L is an M-matrix


heard_by_each = st.tuples(
    *(st.frozensets(st.sampled_from([j for j in range(6) if j != i])) for i in range(1, 6))
)


@given(heard_by_each)
@example(({0}, {1}, {2}, {5}, {4}))  # 4 and 5 hear only each other
@example(({0}, {0, 4, 5}, {4, 5}, {3, 5}, {3, 4}))  # 3, 4 and 5 hear only one another
@example(({0}, {1}, {2}, {3}, set()))  # 5 hears nobody
def test_the_residual_tells_whether_the_navigator_reaches_everybody(heard):
    edges = [(i, j, 1.0) for i, sources in enumerate(heard, start=1) for j in sources]
    weights = graph.weighted(5, edges)
    _, residual = invert(jnp.asarray(weights))
    assert bool(residual < CONNECTED) == (graph.unreachable(weights) == [])


@given(seeds)
def test_the_residual_tells_a_cut_whatever_the_weights(seed):
    """Unequal weights leave L singular up to rounding only, its inverse huge but finite."""
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.1, 1.0, (12, 13))
    weights[range(12), range(1, 13)] = 0.0
    lost = rng.choice(12, rng.integers(2, 8), replace=False)
    weights[np.ix_(lost, [0, *(j for j in range(1, 13) if j - 1 not in lost)])] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    _, residual = invert(jnp.asarray(weights))
    assert not residual < CONNECTED
