"""Vehicles that keep their last drive `z = y‴ + P(ŷ)` until the next tick; they sense ŷ.

A vehicle that hears nobody keeps it. So does a group of vehicles that hear only each other: the law
has no solution for such a group. If decisions alone cut a vehicle off from the navigator, its lane
fails, or the vehicle coasts: it keeps its last drive too, and stops for good where it comes to rest
(`stopping`). With `vehicle.standstill: stop` every vehicle stops where it comes to rest. The law
then has it keep the drive of a vehicle at rest.
"""

from dataclasses import replace
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.engine.moment import Instants, LaneFlags, Moment, PerAxis, VehicleFlags
from jaxnet.engine.plan import Plan
from jaxnet.engine.stages import stopping
from jaxnet.engine.stages.channel import Reception
from jaxnet.engine.stages.judging import Judged
from jaxnet.engine.stages.sensing import Sensed
from jaxnet.engine.stages.stopping import Rest, stops
from jaxnet.engine.vehicles import States
from jaxnet.model import control, xla
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets


def nobody(lane: Lane) -> VehicleFlags:
    return jnp.zeros(lane.weights.shape[1:], bool)


class Coasting(eqx.Module):
    """Vehicles that keep their drive: nobody ever does."""

    drives: ClassVar[bool] = False  # whether kept drives act

    def next(self, now: Moment, judged: Judged, heard: Reception, sensed: Sensed) -> "Coasting":
        """Vehicles that no believed message reaches at a tick keep their drive."""
        return self

    def moving(self, weights: AxisWeights) -> AxisWeights:
        """Weights of the vehicles that do not keep their drive."""
        return weights

    def kept(self, lane: Lane) -> VehicleFlags:
        """Vehicles that keep their drive."""
        return nobody(lane)

    def cut_off(self, lane: Lane) -> VehicleFlags:
        """Vehicles that decisions alone cut off; none where the lane fails for it."""
        return nobody(lane)

    def may_stop(self, lane: Lane) -> VehicleFlags:
        """Vehicles that stop where they come to rest."""
        return nobody(lane)

    def stopped(self, lane: Lane) -> VehicleFlags:
        """Vehicles that stand still for good."""
        return nobody(lane)

    def frozen(self, lane: Lane) -> VehicleFlags:
        """Vehicles whose motion until the next tick needs no integrator."""
        return nobody(lane)

    def drive(self, lane: Lane) -> PerAxis:
        """The drive that they keep, 0 for others [m/s³]."""
        return jnp.zeros_like(lane.initial[:2])

    def share(self, weights: AxisWeights) -> Float[Array, "axes m lanes"]:
        """1 for a row of weights whose vehicle keeps its drive, else 0."""
        return jnp.zeros((len(weights), *weights.shape[2:]))

    def at_rest(self, states: States) -> States:
        """States of vehicles, with those of rest for vehicles that have stopped."""
        return states

    def held(self, demand: PerAxis, last: PerAxis) -> PerAxis:
        """The r-th derivative that vehicles hold from now on, where others hold the demand."""
        return demand

    def changed(self, before: "Coasting", lanes: LaneFlags) -> LaneFlags:
        """Lanes, with some, in which what a stopped vehicle tells changed."""
        return lanes


class Unheard(Coasting):
    """Vehicles that hear nobody, under a law without a drive to keep."""

    vehicles: VehicleFlags

    def next(self, now, judged, heard, sensed):
        hears = (heard.usable(judged.in_force(now.lane)) > 0).any(axis=1)
        return replace(self, vehicles=(~hears).all(axis=0) | self.stopped(now.lane))

    def moving(self, weights):
        return jnp.where(self.vehicles[None, None], 0.0, weights)

    def kept(self, lane):
        return self.vehicles


class Coasts(Unheard):
    """Vehicles that keep their drive until the next tick."""

    kept_drive: PerAxis
    off: VehicleFlags

    drives: ClassVar[bool] = True

    def next(self, now, judged, heard, sensed):
        lane, hearing, off = now.lane, now.network.hearing, self.off
        if coasts(lane):
            off = cut_off(lane, now.network, judged, self)
        keeps = off | self.stopped(lane)
        if heard.lossy:
            links = heard.usable(judged.in_force(lane)) > 0
            alone = ~links.any(axis=1) | keeps[None]
            keeps = (alone | ~hearing.reached(links, alone)).any(axis=0)
        last = self.last_drive(now, sensed)
        kept = xla.materialised(lambda: jnp.where(keeps[None], last, 0.0))
        return replace(self, vehicles=keeps, kept_drive=kept, off=off)

    def last_drive(self, now: Moment, sensed: Sensed) -> PerAxis:
        """A vehicle that still keeps its drive keeps the same one."""
        return jnp.where(self.vehicles[None], self.kept_drive, now.last)

    def cut_off(self, lane):
        return self.off

    def drive(self, lane):
        return self.kept_drive

    def share(self, weights):
        return jnp.broadcast_to(self.vehicles[None].astype(float), weights[:, 0].shape)

    def held(self, demand, last):
        return jnp.where(self.vehicles[None], last, demand)


