"""Sense: a vehicle senses its own jets, with errors that stay the same until the next tick."""

import equinox as eqx
import jax.numpy as jnp

from jaxnet.engine.moment import Instants, Moment, PerAxis
from jaxnet.model import control, plane, xla
from jaxnet.model.control import Gain
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets
from jaxnet.model.signal import ByFunction


class Sensed(eqx.Module):
    """What vehicles sense of themselves until the next tick."""

    noise: Jets = ()  # errors of a sensor, drawn anew at each tick; none without a sensor

    @property
    def errs(self) -> bool:
        return bool(self.noise)

    def next(self, now: Moment) -> "Sensed":
        return Sensed(fresh_errors(now.lane, self.noise, now.time)) if self.errs else self

    def of(self, jets: Jets) -> Jets:
        return plane.plus(jets, self.noise) if self.errs else jets

    def jerk(self, gain: Gain, drive: PerAxis, own: Jets) -> PerAxis:
        """The r-th derivative `z - P(ŷ)` under a drive."""
        return drive - control.feedback(gain, self.of(own))

    def drive(self, gain: Gain, jerk: PerAxis, own: Jets) -> PerAxis:
        """The drive `y^(r) + P(ŷ)` of an r-th derivative."""
        return jerk + control.feedback(gain, self.of(own))

    def less_feedback(self, gain: Gain, drive: PerAxis) -> PerAxis:
        """A drive minus P of the errors."""
        return drive - control.feedback(gain, self.noise) if self.errs else drive

    def pushed(self, gain: Gain, response: ByFunction, place: int) -> ByFunction:
        """The response, where `-P(n)` joins the constant drive at a place."""
        if not self.errs:
            return response
        return response.at[place].add(-control.feedback(gain, self.noise))


class Stale(Sensed):
    """Readings with errors, of which some stay what they were at the last tick."""

    fresh: Jets = ()  # errors of the readings that are new
    reading: Jets = ()  # relative to no navigator

    def next(self, now):
        fresh, own, sensor = fresh_errors(now.lane, self.fresh, now.time), now.own, now.lane.sensor
        stays = xla.materialised(lambda: sensor.stays(now.time, own[0].shape[1]))[None]
        each = zip(self.reading, own, fresh, strict=False)
        held = [jnp.where(stays, old - jet, new) for old, jet, new in each]
        noise = (*held, *fresh[len(held) :])
        return Stale(noise, fresh, plane.plus(own, noise))


def fresh_errors(lane: Lane, last: Jets, time: Instants) -> Jets:
    """Errors of the readings of a tick. A sensor gives three; further jets are sensed exactly."""
    errors = xla.materialised(lambda: lane.sensor.next_errors(last[:3], time, lane.interval))
    return *errors, *[jnp.zeros_like(errors[0])] * (len(lane.gain) - len(errors))


def first_sensed(lane: Lane) -> Sensed:
    if lane.sensor is None:
        return Sensed()
    zero, order = jnp.zeros_like(lane.initial[:2]), len(lane.gain)
    noise = (zero,) * max(3, order)
    if lane.sensor.stays(jnp.zeros_like(lane.attack_scale), zero.shape[1]) is None:
        return Sensed(noise)
    return Stale(noise, noise, (zero,) * order)
