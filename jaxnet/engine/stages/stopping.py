"""Vehicles that come to rest: they stop there, and stay stopped.

A vehicle that coasts moves by `y^(r) + P(y + n) = z` until the next tick, with its kept drive z and
the errors n of its sensor. Under a law that holds the r-th derivative, P is 0. The derivatives of y
obey a linear equation without a constant, so `standstill.stands` finds the first instant at which
the vehicle stands still (`rest_within_tick`). The motion of any vehicle is searched as a polynomial
(`rest_in`). Where inputs are held or limited, a vehicle comes to rest where its speed changes sign
(`rest_on_the_way`), also one that coasts.

The vehicle stops at that instant. Until the next tick its listeners hear what the law asked of it,
or z. From the next tick on the vehicle tells its place at rest. It never restarts, because the law
is singular at rest.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.engine import flow, standstill, vehicles
from jaxnet.engine.gauss import Window
from jaxnet.engine.moment import Instants, VehicleFlags
from jaxnet.engine.status import LEAST_MARGIN
from jaxnet.engine.subset import run_if
from jaxnet.engine.vehicles import PerVehicle, States
from jaxnet.kinds.vehicles import HEADING
from jaxnet.model import control
from jaxnet.model.circle import angle
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets, length
from jaxnet.model.polynomial import Polynomial

# [1/s] acceleration over speed, above which a vehicle that comes to rest brakes along its course
BRAKING = 1e3
MOST_SECANTS = 100


class Rest(NamedTuple):
    """Vehicles that have come to rest until now, and their states of rest."""

    which: VehicleFlags
    states: States

    def plus(self, new: "Rest") -> "Rest":
        return Rest(self.which | new.which, jnp.where(new.which[None], new.states, self.states))


def stops(lane: Lane) -> bool:
    """Whether every vehicle stops where it comes to rest."""
    return lane.vehicle.standstill == "stop"


def first_rest(lane: Lane, coasting: bool = False) -> Rest | None:
    """Vehicles at rest at t = 0: none; None where only vehicles that are cut off may stop.

    `coasting` says that the motion finds their rest too, not `rest_within_tick`.
    """
    if not (stops(lane) or coasting):
        return None
    return Rest(jnp.zeros(lane.initial.shape[1:], bool), jnp.zeros_like(lane.initial))


def at_rest(rest: Rest | None, frozen: VehicleFlags) -> VehicleFlags:
    """The frozen vehicles, and those that have come to rest until now."""
    return frozen if rest is None else frozen | rest.which


def each_vehicle(leaf: Array, shape: tuple[int, ...]) -> Array:
    """Numbers of lanes, (..., lanes), for each vehicle as a lane, (..., m times lanes)."""
    spread = jnp.broadcast_to(leaf[..., None, :], (*leaf.shape[:-1], *shape))
    return spread.reshape(*leaf.shape[:-1], -1)


def rest_of(lane: Lane, jets: Jets, time: Instants) -> States:
    """States of rest of vehicles that have come to rest with these jets, each (2, m, lanes)."""
    place, velocity, acceleration = jets[:3]
    # Rounding bends a velocity of 1e-9 m/s.
    brakes = length(acceleration) > BRAKING * length(velocity)
    course = jnp.where(brakes[None], -acceleration, velocity)
    (place,) = vehicles.in_formation(lane, (place,), time)
    return vehicles.standing(lane, place, angle(course[0], course[1]))


def rest_in(lane: Lane, window: Window, among: VehicleFlags) -> Rest:
    """Vehicles, among some, that come to rest in a window of time: each at its first instant."""
    shape, terms = among.shape, window.motion.terms
    each = Window(
        each_vehicle(window.start, shape),
        each_vehicle(window.length, shape),
        Polynomial(terms.reshape(*terms.shape[:2], 1, -1)),
    )
    highest, nobody = each.greatest_jerk(), jnp.zeros((1, among.size), bool)

    def pace(time: Instants) -> standstill.Pace:
        return standstill.onwards(lane.vehicle, each.jets_at(time), highest, nobody)

    near = standstill.safe(*pace(each.start))[0] < each.length
    span = jnp.where(among.ravel() & near, each.length, 0.0)
    still, end = standstill.stands(pace, jnp.add, each.start, span, each.length)
    still, jets = still & (span > 0), (*each.jets_at(end), each.jerk_at(end))
    jets = tuple(jet.reshape(2, *shape) for jet in jets)
    return Rest(still.reshape(shape), rest_of(lane, jets, window.start))


def rest_on_the_way(
    lane: Lane,
    before: States,
    then: States,
    which: VehicleFlags,
    after: Callable[[PerVehicle], States],
) -> Rest:
    """States of rest of vehicles that stop between two states; `after(share)` has those between.

    A bracket of the share shrinks by the secant method, and an end that stays counts half.
    """

    def under_way(carry: Any) -> Bool[Array, ""]:
        *_, found, number = carry
        missed = which & (jnp.abs(vehicles.ahead(lane, found)) >= LEAST_MARGIN)
        return missed.any() & (number < MOST_SECANTS)

    def one(carry: Any) -> Any:
        low, high, first, last, _, number = carry
        slope = jnp.maximum(first - last, jnp.finfo(float).tiny)
        share = jnp.clip(low + (high - low) * first / slope, low, high)
        found = after(jnp.where(which, share, 0.0))
        margin = vehicles.ahead(lane, found)
        moves = margin > 0
        low, first = jnp.where(moves, share, low), jnp.where(moves, margin, first / 2)
        high, last = jnp.where(moves, high, share), jnp.where(moves, last / 2, margin)
        return low, high, first, last, found, number + 1

    zero, first, last = jnp.zeros(which.shape), *(vehicles.ahead(lane, x) for x in (before, then))
    begin = zero, zero + 1.0, first, last, then, jnp.asarray(0)
    found = jax.lax.while_loop(under_way, one, begin)[4]
    return Rest(which, vehicles.standing(lane, found[:2], found[HEADING]))


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
        return each_vehicle(leaf, shape)

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
    end = tuple(jet.reshape(2, *shape) for jet in end)
    return still.reshape(shape) & among, rest_of(lane, end, time)
