"""Attacked vehicles that move as they tell: the path on their links is where they are.

The path is known in closed form, so no engine integrates it. The law's motion of such a vehicle goes on, but
nobody hears it.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.engine.stepper import States
from jaxnet.engine.tick import Instants, VehicleFlags
from jaxnet.model import signal
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets
from jaxnet.model.shapes import Numbers
from jaxnet.model.signal import Basis


class ToldMotion(NamedTuple):
    """The motion that attacked vehicles tell, and which vehicles these are."""

    vehicles: VehicleFlags
    errors: Jets  # E and its derivatives below the order
    states: States
    inputs: Float[Array, "2 m lanes"]
    pace: tuple[Float[Array, "m lanes"], Float[Array, "m lanes"]]

    def instead_of(self, told: Numbers, of_law: Numbers) -> Numbers:
        """Return what is told, of the attacked vehicles, and what follows from the law, of others."""
        return jnp.where(self.vehicles, told, of_law)


def told_errors(lane: Lane, basis: Basis, errors: Jets) -> Jets:
    """Return the jets E, which are the signals where vehicles are attacked."""
    told, attacked = signal.jets(lane.vectors, basis), lying_vehicles(lane)
    return tuple(jnp.where(attacked, own, jet) for own, jet in zip(told, errors, strict=False))


def told_motion(lane: Lane, time: Instants, basis: Basis) -> ToldMotion:
    """Return the motion that attacked vehicles tell at these times [s]."""
    order, vehicle = len(lane.gain), lane.vehicle
    told = signal.jets(lane.vectors, basis)[: order + 1]
    jets = tuple(jet + path[:, None] for jet, path in zip(told, lane.path(time), strict=False))
    states = vehicle.state_of(jets[:order])
    inputs = vehicle.inputs_for(states, jets[order])
    return ToldMotion(
        lying_vehicles(lane), told[:order], states, inputs, vehicle.pace(states, inputs)
    )


def lying_vehicles(lane: Lane) -> VehicleFlags:
    """Return the vehicles with a signal, where each vehicle has one."""
    return (lane.vectors != 0).any(axis=(0, 2))
