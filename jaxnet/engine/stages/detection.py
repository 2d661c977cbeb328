"""Alarms about the messages that arrive (theorems.md O17).

The prediction of a message is the jets of its source at the tick: a listener that knows the motion
since the last tick predicts them without error. The residual is then what attack and errors add.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxnet.engine.moment import Instants, LinkFlags, Moment, tell
from jaxnet.engine.stages.channel import Reception
from jaxnet.engine.stages.links import LinkErrors
from jaxnet.engine.stages.sensing import Sensed
from jaxnet.kinds.detectors import JudgedWords
from jaxnet.kinds.shapes import Memory, SlotJets
from jaxnet.model import plane
from jaxnet.model.hearing import Hearing
from jaxnet.model.lane import Lane


class Alarms(eqx.Module):
    """Alarms until now: none, nobody tests messages."""

    def next(self, now: Moment, sensed: Sensed, links: LinkErrors, heard: Reception) -> "Alarms":
        return self

    @property
    def shares(self) -> Float[Array, "2 lanes"] | None:
        """Alarms over judged messages, of attacked and of honest links; None without a detector."""
        return None


class Detection(Alarms):
    """Alarms and judged messages until now, of attacked links and of honest links."""

    alarms: Int[Array, "2 lanes"]
    judged: Int[Array, "2 lanes"]
    memory: Memory  # of the detector

    def next(self, now, sensed, links, heard):
        """A residual is what a link carries minus what its source tells, plus the errors of both.

        It is the errors alone, to the last bit, where the link carries what the source tells.
        """
        lane, hearing, sent = now.lane, now.network.hearing, tell(sensed.of(now.errors))
        residuals = tuple(
            one - hearing.sent(told) for one, told in zip(now.carried(sent), sent, strict=True)
        )
        still = tuple(jnp.zeros_like(jet) for jet in now.errors)
        residuals = plane.plus(residuals, tuple(map(hearing.sent, tell(sensed.of(still)))))
        arrived = lane.weights > 0
        if heard.arrivals is not None:
            arrived = arrived & heard.arrivals
        messages = judged_messages(lane, hearing, links.of(residuals), arrived, now.time)
        alarms, memory = lane.detector.alarms(messages, self.memory)
        attacked = now.attacked_links()
        each = jnp.stack([attacked & messages.judged, ~attacked & messages.judged])
        judged, raised = (part.sum(axis=(1, 2)) for part in (each, each & alarms[None]))
        return Detection(self.alarms + raised, self.judged + judged, memory)

    @property
    def shares(self):
        return jnp.where(self.judged > 0, self.alarms / jnp.maximum(self.judged, 1), jnp.nan)


def first_alarms(lane: Lane, hearing: Hearing) -> Alarms:
    if lane.detector is None:
        return Alarms()
    nothing = jnp.zeros((2, *lane.attack_scale.shape), int)
    silent = (jnp.zeros((2, *lane.weights.shape)),) * len(lane.gain)
    time = jnp.zeros_like(lane.attack_scale)
    messages = judged_messages(lane, hearing, silent, lane.weights > 0, time)
    return Detection(nothing, nothing, lane.detector.start(messages))


def judged_messages(
    lane: Lane, hearing: Hearing, residuals: SlotJets, arrived: LinkFlags, time: Instants
) -> JudgedWords:
    """Messages with these residuals [m, m/s, …], each divided by the deviation of its error."""
    variances = jnp.stack(error_variances(lane, hearing))
    noisy = variances > 0
    scale = jnp.where(noisy, 1.0 / jnp.sqrt(jnp.where(noisy, variances, 1.0)), 0.0)
    orders = noisy.sum(axis=0)
    whitened = scale[:, None] * jnp.stack(residuals)
    judged = arrived & (orders > 0)
    return JudgedWords(time, hearing.sources, whitened, orders, judged, lane.interval)


def error_variances(lane: Lane, hearing: Hearing) -> list[Float[Array, "slots m lanes"]]:
    """Variance of a message's error per axis and order below r; the navigator has no sensor."""
    sources, noise = hearing.sources, lane.noise
    total = [jnp.zeros_like(lane.weights)] * len(lane.gain)
    of_links = None if noise is None else (noise, ~noise.exact_links(sources))
    of_sensors = None if lane.sensor is None else (lane.sensor, sources > 0)
    for kind, links in filter(None, (of_links, of_sensors)):
        for order, size in enumerate(kind.deviations()[: len(total)]):
            if size is not None:
                by = jnp.where(links[..., None], size[None, None] ** 2, 0.0)
                total[order] = total[order] + by
    return total
