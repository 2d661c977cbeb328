"""Vehicles that decisions cut off and that come to rest: they stop there, and stay stopped.

A vehicle that coasts moves by `y^(r) + P(y + n) = z` until the next tick, with its kept drive z and
the errors n of its sensor. Under a law that holds the r-th derivative, P is 0. The derivatives of y
obey a linear equation without a constant, so `standstill.stands` finds the first instant at which
the vehicle stands still.

The vehicle stops at that instant. Until the next tick its listeners still hear z. From the next
tick on the vehicle tells its place at rest. It never restarts, because the law is singular at rest.
"""

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.engine import flow, standstill, vehicles
from jaxnet.engine.moment import Instants, VehicleFlags
from jaxnet.engine.subset import run_if
from jaxnet.engine.vehicles import States
from jaxnet.model import control
from jaxnet.model.circle import angle
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets, length

# [1/s] acceleration over speed, above which a vehicle that comes to rest brakes along its course
BRAKING = 1e3


def rest_within_tick(
    lane: Lane, jets: Jets, among: VehicleFlags, interval: Float[Array, ""], time: Instants
) -> tuple[VehicleFlags, States]:
    """Find the vehicles, among some, that stand still in this tick, and their states of rest.

    `jets` are y and its r derivatives now.
    """
    gain = lane.law.own_gain(lane.gain)
    rate, shape = jnp.maximum(1.0, control.norms(gain).sum(axis=0)), among.shape
    whole = jnp.concatenate([jnp.zeros_like(gain[:1]), gain])  # of y^(r+1), without the constant z

    def of_vehicles(leaf: Array) -> Array:
        spread = jnp.broadcast_to(leaf[..., None, :], (*leaf.shape[:-1], *shape))
        return spread.reshape(*leaf.shape[:-1], -1)

    def pace(jets: Jets) -> standstill.Pace:
        largest = jnp.stack([length(jet) for jet in jets[1:]]).max(axis=0)
        return jets[1], jets[2], math.e * of_vehicles(rate)[None] * largest  # within `flow.longest`

    def advance(jets: Jets, step: Float[Array, " all"]) -> Jets:
        return flow.propagate(flow.span_of(of_vehicles(whole), step, 0).flow, jets)

    each, longest = tuple(jet.reshape(2, 1, -1) for jet in jets), of_vehicles(flow.longest(gain))
    near = jnp.minimum(standstill.safe(*pace(each))[0], longest) < interval
    span = jnp.where(among.ravel() & near, interval, 0.0)

    def search(carry: tuple[Bool[Array, " all"], Jets]) -> tuple[Bool[Array, " all"], Jets]:
        return standstill.stands(pace, advance, carry[1], span, longest)

    still, end = run_if((span > 0).any(), search, (jnp.zeros_like(near), each))
    place, velocity, acceleration = (jet.reshape(2, *shape) for jet in end[:3])
    # Rounding bends a velocity of 1e-9 m/s.
    brakes = length(acceleration) > BRAKING * length(velocity)
    course = jnp.where(brakes[None], -acceleration, velocity)
    (place,) = vehicles.in_formation(lane, (place,), time)
    states = lane.vehicle.start(place, angle(course[0], course[1]), jnp.zeros(shape))
    return still.reshape(shape) & among, states
