"""The two-wheeled robot: its state, its motion and its flat outputs (paper, section 4.1; SCIENCE O4).

A vehicle's state is `[p_x, p_y, θ, v, ω, F]` [m, m, rad, m/s, rad/s, m/s²], its input `u = [Ḟ, ω̇]`. In the
output's jets (y, ẏ, ÿ) the robot is three integrators per axis: `y‴ = σ + ψ u`. Both descriptions are the
same off v = 0.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

State = Float[Array, "m 6"]
Plane = Float[Array, "m 2"]

HEADING, SPEED, TURN_RATE, FORCE = 2, 3, 4, 5


def directions(state: State) -> tuple[Plane, Plane]:
    """Unit vectors along the heading, `h = [cosθ, sinθ]`, and to its left, `n = [-sinθ, cosθ]`."""
    cosine, sine = jnp.cos(state[:, HEADING]), jnp.sin(state[:, HEADING])
    return jnp.stack([cosine, sine], axis=1), jnp.stack([-sine, cosine], axis=1)


def output_jets(state: State) -> Float[Array, "3 m 2"]:
    """Position, velocity `v h` and acceleration `F h + v ω n`."""
    along, left = directions(state)
    v, turn_rate, force = state[:, SPEED, None], state[:, TURN_RATE, None], state[:, FORCE, None]
    return jnp.stack([state[:, :2], v * along, force * along + v * turn_rate * left])


def drift(state: State) -> Plane:
    """`σ = 2 F ω n - v ω² h`, the jerk that is there without input."""
    along, left = directions(state)
    v, turn_rate, force = state[:, SPEED, None], state[:, TURN_RATE, None], state[:, FORCE, None]
    return 2 * force * turn_rate * left - v * turn_rate**2 * along


def decoupling(state: State) -> Float[Array, "m 2 2"]:
    """`ψ = [h, v n]` (columns), by which the input enters the jerk; `det ψ = v`."""
    along, left = directions(state)
    return jnp.stack([along, state[:, SPEED, None] * left], axis=2)


def inputs_for(state: State, jerk: Plane) -> Plane:
    """`u = ψ⁻¹ (jerk - σ)`: the input that makes the output's jerk what is asked; infinite at v = 0."""
    along, left = directions(state)
    demand = jerk - drift(state)
    force_rate = (along * demand).sum(axis=1)
    torque = (left * demand).sum(axis=1) / state[:, SPEED]
    return jnp.stack([force_rate, torque], axis=1)


def motion(state: State, inputs: Plane) -> State:
    """`ẋ = f(x, u)`."""
    along, _ = directions(state)
    velocity = state[:, SPEED, None] * along
    rest = [state[:, TURN_RATE], state[:, FORCE], inputs[:, 1], inputs[:, 0]]
    return jnp.concatenate([velocity, jnp.stack(rest, axis=1)], axis=1)


def state_of(jets: Float[Array, "3 m 2"]) -> State:
    """State with these output jets and v > 0; undefined where the velocity is zero."""
    position, velocity, acceleration = jets
    speed = jnp.hypot(velocity[:, 0], velocity[:, 1])
    along = velocity / speed[:, None]
    left = jnp.stack([-along[:, 1], along[:, 0]], axis=1)
    force = (acceleration * along).sum(axis=1)
    turn_rate = (acceleration * left).sum(axis=1) / speed
    heading = jnp.arctan2(velocity[:, 1], velocity[:, 0])
    return jnp.concatenate([position, jnp.stack([heading, speed, turn_rate, force], axis=1)], axis=1)
