"""Scores of received messages; removal of the greatest, slot by slot (paper, section 5.1)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.model import ties
from jaxnet.model.plane import length
from jaxnet.model.shapes import LoopIndex

Mask = Bool[Array, "slots m lanes"]
Scores = Float[Array, "slots m lanes"]
BestSlots = tuple[Int[Array, "..."], Float[Array, "m lanes"]]  # number of a slot, and its score


def trusted_shares(trusted: Mask, references: Int[Array, "most m"]) -> Float[Array, "most m lanes"]:
    """The share of each reference in the mean over the trusted references, 0 for an untrusted slot.

    `references` lists the slots that may serve as reference, for each vehicle.
    """
    listeners = jnp.arange(trusted.shape[1])[None]
    counts = trusted.at[references, listeners].get(mode="promise_in_bounds")
    return counts.astype(float) / jnp.maximum(1, trusted.sum(axis=0)).astype(float)[None]


def deviation(
    received: Float[Array, "axes slots m lanes"],
    shares: Float[Array, "most m lanes"],
    references: Int[Array, "most m"],
) -> Scores:
    """`Δ_ik`, the mean distance of source k's message to the trusted messages at listener i.

    The score is 0 without trusted references. The first axis of `received` has the components of a
    position [m], or more components.
    """
    listeners, distance = jnp.arange(received.shape[2]), jnp.zeros(received.shape[1:])
    for slot, share in zip(references, shares, strict=True):
        apart = received - received.at[:, slot, listeners].get(mode="promise_in_bounds")[:, None]
        distance = distance + share[None] * length(apart)
    return distance


def stiffened(score: Scores, retained: Mask, tolerance: Float[Array, " lanes"]) -> Scores:
    """Add a tolerance [m] to the scores of the sources that the previous decision dropped."""
    return score + jnp.where(retained, 0.0, tolerance[None, None])


def filtered(
    score: Scores,
    before: Scores,
    interval: Float[Array, " lanes"],
    constant: Float[Array, " lanes"],
) -> Scores:
    """Low-pass filtered scores, `s ← s + (1 - e^{-h/T}) (Δ - s)`.

    `interval` is h [s], infinite at the first tick, where the result is the score itself.
    `constant` is T [s].
    """
    first = jnp.isinf(interval)[None, None]
    share = -jnp.expm1(-interval / constant)[None, None]
    return jnp.where(first, score, before + share * (score - before))


def farthest(score: Scores, candidates: Mask, theta: Int[Array, " m"]) -> Mask:
    """The ϑ candidates with the greatest scores.

    The lowest slot wins among tied scores (`ties`). A loop selects the greatest score ϑ times. The
    scores enter the loop as computed numbers. Otherwise a compiler may evaluate a score twice with
    different rounding.
    """
    slots = jnp.arange(len(score), dtype=jnp.int32)
    score = jnp.where(candidates, score, -jnp.inf)

    def farther(best: BestSlots, slot: BestSlots) -> tuple[BestSlots, None]:
        number, score = slot
        beats = ties.over(score, best[1])
        return (jnp.where(beats, number, best[0]), jnp.where(beats, score, best[1])), None

    def take(carry: tuple[LoopIndex, Mask]) -> tuple[LoopIndex, Mask]:
        turn, taken = carry
        nobody = jnp.full(score.shape[1:], -1, jnp.int32), jnp.full(score.shape[1:], -jnp.inf)
        left = jnp.where(taken, -jnp.inf, score)
        # Unrolled: 1.08 times, trimming, 12 vehicles and 1,000.
        number = jax.lax.scan(farther, nobody, (slots, left), unroll=8)[0][0]
        return turn + 1, taken | (slots[:, None, None] == number[None]) & (turn < theta)[
            None, :, None
        ]

    turns = jnp.max(theta)
    carry = jnp.zeros_like(turns), jnp.zeros_like(candidates)
    return jax.lax.while_loop(lambda carry: carry[0] < turns, take, carry)[1]
