"""Signals as fixed vectors times scalar functions of time, `a_j(t) = Σ_b v_jb β_b(t)`.

The functions come with three derivatives, so that whatever is linear in a signal, the attack's effect on the
fleet above all (SCIENCE O2), is found from the vectors alone and holds at all times. A harmonic has two of
them, cos ωt and sin ωt.

`‖a_j^(k)‖ ≤ ‖V_j‖ ‖β^(k)‖` with the spectral norm of `V_j = [v_j1 … v_jB]`; a unit signal has ‖V_j‖ = 1.
"""

from typing import Any, NamedTuple

from jaxtyping import Float

from jaxnet.model.circle import circle

ORDERS = (0, 1, 2, 3)  # of a path and its derivatives, as they are received

Vectors = Float[Any, "2 _ functions *lanes"]  # of vehicles, or of links
Basis = Float[Any, "4 functions *lanes"]  # β_b and its first three derivatives


class Harmonic(NamedTuple):
    """`cos ωt` and `sin ωt` of an angular frequency ω [rad/s]; constant where ω = 0."""

    frequency: Any  # (lanes,)

    def basis(self, time: Any) -> Any:
        """Both functions with their derivatives: (4, 2, lanes)."""
        return turning(*circle(self.frequency * time), self.frequency)


class Falsified(NamedTuple):
    """A signal of which only some orders are received, so that they need not be each other's derivatives."""

    signal: Any  # with a `basis`
    orders: Any  # (4, lanes), 1 for an order that is received, else 0

    def basis(self, time: Any) -> Any:
        """The signal's functions, with zeros in the other orders."""
        return self.orders[:, None] * self.signal.basis(time)


class Apart(NamedTuple):
    """A signal that each of n vehicles has with numbers, and so with functions, of its own.

    Vehicles are asked for as lanes are. All vehicles' first functions come first, then their second ones.
    """

    signal: Any  # leaves (..., n, lanes)

    def basis(self, time: Any) -> Any:
        """All functions: (4, B · n, lanes), with n · lanes for lanes."""
        import jax

        xp, lanes = time.__array_namespace__(), time.ndim
        leaves, shape = jax.tree.flatten(self.signal)
        n = leaves[0].shape[-1 - lanes]
        flat = [leaf.reshape(*leaf.shape[: leaf.ndim - lanes - 1], -1) for leaf in leaves]
        alone = jax.tree.unflatten(shape, flat)
        times = xp.broadcast_to(time[None], (n, *time.shape)).reshape(-1)
        return alone.basis(times).reshape(4, -1, *time.shape)


def turning(cosine: Any, sine: Any, rate: Any) -> Any:
    """`cos` and `sin` of an angle that grows at a constant rate, with three derivatives: (4, 2, …)."""
    xp = cosine.__array_namespace__()
    now, ahead = xp.stack([cosine, sine]), xp.stack([-sine, cosine])
    rate = xp.broadcast_to(xp.asarray(rate), cosine.shape)[None]
    return xp.stack([now, rate * ahead, -(rate**2) * now, -(rate**3) * ahead])


def combined(vectors: Any, functions: Any) -> Any:
    """`Σ_b v_jb β_b` (2, m, lanes) for functions (B, lanes)."""
    total = vectors[:, :, 0] * functions[0][None, None]
    for b in range(1, vectors.shape[2]):
        total = total + vectors[:, :, b] * functions[b][None, None]
    return total


def jets(vectors: Any, basis: Any) -> tuple[Any, ...]:
    """A signal and as many derivatives as the functions have [m, m/s, …], each (2, m, lanes)."""
    return tuple(combined(vectors, order) for order in basis)
