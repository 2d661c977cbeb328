"""Multirate integration: shorter steps for the few vehicles of a fleet that need them.

A vehicle that nearly stands still turns round within a moment. A large fleet nearly always has such a
vehicle, and one common step would follow its pace. Where a few vehicles cause a step to be refused, these
vehicles alone repeat the step in shorter steps. The other vehicles keep the one long step (Savcenko,
Hundsdorfer and Verwer, A multirate time stepping strategy for stiff ordinary differential equations, BIT 47,
2007).

The other vehicles act on vehicle i only through `z_i = Σ_j w_ij (z_j + R(a_ij))` with `z_0 = R(y_0)`. The law
asks vehicle i for the jerk `z_i - P(y_i)`. At the stages of the fleet's step, the motion of vehicle i gives
`z = y‴ + P(y)`. A polynomial fitted to these values stands for z in between. The step is refused, as without
this module, where the polynomial is not accurate enough or a vehicle does not arrive.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxnet.engine import stepper
from jaxnet.engine.plan import Plan, Tolerances
from jaxnet.engine.stepper import Method, States, Times, Trial
from jaxnet.engine.subset import for_each, picked, put, run_if
from jaxnet.model.control import Gain, feedback
from jaxnet.model.lane import Lane
from jaxnet.solvers import choice

SHARE = 4  # one vehicle in so many may need shorter steps
TOGETHER = 16  # vehicles of any lanes that step at once
ATTEMPTS = 64  # most attempts of a vehicle within one step of its fleet
DEGREE = 4  # of the polynomial; every method has six nodes or more, so that a misfit shows
WILD = 100.0  # greatest jerk over greatest z at the stages; above, z is a small difference of large numbers


class SlowVehicles(NamedTuple):
    """A few vehicles that are about to step alone; each vehicle takes the place of a lane."""

    vehicle: Any  # the vehicle kind, with the parameters of each vehicle
    gain: Gain  # zero where the law holds a jerk: z is then that jerk
    start: Times
    end: Times
    tolerances: Tolerances


class Walk(NamedTuple):
    """Progress of a few vehicles through one step of their fleet."""

    time: Times
    state: States  # of one vehicle each
    slope: States
    step: Times  # [s] proposed for the next attempt
    going: Bool[Array, " few"]
    attempts: Any


def suits(lane: Lane, plan: Plan) -> bool:
    """Return whether vehicles of these lanes may step alone.

    Vehicles that decide inside the vector field may not, because the received signals then jump. Vehicles
    whose kind has parameters vehicle by vehicle may not either, nor vehicles under a linearised law or with
    gains of their own, which ask for no `z - P(y)`.
    """
    of_lanes = all(jnp.ndim(leaf) == 1 for leaf in jax.tree.leaves(lane.vehicle))
    asks = of_lanes and not plan.in_field and not lane.law.linearised and lane.gain_apart is None
    return choice.few_step_alone(lane.initial.shape[1]) and asks


def refined(
    trial: Trial,
    going: Bool[Array, " lanes"],
    start: Times,
    end: Times,
    state: States,
    lane: Lane,
    tolerances: Tolerances,
    rule: Method,
) -> Trial:
    """Return the attempted step, with shorter steps for the vehicles whose own error is too large.

    Only a lane that is going, whose step would be refused, and that has few such vehicles takes shorter
    steps. The lane's error is then the error of the other vehicles. The error stays the same if a vehicle
    does not arrive.
    """
    rough, (m, lanes) = trial.errors >= 1.0, trial.errors.shape
    wanted = going & trial.finite & (trial.error >= 1.0) & (rough.sum(axis=0) <= m // SHARE)
    gain = jnp.zeros_like(lane.gain) if lane.law.holds else lane.gain
    everybody = SlowVehicles(lane.vehicle, gain, start, end, tolerances)

    def some(numbers: Any, carry: Any) -> Any:
        few = jax.tree.map(lambda leaf: picked(leaf, numbers % lanes), everybody)
        before, slopes, errors = (
            picked(of_all_lanes(each), numbers) for each in (state, trial.slopes, trial.errors)
        )
        found = by_themselves(few, before, slopes, errors, numbers < m * lanes, rule)
        return tuple(put(everywhere, numbers, new) for everywhere, new in zip(carry, found, strict=True))

    flags = of_all_lanes(rough & wanted[None])
    carry = of_all_lanes(trial.state), of_all_lanes(trial.slope), jnp.zeros_like(flags)
    carry = run_if(flags.any(), lambda carry: for_each(flags, TOGETHER, some, carry), carry)
    moved, slope, arrived = (each.reshape(*each.shape[:-1], m, lanes) for each in carry)
    rest = stepper.fleet_norm(jnp.where(rough, 0.0, trial.errors))
    kept = wanted & (arrived | ~rough).all(axis=0)
    return trial._replace(state=moved, slope=slope, error=jnp.where(kept, rest, trial.error))


def of_all_lanes(array: Array) -> Array:
    """Return the array with the axes of vehicles and lanes joined into one last axis."""
    return array.reshape(*array.shape[:-2], -1)


def by_themselves(
    few: SlowVehicles,
    state: Float[Array, "n few"],
    slopes: Float[Array, "s n few"],
    error: Times,
    there: Bool[Array, " few"],
    rule: Method,
) -> tuple[Float[Array, "n few"], Float[Array, "n few"], Bool[Array, " few"]]:
    """Step vehicles alone to the end of a step. Return their states, their slopes, and which arrived.

    `slopes` and `error` belong to the fleet's step. `there` is False for padding.
    """
    length = few.end - few.start
    coefficients, able = heard(few, state, slopes, rule)

    def signals(time: Times) -> Any:
        return jnp.polyval(coefficients, ((time - few.start) / length)[None])[:, None]

    def field(now: Any, state: States) -> States:
        jerk = now - feedback(few.gain, few.vehicle.output_jets(state))
        return few.vehicle.motion(state, few.vehicle.inputs_for(state, jerk))

    def advance(walk: Walk) -> Walk:
        goal = stepper.towards(few.end, walk.time, walk.step)
        trial = stepper.attempt(field, signals, rule, walk.time, goal, walk.state, walk.slope, few.tolerances)
        kept = walk.going & (trial.error < 1.0)
        step = stepper.next_step(goal - walk.time, trial.error, rule.order)
        return Walk(
            jnp.where(kept, goal, walk.time),
            jnp.where(kept[None, None], trial.state, walk.state),
            jnp.where(kept[None, None], trial.slope, walk.slope),
            jnp.where(walk.going, step, walk.step),
            walk.going & ~(kept & (goal == few.end)),
            walk.attempts + 1,
        )

    def under_way(walk: Walk) -> Bool[Array, ""]:
        return walk.going.any() & (walk.attempts < ATTEMPTS)

    step, going = stepper.next_step(length, error, rule.order), there & able
    begin = Walk(few.start, state[:, None], slopes[0, :, None], step, going, jnp.asarray(0))
    end = jax.lax.while_loop(under_way, advance, begin)
    return end.state[:, 0], end.slope[:, 0], going & ~end.going


def heard(
    few: SlowVehicles, state: Float[Array, "n few"], slopes: Float[Array, "s n few"], rule: Method
) -> tuple[Float[Array, "coefficients 2 few"], Bool[Array, " few"]]:
    """Fit z over a step by a polynomial in the share of the step that is past.

    Return the coefficients, and the vehicles for which the polynomial may replace z, under three conditions:

    - the polynomial's misfit moves the highest jet, the acceleration for order 3, by less than its tolerance;
    - no stage went wild: the jerk is at most `WILD` times z;
    - the vehicle moves as asked: asked for the jerk that it had, it has that jerk.
    """
    length = few.end - few.start
    states = state[None] + length[None, None] * jnp.tensordot(jnp.asarray(rule.matrix), slopes, axes=1)
    states, rates = (jnp.moveaxis(each, 0, 1) for each in (states, slopes))  # stages replace vehicles
    jets, (*_, jerk) = jax.jvp(few.vehicle.output_jets, (states,), (rates,))
    at_stages = jnp.moveaxis(jerk + feedback(few.gain, jets), 1, 0)  # s 2 few
    powers = np.vander(rule.nodes, DEGREE + 1)
    coefficients = jnp.tensordot(jnp.asarray(np.linalg.pinv(powers)), at_stages, axes=1)
    missed = jnp.abs(at_stages - jnp.tensordot(jnp.asarray(powers), coefficients, axes=1)).max(axis=(0, 1))
    asked = few.vehicle.motion(states, few.vehicle.inputs_for(states, jerk))
    unasked = jnp.abs(jax.jvp(few.vehicle.output_jets, (states,), (asked,))[1][-1] - jerk).max(axis=(0, 1))
    off = jnp.maximum(missed * hidden(rule), unasked)
    highest = jnp.abs(jets[-1][:, 0]).max(axis=0)
    near = off * length <= few.tolerances.rtol * highest + few.tolerances.atol
    tame = jnp.abs(jerk).max(axis=(0, 1)) <= WILD * jnp.abs(at_stages).max(axis=(0, 1))
    return coefficients, near & tame


def hidden(rule: Method) -> float:
    """Return the integral of the polynomial's misfit over the greatest misfit at a stage; 1 or more.

    The misfit is that of the next power, which dominates for a smooth signal. The integral is the greatest
    over any part from the start of a step of length 1.
    """
    fitted = np.linalg.pinv(np.vander(rule.nodes, DEGREE + 1)) @ rule.nodes ** (DEGREE + 1)
    missed = np.poly1d([1.0, *-fitted])
    return max(
        1.0, np.abs(missed.integ()(np.linspace(0.0, 1.0, 101))).max() / np.abs(missed(rule.nodes)).max()
    )
