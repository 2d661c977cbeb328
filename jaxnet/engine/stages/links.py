"""Errors of the messages on links: noise, drawn at each tick, and rounding."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.engine.moment import Instants, Moment, PerAxis, PerLink, Received
from jaxnet.engine.stages.sensing import Sensed
from jaxnet.model import control, plane, xla
from jaxnet.model.control import Gain
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane

SomeReceived = tuple[PerLink | None, ...]  # None for an order without errors


class LinkErrors(eqx.Module):
    """Errors of the jets on links until the next tick.

    Errors of the r-th derivative come last, after `max(3, r)` errors of lower ones.
    """

    noise: SomeReceived = ()  # none where messages arrive without errors

    @property
    def present(self) -> bool:
        return bool(self.noise)

    def next(self, now: Moment, sensed: Sensed) -> "LinkErrors":
        if not self.present:
            return self
        lane, jets, last = now.lane, max(3, now.order), self.errors()
        sources, erring = now.network.hearing.sources, erring_orders(lane)

        def draw() -> SomeReceived:
            below = *last[:3], *last[jets:]
            found = list(lane.noise.next_errors(below, now.time, lane.interval, sources))
            found[3:3] = [None] * (jets - 3)
            return tuple(error if errs else None for error, errs in zip(found, erring, strict=True))

        return LinkErrors(xla.materialised(draw))

    def errors(self) -> Received:
        """Errors of all orders, also of those without."""
        if not self.present:
            return ()
        nothing = jnp.zeros_like(next(error for error in self.noise if error is not None))
        return tuple(nothing if error is None else error for error in self.noise)

    def of(self, received: Received) -> Received:
        """Jets below the order as they arrive."""
        return plane.plus(received, self.errors()) if self.present else received

    def of_highest(self, jet: PerLink, order: int) -> PerLink:
        """The r-th derivative as it arrives."""
        for error in self.errors()[max(3, order) :]:
            jet = jet + error
        return jet

    def of_message(self, gain: Gain, message: PerLink) -> PerLink:
        """R of the jets as it arrives."""
        return message + self.feedback(gain) if self.present else message

    def of_mean(self, gain: Gain, weights: AxisWeights, drive: PerAxis) -> PerAxis:
        """A drive plus R of the errors, by weight."""
        return drive + (weights * self.feedback(gain)).sum(axis=1) if self.present else drive

    def feedback(self, gain: Gain) -> PerLink:
        """`P(n) + n^(r)`."""
        return self.of_highest(control.feedback(gain, self.errors()), len(gain))


class Rounded(LinkErrors):
    """Noise and rounding: `noise` is their sum, `drawn` the noise alone."""

    drawn: LinkErrors = LinkErrors()

    def next(self, now, sensed):
        drawn, total = self.drawn.next(now, sensed), rounding_errors(now, sensed)
        return Rounded((*drawn.of(total), *drawn.errors()[len(total) :]), drawn)


def rounding_errors(now: Moment, sensed: Sensed) -> Received:
    """Errors of the jets that links carry now if each jet is rounded to a multiple of its step."""
    navigator = now.navigator[: now.order, :, None]
    own = sensed.of(now.own)
    sent = tuple(jnp.concatenate(both, axis=1) for both in zip(navigator, own, strict=False))

    def rounded(jet: PerLink, step: Instants) -> PerLink:
        unit = jnp.where(step > 0, step, 1.0)[None, None, None]
        return jnp.where((step > 0)[None, None, None], unit * jnp.round(jet / unit) - jet, 0.0)

    steps = now.lane.steps
    assert steps is not None
    found = xla.materialised(lambda: tuple(map(rounded, now.carried(sent), steps)))
    return *found, *[jnp.zeros_like(found[0])] * (3 - len(found))


def first_link_errors(lane: Lane) -> LinkErrors:
    """Errors before the first tick. Delayed messages are rounded when they are sent (`late`)."""
    silent: Float[Array, "2 slots m lanes"] = jnp.zeros((2, *lane.weights.shape))
    drawn = LinkErrors()
    if lane.noise is not None:
        drawn = LinkErrors(tuple(silent if errs else None for errs in erring_orders(lane)))
    if lane.steps is None or lane.delay is not None:
        return drawn
    return Rounded((silent,) * max(len(drawn.noise), 3, len(lane.gain)), drawn)


def erring_orders(lane: Lane) -> list[bool]:
    """Orders of the jets to which noise gives errors: `max(3, r)`, and then the r-th."""
    below = [*lane.noise.erring(), *[False] * (len(lane.gain) - 3)]
    return below + [True] * lane.noise.errs_in_highest()