class Rests(Coasting):
    """Vehicles that stop where they come to rest."""

    standing: VehicleFlags  # they stand still for good
    soon: VehicleFlags  # they stop before the next tick, as known before the motion
    states: States  # of rest, of both

    def may_stop(self, lane):
        return jnp.ones_like(self.standing)

    def stopped(self, lane):
        return self.standing

    def frozen(self, lane):
        return self.standing | self.soon

    def at_rest(self, states):
        return jnp.where(self.standing[None], self.states, states)

    def at_tick(self, here: LaneFlags, found: Rest | None) -> Self:
        """Vehicles that stand at a tick: those that were to stop, and those that motion found."""
        soon, states = self.soon & here[None], self.states
        if found is not None:
            came = found.which & here[None] & ~(self.standing | self.soon)
            soon, states = soon | came, jnp.where(came[None], found.states, states)
        return replace(self, standing=self.standing | soon, soon=self.soon & ~soon, states=states)


class Halts(Rests, Unheard):
    """Vehicles that stop where they come to rest, under a law without a drive to keep."""

    def changed(self, before, lanes):
        assert isinstance(before, Halts)
        return lanes | xla.in_any_row(self.vehicles != before.vehicles)


class Stops(Rests, Coasts):
    """Vehicles stop where they come to rest: all of them, or those that are cut off."""

    def last_drive(self, now, sensed):
        """The drive of a vehicle that has stopped is P of what it senses."""
        still = control.feedback(now.lane.gain, sensed.of(now.own))
        return jnp.where(self.standing[None], still, super().last_drive(now, sensed))

    def may_stop(self, lane):
        return super().may_stop(lane) if stops(lane) else self.off

    def held(self, demand, last):
        return jnp.where(self.standing[None], 0.0, super().held(demand, last))

    def changed(self, before, lanes):
        assert isinstance(before, Stops)
        told = (self.kept_drive != before.kept_drive) & self.standing[None]
        return lanes | xla.in_any_row(told)

    def will_stop(
        self,
        lane: Lane,
        interval: Float[Array, ""],
        highest: PerAxis,
        own: Jets,
        sensed: Sensed,
        here: LaneFlags,
        time: Instants,
    ) -> "Stops":
        """Note the vehicles that stop before the next tick, in the lanes at a tick.

        `highest` is the r-th derivative until now, `own` are the vehicles' jets.
        """
        if not lane.law.needs_ticks():
            highest = self.kept_drive - control.feedback(lane.gain, sensed.of(own))
        among = self.off & ~self.standing & here[None]
        soon, states = stopping.rest_within_tick(lane, (*own, highest), among, interval, time)
        states = jnp.where(soon[None], states, self.states)
        return replace(self, soon=jnp.where(here[None], soon, self.soon), states=states)


def first_coasting(lane: Lane) -> Coasting:
    """Vehicles that keep their drive before the first tick: nobody."""
    if not (lane.lossy or coasts(lane) or stops(lane)):
        return Coasting()
    nobody_yet = nobody(lane)
    at_rest = nobody_yet, nobody_yet, jnp.zeros_like(lane.initial)
    if not lane.law.couples():
        return Halts(nobody_yet, *at_rest) if stops(lane) else Unheard(nobody_yet)
    coasting = nobody_yet, jnp.zeros_like(lane.initial[:2]), nobody_yet
    # Coasting vehicles can come to rest where the law is singular.
    rests = lane.singular and lane.vehicle.singular == 1 and not lane.vehicle.internal
    if not (stops(lane) or (coasts(lane) and rests)):
        return Coasts(*coasting)
    return Stops(*coasting, *at_rest)


def rests_on_the_way(lane: Lane, plan: Plan) -> bool:
    """Whether vehicles may rest whose motion is not known before: inputs are held, or limited."""
    unknown = plan.engine.samples or bool(lane.vehicle.limits)
    return unknown and isinstance(first_coasting(lane), Rests)


def coasts(lane: Lane) -> bool:
    """Whether vehicles that decisions cut off keep their drive."""
    return lane.defence.coasts() and lane.law.couples()


def keeps_drives(lane: Lane) -> bool:
    """Whether a vehicle may keep its drive under a law that couples vehicles."""
    return lane.lossy or coasts(lane) or stops(lane)


def cut_off(lane: Lane, network: Network, judged: Judged, coasting: Coasting) -> VehicleFlags:
    """Vehicles cut off by decisions without loss.

    A vehicle that has stopped passes on nothing. Where nobody coasts, others follow it all the
    same.
    """
    weights = judged.in_force(lane)
    on_its_way = ~coasting.stopped(lane)[None]
    heard = (weights > 0) & on_its_way[:, None]
    alone = (weights == 0).all(axis=1) & on_its_way
    if lane.turns is None and lane.alarms_cut:  # then alarms alone leave a vehicle without links
        alone = jnp.zeros_like(alone)
    if not coasts(lane):
        alone = alone | ~on_its_way
    return ~network.hearing.reached(heard, alone).all(axis=0)
