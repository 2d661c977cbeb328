"""The flow `expm(A_c h)` of the closed loop (theorems.md O1), and responses to a disturbance."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxnet.model import control
from jaxnet.model.lane import Lane
from jaxnet.model.polynomial import power, powers_of

NODES = (np.polynomial.legendre.leggauss(8)[0] + 1) / 2  # of the Gauss–Legendre rule on [0, 1]
SHARES = np.polynomial.legendre.leggauss(8)[1] / 2
TERMS = 18  # terms of the exponential's series; 1/18! is under rounding

Durations = Float[Array, "lanes"]
Transition = Float[Array, "r r 2 2 lanes"] | Float[Array, "r r lanes"]  # expm(A_c h)
Effect = Float[
    Array, "r functions lanes"
]  # g, the functions of G, with derivatives below the order r
Responses = Float[Array, "nodes r lanes"]  # expm(A_c (1 - x) h) B at the NODES x
PowerResponses = Float[Array, "r powers lanes"]


def propagate(flow: Transition, jets: Any) -> tuple[Any, ...]:
    """`expm(A_c h)` times a signal and its derivatives below the order r, each (..., lanes)."""
    if flow.ndim > 3:
        return tuple(control.feedback(row, jets) for row in flow)
    alike = (None,) * (jets[0].ndim - 1)

    def row_times(row: Float[Array, "r lanes"]) -> Any:
        total = row[0][alike] * jets[0]
        for order in range(1, len(flow)):
            total = total + row[order][alike] * jets[order]
        return total

    return tuple(row_times(row) for row in flow)


def of_integrators(time: Durations, order: int) -> Transition:
    """The flow of as many integrators over a time [s]."""
    rows = [[power(time, n - row) for n in range(order)] for row in range(order)]
    return jnp.stack([jnp.stack(row) for row in rows])


def held_input(time: Durations, order: int) -> Effect:
    """Change of a signal and its lower derivatives while this one is 1 for a time [s]."""
    return jnp.stack([power(time, n) for n in range(order, 0, -1)])[:, None]


def longest(gain: control.Gain) -> Durations:
    """A time [s] over which the series of `brief` is exact to rounding."""
    return 1.0 / jnp.maximum(1.0, control.norms(gain).sum(axis=0))


def brief(gain: control.Gain, time: Durations) -> Transition:
    """The flow over a time [s] of at most `longest`, forward or back, by its power series."""
    coupled = control.is_matrix(gain)
    one = jnp.eye(len(gain))[:, :, None]
    if coupled:
        one = one[..., None, None] * jnp.eye(2)[None, None, :, :, None]
    identity = jnp.broadcast_to(one, (len(gain), *gain.shape))

    def add(term: Any, total: Transition) -> Transition:
        if coupled:
            last = -jnp.einsum("kabl,kcbdl->cadl", gain, total)
        else:
            last = -(gain[:, None] * total).sum(axis=0)
        shifted = jnp.stack([*total[1:], last])
        return identity + (time / (TERMS - term).astype(float))[(None,) * gain.ndim] * shifted

    return jax.lax.fori_loop(0, TERMS, add, identity)


def impulse_responses(gain: control.Gain, interval: Any) -> Responses:
    """The impulse responses over a tick of any length [s]."""
    identity = jnp.broadcast_to(jnp.eye(len(gain))[1:, :, None], (len(gain) - 1, *gain.shape))
    companion = jnp.concatenate([identity, -gain[None]]) * interval
    rest = companion[None] * (1 - NODES)[:, None, None, None]
    return jax.vmap(jax.vmap(jax.scipy.linalg.expm, -1, -1))(rest)[:, :, -1]


def brief_responses(gain: control.Gain, time: Durations) -> Responses:
    """The impulse responses over a time [s] of at most `longest`, forward or back."""
    return jax.vmap(lambda rest: brief(gain, rest * time))(jnp.asarray(1 - NODES))[:, :, -1]


def power_responses(
    gain: control.Gain, span: Any, number: int, begin: Any = 0.0, share: Any = 1.0
) -> PowerResponses:
    """`∫ expm(A_c (T - s)) B σ^k / k! ds` over a span T [s] for k below `number`.

    σ goes from `begin` to `begin + share`. Nothing cancels, and nothing is divided by T: a piece of
    at most `longest` follows from `J_k = T (B / (k + 1)! + A_c J_{k+1})`, and a span from pieces
    that double.
    """
    span, share = (jnp.broadcast_to(each, gain.shape[1:]) for each in (span, share))
    doublings = jnp.ceil(jnp.log2(jnp.maximum(1.0, (jnp.abs(span) / longest(gain)).max())))
    piece = span / 2.0**doublings
    factorials = jnp.asarray([1 / math.factorial(k + 1) for k in range(number + TERMS)])

    def lower(k: Any, above: Float[Array, "r lanes"]) -> Float[Array, "r lanes"]:
        turned = jnp.stack([*above[1:], -(gain * above).sum(axis=0)])
        return piece[None] * turned.at[-1].add(factorials[k])

    highest, nothing = number + TERMS - 1, jnp.zeros_like(gain)
    each = [jax.lax.fori_loop(0, TERMS, lambda n, above: lower(highest - n, above), nothing)]
    for k in reversed(range(number)):
        each.append(lower(k, each[-1]))

    def double(
        _: Any, carry: tuple[Transition, PowerResponses]
    ) -> tuple[Transition, PowerResponses]:
        flow, half = carry
        whole = jnp.stack(propagate(flow, half)) + shifted(half, jnp.ones_like(span))
        return jnp.einsum("ijl,jkl->ikl", flow, flow), whole * shares(jnp.full_like(span, 0.5))

    def shares(share: Durations) -> Float[Array, "1 powers lanes"]:
        return jnp.stack([share**k for k in range(number)])[None]

    start = brief(gain, piece), jnp.stack(each[:0:-1], axis=1)
    _, found = jax.lax.fori_loop(0, doublings.astype(int), double, start)
    return shifted(found * shares(share), jnp.broadcast_to(begin, span.shape))


def shifted(responses: PowerResponses, by: Durations) -> PowerResponses:
    """The responses to `(σ + by)^k / k!` of those to σ^k / k!."""
    terms = powers_of(by, responses.shape[1])[:, None]
    each = (sum(responses[:, i] * terms[k - i] for i in range(k + 1)) for k in range(len(terms)))
    return jnp.stack(list(each), axis=1)


def passed_on(
    effect: Effect,
    flow: Transition,
    responses: Responses,
    lane: Lane,
    time: Durations,
    interval: Any,
) -> Effect:
    """G and its derivatives an interval later, where `R(g) = R(β)`, from g now.

    `x(t + h) = expm(A_c h) x(t) + ∫ expm(A_c (h - s)) B R(β)(t + s) ds`, by Gauss–Legendre
    quadrature. The result is exact to rounding for functions that are smooth within the interval.
    """
    total, interval = jnp.stack(propagate(flow, effect)), jnp.broadcast_to(interval, time.shape)
    for node, share, answer in zip(NODES, SHARES, responses, strict=True):
        disturbance = control.driven(lane.gain, lane.basis(time + node * interval))
        total = total + (share * interval)[None, None] * answer[:, None] * disturbance[None]
    return total
