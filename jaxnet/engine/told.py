"""Attacked vehicles that move as they tell: the path on their links is where they are.

The path is known in closed form, so no engine integrates it. The law's motion of such a vehicle
goes on, but nobody hears it.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from jaxnet.engine import vehicles
from jaxnet.engine.moment import Instants, PerAxis, VehicleFlags
from jaxnet.engine.vehicles import PerVehicle, States
from jaxnet.model import signal
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets
from jaxnet.model.signal import Basis


class ByLaw(eqx.Module):
    """What outputs show of vehicles that all move by the law."""

    def error(self, error: PerAxis) -> PerAxis:
        return error

    def states(self, states: States) -> States:
        return states

    def inputs(self, inputs: PerAxis) -> PerAxis:
        return inputs

    def pace(self, speed: PerVehicle, turn_rate: PerVehicle) -> tuple[PerVehicle, PerVehicle]:
        return speed, turn_rate


class AsTold(ByLaw):
    """What outputs show where the attacked vehicles move as they tell."""

    vehicles: VehicleFlags
    told_error: PerAxis
    told_states: States
    told_inputs: PerAxis
    told_pace: tuple[PerVehicle, PerVehicle]

    def theirs(self, told: Any, by_law: Any) -> Any:
        return jnp.where(self.vehicles, told, by_law)

    def error(self, error: PerAxis) -> PerAxis:
        return self.theirs(self.told_error, error)

    def states(self, states: States) -> States:
        return self.theirs(self.told_states, states)

    def inputs(self, inputs: PerAxis) -> PerAxis:
        return self.theirs(self.told_inputs, inputs)

    def pace(self, speed: PerVehicle, turn_rate: PerVehicle) -> tuple[PerVehicle, PerVehicle]:
        told_speed, told_turn_rate = self.told_pace
        return self.theirs(told_speed, speed), self.theirs(told_turn_rate, turn_rate)


def told_errors(lane: Lane, basis: Basis, errors: Jets) -> Jets:
    """Jets E, which are the signals where vehicles are attacked."""
    told, attacked = signal.jets(lane.vectors, basis), lying_vehicles(lane)
    return tuple(jnp.where(attacked, own, jet) for own, jet in zip(told, errors, strict=False))


def told_motion(lane: Lane, time: Instants, basis: Basis) -> AsTold:
    """The motion that attacked vehicles tell at these times [s]."""
    order = len(lane.gain)
    told = signal.jets(lane.vectors, basis)[: order + 1]
    jets = tuple(jet + path[:, None] for jet, path in zip(told, lane.path(time), strict=False))
    states = vehicles.states_of(lane, jets[:order], time)
    inputs = vehicles.inputs(lane, states, jets[order], time)
    pace = vehicles.pace_of(lane, states, inputs)
    return AsTold(lying_vehicles(lane), told[0], states, inputs, pace)


def lying_vehicles(lane: Lane) -> VehicleFlags:
    """Vehicles with a signal, where each vehicle has one."""
    return (lane.vectors != 0).any(axis=(0, 2))
