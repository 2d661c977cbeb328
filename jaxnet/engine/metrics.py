"""Metrics of a lane, gathered at output times so that memory stays constant; saved series."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.plan import Clock
from jaxnet.engine.stages.detection import TestedLinks
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
    start, steered
        What the law steers of each vehicle, at t = 0 and now: its output, less its offset in the
        formation [m], (2, m, lanes).
    inputs_now, errors_at_start
        Functions that return `inputs`, and `error` at t = 0, which nobody needs in most studies.
    time, next_time
        Time of this output and of the next one [s], (lanes,); infinite after the last one.
    leads
        Whether there is a navigator.
    alarms
        Alarms over messages judged until now, of attacked and of honest links, (2, lanes); None
        without a detector.
    links
        Attacked and honest links, first alarms about them, and which are cut (`TestedLinks`);
        None without a detector.
    tallies
        Share of (vehicle, tick) pairs until now at which something happened, and the number of
        ticks with any such vehicle, (2, lanes), by the metric of this share: `saturated`, inputs
        were limited; `infeasible`, the filter had no velocity; `standing`, a vehicle had stopped.
        What cannot happen is not there.
    offset
        Offset of each vehicle in the formation [m], (2, m, lanes); None without a formation.
        Errors are those of y minus the offset.

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
    steered: Float[Array, "2 m *lanes"]
    inputs_now: Callable[[], Float[Array, "2 m *lanes"]]
    errors_at_start: Callable[[], Float[Array, "2 m *lanes"]]
    time: Float[Array, "*lanes"]
    next_time: Float[Array, "*lanes"]
    leads: bool = True
    alarms: Float[Array, "2 *lanes"] | None = None
    links: TestedLinks | None = None
    tallies: Mapping[str, Float[Array, "2 *lanes"]] = {}
    offset: Float[Array, "2 m *lanes"] | None = None

    @property
    def inputs(self) -> Float[Array, "2 m *lanes"]:
        """Control input u of each vehicle right after the decision, (2, m, lanes).

        The input of the two-wheeled robot is the rate of force over mass [m/s³] and the angular
        acceleration [rad/s²].
        """
        return self.inputs_now()

    def apart(self) -> Float[Array, "m m *lanes"]:
        """Distance [m] of each vehicle to each other, by their true outputs."""
        place = self.error if self.offset is None else self.error + self.offset
        return length(place[:, :, None] - place[:, None])

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


# The value before the first output time, and the value after one more.
OVER_OUTPUTS = {
    "mean": (0.0, jnp.add),
    "max": (-jnp.inf, jnp.maximum),
    "min": (jnp.inf, jnp.minimum),
    "sum": (0.0, jnp.add),
    "integral": (0.0, jnp.add),
    "last": (jnp.nan, lambda _, value: value),
}
OVER_VEHICLES = {"mean": jnp.mean, "max": jnp.max, "min": jnp.min}
MAY_BE = {
    "error": jnp.isfinite,
    "infinite": lambda x: ~jnp.isnan(x),
    "blank": lambda x: ~jnp.isinf(x),
}

Gathered = Mapping[str, Float[Array, "m *lanes"]]  # by metric, before any sum over vehicles
FleetValues = dict[str, Float[Array, "*lanes"]]


def nothing(metrics: Sequence[Metric], shape: tuple[int, ...]) -> Gathered:
    """The metrics before the first output time, for the shape (m, lanes)."""
    return {metric.name: jnp.full(shape, OVER_OUTPUTS[metric.time][0]) for metric in metrics}


def add(
    metrics: Sequence[Metric],
    gathered: Gathered,
    seen: Observation,
    there: Bool[Array, "*lanes"],
    output: Int[Array, "*some"],
    clock: Clock,
) -> Gathered:
    """The metrics with the output time of number `output`, in the lanes where `there` holds.

    Metrics over the tail change only at output times in the tail. The integral over time is by the
    trapezoidal rule.
    """

    def over(part: str, there: Bool[Array, "*lanes"], first: Int[Array, ""]) -> Gathered:
        sides = (output > first).astype(float) + (output < clock.outputs).astype(float)
        weight = sides * (clock.at(clock.ticks) / 2)  # [s]
        found = {}
        for metric in metrics:
            if metric.over == part:
                known = gathered[metric.name]
                value = measured(metric, seen, known.shape)
                if metric.time == "integral":
                    value = value * jnp.broadcast_to(weight, known.shape)
                after = OVER_OUTPUTS[metric.time][1](known, value)
                found[metric.name] = jnp.where(there[None], after, known)
        return found

    counts = there & clock.in_tail(output)
    before = {metric.name: gathered[metric.name] for metric in metrics if metric.over == "tail"}
    first = clock.outputs - clock.tail_outputs + 1
    in_tail = jax.lax.cond(counts.any(), lambda: over("tail", counts, first), lambda: before)
    return {**over("run", there, jnp.asarray(0)), **in_tail}


def measured(metric: Metric, seen: Observation, shape: tuple[int, ...]) -> Float[Array, "m *lanes"]:
    """A metric of each vehicle; raise KindError unless it gives real numbers of this shape."""
    given = metric.of(seen)
    try:
        return jnp.broadcast_to(jnp.asarray(given, float), shape)
    except (TypeError, ValueError):
        told = f"metric {metric.name}.of gives {contract.described(given)}"
        raise KindError(f"{told}; expected: numbers, (m, lanes) = {shape}") from None


class Windows(NamedTuple):
    """Sums of the judged error [m] over windows of half a tail's output times, (lanes,).

    The last window ends the run. Sums of windows that began before t = 0 are infinite.
    """

    last: Float[Array, "*lanes"]  # of the window under way
    least: Float[Array, "*lanes"]  # the least of those before it

    def after(
        self,
        seen: Observation,
        there: Bool[Array, "*lanes"],
        output: Int[Array, "*some"],
        clock: Clock,
    ) -> "Windows":
        """The windows with the output time of number `output`, in the lanes `there`."""
        size, left = jnp.maximum(clock.tail_outputs // 2, 1), clock.outputs - output
        ended = jnp.where((left + 1) % size == 0, self.last, jnp.inf)
        began = jnp.where((left + 1) % size == 0, 0.0, self.last)
        now = Windows(began + judged_error(seen), jnp.minimum(self.least, ended))
        return Windows(*(jnp.where(there, *pair) for pair in zip(now, self, strict=True)))

    def fall(self) -> Float[Array, "*lanes"]:
        """How far the last window is below the least of the others, a share of the greater."""
        most = jnp.maximum(self.last, self.least)
        return (self.least - self.last) / jnp.where(most > 0, most, 1.0)


def judged_error(seen: Observation) -> Float[Array, "*lanes"]:
    """Mean error of the fleet; without a navigator the greatest of honest vehicles [m]."""
    if seen.leads:
        return seen.errors().mean(axis=0)
    return jnp.where(seen.attacked, 0.0, seen.errors()).max(axis=0)


def finite(gathered: Gathered) -> Bool[Array, "*lanes"]:
    """The lanes in which every metric of the contract is finite for every vehicle."""
    return jnp.isfinite(jnp.stack([gathered[metric.name] for metric in CONTRACT])).all(axis=(0, 1))


def fleet_values(metrics: Sequence[Metric], gathered: Gathered, clock: Clock) -> FleetValues:
    times, found = {"run": clock.outputs + 1, "tail": clock.tail_outputs}, {}
    for metric in metrics:
        value = OVER_VEHICLES[metric.vehicles](gathered[metric.name], axis=0)
        if metric.time == "mean":
            value = value / times[metric.over].astype(float)
        found[metric.name] = value
    return found


def all_defined(metrics: Sequence[Metric], values: FleetValues) -> Bool[Array, "*lanes"]:
    """The lanes in which every metric of the fleet is what its `undefined` allows."""
    return jnp.stack([MAY_BE[each.undefined](values[each.name]) for each in metrics]).all(axis=0)


def vehicle_errors(
    save: Sequence[str], gathered: Gathered, clock: Clock, ok: Bool[Array, "*lanes"]
) -> Series:
    """The saved errors of each vehicle over the tail [m], (m, lanes); NaN in failed lanes."""
    found = {}
    for name in save:
        if name in VEHICLE_ERRORS:
            times = clock.tail_outputs.astype(float) if name == "vehicle_mean" else 1.0
            found[name] = jnp.where(ok, gathered[VEHICLE_ERRORS[name]] / times, jnp.nan)
    return found
