"""The control law: the jerk that a vehicle demands, from its own jets and the received messages.

    ε = y - Σ_j w_ij (y_j + a_ij),      P(y) = k0 y + k1 ẏ + k2 ÿ
    L q = a0 ⊗ y_0‴ + d‴ - P(ε),        q = y‴

A vehicle of order r has r gains. P then has the terms up to k_{r-1}, and q is the r-th derivative.

The paper states the dense system `M u = …` with 2m unknowns; `definition` implements it. Without ψ, that
system becomes an m × m system with two right-hand sides, one for each axis.

P is linear. From each neighbour j, a vehicle therefore receives `P(y_j) + P(a_ij) + a_ij‴`. From the
navigator it receives y_0‴ in addition. The third derivatives of the neighbours are the unknowns.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxnet.model.hearing import AxisWeights, Hearing
from jaxnet.model.shapes import Numbers, OrderedJets

Gain = Float[Array, "r *lanes"]


def feedback(gain: Gain, jets: OrderedJets) -> Numbers:
    """Return `P(y) = k0 y + k1 ẏ + …` of the jets of a signal, with a term for each of the r gains.

    The function ignores derivatives of order r and above.
    """
    lift = [1] * (jets[0].ndim + 1 - gain.ndim)
    first, *others = (each.reshape(*lift, *each.shape) for each in gain)
    total = first * jets[0]
    for order, each in enumerate(others, start=1):
        total = total + each * jets[order]
    return total


def driven(gain: Gain, jets: OrderedJets) -> Numbers:
    """Return `R(y) = y^(r) + P(y)` of the jets of a signal, at least r + 1 of them for r gains."""
    return feedback(gain, jets) + jets[len(gain)]


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


def local_demand(
    own: OrderedJets,
    navigator: OrderedJets,
    signals: OrderedJets,
    hearing: Hearing,
    weights: AxisWeights,
    gain: Gain,
) -> Float[Array, "2 m *lanes"]:
    """Return `q = a0 ⊗ y_0^(r) - P(ε)`, for which no neighbour tells its r-th derivative.

    A vehicle with weights 0 has q = 0. The navigator tells its r-th derivative to those who hear it. `own`,
    `navigator` and `signals` are the jets of the vehicles (2, m, lanes), the navigator (2, lanes) and the
    attacks (2, signals, lanes).
    """
    mine, path, order = feedback(gain, own), feedback(gain, navigator), len(gain)
    sources = jnp.concatenate([path[:, None], mine], axis=1)
    told = jnp.concatenate([navigator[order][:, None], jnp.zeros_like(mine)], axis=1)
    ahead = jnp.where((hearing.sources == 0)[None, ..., None], weights, 0.0)
    heard = hearing.mean(weights, sources, feedback(gain, signals))
    asked = heard + hearing.mean(ahead, told, signals[order]) - mine
    return jnp.where((weights == 0).all(axis=1), 0.0, asked)
