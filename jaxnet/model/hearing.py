"""Who hears whom, slot by slot, and what they hear.

A vehicle has as many slots as the busiest listener has sources, filled in the order of their numbers. One
left over holds the listener itself, with weight 0. So a graph's arrays are (slots, m), whatever m².
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

SlotWeights = Float[Array, "slots m *lanes"]


class Hearing(NamedTuple):
    """The source in each slot of each listener, 0 the navigator, and on which links lies are told."""

    sources: Int[Array, "slots m"]
    attacked: Bool[Array, "slots m"]

    def told(self, sources: Float[Array, "2 n *lanes"]) -> Float[Array, "2 slots m *lanes"]:
        """What each slot's source says, of what the navigator and the vehicles say (n = m + 1)."""
        return sources.at[:, self.sources].get(mode="promise_in_bounds")

    def lies(self, signal: Float[Array, "2 m *lanes"]) -> Float[Array, "2 slots m *lanes"]:
        """What is added on each link: a listener's own signal to the navigator, else the transmitter's."""
        liar = jnp.where(self.sources > 0, self.sources - 1, jnp.arange(self.sources.shape[1])[None])
        attacked = self.attacked.reshape(1, *self.attacked.shape, *[1] * (signal.ndim - 2))
        return jnp.where(attacked, signal.at[:, liar].get(mode="promise_in_bounds"), 0.0)

    def heard(
        self, sources: Float[Array, "2 n *lanes"], signal: Float[Array, "2 m *lanes"]
    ) -> Float[Array, "2 slots m *lanes"]:
        """What is heard in each slot, lies included."""
        return self.told(sources) + self.lies(signal)

    def mean(
        self,
        weights: SlotWeights,
        sources: Float[Array, "2 n *lanes"],
        signal: Float[Array, "2 m *lanes"],
    ) -> Float[Array, "2 m *lanes"]:
        """`Σ_j w_ij (y_j + a_ij)`, the weighted mean of what is heard, slot by slot."""

        def add(total: jax.Array, slot: tuple[jax.Array, Hearing]) -> tuple[jax.Array, None]:
            weight, one = slot
            return total + weight[None] * one.heard(sources, signal)[:, 0], None

        each = Hearing(self.sources[:, None], self.attacked[:, None])
        return jax.lax.scan(add, jnp.zeros_like(signal), (weights, each))[0]

    def matrix(self, weights: SlotWeights) -> Float[Array, "m n *lanes"]:
        """The graph's `[a0 | A]` from weights by slot."""
        slots, m = self.sources.shape
        dense = jnp.zeros((m, m + 1, *weights.shape[2:]))
        listeners = jnp.broadcast_to(jnp.arange(m)[None], (slots, m))
        return dense.at[listeners, self.sources].add(weights)


def slots(weights: Float[np.ndarray, "m n"]) -> Int[np.ndarray, "slots m"]:
    """Sources of a graph's listeners slot by slot."""
    heard = weights > 0
    most, m = int(heard.sum(axis=1).max()), len(weights)
    table = np.broadcast_to(np.arange(1, m + 1), (most, m)).copy()
    for listener in range(m):
        sources = np.flatnonzero(heard[listener])
        table[: len(sources), listener] = sources
    return table


def by_slot(matrix: np.ndarray, sources: Int[np.ndarray, "slots m"]) -> np.ndarray:
    """An array over (m, n, …) links by slot: (slots, m, …)."""
    return matrix[np.arange(sources.shape[1])[None], sources]
