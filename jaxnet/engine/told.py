"""Attacked vehicles that move as they tell: the path on their links is where they are.

The path is known in closed form, so no engine integrates it. The law's motion of such a vehicle
goes on, but nobody hears it.
"""

from typing import Any

import jax.numpy as jnp

from jaxnet.engine import vehicles
from jaxnet.engine.metrics import Observation
from jaxnet.engine.moment import Instants, VehicleFlags
from jaxnet.model import signal
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis


def told_errors(lane: Lane, basis: Basis, errors: Jets) -> Jets:
    """Jets E, which are the signals where vehicles are attacked."""
    told, attacked = signal.jets(lane.vectors, basis), lying_vehicles(lane)
    return tuple(jnp.where(attacked, own, jet) for own, jet in zip(told, errors, strict=False))


def as_told(lane: Lane, time: Instants, basis: Basis, seen: Observation) -> Observation:
    """An observation with the states, inputs and pace that attacked vehicles tell."""
    order, lying = len(lane.gain), lying_vehicles(lane)
    told = signal.jets(lane.vectors, basis)[: order + 1]
    jets = tuple(jet + path[:, None] for jet, path in zip(told, lane.path(time), strict=False))
    states = vehicles.states_of(lane, jets[:order], time)
    inputs = vehicles.asked(lane, states, jets[order], time)
    speed, turn_rate = vehicles.pace_of(lane, states, inputs)

    def theirs(told: Any, by_law: Any) -> Any:
        return jnp.where(lying, told, by_law)

    return seen._replace(
        speed=theirs(speed, seen.speed),
        turn_rate=theirs(turn_rate, seen.turn_rate),
        state=theirs(states, seen.state),
        inputs_now=lambda: theirs(inputs, seen.inputs),
    )


def lying_vehicles(lane: Lane) -> VehicleFlags:
    """Vehicles with a signal, where each vehicle has one."""
    return (lane.vectors != 0).any(axis=(0, 2))
