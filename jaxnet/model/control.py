"""The control law: the jerk that a vehicle demands, from its own jets and the received messages.

    ε = y - Σ_j w_ij (y_j + a_ij),      P(y) = k0 y + k1 ẏ + k2 ÿ
    L q = a0 ⊗ y_0‴ + d‴ - P(ε),        q = y‴

A vehicle of order r has r gains. P then has the terms up to k_{r-1}, and q is the r-th derivative.
A gain may be a 2 × 2 matrix, which couples the axes.

The paper states the dense system `M u = …` with 2m unknowns, which the stacked engine solves.
Without ψ, that system becomes an m × m system with two right-hand sides, one for each axis.

P is linear. From each neighbour j, a vehicle therefore receives `P(y_j) + P(a_ij) + a_ij‴`. From
the navigator it receives y_0‴ in addition. The third derivatives of the neighbours are the
unknowns.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.model.hearing import AxisWeights, Hearing
from jaxnet.model.shapes import Numbers, OrderedJets, PlaneArray
from jaxnet.model.signal import Basis, Vectors

Gain = Float[Array, "r 2 2 *lanes"] | Float[Array, "r *lanes"]  # matrices, or numbers


def is_matrix(gain: Gain) -> bool:
    return gain.ndim > 2


def times_matrix(matrix: Float[Array, "2 2 *lanes"], vectors: PlaneArray) -> PlaneArray:
    """A matrix times vectors (2, …, *lanes)."""
    xp, lift = vectors.__array_namespace__(), [1] * (vectors.ndim + 1 - matrix.ndim)
    (xx, xy), (yx, yy) = matrix.reshape(2, 2, *lift, *matrix.shape[2:])
    return xp.stack([xx * vectors[0] + xy * vectors[1], yx * vectors[0] + yy * vectors[1]])


def feedback(gain: Gain, jets: OrderedJets) -> Numbers:
    """`P(y) = k0 y + k1 ẏ + …` of the jets of a signal, with a term for each of the r gains.

    Where gains are matrices, a jet has the two axes first. The function ignores derivatives of
    order r and above.
    """
    if is_matrix(gain):
        return sum(times_matrix(each, jet) for each, jet in zip(gain, jets, strict=False))
    lift = [1] * (jets[0].ndim + 1 - gain.ndim)
    first, *others = (each.reshape(*lift, *each.shape) for each in gain)
    total = first * jets[0]
    for order, each in enumerate(others, start=1):
        total = total + each * jets[order]
    return total


def driven(gain: Gain, jets: OrderedJets) -> Numbers:
    """`R(y) = y^(r) + P(y)` of the jets of a signal, at least r + 1 of them for r gains."""
    return feedback(gain, jets) + jets[len(gain)]


def drive_functions(gain: Gain, basis: Basis) -> Float[Array, "driving *lanes"]:
    """The functions of R(a) for a signal a with these functions β: R(β).

    Where gains are matrices, these are the functions with their r derivatives, the functions first.
    """
    if is_matrix(gain):
        return basis[: len(gain) + 1].reshape(-1, *basis.shape[2:])
    return driven(gain, basis)


def drive_vectors(gain: Gain, vectors: Vectors) -> Float[Array, "2 _ driving *lanes"]:
    """The vectors of R(a), which belong to `drive_functions`, for a signal with these vectors."""
    if is_matrix(gain):
        xp = vectors.__array_namespace__()
        return xp.concatenate([*(times_matrix(each, vectors) for each in gain), vectors], axis=2)
    return vectors


def gain_in_ticks(gain: Gain, powers: list[Float[Array, " lanes"]]) -> Gain:
    """Gains with time counted in ticks; `powers` are those of a tick [s], up to the order."""
    return jnp.stack([each * powers[len(gain) - k] for k, each in enumerate(gain)])


def norms(gain: Gain) -> Float[Array, "r *lanes"]:
    """The absolute gains; of matrices, their Frobenius norms."""
    return (gain**2).sum(axis=(1, 2)) ** 0.5 if is_matrix(gain) else abs(gain)


def demand(
    own: OrderedJets,
    path: Float[Array, "2 *lanes"],
    attack: Float[Array, "2 signals *lanes"],
    hearing: Hearing,
    weights: AxisWeights,
    gain: Gain,
) -> Float[Array, "2 m *lanes"]:
    """The right-hand side `a0 ⊗ y_0‴ + d‴ - P(ε)`; `path` is R(y_0), and `attack` is R(a)."""
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
    heeded: Bool[Array, "slots m"],
) -> Float[Array, "2 m *lanes"]:
    """`q = a0 ⊗ y_0^(r) - P(ε)`, for which no neighbour tells its r-th derivative.

    The navigator tells its r-th derivative to those who hear it, on `heeded` links. `own`,
    `navigator` and `signals` are the jets of the vehicles (2, m, lanes), the navigator (2, lanes)
    and the attacks (2, signals, lanes).
    """
    path, attack, order = feedback(gain, navigator), feedback(gain, signals), len(gain)
    nothing = jnp.zeros_like(own[0])
    highest = jnp.concatenate([navigator[order][:, None], nothing], axis=1)
    ahead = jnp.where(heeded[None, ..., None], weights, 0.0)
    below = demand(own, path, attack, hearing, weights, gain)
    return below + hearing.mean(ahead, highest, signals[order])


def damped(demand: PlaneArray, damping: Gain | None, own: OrderedJets) -> PlaneArray:
    """A demand less the damping of a vehicle's own derivatives, if there is any."""
    return demand if damping is None else demand - feedback(damping, own)
