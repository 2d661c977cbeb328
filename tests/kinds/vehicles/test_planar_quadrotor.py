"""The planar quadrotor: one motion in two coordinates, by differentiating along it; it hovers."""

import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.kinds.vehicles.planar_quadrotor import GRAVITY, PITCH, THRUST, PlanarQuadrotor
from tests.kinds.vehicles.flatness import assert_flat, assert_margin

QUADROTOR = PlanarQuadrotor()


def fleet(seed):
    """Random states (8, 6, 2), with thrusts of either sign, and inputs."""
    rng = np.random.default_rng(seed)
    state, inputs = rng.uniform(-3, 3, (8, 6, 2)), rng.uniform(-3, 3, (2, 6, 2))
    state[THRUST] += 0.1 * np.sign(state[THRUST])
    return jnp.asarray(state), jnp.asarray(inputs)


@given(st.integers(0, 2**32 - 1))
def test_it_is_four_integrators_for_each_axis(seed):
    state, inputs = fleet(seed)
    assert_flat(QUADROTOR, state, inputs)
    assert_margin(QUADROTOR, state)


@given(st.integers(0, 2**32 - 1))
def test_jets_determine_the_state_of_a_quadrotor_that_pushes(seed):
    state, _ = fleet(seed)
    state = state.at[THRUST].set(abs(state[THRUST]))
    back = QUADROTOR.state_of(QUADROTOR.output_jets(state))
    turns = (back - state)[PITCH] / (2 * np.pi)
    np.testing.assert_allclose(
        back.at[PITCH].add(-2 * np.pi * jnp.round(turns)), state, rtol=1e-9, atol=1e-9
    )


def test_it_moves_as_its_equation_says():
    """Pitched by 30° to the left with thrust 2: `ẍ = -2 sin φ`, `ÿ = 2 cos φ - g`."""
    state = jnp.array([1.0, 2.0, 3.0, 4.0, np.pi / 6, 5.0, 2.0, 6.0])[:, None]
    rates = QUADROTOR.motion(state, jnp.array([[7.0], [8.0]]))
    known = [3, 4, -1, np.sqrt(3) - GRAVITY, 5, 8, 6, 7]
    np.testing.assert_allclose(rates[:, 0], known, rtol=1e-14)


def test_it_starts_at_rest():
    """All jets above the position are 0, and without input it stays there."""
    position, numbers = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([0.5, 0.6])
    state = QUADROTOR.start(position, numbers, numbers)
    jets = QUADROTOR.output_jets(state)
    np.testing.assert_array_equal(jets[0], position)
    np.testing.assert_array_equal(np.stack(jets[1:]), 0.0)
    np.testing.assert_array_equal(QUADROTOR.motion(state, np.zeros((2, 2))), 0.0)
