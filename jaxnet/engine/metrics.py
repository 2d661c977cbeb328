"""Metrics of a lane, gathered at output times so that memory stays constant; saved series."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.plan import Clock
from jaxnet.kinds import contract
from jaxnet.kinds.kind import KindError
from jaxnet.kinds.metrics import CONTRACT, Metric
from jaxnet.kinds.metrics.spread import farthest_honest
from jaxnet.model.hearing import Hearing
from jaxnet.model.plane import length


class Observation(NamedTuple):
    """State of the fleet at one output time, after the decision of that tick.

    The last axis of every array is over lanes. The vehicle's kind names the states and inputs with
    their units.

    Attributes
    ----------
    error
        `y_i - y_0` [m], (2, m, lanes); without a navigator, y_0 is the mean of vehicles that are
        not attacked.
    speed, turn_rate
        Speed [m/s] and turn rate [rad/s] of each vehicle, (m, lanes).
    state
        State of each vehicle, (n, m, lanes): x [m], y [m], heading [rad], speed [m/s], and further
        states. These are turn rate [rad/s] and force over mass [m/s²] of the two-wheeled robot.
    attack
        Signal of each attacked vehicle [m], (2, m, lanes).
    weights
        Weights in force, (axes, slots, m, lanes).
    hearing
        Who hears whom.
    attacked
        Whether each vehicle is attacked, (m, lanes).
    start
        Position of each vehicle at t = 0 [m], (2, m, lanes).
    inputs_now
        Function that returns `inputs`, which nobody needs in most studies.
    alarms
        Alarms over words that were judged until now, of attacked and of honest links, (2, lanes);
        None without a detector.

    Examples
    --------
    >>> import jaxnet
    >>> from jaxnet.kinds.metrics import Metric
    >>> apart = Metric("apart", "m", lambda seen: seen.disagreements(), "tail", "mean", "mean")
    >>> keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5, "metrics": [apart]}
    >>> results = jaxnet.simulate(keys, samples=2, progress=False)
    >>> bool((results.lanes["apart"] == results.lanes["tail_disagreement"]).all())
    True
    """

    error: Float[Array, "2 m *lanes"]
    speed: Float[Array, "m *lanes"]
    turn_rate: Float[Array, "m *lanes"]
    state: Float[Array, "n m *lanes"]
    attack: Float[Array, "2 m *lanes"]
    weights: Float[Array, "axes slots m *lanes"]
    hearing: Hearing
    attacked: Bool[Array, "m *lanes"]
    start: Float[Array, "2 m *lanes"]
    inputs_now: Callable[[], Float[Array, "2 m *lanes"]]
    alarms: Float[Array, "2 *lanes"] | None = None

    @property
    def inputs(self) -> Float[Array, "2 m *lanes"]:
        """Control input u of each vehicle right after the decision, (2, m, lanes).

        The input of the two-wheeled robot is the rate of force over mass [m/s³] and the angular
        acceleration [rad/s²].
        """
        return self.inputs_now()

    def errors(self) -> Float[Array, "m *lanes"]:
        """`‖y_i - y_0‖` [m] of each vehicle."""
        return length(self.error)

    def disagreements(self) -> Float[Array, "m *lanes"]:
        """`‖y_i - Σ_j w_ij y_j‖` [m], true outputs, weights in force; 0 if i hears nobody."""
        sources = jnp.concatenate([jnp.zeros_like(self.error[:, :1]), self.error], axis=1)
        apart = self.error - self.hearing.mean_sent(self.weights, sources)
        return length(jnp.where((self.weights == 0).all(axis=1), 0.0, apart))


Series = dict[str, Float[Array, "..."]]  # stacked over output times, lanes last

# Arrays that can be saved at every output time, lanes last (docs/results-folder.md).
SERIES: dict[str, Callable[[Observation], Float[Array, "..."]]] = {
    "tracking": lambda seen: seen.errors().mean(axis=0),
    "disagreement": lambda seen: seen.disagreements().mean(axis=0),
    "spread": lambda seen: farthest_honest(seen).max(axis=0),
    "state": lambda seen: seen.state.swapaxes(0, 1),
    "inputs": lambda seen: seen.inputs.swapaxes(0, 1),
    "attack": lambda seen: seen.attack.swapaxes(0, 1),
    "kept": lambda seen: seen.weights.mean(axis=0),
}


# Errors of each vehicle over the tail that can be saved; each names its contract's metric.
VEHICLE_ERRORS = {"vehicle_mean": "tail_mean", "vehicle_max": "tail_max"}


def series(save: Sequence[str], seen: Observation) -> Series:
    return {name: SERIES[name](seen) for name in save if name in SERIES}


def empty_series(save: Sequence[str], rows: int, seen: Callable[[], Observation]) -> Series:
    """Stacks of the saved arrays over `rows` output times, filled with not-a-number."""
    if not any(name in SERIES for name in save):
        return {}  # tracing an observation for nothing takes a tenth of all tracing
    shapes = jax.eval_shape(lambda: series(save, seen()))
    return {name: jnp.full((rows, *one.shape), jnp.nan) for name, one in shapes.items()}


NEUTRAL = {
    "mean": 0.0,
    "max": -jnp.inf,
    "min": jnp.inf,
    "sum": 0.0,
    "integral": 0.0,
    "last": jnp.nan,
}
STEP_OVER_TIME = {
    "mean": jnp.add,
    "max": jnp.maximum,
    "min": jnp.minimum,
    "sum": jnp.add,
    "integral": jnp.add,
    "last": lambda _, value: value,
}
OVER_VEHICLES = {"mean": jnp.mean, "max": jnp.max, "min": jnp.min}

Gathered = Mapping[
    str, Float[Array, "m *lanes"]
]  # by metric and vehicle, before any sum over vehicles


def nothing(metrics: Sequence[Metric], shape: tuple[int, ...]) -> Gathered:
    """The metrics before the first output time, for the shape (m, lanes)."""
    return {metric.name: jnp.full(shape, NEUTRAL[metric.time]) for metric in metrics}


def add(
    metrics: Sequence[Metric],
    gathered: Gathered,
    seen: Observation,
    there: Bool[Array, "*lanes"],
    output: Int[Array, "*some"],
    clock: Clock,
) -> Gathered:
    """The metrics with the output time of number `output`, in the lanes where `there` holds.

    Metrics over the tail change only at output times in the tail.
    """
    run, tail = ([metric for metric in metrics if metric.over == over] for over in ("run", "tail"))
    counts = there & clock.in_tail(output)
    before = {metric.name: gathered[metric.name] for metric in tail}

    def in_tail() -> dict[str, Float[Array, "m *lanes"]]:
        first = clock.outputs - clock.tail_outputs + 1
        return reduce_over_time(tail, gathered, seen, counts, trapezium(output, first, clock))

    after = jax.lax.cond(counts.any(), in_tail, lambda: before)
    weight = trapezium(output, jnp.asarray(0), clock)
    return reduce_over_time(run, gathered, seen, there, weight) | after


def trapezium(
    output: Int[Array, "*some"], first: Int[Array, ""], clock: Clock
) -> Float[Array, "*some"]:
    """The weight [s] of an output time in the trapezoidal rule from output `first` to the last."""
    sides = (output > first).astype(float) + (output < clock.outputs).astype(float)
    return sides * (clock.at(clock.ticks) / 2)


def reduce_over_time(
    metrics: Sequence[Metric],
    gathered: Gathered,
    seen: Observation,
    there: Bool[Array, "*lanes"],
    weight: Float[Array, "*some"],
) -> dict[str, Float[Array, "m *lanes"]]:
    """These metrics with the observation added, in the lanes where `there` holds.

    `weight` [s] is that of the observation in an integral over time.
    """
    found = {}
    for metric in metrics:
        known = gathered[metric.name]
        value = measured(metric, seen, known.shape)
        if metric.time == "integral":
            value = value * jnp.broadcast_to(weight, known.shape)
        step = STEP_OVER_TIME[metric.time](known, value)
        found[metric.name] = jnp.where(there[None], step, known)
    return found


def measured(metric: Metric, seen: Observation, shape: tuple[int, ...]) -> Float[Array, "m *lanes"]:
    """A metric of each vehicle; raise KindError unless it gives real numbers of this shape."""
    given = metric.of(seen)
    try:
        return jnp.broadcast_to(jnp.asarray(given, float), shape)
    except (TypeError, ValueError):
        told = f"metric {metric.name}.of gives {contract.described(given)}"
        raise KindError(f"{told}; expected: numbers, (m, lanes) = {shape}") from None


def finite(gathered: Gathered) -> Bool[Array, "*lanes"]:
    """The lanes in which every metric of the contract is finite for every vehicle."""
    return jnp.isfinite(jnp.stack([gathered[metric.name] for metric in CONTRACT])).all(axis=(0, 1))


def fleet_values(
    metrics: Sequence[Metric],
    gathered: Gathered,
    outputs: Int[Array, ""],
    tail_outputs: Int[Array, ""],
) -> dict[str, Float[Array, "*lanes"]]:
    times = {"run": outputs + 1, "tail": tail_outputs}
    found = {}
    for metric in metrics:
        value = OVER_VEHICLES[metric.vehicles](gathered[metric.name], axis=0)
        found[metric.name] = (
            value / times[metric.over].astype(float) if metric.time == "mean" else value
        )
    return found


MAY_BE = {
    "error": jnp.isfinite,
    "infinite": lambda x: ~jnp.isnan(x),
    "blank": lambda x: ~jnp.isinf(x),
}


def all_defined(
    metrics: Sequence[Metric], values: Mapping[str, Float[Array, "*lanes"]]
) -> Bool[Array, "*lanes"]:
    """The lanes in which every metric of the fleet is what its `undefined` allows."""
    return jnp.stack([MAY_BE[each.undefined](values[each.name]) for each in metrics]).all(axis=0)


def vehicle_errors(
    save: Sequence[str], gathered: Gathered, tail_outputs: Int[Array, ""], ok: Bool[Array, "*lanes"]
) -> Series:
    """The saved errors of each vehicle over the tail [m], (m, lanes); NaN in failed lanes."""
    found = {}
    for name, metric in VEHICLE_ERRORS.items():
        if name in save:
            times = tail_outputs.astype(float) if name == "vehicle_mean" else 1.0
            found[name] = jnp.where(ok, gathered[metric] / times, jnp.nan)
    return found
