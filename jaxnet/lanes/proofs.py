"""Tests of an attack, a navigator or a vehicle from outside the package before lanes run.

The test suite covers the kinds of the package. The module tests others at a few instants, and
vehicles in a few states, because an exact engine with a wrong derivative would give a wrong result.
"""

from collections.abc import Callable, Hashable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxnet.config.keys import Scenario
from jaxnet.kinds.attacks import AnyAttack
from jaxnet.kinds.kind import Kind, KindError, as_pytree
from jaxnet.kinds.navigators import Navigator
from jaxnet.kinds.ticks import JET_ORDERS
from jaxnet.kinds.vehicles import Vehicle
from jaxnet.model.lane import Lane
from jaxnet.model.signal import ORDERS

INSTANTS = 65
FINITE_STEP = 1e-4  # [s], step of the difference quotients
CLOSE_ENOUGH = 1e-3  # relative, tolerance between a derivative and its difference quotient
PROOF_ROUNDING = 1e-9
TRIED_VEHICLES = 512  # states in which a vehicle is tried, at least 4 for each
TRIED_SIZES = -1.0, 2.0  # decimal logarithms of jets' norms; the derivative asked for: ten times
ALIKE = 1e-6  # relative, difference of a derivative from what was asked for
# Vehicles that this process has tried, by their keys and what is presumed of them
PROVED = set[Hashable]()


def prove(
    attack: AnyAttack,
    basis: Any,
    vectors: np.ndarray | None,
    sizes: Any,
    horizon: float,
    count: int,
) -> None:
    """Raise KindError if functions, unit vectors or sizes of a drawn attack violate their contract.

    `count` is the number of lanes. Attacks of the package pass without a test.
    """
    if not from_outside(attack):
        return
    name, sizes = type(attack).__name__, np.asarray(sizes)[: len(ORDERS)]
    first = np.asarray(basis(np.zeros(count)))
    if first.ndim != 3 or first.shape[::2] != (4, count):
        told = f"(4, B, lanes = {count}) (got {first.shape})"
        raise KindError(f"{name}.basis must have the shape {told}")
    if sizes.shape not in ((4, 1), (4, count)):
        told = f"(4, lanes = {count}) (got {sizes.shape})"
        raise KindError(f"{name}.sizes must have the shape {told}")
    if vectors is not None:
        shape, functions = vectors.shape, first.shape[1]
        if len(shape) != 4 or shape[::2] != (2, functions) or shape[3] not in (1, count):
            told = f"(2, vehicles, B = {functions}, lanes = {count})"
            raise KindError(f"{name}.vectors must have the shape {told} (got {shape})")
        norm = np.linalg.norm(vectors.transpose(1, 3, 0, 2), 2, axis=(2, 3)).max()
        if not norm <= 1 + PROOF_ROUNDING:
            told = f"a spectral norm of at most 1 (got {norm:.4g})"
            raise KindError(f"{name}.vectors must have {told}")
    each = jax.vmap(lambda t: basis(jnp.full(count, t)))
    times, quotients, now = around(lambda instants: np.asarray(each(instants)), horizon)
    if attack.derived:
        prove_derivatives(f"{name}.basis", times, quotients[:, :3], now[:, 1:])
    greatest = np.linalg.norm(now, axis=2).max(axis=0)
    if not (greatest <= sizes * (1 + PROOF_ROUNDING) + PROOF_ROUNDING).all():
        order = int(np.argmax((greatest - sizes).max(axis=1)))
        raise KindError(
            f"{name}.sizes: the functions' derivative of order {order} comes to"
            f" {greatest[order].max():.4g}, which is over {sizes[order].max():.4g}"
        )


