"""Feedback of the state's error, linearised about the navigator (paper, section 3.3).

    u = u_0 + ∂g/∂x (x - x_0) + ∂g/∂z (z - z_0)   at (x_0, z_0),      g(x, z) = ψ⁻¹ (z - P(y(x)) -
    σ(x))

g gives the inputs of the exact law, z_0 = R(y_0), and x_0 and u_0 are the state and the inputs of a
vehicle on the navigator's path. `K = ∂g/∂x`. The drive z - z_0 = L⁻¹ d is the attacks' effect.
"""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.model import control
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Plane
from jaxnet.model.shapes import OrderedJets

VehicleStates = Float[Array, "n m lanes"]


def inputs_near_navigator(
    lane: Lane, states: VehicleStates, path: OrderedJets, drive: Plane
) -> Plane:
    """The inputs (2, m, lanes) of vehicles with these states.

    `path` are the jets of the navigator's path, for each vehicle in its place, up to the order at
    least; `drive` is z - R(y_0) [m/s³] of each vehicle.
    """
    vehicle, order = lane.vehicle, len(lane.gain)
    target = vehicle.state_of(tuple(path[:order]))
    error, turn = states - target, 2 * math.pi
    angles = jnp.asarray([unit == "rad" for unit in vehicle.units])[:, None, None]
    error = error - jnp.where(angles, turn * jnp.round(error / turn), 0.0)  # half a turn at most

    def exact(state: VehicleStates, z: Plane) -> Plane:
        own = vehicle.output_jets(state)
        return vehicle.inputs_for(state, z - control.feedback(lane.gain, own))

    at = target, control.driven(lane.gain, path)
    there, change = jax.jvp(exact, at, (error, drive))
    return there + change
