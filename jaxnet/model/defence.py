"""Whom a vehicle keeps: from what it hears and what it remembers, the weights in force (paper, section 5.1).

A kind of defence is a type with `start()`, its memory before anything was heard, and
`decide(weights, heard, memory)`, which gives the weights in force and the new memory.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

Weights = Float[Array, "m sources"]
Links = Bool[Array, "m sources"]
Heard = Float[Array, "m sources 2"]


class KeepAll(NamedTuple):
    """No defence: everybody is believed."""

    def start(self) -> None:
        """Nothing to remember."""

    def decide(self, weights: Weights, heard: Heard, memory: None) -> tuple[Weights, None]:
        """The graph's own weights."""
        return weights, memory


class TrustedTrim(NamedTuple):
    """Drop the ϑ_i untrusted neighbours that lie farthest, on average, from the trusted ones.

    `protected` marks the vehicles that meet the condition for trimming; the others keep everyone.
    `tolerance` [m] is added to the score of those dropped last, so that rounding alone changes nobody's
    mind (SCIENCE O8); ties go to the lower number.
    """

    trusted: Links
    protected: Bool[Array, " m"]
    theta: Int[Array, " m"]
    tolerance: Float[Array, ""]

    def start(self) -> Links:
        """Nobody was dropped yet."""
        return jnp.zeros_like(self.trusted)

    def decide(self, weights: Weights, heard: Heard, memory: Links) -> tuple[Weights, Links]:
        """Weights of the kept sources, renormalised to sum 1, and the links dropped."""
        score = deviation(heard, self.trusted) + jnp.where(memory, self.tolerance, 0.0)
        candidate = (weights > 0) & ~self.trusted & self.protected[:, None]
        dropped = candidate & (ranks(score, candidate) < self.theta[:, None])
        kept = jnp.where(dropped, 0.0, weights)
        return kept / kept.sum(axis=1, keepdims=True), dropped


Defence = KeepAll | TrustedTrim


def deviation(heard: Heard, trusted: Links) -> Weights:
    """`Δ_ik`, the mean distance [m] from what i hears of k to what it hears of those it trusts; else 0."""
    x, y = heard[:, :, 0], heard[:, :, 1]
    distance = jnp.sqrt((x[:, :, None] - x[:, None]) ** 2 + (y[:, :, None] - y[:, None]) ** 2)
    total = jnp.where(trusted[:, :, None], distance, 0.0).sum(axis=1)
    return total / jnp.maximum(1.0, trusted.sum(axis=1, keepdims=True, dtype=float))


def ranks(score: Weights, candidate: Links) -> Int[Array, "m sources"]:
    """How many candidates of the same listener come before each: the greater score, then the lower number.

    By sorting, for a compiler may evaluate a score twice and round it differently: compared with itself it
    could then come before itself. A sort evaluates it once.
    """
    numbers = jnp.broadcast_to(jnp.arange(score.shape[1])[None], score.shape)
    farthest_first = jnp.where(candidate, -score, jnp.inf)
    _, order = jax.lax.sort((farthest_first, numbers), num_keys=1, is_stable=True)
    places = jnp.arange(score.shape[1])[None, None]
    return jnp.where(order[:, None] == numbers[:, :, None], places, 0).sum(axis=2)
