"""The unicycle: one motion in two coordinates, by differentiating along it."""

import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.kinds.vehicles import HEADING, SPEED
from jaxnet.kinds.vehicles.unicycle import Unicycle
from tests.kinds.vehicles.flatness import assert_flat, assert_margin

ROBOT = Unicycle()


def fleet(seed):
    """Random states (4, 6, 2), ahead and astern at 0.1 m/s and more, and inputs."""
    rng = np.random.default_rng(seed)
    state, inputs = rng.uniform(-10, 10, (4, 6, 2)), rng.uniform(-10, 10, (2, 6, 2))
    state[SPEED] += 0.1 * np.sign(state[SPEED])
    return jnp.asarray(state), jnp.asarray(inputs)


@given(st.integers(0, 2**32 - 1))
def test_it_is_two_integrators_for_each_axis(seed):
    state, inputs = fleet(seed)
    assert_flat(ROBOT, state, inputs)
    assert_margin(ROBOT, state)
    np.testing.assert_array_equal(ROBOT.pace(state, inputs), [state[SPEED], inputs[1]])


@given(st.integers(0, 2**32 - 1))
def test_jets_determine_the_state_of_a_robot_that_goes_ahead(seed):
    state, _ = fleet(seed)
    state = state.at[SPEED].set(abs(state[SPEED]))
    back = ROBOT.state_of(ROBOT.output_jets(state))
    turns = (back - state)[HEADING] / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)
    rest = [0, 1, SPEED]
    np.testing.assert_allclose(back[rest, :, :], state[rest, :, :], rtol=1e-12)


def test_it_circles_as_its_equation_says():
    """At 2 m/s and 3 rad/s it moves on a circle: ẋ = 2 cos θ, ẏ = 2 sin θ, θ̇ = 3, v̇ = 5."""
    rates = ROBOT.motion(jnp.array([7.0, 8.0, np.pi / 6, 2.0])[:, None], jnp.array([[5.0], [3.0]]))
    np.testing.assert_allclose(rates[:, 0], [np.sqrt(3), 1, 3, 5], rtol=1e-15)
