"""The control law: the jerk that a vehicle demands, from its own jets and the received messages.

    ε = y - Σ_j w_ij (y_j + a_ij),      P(y) = k0 y + k1 ẏ + k2 ÿ
    L q = a0 ⊗ y_0‴ + d‴ - P(ε),        q = y‴

The paper states the dense system `M u = …` with 2m unknowns; `definition` implements it. Without ψ, that
system becomes an m × m system with two right-hand sides, one for each axis.

P is linear. From each neighbour j, a vehicle therefore receives `P(y_j) + P(a_ij) + a_ij‴`. From the
navigator it receives y_0‴ in addition. The third derivatives of the neighbours are the unknowns.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.model.hearing import AxisWeights, Hearing
from jaxnet.model.shapes import Numbers, OrderedJets

Gain = Float[Array, "3 *lanes"]


def feedback(gain: Gain, jets: OrderedJets) -> Numbers:
    """Return `P(y) = k0 y + k1 ẏ + k2 ÿ` of the jets of a signal.

    The function ignores derivatives of order 3 and above.
    """
    lift = [1] * (jets[0].ndim + 1 - gain.ndim)
    k0, k1, k2 = (each.reshape(*lift, *each.shape) for each in gain)
    return k0 * jets[0] + k1 * jets[1] + k2 * jets[2]


def driven(gain: Gain, jets: OrderedJets) -> Numbers:
    """Return `R(y) = y‴ + P(y)` of the four jets of a signal."""
    return feedback(gain, jets) + jets[3]


def demand(
    own: OrderedJets,
    path: Float[Array, "2 *lanes"],
    attack: Float[Array, "2 signals *lanes"],
    hearing: Hearing,
    weights: AxisWeights,
    gain: Gain,
) -> Float[Array, "2 m *lanes"]:
    """Return the right-hand side `a0 ⊗ y_0‴ + d‴ - P(ε)` of the law.

    `own` are the jets of the vehicles, `path` is R(y_0) of the navigator, and `attack` is R(a) of the attack
    signals.
    """
    mine = feedback(gain, own)
    sources = jnp.concatenate([path[:, None], mine], axis=1)
    return hearing.mean(weights, sources, attack) - mine
