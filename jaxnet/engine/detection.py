"""Alarms about the words that arrive (theorems.md O17).

The prediction of a word is the jets of its source at the tick: a listener that knows the motion since the
last tick predicts them without error. The residual is then what attack and errors add.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.kinds.detectors import JudgedWords
from jaxnet.kinds.shapes import LaneTimes, Memory, SlotJets
from jaxnet.model.hearing import Hearing
from jaxnet.model.lane import Lane

SlotFlags = Bool[Array, "slots m lanes"]


class Detection(NamedTuple):
    """Alarms and judged words until now, of attacked links and of honest links."""

    alarms: Int[Array, "2 lanes"]
    words: Int[Array, "2 lanes"]
    memory: Memory  # of the detector

    @property
    def shares(self) -> Float[Array, "2 lanes"]:
        """Return alarms over words; not-a-number without a word."""
        return jnp.where(self.words > 0, self.alarms / jnp.maximum(self.words, 1), jnp.nan)


def first_detection(lane: Lane, hearing: Hearing) -> Detection | None:
    """Return that no word has been judged, None without a detector."""
    if lane.detector is None:
        return None
    nothing = jnp.zeros((2, *lane.attack_scale.shape), int)
    silent = (jnp.zeros((2, *lane.weights.shape)),) * len(lane.gain)
    words = judged_words(lane, hearing, silent, lane.weights > 0, jnp.zeros_like(lane.attack_scale))
    return Detection(nothing, nothing, lane.detector.start(words))


def judged_words(
    lane: Lane, hearing: Hearing, residuals: SlotJets, arrived: SlotFlags, time: LaneTimes
) -> JudgedWords:
    """Return words with these residuals [m, m/s, …], each divided by the deviation of its error."""
    variances = jnp.stack(word_variances(lane, hearing))
    noisy = variances > 0
    scale = jnp.where(noisy, 1.0 / jnp.sqrt(jnp.where(noisy, variances, 1.0)), 0.0)
    orders = noisy.sum(axis=0)
    whitened = scale[:, None] * jnp.stack(residuals)
    return JudgedWords(
        time, hearing.sources, whitened, orders, arrived & (orders > 0), lane.interval
    )


def word_variances(lane: Lane, hearing: Hearing) -> list[Float[Array, "slots m lanes"]]:
    """Return the variance of a word's error on each axis, for each order below that of the vehicles.

    Words of the navigator have no errors of sensors.
    """
    sources, noise = hearing.sources, lane.noise
    total = [jnp.zeros_like(lane.weights)] * len(lane.gain)
    of_links = None if noise is None else (noise, ~noise.exact_links(sources))
    of_sensors = None if lane.sensor is None else (lane.sensor, sources > 0)
    for kind, links in filter(None, (of_links, of_sensors)):
        for order, size in enumerate(kind.deviations()[: len(total)]):
            if size is not None:
                total[order] = total[order] + jnp.where(
                    links[..., None], size[None, None] ** 2, 0.0
                )
    return total


def detect(
    before: Detection,
    lane: Lane,
    hearing: Hearing,
    residuals: SlotJets,
    arrived: SlotFlags,
    time: LaneTimes,
) -> Detection:
    """Return the alarms after a tick at which words with these residuals arrived."""
    words = judged_words(lane, hearing, residuals, arrived & (lane.weights > 0), time)
    alarms, memory = lane.detector.alarms(words, before.memory)
    attacked = (hearing.added(jnp.abs(lane.vectors).sum(axis=2)) != 0).any(axis=0)
    links = jnp.stack([attacked & words.judged, ~attacked & words.judged])
    judged, raised = (each.sum(axis=(1, 2)) for each in (links, links & alarms[None]))
    return Detection(before.alarms + raised, before.words + judged, memory)
