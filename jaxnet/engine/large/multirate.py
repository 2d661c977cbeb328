"""Shorter steps for the few vehicles of a fleet that need them.

A vehicle that nearly stands still turns round within a moment. In a large fleet there is nearly always
one, and all others would go at its pace. Where a step is refused on account of a few vehicles, these take
it alone, in steps of their own, while the others have taken it in one (Savcenko, Hundsdorfer and Verwer, A
multirate time stepping strategy for stiff ordinary differential equations, BIT 47, 2007).

Of the others a vehicle i needs what it hears, `z_i = Σ_j w_ij (z_j + R(a_ij))` with `z_0 = R(y_0)`: the law
asks it for the jerk `z_i - P(y_i)`. How it moved at the stages of the fleet's step says what it heard there,
`z = y‴ + P(y)`; a polynomial near these stands for z in between. Where that does not tell z well enough, and
where a vehicle does not arrive, the step is refused as it would have been.
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

SMALLEST = 32  # vehicles; in smaller fleets it takes as long as it saves
SHARE = 4  # one vehicle in so many may need shorter steps
TOGETHER = 16  # vehicles, of any lanes
ATTEMPTS = 64  # of a vehicle within a step of its fleet
DEGREE = 4  # of the polynomial; every method has six nodes or more, so that it can be seen to miss some
WILD = 100.0  # greatest jerk over greatest z at the stages; in more z is a small difference of large numbers


class SlowVehicles(NamedTuple):
    """A few vehicles, each in the place of a lane, about to take a step."""

    vehicle: Any  # its kind, with the parameters of each
    gain: Gain  # zero where the law holds a jerk, which is then what is heard
    start: Times
    end: Times
    tolerances: Tolerances


class Walk(NamedTuple):
    """A few vehicles on their way through a step."""

    time: Times
    state: States  # of one vehicle each
    slope: States
    step: Times  # [s] proposed for the next attempt
    going: Bool[Array, " few"]
    attempts: Any


def suits(lane: Lane, plan: Plan) -> bool:
    """Whether vehicles of such lanes may go alone.

    They may not where all decide inside the vector field, for what they hear there jumps, nor where their
    kind has numbers of every vehicle.
    """
    of_lanes = all(jnp.ndim(leaf) == 1 for leaf in jax.tree.leaves(lane.vehicle))
    return lane.initial.shape[1] >= SMALLEST and of_lanes and not plan.in_field


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
    """The attempted step, with shorter ones for the vehicles whose own error is not tolerated.

    They are taken in lanes that are going and whose step would be refused, where such vehicles are few. The
    error of a lane is then that of the others, but stays what it was where a vehicle has not arrived.
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
    """The vehicles of all lanes as one last axis."""
    return array.reshape(*array.shape[:-2], -1)


def by_themselves(
    few: SlowVehicles,
    state: Float[Array, "n few"],
    slopes: Float[Array, "s n few"],
    error: Times,
    there: Bool[Array, " few"],
    rule: Method,
) -> tuple[Float[Array, "n few"], Float[Array, "n few"], Bool[Array, " few"]]:
    """State and slope at the end of a step, of vehicles that take it alone, and who has arrived.

    `slopes` and `error` are those of the fleet's step; who is not `there` is left out.
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
        kept, step = walk.going & (trial.error < 1.0), stepper.next_step(goal - walk.time, trial.error, rule)
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

    step, going = stepper.next_step(length, error, rule), there & able
    begin = Walk(few.start, state[:, None], slopes[0, :, None], step, going, jnp.asarray(0))
    end = jax.lax.while_loop(under_way, advance, begin)
    return end.state[:, 0], end.slope[:, 0], going & ~end.going


def heard(
    few: SlowVehicles, state: Float[Array, "n few"], slopes: Float[Array, "s n few"], rule: Method
) -> tuple[Float[Array, "coefficients 2 few"], Bool[Array, " few"]]:
    """What vehicles hear over a step, as polynomials in the share of it that is past, and who can go by it.

    A vehicle can if what its polynomial misses moves its acceleration by less than is tolerated of it, if no
    stage went wild, and if it moved as it was asked: asked for the jerk that it had, it has that jerk.
    """
    length = few.end - few.start
    states = state[None] + length[None, None] * jnp.tensordot(jnp.asarray(rule.matrix), slopes, axes=1)
    states, rates = (jnp.moveaxis(each, 0, 1) for each in (states, slopes))  # stages in the place of vehicles
    jets, (_, _, jerk) = jax.jvp(few.vehicle.output_jets, (states,), (rates,))
    at_stages = jnp.moveaxis(jerk + feedback(few.gain, jets), 1, 0)  # s 2 few
    powers = np.vander(rule.nodes, DEGREE + 1)
    coefficients = jnp.tensordot(jnp.asarray(np.linalg.pinv(powers)), at_stages, axes=1)
    missed = jnp.abs(at_stages - jnp.tensordot(jnp.asarray(powers), coefficients, axes=1)).max(axis=(0, 1))
    asked = few.vehicle.motion(states, few.vehicle.inputs_for(states, jerk))
    unasked = jnp.abs(jax.jvp(few.vehicle.output_jets, (states,), (asked,))[1][2] - jerk).max(axis=(0, 1))
    off = jnp.maximum(missed * hidden(rule), unasked)
    acceleration = jnp.abs(jets[2][:, 0]).max(axis=0)
    near = off * length <= few.tolerances.rtol * acceleration + few.tolerances.atol
    tame = jnp.abs(jerk).max(axis=(0, 1)) <= WILD * jnp.abs(at_stages).max(axis=(0, 1))
    return coefficients, near & tame


def hidden(rule: Method) -> float:
    """The integral of what a polynomial misses, over the most that it misses at a stage; 1 or more.

    Of the next power, which is the most of what it misses of a smooth signal, over any part from the start of
    a step whose length is 1.
    """
    fitted = np.linalg.pinv(np.vander(rule.nodes, DEGREE + 1)) @ rule.nodes ** (DEGREE + 1)
    missed = np.poly1d([1.0, *-fitted])
    return max(
        1.0, np.abs(missed.integ()(np.linspace(0.0, 1.0, 101))).max() / np.abs(missed(rule.nodes)).max()
    )
