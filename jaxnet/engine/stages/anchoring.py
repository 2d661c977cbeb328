"""Vehicles that a defence holds to their own starts, by a share λ of what drives them.

    q_i = -λ P(y_i - y_i(0)) + (1 - λ) s_i (a0 y_0^(r) - P(ε_i))

A start y(0) is a place at rest. The strength of a row becomes `s' = λ + (1 - λ) s`, its weights
are times `(1 - λ) s / s'`, and `P(y(0)) λ / s'` is a known part of the drive: the local law again.
"""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.engine import vehicles
from jaxnet.engine.moment import Instants, LaneFlags, Moment
from jaxnet.engine.stages.known import Known, KnownDrive
from jaxnet.model import control
from jaxnet.model.hearing import AxisWeights
from jaxnet.model.lane import Lane
from jaxnet.model.polynomial import Polynomial

RowStrengths = Float[Array, "axes m lanes"]


class Pull(NamedTuple):
    """What moves vehicles under a local law: `s (known + Σ_j w_ij P(y_j) - P(y_i))`."""

    weights: AxisWeights
    known: Known
    strength: RowStrengths


class Anchor(eqx.Module):
    """What holds vehicles to their starts: nothing."""

    present: ClassVar[bool] = False

    def next(self, now: Moment) -> "Anchor":
        return self

    def held(self, lane: Lane, pull: Pull) -> Pull:
        """What moves vehicles that are held, of what moves them else."""
        return pull

    def changed(self, before: "Anchor", lanes: LaneFlags) -> LaneFlags:
        """Lanes, with some, in which the share changed."""
        return lanes


class Anchored(Anchor):
    """A share λ until the next tick."""

    share: Instants

    present: ClassVar[bool] = True

    def next(self, now):
        return Anchored(now.lane.defence.anchoring(now.time))

    def held(self, lane, pull):
        """A row that hears nobody has strength 0: it follows its start alone."""
        weights, known, strength = pull
        silent = known.silent((weights == 0).all(axis=1))
        share, free = self.share[None, None], 1.0 - self.share[None, None]
        total = share + free * jnp.where(silent, 0.0, strength)
        part = share / jnp.where(total > 0, total, 1.0)
        place, *_ = vehicles.first_outputs(lane)
        still = [jnp.zeros_like(place)] * (len(lane.gain) - 1)
        start = control.feedback(lane.gain, (place, *still))
        drive, begin = jnp.zeros_like(place)[None], jnp.zeros_like(self.share)
        if isinstance(known, KnownDrive):
            drive, begin = known.drive.terms, known.time
        drive = ((1.0 - part)[None] * drive).at[0].add(part * start)
        rows = part + (1.0 - part) * known.row_share(weights)
        there = KnownDrive(Polynomial(drive), rows, lane.interval, begin)
        return Pull((1.0 - part)[:, None] * weights, there, total)

    def changed(self, before, lanes):
        assert isinstance(before, Anchored)
        return lanes | (self.share != before.share)


def first_anchor(lane: Lane) -> Anchor:
    """What holds vehicles before the first tick: nothing yet."""
    time = jnp.zeros_like(lane.attack_scale)
    return Anchor() if lane.defence.anchoring(time) is None else Anchored(time)
