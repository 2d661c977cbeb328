"""The law: from what a vehicle knows of itself and what it hears, the jerk that it wants.

    ε = y - Σ_j w_ij (y_j + a_ij),      P(y) = k0 y + k1 ẏ + k2 ÿ
    L q = a0 ⊗ y_0‴ + d‴ - P(ε),        q = y‴

It is the paper's `M u = …` with ψ taken out: 2m unknowns in one dense system become m with two right-hand
sides. P is linear, so a vehicle hears `P(y_j) + P(a_ij) + a_ij‴` from each neighbour j, and from the
navigator the same with y_0‴ on top; the neighbours' own third derivatives are what is solved for.
`definition` has the original.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.model.hearing import AxisWeights, Hearing

Gain = Float[Array, "3 *lanes"]


def feedback(gain: Gain, jets: Any) -> Any:
    """`P(y) = k0 y + k1 ẏ + k2 ÿ` of a signal's jets; further derivatives are left alone."""
    lift = [1] * (jets[0].ndim + 1 - gain.ndim)
    k0, k1, k2 = (each.reshape(*lift, *each.shape) for each in gain)
    return k0 * jets[0] + k1 * jets[1] + k2 * jets[2]


def driven(gain: Gain, jets: Any) -> Any:
    """`R(y) = y‴ + P(y)` of a signal's jets, of which there are four."""
    return feedback(gain, jets) + jets[3]


def demand(
    own: Any,
    path: Float[Array, "2 *lanes"],
    attack: Float[Array, "2 signals *lanes"],
    hearing: Hearing,
    weights: AxisWeights,
    gain: Gain,
) -> Float[Array, "2 m *lanes"]:
    """`a0 ⊗ y_0‴ + d‴ - P(ε)`, from a vehicle's own jets, `R(y_0)`, and `R(a)` of what attacks add."""
    mine = feedback(gain, own)
    sources = jnp.concatenate([path[:, None], mine], axis=1)
    return hearing.mean(weights, sources, attack) - mine
