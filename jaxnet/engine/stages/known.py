"""What is known at a tick until the next: kept drives, substituted and delayed messages, errors.

A message is X_j = R(y_j) plus R of the attack. What stands in place of live ones is a polynomial of
the share σ of the tick that has passed:

    L_r X = a0_live R(y_0) + W_live R(a) + Σ_k z_k σ^k / k!,      L_r = I - A_live.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.engine.moment import Instants, PerAxis
from jaxnet.model.hearing import AxisWeights, plus_slots
from jaxnet.model.polynomial import Polynomial
from jaxnet.model.shapes import LoopIndex

RowShare = Float[Array, "axes m *lanes"]
Drives = Float[Array, "degrees 2 m lanes"]
LinkDrives = Float[Array, "degrees 2 slots m lanes"]
LongerDrives = Float[Array, "more 2 m lanes"]
Demand = Float[Array, "2 m *lanes"]
AnyInstants = Float[Array, "*lanes"]
Silent = Bool[Array, "axes m lanes"]


class Known(eqx.Module):
    """What known messages add to the drives: nothing."""

    def plus(self, demand: Demand, time: AnyInstants) -> Demand:
        """A demand with what is known at a time."""
        return demand

    def silent(self, silent: Silent) -> Silent:
        """The rows, of some, that no known message reaches; all, where own jets are in messages."""
        return silent

    def row_share(self, weights: AxisWeights) -> RowShare:
        """Share of the weights of each row whose messages are not live; these are the others."""
        return jnp.zeros((len(weights), *weights.shape[2:]))

    def columns(self, attacks: list[PerAxis]) -> list[PerAxis]:
        """Right-hand sides of all functions: the attacks', then those of powers of σ."""
        return attacks

    def derivatives(self, time: Instants, span: Instants, order: int, demand: PerAxis) -> Drives:
        """Derivatives of order r, r + 1, … at a time, counted in spans; shaped as `demand`."""
        return jnp.zeros((0, *demand.shape))


class KnownDrive(Known):
    """A polynomial drive [m/s³] from a tick to the next."""

    drive: Polynomial
    share: RowShare  # of the weights of a row whose messages are not live
    interval: Instants  # from tick to tick [s]
    time: Instants  # of the tick [s]
    relative: bool = eqx.field(static=True, default=False)  # whether own jets are in messages

    def plus(self, demand, time):
        if len(self.drive.terms) == 1:
            return demand + self.drive.terms[0]
        return demand + self.drive.at((time - self.time) / self.interval)

    def silent(self, silent):
        return jnp.ones_like(silent) if self.relative else silent & (self.share == 0)

    def row_share(self, weights):
        return self.share

    def columns(self, attacks):
        return [*attacks, *self.drive.terms]

    def derivatives(self, time, span, order, demand):
        part, terms = span / self.interval, self.drive.terms
        if len(terms) > 1:
            terms = self.drive.about((time - self.time) / self.interval).terms
        factors = [span**order * part**n for n in range(len(terms))]
        return jnp.stack([each * by[None, None] for each, by in zip(terms, factors, strict=True)])


def padded(drive: Drives, degrees: int) -> LongerDrives:
    return jnp.pad(drive, [(0, degrees - len(drive)), *[(0, 0)] * 3])


def plus_messages(
    drive: Drives, weights: AxisWeights, messages: Float[Array, "more 2 slots m lanes"]
) -> LongerDrives:
    """A drive plus messages by weight."""

    def in_slot(slot: LoopIndex) -> Drives:
        return jax.lax.dynamic_index_in_dim(messages, slot, axis=2, keepdims=False)

    return plus_slots(padded(drive, len(messages)), weights, in_slot)
