"""The flow `expm(A_c h)` of the closed loop (theorems.md O1), and an axis' response to a disturbance."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxnet.model import control
from jaxnet.model.lane import Lane

NODES = (np.polynomial.legendre.leggauss(8)[0] + 1) / 2  # of the Gauss–Legendre rule on [0, 1]
SHARES = np.polynomial.legendre.leggauss(8)[1] / 2
TERMS = 18  # terms of the exponential's series; 1/18! is under rounding

Durations = Float[Array, "lanes"]
Transition = Float[Array, "3 3 lanes"]  # expm(A_c h)
Effect = Float[Array, "3 functions lanes"]  # g, the functions of G, with two derivatives
Responses = Float[Array, "nodes 3 lanes"]  # expm(A_c (1 - x) h) B at the NODES x


def propagate(flow: Transition, jets: Any) -> tuple[Any, Any, Any]:
    """Return `expm(A_c h)` times a signal and its two derivatives, each (..., lanes)."""
    y, velocity, acceleration, *_ = jets
    alike = (None,) * (y.ndim - 1)
    rows = ((row[0][alike], row[1][alike], row[2][alike]) for row in flow)
    a, b, c = (k[0] * y + k[1] * velocity + k[2] * acceleration for k in rows)
    return a, b, c


def of_integrators(time: Durations) -> Transition:
    """Return the flow of three integrators over a time [s]."""
    one, zero = jnp.ones_like(time), jnp.zeros_like(time)
    rows = [one, time, time**2 / 2], [zero, one, time], [zero, zero, one]
    return jnp.stack([jnp.stack(row) for row in rows])


def held_input(time: Durations) -> Effect:
    """Return the change of a signal and two derivatives by a third derivative of 1 held for a time [s]."""
    return jnp.stack([time**3 / 6, time**2 / 2, time])[:, None]


def longest(gain: control.Gain) -> Durations:
    """Return a time [s] over which the series of `brief` is exact to rounding."""
    return 1.0 / jnp.maximum(1.0, jnp.abs(gain).sum(axis=0))


def brief(gain: control.Gain, time: Durations) -> Transition:
    """Return the flow over a time [s] of at most `longest`, forward or back, by its power series."""
    identity = jnp.broadcast_to(jnp.eye(3)[:, :, None], (3, *gain.shape))

    def add(term: Any, total: Transition) -> Transition:
        last = -(gain[:, None] * total).sum(axis=0)
        shifted = jnp.stack([total[1], total[2], last])
        return identity + (time / (TERMS - term).astype(float))[None, None] * shifted

    return jax.lax.fori_loop(0, TERMS, add, identity)


def impulse_responses(gain: control.Gain, interval: Any) -> Responses:
    """Return the impulse responses over a tick of any length [s]."""
    identity = jnp.broadcast_to(jnp.eye(3)[1:, :, None], (2, *gain.shape))
    companion = jnp.concatenate([identity, -gain[None]]) * interval
    rest = companion[None] * (1 - NODES)[:, None, None, None]
    return jax.vmap(jax.vmap(jax.scipy.linalg.expm, -1, -1))(rest)[:, :, 2]


def brief_responses(gain: control.Gain, time: Durations) -> Responses:
    """Return the impulse responses over a time [s] of at most `longest`, forward or back."""
    return jax.vmap(lambda rest: brief(gain, rest * time))(jnp.asarray(1 - NODES))[:, :, 2]


def passed_on(
    effect: Effect, flow: Transition, responses: Responses, lane: Lane, time: Durations, interval: Any
) -> Effect:
    """Return g and its derivatives an interval later, where `g‴ + P(g) = R(β)`, from g now.

    `x(t + h) = expm(A_c h) x(t) + ∫ expm(A_c (h - s)) B R(β)(t + s) ds`, by Gauss–Legendre quadrature. The
    result is exact to rounding for functions that are smooth within the interval.
    """
    total, interval = jnp.stack(propagate(flow, effect)), jnp.broadcast_to(interval, time.shape)
    for node, share, answer in zip(NODES, SHARES, responses, strict=True):
        disturbance = control.driven(lane.gain, lane.signal.basis(time + node * interval))
        total = total + (share * interval)[None, None] * answer[:, None] * disturbance[None]
    return total
