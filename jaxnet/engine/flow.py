"""Flow of errors and kept drives over a span of time: one power series (theorems.md O1).

With the drive u of a vehicle, a polynomial of the share σ of a tick, `η̇ = A_c η + B u` has the
states (y, …, y^(r-1), u, …, u^(n-1)). The matrix of these states has an exponential, which holds
`expm(A_c h)` and the responses to `σ^k / k!`. Nothing cancels, and nothing is divided by the span:
a piece of at most `longest` follows from the series, and a longer span from pieces that double.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxnet.engine.subset import select
from jaxnet.model import control
from jaxnet.model.polynomial import powers_of, scaled

NODES = (np.polynomial.legendre.leggauss(8)[0] + 1) / 2  # of the Gauss–Legendre rule on [0, 1]
SHARES = np.polynomial.legendre.leggauss(8)[1] / 2
TERMS = 18  # terms of the exponential's series; 1/18! is under rounding

Durations = Float[Array, "lanes"]
Transition = Float[Array, "r r 2 2 lanes"] | Float[Array, "r r lanes"]


class Span(NamedTuple):
    """Motion over a span of time, forward or back."""

    length: Durations  # [s]
    flow: Transition  # expm(A_c h)
    powers: Float[Array, "r powers lanes"]  # response from rest to each σ^k / k!
    impulses: Float[Array, "nodes r lanes"] | None  # expm(A_c (1 - x) h) B at NODES, where needed


def span_of(
    gain: control.Gain,
    length: Any,
    powers: int,
    impulses: bool = False,
    begin: Any = 0.0,
    share: Any = 1.0,
) -> Span:
    """The motion over a span [s] in which σ goes from `begin` to `begin + share`."""
    length, begin, share = (jnp.broadcast_to(x, gain.shape[-1:]) for x in (length, begin, share))
    order, whole = len(gain), exponential(gain, length, powers, share)
    responses = jnp.zeros((order, 0, len(length)))
    if powers:  # (σ + begin)^k / k! by powers of σ
        terms = powers_of(begin, powers)[:, None]
        each = (
            sum(whole[:order, order + n] * terms[k - n] for n in range(k + 1))
            for k in range(powers)
        )
        responses = jnp.stack(list(each), axis=1)
    rest = None
    if impulses:
        rest = jax.vmap(lambda left: exponential(gain, left * length, 0, share)[:, -1])(
            jnp.asarray(1 - NODES)
        )
    return Span(length, whole[:order, :order], responses, rest)


def exponential(gain: control.Gain, length: Durations, powers: int, share: Durations) -> Any:
    """The flow of (y, …, y^(r-1), u, …, u^(powers-1)); gains that are matrices give blocks."""
    order, coupled = len(gain), control.is_matrix(gain)
    doublings = jnp.ceil(jnp.log2(jnp.maximum(1.0, jnp.abs(length) / longest(gain))))
    doublings = jnp.where(jnp.isfinite(doublings), doublings, 0.0)  # of each lane
    piece, by = length / 2.0**doublings, share / 2.0**doublings
    one = jnp.eye(order + powers)[:, :, None]
    if coupled:
        one = one[..., None, None] * jnp.eye(2)[None, None, :, :, None]
    identity = jnp.broadcast_to(one, (*one.shape[:-1], len(length)))

    def add(term: Any, total: Any) -> Any:
        own, known = total[:order], total[order:]
        if coupled:
            asked = -jnp.einsum("kabl,kcbdl->cadl", gain, own)
        else:
            asked = -(gain[:, None] * own).sum(axis=0)
        highest = asked + known[0] if powers else asked
        moved = scaled(jnp.stack([*own[1:], highest]), piece)
        if powers:
            above = scaled(jnp.stack([*known[1:], jnp.zeros_like(asked)]), by)
            moved = jnp.concatenate([moved, above])
        return identity + moved / (TERMS - term).astype(float)

    def double(number: Any, half: Any) -> Any:
        axes = "ijabl,jkbcl->ikacl" if coupled else "ijl,jkl->ikl"
        return select(number < doublings.astype(int), jnp.einsum(axes, half, half), half)

    start = jax.lax.fori_loop(0, TERMS, add, identity)
    return jax.lax.fori_loop(0, doublings.max().astype(int), double, start)


def propagate(flow: Transition, jets: Any) -> tuple[Any, ...]:
    """`expm(A_c h)` times a signal and its derivatives below the order r, each (..., lanes)."""
    return tuple(control.feedback(row, jets) for row in flow)


def longest(gain: control.Gain) -> Durations:
    """A time [s] over which the series of the exponential is exact to rounding."""
    return 1.0 / jnp.maximum(1.0, control.norms(gain).sum(axis=0))


def backward_reach(gain: control.Gain, span: Durations) -> Float[Array, "r lanes"]:
    """Bounds on the entries of the last row of `A_c expm(-A_c s)` for s up to a span [s].

    They give y^(r) at earlier times from the errors now. With absolute gains no term cancels.
    """
    sizes = control.norms(gain)
    return (sizes[:, None] * span_of(-sizes, span, 0).flow).sum(axis=0)
