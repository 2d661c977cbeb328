"""Adaptive Runge-Kutta steps from one instant to the next, with diffrax's solvers and step size control."""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.status import Code, Status, fail

SOLVERS = {"dopri5": diffrax.Dopri5, "tsit5": diffrax.Tsit5, "dopri8": diffrax.Dopri8}
ROUNDING = 4 * 2.0**-52  # a relative step below this no longer moves the time

Time = Float[Array, ""]
VectorField = Callable[..., Any]  # of time, state and arguments


class Tolerances(NamedTuple):
    """Local error `rtol·|state| + atol` (root mean square over the lane) and the steps allowed per lane."""

    rtol: Float[Array, ""]
    atol: Float[Array, ""]
    max_steps: Int[Array, ""]


class Stepper(NamedTuple):
    """Where the integration stands."""

    state: Float[Array, "m 6"]
    step: Float[Array, ""]  # [s] proposed for the next attempt
    steps: Int[Array, ""]  # attempts so far, accepted and rejected
    status: Code


def start(
    field: VectorField, solver: str, state: Any, args: Any, tolerances: Tolerances, interval: Time
) -> Stepper:
    """Stepper at time 0 with a first step by the usual heuristics (Hairer, Nørsett, Wanner, II.4)."""
    method, term = SOLVERS[solver](), diffrax.ODETerm(field)
    first, _ = controller(tolerances).init(
        term, jnp.zeros(()), interval, state, None, args, method.func, method.error_order(term)
    )
    return Stepper(state, jnp.where(first > 0, first, interval), jnp.asarray(0), jnp.asarray(int(Status.ok)))


def advance(
    field: VectorField,
    solver: str,
    stepper: Stepper,
    t0: Time,
    t1: Time,
    args: Any,
    tolerances: Tolerances,
    sound: Callable[[Any], Bool[Array, ""]],
    last: Bool[Array, ""],
) -> Stepper:
    """Integrate from t0 to t1 exactly, or until the lane fails; `sound(state)` is asked at each step.

    `last` tells whether the lane ends at t1: only then may the last step allowed end the interval.

    The first stage is evaluated anew in each step: reusing the last step's would let a lane's rounding
    depend on whether a neighbour in its batch was rejected.
    """
    method, term, control = SOLVERS[solver](), diffrax.ODETerm(field), controller(tolerances)
    order = method.error_order(term)

    def attempt(carry: tuple[Any, Stepper]) -> tuple[Any, Stepper]:
        t, now = carry
        left = jnp.maximum(1.0, jnp.ceil((t1 - t) / now.step))
        end = jnp.where(left > 1, t + (t1 - t) / left, t1)
        fresh = method.init(term, t, end, now.state, args)
        trial, error, *_ = method.step(term, t, end, now.state, args, fresh, made_jump=True)
        finite = jnp.isfinite(trial).all()
        error = jnp.where(finite & jnp.isfinite(error), error, jnp.inf)
        adapted: Any = control.adapt_step_size(
            t, end, now.state, trial, args, error, order, (jnp.ones(()), jnp.ones(()), False)
        )
        accept, t_next, t_after, *_ = adapted
        state = jnp.where(accept, trial, now.state)
        status = fail(now.status, Status.singular, ~sound(state))
        stuck = ~accept & (t_after - t_next <= ROUNDING * jnp.maximum(t1, 1.0))
        status = fail(status, Status.nonfinite, stuck & ~finite)
        spent = (now.steps + 1 >= tolerances.max_steps) & ((t_next < t1) | ~last)
        status = fail(status, Status.max_steps, spent | stuck)
        return t_next, Stepper(state, t_after - t_next, now.steps + 1, status)

    def unfinished(carry: tuple[Time, Stepper]) -> Bool[Array, ""]:
        t, now = carry
        return (now.status == Status.ok) & (t < t1)

    return jax.lax.while_loop(unfinished, attempt, (t0, stepper))[1]


def controller(tolerances: Tolerances) -> diffrax.PIDController:
    """The integral controller that MATLAB's `ode45` and SciPy's `RK45` use."""
    return diffrax.PIDController(rtol=tolerances.rtol, atol=tolerances.atol)
