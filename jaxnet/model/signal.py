"""Signals as fixed vectors times scalar functions of time, `a_j(t) = Σ_b v_jb β_b(t)`.

Each function comes with three derivatives. Every linear effect of a signal follows from the vectors
alone and holds at all times. The most important one is the attack's effect on the fleet
(theorems.md O2). A harmonic has two functions, cos ωt and sin ωt.

The signal obeys `‖a_j^(k)‖ ≤ ‖V_j‖ ‖β^(k)‖`, with the spectral norm of `V_j = [v_j1 … v_jB]`. A
unit signal has ‖V_j‖ = 1.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from jaxtyping import Float

from jaxnet.model.circle import circle
from jaxnet.model.shapes import Numbers, OrderedJets, PlaneArray

ORDERS = (0, 1, 2, 3)  # orders of the derivatives in a received message

Vectors = Float[Any, "2 _ functions *lanes"]  # one set for each vehicle, or for each link
ByFunction = Float[Any, "functions 2 m *lanes"]  # vectors of the vehicles, by function
Basis = Float[Any, "derivatives functions *lanes"]  # β_b and its derivatives, three or as many as r


class Harmonic(NamedTuple):
    """The functions `cos ωt` and `sin ωt` of an angular frequency ω [rad/s], constant for ω = 0."""

    frequency: Any  # (lanes,)

    def basis(self, time: Numbers) -> Basis:
        """Both functions with three derivatives: (4, 2, lanes)."""
        return turning(*circle(self.frequency * time), self.frequency)


class Falsified(NamedTuple):
    """A signal in only some of the received orders of derivatives.

    The received orders therefore need not be derivatives of each other.
    """

    signal: Any  # has a method `basis`
    orders: Any  # (derivatives, lanes), the factor of each order, 0 for an order without the signal

    def basis(self, time: Numbers) -> Basis:
        return self.orders[:, None] * up_to(len(self.orders) - 1, self.signal.basis, time)


class OfInputs(NamedTuple):
    """A signal that attacked vehicles take as their input. No link carries it."""

    signal: Any  # has a method `basis`

    def basis(self, time: Numbers) -> Basis:
        return 0.0 * self.signal.basis(time)


class Apart(NamedTuple):
    """A signal with separate functions for each of n vehicles.

    The signal treats the n vehicles as lanes. The first functions of all vehicles come first, then
    their second functions.
    """

    signal: Any  # leaves (..., n, lanes)

    def basis(self, time: Numbers) -> Basis:
        """(derivatives, B · n, lanes); the inner signal runs with n · lanes as its lanes."""
        import jax

        xp, lanes = time.__array_namespace__(), time.ndim
        leaves, shape = jax.tree.flatten(self.signal)
        n = leaves[0].shape[-1 - lanes]
        flat = [leaf.reshape(*leaf.shape[: leaf.ndim - lanes - 1], -1) for leaf in leaves]
        alone = jax.tree.unflatten(shape, flat)
        times = xp.broadcast_to(time[None], (n, *time.shape)).reshape(-1)
        found = alone.basis(times)
        return found.reshape(len(found), -1, *time.shape)


def turning(cosine: Numbers, sine: Numbers, rate: Numbers | float) -> Numbers:
    """Cos and sin of an angle with constant rate [rad/s], with three derivatives: (4, 2, …).

    `cosine` and `sine` are the values at the present angle.
    """
    xp = cosine.__array_namespace__()
    now, ahead = xp.stack([cosine, sine]), xp.stack([-sine, cosine])
    rate = xp.broadcast_to(xp.asarray(rate), cosine.shape)[None]
    return xp.stack([now, rate * ahead, -(rate**2) * now, -(rate**3) * ahead])


def up_to(order: int, function: Callable[[Numbers], Numbers], time: Numbers) -> Numbers:
    """`function(time)`, with derivatives in the first axis up to this order, at least the third.

    A kind gives at least three derivatives. JAX differentiates the last one for higher orders.
    """
    found, rows = function(time), max(order + 1, len(ORDERS))
    if len(found) >= rows:
        return found if len(found) == rows else found[:rows]
    import jax
    import jax.numpy as jnp

    def below(now: Numbers) -> Numbers:
        return up_to(order - 1, function, now)

    time = jnp.asarray(time)
    lower, rates = jax.jvp(below, (time,), (jnp.ones_like(time),))
    return jnp.concatenate([lower, rates[-1:]])


def of_functions(response: ByFunction) -> Vectors:
    """Vectors in the order of axes that signals have, from those in the order of functions."""
    return response.__array_namespace__().moveaxis(response, 0, 2)


def combined(vectors: Vectors, functions: Numbers) -> PlaneArray:
    """`Σ_b v_jb β_b` (2, m, lanes) for functions (B, lanes)."""
    each = [vectors[:, :, b] * functions[b][None, None] for b in range(vectors.shape[2])]
    return sum(each[1:], each[0]) if each else vectors.sum(axis=2)


def jets(vectors: Vectors, basis: OrderedJets) -> tuple[PlaneArray, ...]:
    """A signal and its derivatives [m, m/s, …], one (2, m, lanes) for each order of the basis."""
    return tuple(combined(vectors, order) for order in basis)
