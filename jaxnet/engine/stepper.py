"""Adaptive explicit Runge–Kutta steps of many lanes side by side, each with its own time and step.

The Butcher tableaux are diffrax's. The step control is diffrax's `PIDController` as an integral
controller. Tests compare a step, its error, the next step and the order of convergence with
diffrax's own.

Diffrax's stepping is for one lane. `vmap` of that stepping puts lanes first, and evaluates the
first stage again whenever some lane of the batch was rejected. This measured half as fast.

The lanes are the last axis of every array. The stages are a loop, so that XLA compiles the vector
field once. The signals at all stages are evaluated before the loop. XLA evaluates the inputs of a
loop once, but may evaluate a value in the loop's body again for each use.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxnet.engine.plan import Tolerances
from jaxnet.engine.vehicles import States

SOLVERS = {"dopri5": diffrax.Dopri5, "dopri8": diffrax.Dopri8}
LEAST_RELATIVE_STEP = 4 * 2.0**-52  # a relative step below this no longer moves the time
SAFETY, LEAST, MOST = 0.9, 0.2, 10.0  # of the factor from one step to the next
FIRST_STEP = 0.01  # share of the time in which the state changes by its own size

Times = Float[Array, " lanes"]
VectorField = Callable[[Any, States], States]  # from signals at a time and states to slopes


class Method(NamedTuple):
    """Butcher tableau of an embedded explicit Runge–Kutta method of s stages."""

    nodes: Float[np.ndarray, " s"]  # c
    matrix: Float[np.ndarray, "s s"]  # a, strictly lower
    solution: Float[np.ndarray, " s"]  # b
    error: Float[np.ndarray, " s"]  # b minus the embedded method's
    order: int


class Trial(NamedTuple):
    """One attempted step of every lane."""

    state: States
    slope: States  # of the last stage, at the end
    signals: Any  # at the end
    error: Times  # local error of the fleet over its tolerance; infinite if anything is not finite
    finite: Bool[Array, " lanes"]


def method(name: str) -> Method:
    """The method of a solver by name; its last stage is the first stage of the next step."""
    solver = SOLVERS[name]()
    table = solver.tableau
    assert table.fsal, name
    stages = len(table.b_sol)
    matrix = np.zeros((stages, stages))
    for row, given in enumerate(table.a_lower, start=1):
        matrix[row, : len(given)] = given
    order = solver.error_order(diffrax.ODETerm(lambda t, y, args: y))
    nodes = np.concatenate([[0.0], table.c])
    return Method(nodes, matrix, table.b_sol, table.b_error, int(order))


def attempt(
    field: VectorField,
    signals: Callable[[Times], Any],
    rule: Method,
    start: Times,
    end: Times,
    state: States,
    slope: States,
    tolerances: Tolerances,
) -> Trial:
    """Attempt a step from `start` to `end`, where `slope` is the vector field at `start`.

    `signals(times)` returns the part of the field's inputs that depends on time alone.
    """
    length, matrix = (end - start)[None, None], jnp.asarray(rule.matrix)
    times = jnp.stack([end if c == 1.0 else start + c * (end - start) for c in rule.nodes])
    at_stages = jax.vmap(signals)(times)
    slopes = jnp.zeros((len(rule.nodes), *state.shape)).at[0].set(slope)

    def stage(number: Any, slopes: Any) -> Any:
        there = state + length * jnp.tensordot(matrix[number], slopes, axes=1)
        found = field(jax.tree.map(lambda leaf: leaf[number], at_stages), there)
        return jax.lax.dynamic_update_index_in_dim(slopes, found, number, 0)

    slopes = jax.lax.fori_loop(1, len(rule.nodes), stage, slopes)
    moved = state + length * jnp.tensordot(jnp.asarray(rule.solution), slopes, axes=1)
    error = length * jnp.tensordot(jnp.asarray(rule.error), slopes, axes=1)
    size = error_norm(error, jnp.maximum(jnp.abs(state), jnp.abs(moved)), tolerances)
    finite = jnp.isfinite(moved).all(axis=(0, 1)) & jnp.isfinite(size)
    last = jax.tree.map(lambda leaf: leaf[-1], at_stages)
    return Trial(moved, slopes[-1], last, jnp.where(finite, size, jnp.inf), finite)


def error_norm(change: States, size: States, tolerances: Tolerances) -> Times:
    """A change over `atol + rtol * size`, as the root mean square over the states of a fleet."""
    scale = tolerances.atol[None, None] + tolerances.rtol[None, None] * size
    each = jnp.sqrt(((change / scale) ** 2).mean(axis=0))
    return jnp.sqrt(jnp.full(len(each), 1 / len(each)) @ each**2)


def towards(goal: Times, time: Times, step: Times) -> Times:
    """The end of the first of equal steps, each at most `step` long, that lead to the goal."""
    pieces = jnp.maximum(1.0, jnp.ceil((goal - time) / step))
    return jnp.where(pieces > 1, time + (goal - time) / pieces, goal)


def next_step(step: Times, error: Times, order: int) -> Times:
    """The next step: no shorter if kept (error < 1), else shorter; errors grow as h^`order`."""
    kept = error < 1.0
    wanted = SAFETY * error ** (-1.0 / order)
    return step * jnp.clip(wanted, jnp.where(kept, 1.0, LEAST), jnp.where(kept, MOST, SAFETY))


def first_step(state: States, slope: States, tolerances: Tolerances) -> Times:
    """A first step (the first guess of Hairer, Nørsett, Wanner, Solving ODEs I, II.4)."""
    size = jnp.abs(state)
    whole, change = (error_norm(each, size, tolerances) for each in (state, slope))
    return FIRST_STEP * whole / change
