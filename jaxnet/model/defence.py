"""Whom a vehicle keeps: from what it hears and what it remembers, the weights in force (paper, section 5.1).

A kind of defence is a type with `start(weights)`, its memory before anything was heard, and
`decide(weights, heard, memory, tolerance)`, which gives the new memory; `in_force(weights, memory)` are the
weights that follow from it. Arrays are by slot (see `hearing`).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

SlotWeights = Float[Array, "slots m *lanes"]
Dropped = Bool[Array, "slots m *lanes"]
Heard = Float[Array, "2 slots m *lanes"]


class KeepAll(NamedTuple):
    """No defence: everybody is believed."""

    def start(self, weights: SlotWeights) -> Dropped:
        """Nobody was dropped yet."""
        return jnp.zeros(weights.shape, bool)

    def decide(self, weights: SlotWeights, heard: Heard, memory: Dropped, tolerance: Any) -> Dropped:
        """Nobody is dropped, ever."""
        return memory

    def in_force(self, weights: SlotWeights, memory: Dropped) -> SlotWeights:
        """The graph's own weights."""
        return weights


class TrustedTrim(NamedTuple):
    """Drop the ϑ_i untrusted neighbours that lie farthest, on average, from the trusted ones.

    `trusted` marks slots, and `references` numbers the trusted slots of each listener, as many as
    `trusts` says. `protected` marks the vehicles that meet the condition for trimming; the others keep
    everyone.
    """

    trusted: Bool[Array, "slots m"]
    references: Int[Array, "most m"]
    trusts: Int[Array, " m"]
    protected: Bool[Array, " m"]
    theta: Int[Array, " m"]

    def start(self, weights: SlotWeights) -> Dropped:
        """Nobody was dropped yet."""
        return jnp.zeros(weights.shape, bool)

    def decide(
        self, weights: SlotWeights, heard: Heard, memory: Dropped, tolerance: Float[Array, "*lanes"]
    ) -> Dropped:
        """Slots dropped: the greatest scores, ties to the lower number.

        `tolerance` [m] is added to the score of those dropped last, so that rounding alone changes nobody's
        mind (SCIENCE O8).

        The farthest is dropped ϑ times over. The scores enter that loop as numbers already computed: left
        to itself, a compiler may evaluate a score twice and round it differently.
        """
        lanes = [1] * (weights.ndim - 2)
        slots = jnp.arange(len(weights))
        may_drop = (self.protected[None] & ~self.trusted).reshape(*self.trusted.shape, *lanes)
        theta = self.theta.reshape(-1, *lanes)
        score = self.deviation(heard) + jnp.where(memory, tolerance[None, None], 0.0)
        candidate = may_drop & (weights > 0)
        score = jnp.where(candidate, score, -jnp.inf)

        def farther(best: tuple[Any, Any], slot: tuple[Any, Any]) -> tuple[tuple[Any, Any], None]:
            number, score = slot
            beats = score > best[1]
            return (jnp.where(beats, number, best[0]), jnp.where(beats, score, best[1])), None

        def drop(carry: tuple[Any, Any]) -> tuple[Any, Any]:
            round_, score = carry
            nobody = jnp.full(score.shape[1:], -1), jnp.full(score.shape[1:], -jnp.inf)
            (farthest, _), _ = jax.lax.scan(farther, nobody, (slots, score))
            gone = (slots.reshape(-1, 1, *lanes) == farthest[None]) & (round_ < theta)[None]
            return round_ + 1, jnp.where(gone, -jnp.inf, score)

        rounds = jnp.max(self.theta)
        left = jax.lax.while_loop(lambda carry: carry[0] < rounds, drop, (jnp.zeros_like(rounds), score))[1]
        return candidate & (left == -jnp.inf)

    def in_force(self, weights: SlotWeights, memory: Dropped) -> SlotWeights:
        """Weights of the kept sources, renormalised to sum 1."""
        kept = jnp.where(memory, 0.0, weights)
        return kept / kept.sum(axis=0, keepdims=True)

    def deviation(self, heard: Heard) -> SlotWeights:
        """`Δ_ik`, mean distance [m] from what i hears of k to what it hears of those it trusts; else 0."""
        lanes = [1] * (heard.ndim - 3)
        listeners, distance = jnp.arange(heard.shape[2]), jnp.zeros(heard.shape[1:])
        for number, slot in enumerate(self.references):
            apart = heard - heard.at[:, slot, listeners].get(mode="promise_in_bounds")[:, None]
            counts = (number < self.trusts).reshape(1, -1, *lanes)
            distance = distance + jnp.where(counts, jnp.sqrt(apart[0] ** 2 + apart[1] ** 2), 0.0)
        return distance / jnp.maximum(1.0, self.trusts.astype(float)).reshape(1, -1, *lanes)


Defence = KeepAll | TrustedTrim


def trusted_trim(
    trusted: Bool[np.ndarray, "slots m"], protected: Bool[np.ndarray, " m"], theta: Int[np.ndarray, " m"]
) -> TrustedTrim:
    """The defence of listeners that trust these slots, as NumPy arrays."""
    trusts = trusted.sum(axis=0)
    references = np.argsort(~trusted, axis=0, kind="stable")[: max(1, int(trusts.max()))]
    return TrustedTrim(trusted, references, trusts, protected, theta)  # pyright: ignore[reportArgumentType]
