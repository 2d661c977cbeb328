"""The law: the structured solve against the equation itself and against the paper's dense one."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.engine.methods.stacked import stacked_inputs
from jaxnet.kinds.vehicles import SPEED
from jaxnet.kinds.vehicles.two_wheeled import TwoWheeled
from jaxnet.model import control, hearing
from jaxnet.solvers.dense import Dense
from tests.matrices import by_slot, slots_of

ROBOT = TwoWheeled()

seeds = st.integers(0, 2**32 - 1)
VEHICLES = 5


def network(weights, attacked):
    """Who hears whom slot by slot, and the weights of it, from matrices over links."""
    sources = slots_of(weights)
    both = [by_slot(each, sources) for each in (weights, attacked)]
    heard = hearing.Hearing(sources, sources, both[1], hearing.of_transmitters(sources))
    return jax.tree.map(jnp.asarray, (heard, both[0]))


class Problem:
    """A fleet in a random moment; NumPy.

    Half of each vehicle's weight goes towards the navigator along a random tree, so that ‖L⁻¹‖
    stays under some thousands and rounding under 1e-12: the graphs are arbitrary otherwise.
    """

    def __init__(self, seed):
        rng, m = np.random.default_rng(seed), VEHICLES
        self.weights = rng.uniform(0.0, 1.0, (m, m + 1)) * (rng.random((m, m + 1)) < 0.4)
        self.weights[range(m), range(1, m + 1)] = 0.0
        total = self.weights.sum(axis=1, keepdims=True)
        self.weights *= 0.5 / np.where(total > 0, total, 1.0)
        order = rng.permutation(m) + 1
        for place, i in enumerate(order):
            parent = rng.choice([0, *order[:place]])
            self.weights[i - 1, parent] += 1.0 - self.weights[i - 1].sum()
        self.state = rng.uniform(-10.0, 10.0, (6, m))
        self.state[:2] *= 20.0
        speed = 10.0 ** rng.uniform(-3.0, np.log10(50.0), m)
        self.state[SPEED] = speed * rng.choice([-1.0, 1.0], m)
        self.navigator = rng.normal(0.0, 30.0, (4, 2))
        self.signal = rng.normal(0.0, 10.0, (4, 2, m))
        self.attacked = rng.random((m, m + 1)) < 0.5
        rates = rng.uniform(0.3, 3.0, 2), rng.uniform(0.0, 3.0)
        roots = [-rates[0][0], *(-rates[0][1] + 1j * np.array([1, -1]) * rates[1])]
        self.gain = np.real(np.poly(roots))[:0:-1].copy()

    def arrays(self):
        """What the law is given."""
        heard, weights = network(self.weights, self.attacked)
        return (
            jnp.asarray(self.state),
            weights,
            jnp.asarray(self.navigator),
            tuple(jnp.asarray(self.signal)),
            heard,
            Dense.of(np.asarray(heard.sources)),
            jnp.asarray(self.gain),
        )

    def corruption(self):
        """`d_i^(k) = Σ_j w_ij a_ij^(k)`: a_ij is i's own signal from the navigator, else j's."""
        shares = self.weights * self.attacked
        return shares[:, 0] * self.signal + self.signal @ shares[:, 1:].T

    def received_error(self):
        """`ε^(k) = L y^(k) - a0 ⊗ y_0^(k) - d^(k)`, k = 0, 1, 2."""
        jets = np.asarray(ROBOT.output_jets(jnp.asarray(self.state)))
        laplacian = np.eye(VEHICLES) - self.weights[:, 1:]
        received = self.weights[:, 0] * self.navigator[:3, :, None]
        return np.stack([y @ laplacian.T for y in jets]) - received - self.corruption()[:3]

    def received_third(self):
        """`a0 ⊗ y_0‴ + d‴`."""
        return self.weights[:, 0] * self.navigator[3, :, None] + self.corruption()[3]

    def in_jerks(self, inputs):
        """σ and Ψu."""
        state = jnp.asarray(self.state)
        entry = np.einsum("xyi,yi->xi", ROBOT.decoupling(state), np.asarray(inputs))
        return np.asarray(ROBOT.drift(state)), entry


@jax.jit
def structured(state, weights, navigator, signal, heard, solver, gain):
    """`u` as the engine finds it."""
    own, attack = ROBOT.output_jets(state), control.driven(gain, signal)
    demand = control.demand(
        own, control.driven(gain, navigator), attack, heard, weights[None], gain
    )
    factors, _ = solver.factorise(heard, weights[None, ..., None])
    return ROBOT.inputs_for(state, solver.apply(heard, factors, demand[..., None], None)[..., 0])


@jax.jit
def dense(state, *others):
    """`u` as the paper states it."""
    return stacked_inputs(ROBOT.drift(state), ROBOT.decoupling(state), *others)


@given(seeds)
def test_structured_solve_satisfies_the_equation_of_the_law(seed):
    """`(L ⊗ I)(σ + Ψu) = a0 ⊗ y_0‴ + d‴ - (k0 ε + k1 ε̇ + k2 ε̈)`, relative to its greatest term."""
    problem = Problem(seed)
    drift, entry = problem.in_jerks(structured(*problem.arrays()))
    jerk = drift + entry
    left = jerk - jerk @ problem.weights[:, 1:].T
    feedback = sum(k * e for k, e in zip(problem.gain, problem.received_error(), strict=True))
    right = problem.received_third() - feedback
    scale = max(np.abs(term).max() for term in (drift, entry, right))
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-11 * scale)


@given(seeds)
def test_structured_solve_is_the_papers_dense_one(seed):
    """Compared as [u_1, v u_2], relative to the greatest jerk in the fleet.

    `u_2` is a jerk divided by v, so an error of rounding in it is 1/v times as large; and u is what
    is left of jerks, σ up to v ω² = 5000, that each vehicle's equation shares with its neighbours'.
    """
    problem = Problem(seed)
    state, *_, gain = problem.arrays()
    stacked = dense(
        state,
        jnp.asarray(problem.weights)[None],
        jnp.asarray(problem.received_third()),
        jnp.asarray(problem.received_error()),
        gain,
    )
    solved = structured(*problem.arrays())
    drift, entry = problem.in_jerks(solved)
    scale = max(np.abs(drift).max(), np.abs(entry).max())
    difference = np.array(solved - stacked)
    difference[1] *= problem.state[SPEED]
    assert np.abs(difference).max() < 1e-9 * scale
