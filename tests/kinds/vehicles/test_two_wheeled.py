"""The two-wheeled robot's flat outputs: one motion in two coordinates, differentiated along it."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.kinds.vehicles import HEADING, SPEED
from jaxnet.kinds.vehicles.two_wheeled import TwoWheeled
from jaxnet.model import plane

FLEET = 12
ROBOT = TwoWheeled()


def fleet(seed, forward=False):
    """Random robots: speeds of 1e-3 to 50 m/s, ahead or astern, turning and accelerating hard."""
    rng = np.random.default_rng(seed)
    state = rng.uniform(-10.0, 10.0, (6, FLEET))
    state[:2] *= 20.0
    state[SPEED] = 10.0 ** rng.uniform(-3.0, np.log10(50.0), FLEET)
    if not forward:
        state[SPEED] *= rng.choice([-1.0, 1.0], FLEET)
    return jnp.asarray(state), jnp.asarray(rng.uniform(-100.0, 100.0, (2, FLEET)))


seeds = st.integers(0, 2**32 - 1)


@jax.jit
def along_the_motion(state, inputs):
    """Output jets, their time derivative along `ẋ = f(x, u)`, and `σ + ψ u`."""
    jets, rates = jax.jvp(ROBOT.output_jets, (state,), (ROBOT.motion(state, inputs),))
    jerk = ROBOT.drift(state) + jnp.einsum("xyi,yi->xi", ROBOT.decoupling(state), inputs)
    return jets, rates, jerk


inputs_for = jax.jit(ROBOT.inputs_for)
there_and_back = jax.jit(lambda state: ROBOT.state_of(ROBOT.output_jets(state)))


def test_motion_is_the_unicycle_with_its_state_in_the_stated_order():
    """Heading north at 3 m/s, turning at 5 rad/s, speeding up by 7 m/s², u = [Ḟ, ω̇] = [11, 13]."""
    state = jnp.array([1.0, 2.0, np.pi / 2, 3.0, 5.0, 7.0])[:, None]
    rates = ROBOT.motion(state, jnp.array([[11.0], [13.0]]))
    np.testing.assert_allclose(rates[:, 0], [0.0, 3.0, 5.0, 7.0, 13.0, 11.0], atol=1e-15)


@given(seeds)
def test_output_jets_follow_each_other_along_any_motion(seed):
    (_, velocity, acceleration), rates, jerk = along_the_motion(*fleet(seed))
    np.testing.assert_allclose(rates[0], velocity, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(rates[1], acceleration, rtol=1e-12, atol=1e-10)
    np.testing.assert_allclose(rates[2], jerk, rtol=1e-12, atol=1e-8)  # terms of v ω² ≤ 5000 cancel


@given(seeds)
def test_the_input_enters_with_determinant_v(seed):
    state, _ = fleet(seed)
    determinant = np.linalg.det(np.moveaxis(ROBOT.decoupling(state), 2, 0))
    np.testing.assert_allclose(determinant, state[SPEED], rtol=1e-12)


@given(seeds)
def test_the_input_for_a_jerk_gives_that_jerk(seed):
    """`u_2` carries what rounding is left of a jerk of at most 1e4, divided by v."""
    state, inputs = fleet(seed)
    _, _, jerk = along_the_motion(state, inputs)
    speed = np.abs(state[SPEED])
    error = np.abs(inputs_for(state, jerk) - inputs)
    assert (error[0] < 1e-10).all()
    assert (error[1] * speed < 1e-10).all()


@given(seeds)
def test_flat_outputs_are_coordinates_of_robots_that_go_ahead(seed):
    state, _ = fleet(seed, forward=True)
    back = np.array(there_and_back(state))
    turns = (back - state)[HEADING] / (2 * np.pi)
    back[HEADING] -= 2 * np.pi * np.round(turns)
    np.testing.assert_allclose(back, state, rtol=1e-11, atol=1e-11)


@given(seeds)
def test_pace_is_what_the_output_jets_say_of_robots_that_go_ahead(seed):
    """Speed and turn rate are states, and found from velocity and acceleration alone."""
    state, inputs = fleet(seed, forward=True)
    speed, turn_rate = plane.pace(ROBOT.output_jets(state))
    np.testing.assert_allclose(ROBOT.pace(state, inputs)[0], speed, rtol=1e-12)
    np.testing.assert_allclose(ROBOT.pace(state, inputs)[1], turn_rate, rtol=1e-11, atol=1e-11)


def test_a_robot_starts_with_its_pose_and_speed_and_all_else_zero():
    position, heading, speed = (
        np.array([[1.0, 2.0], [3.0, 4.0]]),
        np.array([0.5, 0.6]),
        np.array([7.0, 8.0]),
    )
    known = [[1, 2], [3, 4], [0.5, 0.6], [7, 8], [0, 0], [0, 0]]
    np.testing.assert_array_equal(ROBOT.start(position, heading, speed), known)
