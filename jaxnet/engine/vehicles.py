"""The one place where the law's output meets a vehicle, with time.

The law steers outputs y, and asks for their r-th derivative q. Here y follows from a vehicle's
state and the input from q. A formation acts here for all engines. A filter and limits of inputs act
here for the sampled and the nonlinear engine: the exact one moves outputs, and never asks for
inputs.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.engine.moment import Instants, PerAxis
from jaxnet.engine.status import LEAST_MARGIN
from jaxnet.engine.subset import LaneIndices, for_each, picked, put
from jaxnet.model import plane
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets

States = Float[Array, "n m *lanes"]
PerVehicle = Float[Array, "m *lanes"]
Which = Bool[Array, "m *lanes"]
FILTERED_AT_ONCE = 16  # lanes


def outputs(lane: Lane, states: States, time: Instants) -> Jets:
    """Jets of what the law steers, below the order: of the outputs less the formation's offsets."""
    found = lane.vehicle.output_jets(states)
    if lane.formation is None:
        return found
    return tuple(jet - by for jet, by in zip(found, lane.offsets(time), strict=False))


def in_formation(lane: Lane, jets: Jets, time: Instants) -> Jets:
    """Jets of the outputs, from those of what the law steers."""
    if lane.formation is None:
        return jets
    return tuple(jet + by for jet, by in zip(jets, lane.offsets(time), strict=False))


def first_outputs(lane: Lane) -> Jets:
    """Jets of what the law steers at t = 0, which do not depend on the formation."""
    return lane.vehicle.output_jets(lane.initial)


def first_states(lane: Lane) -> States:
    """States of the vehicles at t = 0."""
    if lane.formation is None:
        return lane.initial
    inner = lane.vehicle.inner(lane.initial) if lane.vehicle.internal else None
    return states_of(lane, first_outputs(lane), jnp.zeros_like(lane.attack_scale), inner)


def states_of(lane: Lane, jets: Jets, time: Instants, inner: Any = None) -> States:
    """States of vehicles with these jets; `inner` are the states that outputs do not tell."""
    jets = in_formation(lane, jets, time)
    if inner is None:
        return lane.vehicle.state_of(jets)
    return lane.vehicle.state_with(jets, inner)


def drift(lane: Lane, states: States, time: Instants) -> PerAxis:
    """The r-th derivative, without input, of what the law steers."""
    found = lane.vehicle.drift(states)
    return found if lane.formation is None else found - lane.offsets(time)[len(lane.gain)]


def asked(
    lane: Lane,
    states: States,
    highest: PerAxis,
    time: Instants,
    lies: Callable[[], PerAxis] | None = None,
) -> PerAxis:
    """Inputs that the law and the filter ask for, for this r-th derivative of what the law steers.

    `lies` gives what each vehicle tells of its place beside the truth. Inputs are not-a-number
    where the filter admits none.
    """
    if lane.formation is not None:
        highest = highest + lane.offsets(time)[len(lane.gain)]
    if lane.filter is not None and lies is not None:
        highest = kept_apart(lane, states, highest, lies())
    return lane.vehicle.inputs_for(states, highest)


def kept_apart(lane: Lane, states: States, velocity: PerAxis, lies: PerAxis) -> PerAxis:
    """Velocities that the filter admits, sought in the lanes with one that it does not."""
    (own,) = lane.vehicle.output_jets(states)
    given = lane.filter, velocity, own, own + lies

    def some(few: LaneIndices, velocity: PerAxis) -> PerAxis:
        safety, *places = jax.tree.map(lambda leaf: picked(leaf, few), given)
        return put(velocity, few, safety.nearest(*places))

    breached = lane.filter.breached(*given[1:]).any(axis=0)
    return for_each(breached, FILTERED_AT_ONCE, some, velocity)


def admitted(lane: Lane, states: States, asked: PerAxis, time: Instants) -> PerAxis:
    """Inputs that reach the vehicles, of those asked for: within their limits, or of rest."""
    if lane.filter is not None:
        rest = lane.vehicle.inputs_for(states, jnp.zeros_like(asked))
        asked = jnp.where(jnp.isnan(asked), rest, asked)
    return lane.vehicle.within_limits(asked) if lane.vehicle.limits else asked


def rates(lane: Lane, states: States, asked: PerAxis, time: Instants) -> States:
    """Rates of the states of vehicles of which the law asks these inputs."""
    return lane.vehicle.motion(states, admitted(lane, states, asked, time))


def output_rates(lane: Lane, states: States, rates: States, time: Instants) -> tuple[Jets, Jets]:
    """Jets of the outputs of states, and their rates along these rates of the states."""

    def of(now: States, at: Instants) -> Jets:
        return outputs(lane, now, at)

    return jax.jvp(of, (states, time), (rates, jnp.ones_like(time)))


def pace_of(lane: Lane, states: States, inputs: PerAxis) -> tuple[PerVehicle, PerVehicle]:
    """Speed [m/s] and turn rate [rad/s]."""
    return lane.vehicle.pace(states, inputs)


def pace_of_jets(lane: Lane, jets: Jets, time: Instants) -> tuple[PerVehicle, PerVehicle] | None:
    """Speed and turn rate where the outputs' jets tell them."""
    return plane.pace(in_formation(lane, jets, time)) if lane.vehicle.jets_tell_pace else None


def highest_in_formation(lane: Lane, highest: PerVehicle) -> PerVehicle:
    """A bound on the norm of the outputs' r-th derivative, from that of what the law steers."""
    if lane.formation is None:
        return highest
    most = lane.formation.greatest(len(lane.gain))
    return highest + jnp.broadcast_to(most, highest.shape[1:])[None]


def standing(lane: Lane, place: PerAxis, heading: PerVehicle) -> States:
    """States of vehicles that stand at places with headings."""
    return lane.vehicle.start(place, heading, jnp.zeros_like(heading))


def ahead(lane: Lane, states: States) -> PerVehicle:
    """Distance from the singular set, negative where a vehicle has passed it since the start."""
    margin = lane.vehicle.margin
    return margin(states) * jnp.sign(margin(first_states(lane)))


def passed_singular(lane: Lane, states: States, apart: Which) -> Which:
    """Vehicles, not `apart`, that are singular or have been since the start."""
    return (ahead(lane, states) < LEAST_MARGIN) & ~apart


def singular(lane: Lane, states: States, apart: Which) -> Which:
    """Vehicles, not `apart`, with states in which the law is singular."""
    return (jnp.abs(lane.vehicle.margin(states)) < LEAST_MARGIN) & ~apart