def around(
    jets: Callable[[np.ndarray], np.ndarray], horizon: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Instants, and at each the difference quotients of jets, and the jets: (instants, …)."""
    times = np.linspace(FINITE_STEP, horizon - FINITE_STEP, INSTANTS)
    before, now, after = (jets(times + step) for step in (-FINITE_STEP, 0.0, FINITE_STEP))
    return times, (after - before) / (2 * FINITE_STEP), now


def prove_path(navigator: Navigator, horizon: float, count: int) -> None:
    """Raise KindError if a drawn navigator's path from outside is not finite or differentiable."""
    if not from_outside(navigator):
        return

    def jets(instants: np.ndarray) -> np.ndarray:
        return np.stack([np.asarray(navigator.jets(np.full(count, each))) for each in instants])

    times, quotients, now = around(jets, horizon)
    prove_finite(navigator, "jets", now)
    prove_derivatives(f"{type(navigator).__name__}.jets", times, quotients[:, :3], now[:, 1:])


def prove_derivatives(
    name: str,
    times: Float[np.ndarray, " instants"],
    quotients: Float[np.ndarray, "instants 3 functions lanes"],
    given: Float[np.ndarray, "instants 3 functions lanes"],
) -> None:
    """Raise KindError if a derivative of order 1 to 3 differs from its difference quotient."""
    scale = (
        np.abs(given).max(axis=(0, 2, 3)) + np.abs(quotients).max(axis=(0, 2, 3)) + PROOF_ROUNDING
    )
    apart = np.abs(quotients - given).max(axis=(2, 3)) / scale
    if not (apart <= CLOSE_ENOUGH).all():
        instant, order = np.unravel_index(
            np.nanargmax(np.nan_to_num(apart, nan=np.inf)), apart.shape
        )
        raise KindError(
            f"{name}: what stands at order {order + 1} is not the derivative of order {order}"
            f" (at t = {times[instant]:.4g} s)"
        )


def from_outside(kind: Kind | None) -> bool:
    return kind is not None and not type(kind).__module__.startswith("jaxnet.")


def prove_finite(kind: Kind, method: str, found: Any) -> None:
    """Raise KindError if a method of a kind from outside has given a number that is not finite."""
    if from_outside(kind) and not all(np.isfinite(each).all() for each in found):
        raise KindError(f"{type(kind).__name__}.{method} gives a number that is not finite")


def prove_errors(lane: Lane, sources: np.ndarray) -> None:
    """Raise KindError if an error of a sensor or noise from outside is not finite at the first
    tick.
    """
    time, slots = np.zeros_like(lane.attack_scale), np.zeros((2, *lane.weights.shape))
    with jax.enable_x64(True):
        if from_outside(lane.sensor):
            found = lane.sensor.next_errors((slots[:, 0],) * len(JET_ORDERS), time, lane.interval)
            prove_finite(lane.sensor, "next_errors", found)
        if from_outside(lane.noise):
            last = (slots,) * (len(JET_ORDERS) + lane.noise.errs_in_highest())
            found = lane.noise.next_errors(last, time, lane.interval, sources)
            prove_finite(lane.noise, "next_errors", found)


def prove_presumed(scenario: Scenario, drawn: Vehicle) -> None:
    """Raise KindError if a drawn vehicle from outside is not what its engine presumes.

    A vehicle is tried once. `tick: 0` and laws decide what an engine presumes.
    """
    presumed, engine = scenario.engine.presumes(scenario), scenario.engine.kind
    asked = type(drawn), repr(scenario.vehicle), scenario.vehicles, presumed
    if not from_outside(drawn) or presumed == "nothing" or asked in PROVED:
        return
    prove_vehicle(drawn, scenario.vehicles, presumed == "motion", engine)
    PROVED.add(asked)


def prove_vehicle(vehicle: Vehicle, count: int, motion: bool, engine: str) -> None:
    """Raise KindError if the jets of a drawn vehicle's output do not tell its state.

    If `motion`, the derivatives of the jets must also be what was asked for: y^(r) = q for the
    inputs that `inputs_for` gives for q. `count` is the number of vehicles. The jets, and the
    derivative q, are random, of sizes from 0.1 to 1,000. States in which a number is not finite do
    not count.
    """
    tries = max(4, TRIED_VEHICLES // count)
    random = np.random.default_rng(0)
    sizes = 10 ** random.uniform(*TRIED_SIZES, (vehicle.order + 1, 1, count, tries))
    sizes[-1] *= 10
    asked = sizes * random.uniform(-1.0, 1.0, (vehicle.order + 1, 2, count, tries))
    drawn = jax.tree.map(
        lambda leaf: leaf[..., np.arange(tries) % leaf.shape[-1]], as_pytree(vehicle)
    )
    headings = random.uniform(-np.pi, np.pi, (count, tries))
    states, rates, size = map(np.asarray, jax.jit(motion_tried)(drawn, asked, headings))
    told = type(vehicle).__name__, f"the {engine} engine takes it for granted: give engine: "
    refuse_unlike(
        states, asked[:-1], 0.0, told, ("state_of", 0, "{kind: nonlinear, solver: dopri5}")
    )
    if motion:
        refuse_unlike(rates, asked[1:], size, told, ("motion", 1, "nonlinear"))


def motion_tried(vehicle: Any, asked: Any, headings: Any) -> tuple[Any, Any, Any]:
    """The jets of states that shall have the jets asked for, their rates, and the sizes of these.

    Inner states are those of vehicles that start with these headings.
    """
    *jets, highest = asked
    if vehicle.internal:
        start = vehicle.start(jets[0], headings, jnp.ones_like(headings))
        state = vehicle.state_with(tuple(jets), vehicle.inner(start))
    else:
        state = vehicle.state_of(tuple(jets))
    inputs = vehicle.inputs_for(state, highest)
    own, rates = jax.jvp(vehicle.output_jets, (state,), (vehicle.motion(state, inputs),))
    pushed = (jnp.abs(vehicle.decoupling(state)) * jnp.abs(inputs)[None]).sum(axis=1)
    sizes = *map(jnp.abs, jets[1:]), pushed + jnp.abs(vehicle.drift(state))
    return jnp.stack(own), jnp.stack(rates), jnp.stack(sizes)


def refuse_unlike(
    given: Float[np.ndarray, "r 2 m tries"],
    asked: Float[np.ndarray, "r 2 m tries"],
    size: Any,
    told: tuple[str, str],
    where: tuple[str, int, str],
) -> None:
    """Raise KindError where a vehicle's output has wrong derivatives; `size` bounds their terms."""
    (name, why), (method, first, instead) = told, where
    with np.errstate(all="ignore"):
        apart = np.abs(given - asked) / (size + np.abs(asked)).max(axis=1, keepdims=True)
    finite = np.isfinite(apart).all(axis=(0, 1))
    wrong = finite & (apart.max(axis=(0, 1)) > ALIKE) if finite.any() else ~finite
    if wrong.any():
        gentle = np.where(wrong, np.abs(asked).max(axis=(0, 1)), np.inf)
        one = np.unravel_index(np.argmin(gentle), gentle.shape)
        order = int(np.argmax(apart[:, :, *one].max(axis=1)))
        got = f"{given[order, :, *one]} where {asked[order, :, *one]} is asked for"
        raise KindError(
            f"{name}.{method}: derivative {order + first} of the output is {got}; {why}{instead}"
        )
