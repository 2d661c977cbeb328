"""The two-wheeled robot: its state, its motion and its flat outputs (paper, section 4.1; SCIENCE O4).

A vehicle's state is `[p_x, p_y, θ, v, ω, F]` [m, m, rad, m/s, rad/s, m/s²], its input `u = [Ḟ, ω̇]`. In the
output's jets (y, ẏ, ÿ) the robot is three integrators per axis: `y‴ = σ + ψ u`. Both descriptions are the
same off v = 0.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.model.circle import circle

State = Float[Array, "6 m *lanes"]
Plane = Float[Array, "2 m *lanes"]
Jets = tuple[Plane, Plane, Plane]  # a signal, its first and its second derivative

HEADING, SPEED, TURN_RATE, FORCE = 2, 3, 4, 5


def directions(state: State) -> tuple[Plane, Plane]:
    """Unit vectors along the heading, `h = [cosθ, sinθ]`, and to its left, `n = [-sinθ, cosθ]`."""
    cosine, sine = circle(state[HEADING])
    return jnp.stack([cosine, sine]), jnp.stack([-sine, cosine])


def output_jets(state: State) -> Jets:
    """Position, velocity `v h` and acceleration `F h + v ω n`."""
    along, left = directions(state)
    v, turn_rate, force = state[SPEED][None], state[TURN_RATE][None], state[FORCE][None]
    return state[:2], v * along, force * along + v * turn_rate * left


def drift(state: State) -> Plane:
    """`σ = 2 F ω n - v ω² h`, the jerk that is there without input."""
    along, left = directions(state)
    v, turn_rate, force = state[SPEED][None], state[TURN_RATE][None], state[FORCE][None]
    return 2 * force * turn_rate * left - v * turn_rate**2 * along


def decoupling(state: State) -> Float[Array, "2 2 m *lanes"]:
    """`ψ = [h, v n]` by axis and column, by which the input enters the jerk; `det ψ = v`."""
    along, left = directions(state)
    return jnp.stack([along, state[SPEED][None] * left], axis=1)


def inputs_for(state: State, jerk: Plane) -> Plane:
    """`u = ψ⁻¹ (jerk - σ)`: the input that makes the output's jerk what is asked; infinite at v = 0."""
    along, left = directions(state)
    demand = jerk - drift(state)
    return jnp.stack([dot(along, demand), dot(left, demand) / state[SPEED]])


def motion(state: State, inputs: Plane) -> State:
    """`ẋ = f(x, u)`."""
    along, _ = directions(state)
    velocity = state[SPEED][None] * along
    return jnp.stack([velocity[0], velocity[1], state[TURN_RATE], state[FORCE], inputs[1], inputs[0]])


def pace(jets: Jets) -> tuple[Float[Array, "m *lanes"], Float[Array, "m *lanes"]]:
    """Speed and turn rate with these output jets and v > 0; undefined where the velocity is zero."""
    _, velocity, acceleration = jets
    square = dot(velocity, velocity)
    return jnp.sqrt(square), cross(velocity, acceleration) / square


def state_of(jets: Jets) -> State:
    """State with these output jets and v > 0; undefined where the velocity is zero."""
    position, velocity, acceleration = jets
    speed, turn_rate = pace(jets)
    heading = jnp.arctan2(velocity[1], velocity[0])
    force = dot(velocity, acceleration) / speed
    return jnp.stack([position[0], position[1], heading, speed, turn_rate, force])


def dot(a: Plane, b: Plane) -> Float[Array, "m *lanes"]:
    """Inner product of plane vectors."""
    return a[0] * b[0] + a[1] * b[1]


def cross(a: Plane, b: Plane) -> Float[Array, "m *lanes"]:
    """`a_x b_y - a_y b_x`, positive where b is to the left of a."""
    return a[0] * b[1] - a[1] * b[0]
