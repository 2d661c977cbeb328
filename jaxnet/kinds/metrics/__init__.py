"""Metrics: what a row measures. Rows, cells, tables and the figure `curve` follow from it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, get_args

from jaxnet.kinds.fields import Record
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.protocols import FleetView, ScenarioView
from jaxnet.kinds.shapes import LaneNumbers, VehicleNumbers
from jaxnet.outside import modules, provenance
from jaxnet.outside.modules import KindError

AGREEMENT = ("spread", "outside")  # metrics that rows have where there is no navigator
DETECTION = ("alarms", "false_alarms")  # metrics that rows have where there is a detector
# Metrics that need a detector
WITH_DETECTOR = (*DETECTION, "first_alarm", "isolation_time", "run_length", "wrongly_cut")

Over = Literal["run", "tail"]
Reduction = Literal["mean", "max", "min"]
OverTime = Literal["mean", "max", "min", "sum", "integral", "last"]
Undefined = Literal["error", "infinite", "blank"]


class Statistic(NamedTuple):
    """A statistic of a metric over lanes: its words, and the ends of its columns' names."""

    words: str
    columns: tuple[str, ...]  # value, and both ends of the interval if `cells.csv` has them


LANE_STATISTICS = {
    "mean": Statistic("mean of lanes", ("mean", "low", "high")),
    "median": Statistic("median of lanes", ("median", "median_low", "median_high")),
    "q05": Statistic("5 % quantile of lanes", ("q05",)),
    "q95": Statistic("95 % quantile of lanes", ("q95",)),
    "max": Statistic("greatest of lanes", ("max",)),
}
COLUMNS_OF_METRIC = tuple(name for each in LANE_STATISTICS.values() for name in each.columns)


class MetricKeys(Record):
    """The `of` of a metric with keys: its fields are the keys, each with a default.

    A subclass gives `__call__`.

    Examples
    --------
    >>> import jax.numpy as jnp, jaxnet
    >>> from jaxnet.kinds.metrics import Metric, MetricKeys
    >>> class Faster(MetricKeys):
    ...     over: float = 1.0
    ...
    ...     def __call__(self, seen):
    ...         return jnp.where(seen.speed > self.over, 1.0, 0.0)
    >>> faster = Metric("faster", "1", Faster(), time="mean", vehicles="mean")
    >>> keys = {"engine": "exact", "metrics": [faster, faster.with_keys(over=1e9, name="light")]}
    >>> jaxnet.simulate(keys, samples=2, progress=False).lanes["light"].to_list()
    [0.0, 0.0]
    """

    def __call__(self, seen: FleetView) -> VehicleNumbers:
        raise KindError(f"{type(self).__name__}: a metric with keys gives __call__(self, seen)")

    def __hash__(self) -> int:
        return hash((type(self), self.model_dump_json()))  # of lists among the keys too

    def words(self) -> str:
        """Meaning of the metric with these keys; "" where that of the metric suits all."""
        return ""

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """The faults of a scenario whose rows have this metric."""
        yield from ()


@dataclass(frozen=True)
class Metric:
    """A number of a lane, reduced over output times and vehicles.

    `of(seen)` returns (m, lanes) from the fleet at one output time (`engine.metrics.Observation`).
    `time` reduces it over the output times of the run or the tail, then `vehicles` reduces it over
    the vehicles.

    Parameters
    ----------
    name
        Name of the column.
    unit
        Unit of the numbers that `of` returns, such as "m/s"; "1" or "" for none.
    of
        Function from an observation to one number for each vehicle, (m, lanes). Of a metric with
        keys it is a `MetricKeys`.
    over
        Output times: those of the whole run, or of the tail.
    time
        Reduction over the output times: "mean", "max", "min", "sum", "last", or "integral" by the
        trapezoidal rule.
    vehicles
        Reduction over the vehicles: "mean", "max" or "min".
    words
        Meaning of the metric in tables and on axes.
    undefined
        Meaning of a result that is no finite number. "error": the lane ends as `unmeasured`.
        "infinite": infinity is a value, such as the time of what did not happen; not-a-number is an
        error. "blank": not-a-number says that there was nothing to measure; infinity is an error.

    Raises
    ------
    KindError
        `over`, `time`, `vehicles` or `undefined` is none of these.

    Examples
    --------
    >>> import jaxnet
    >>> from jaxnet.kinds.metrics import Metric
    >>> speed = lambda seen: abs(seen.speed)
    >>> peak_speed = Metric("peak_speed", "m/s", speed, words="greatest speed")
    >>> keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5, "metrics": [peak_speed]}
    >>> results = jaxnet.simulate(keys, samples=2, progress=False)
    >>> bool((results.lanes["peak_speed"] > 0).all())
    True
    """

    name: str  # name of the column
    unit: str
    of: Callable[["FleetView"], Any]
    over: Over = "run"
    time: OverTime = "max"
    vehicles: Reduction = "max"
    words: str = ""  # meaning, for tables and axes
    undefined: Undefined = "error"
    base: str = field(init=False, default="")  # the name before a config gives another

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", self.name)
        allowed = {"over": get_args(Over), "time": get_args(OverTime)}
        allowed |= {"vehicles": get_args(Reduction), "undefined": get_args(Undefined)}
        for key, known in allowed.items():
            if (given := getattr(self, key)) not in known:
                message = f"{key} is one of {', '.join(known)} (got {given!r})"
                raise KindError(f"metric {self.name}: {message}")
        if isinstance(self.of, MetricKeys):
            object.__setattr__(self, "words", self.of.words() or self.words)
            if "name" in type(self.of).model_fields:
                raise KindError(f"metric {self.name}: the key name is the name of the column")

    @property
    def keys(self) -> dict[str, Any]:
        """The keys of the metric with their values, and the name that a config gives it."""
        own = self.of.model_dump() if isinstance(self.of, MetricKeys) else {}
        return own if self.name == self.base else {**own, "name": self.name}

    def with_keys(self, name: object = None, **keys: object) -> "Metric":
        """The metric with these keys and its own others; raise ValueError where they are wrong.

        `name` is the name of its column, if it is not to be as before.
        """
        of, name = self.of, self.name if name is None else name
        if not isinstance(name, str):
            raise ValueError(f"name must be text (got {name})")
        if isinstance(of, MetricKeys):
            of = type(of).model_validate(dict(of) | keys)
        elif keys:
            raise ValueError(f"{self.base} has no keys")
        made = replace(self, name=name, of=of)
        object.__setattr__(made, "base", self.base)
        return made

    def is_alike(self, other: "Metric") -> bool:
        """Whether the other is this metric with other keys."""
        alike = self.base == other.base and type(self.of) is type(other.of)
        return alike and self.with_keys(**{"name": other.name, **other.keys}) == other

    @property
    def told(self) -> str:
        """Its words, with the name that a config gives it."""
        words = self.words or self.base.replace("_", " ")
        return words if self.name == self.base else f"{words} ({self.name})"

    @property
    def column_unit(self) -> str:
        """Unit of the column, "" without dimension; an integral has that of the metric times s."""
        unit = "" if self.unit == "1" else self.unit
        if self.time != "integral":
            return unit
        return f"{unit}·s" if unit else "s"

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """The faults of a scenario whose rows have this metric."""
        return self.of.faults(scenario) if isinstance(self.of, MetricKeys) else iter(())

    def __reduce__(self) -> tuple[Callable[..., "Metric"], tuple[object, ...]]:
        """Pickle the file of the metric with its hash: another process loads the same metric."""
        return restore_metric, (provenance.origin_of(self), provenance.name_in(self), self.keys)


def restore_metric(origin: modules.Origin, name: str, keys: dict[str, Any]) -> Metric:
    found: Metric = modules.attribute(modules.load_origin(origin), name)
    return found.with_keys(**keys)


def of_fleet(seen: FleetView, number: float | LaneNumbers) -> VehicleNumbers:
    """A number of the whole fleet, for each vehicle (m, lanes)."""
    xp = seen.error.__array_namespace__()
    return xp.broadcast_to(xp.asarray(number), seen.error.shape[1:])


def tallied(seen: FleetView, name: str, which: int) -> VehicleNumbers:
    """What a tally says until now, (m, lanes): the share of vehicle-steps (0), or the steps (1)."""
    return of_fleet(seen, seen.tallies[name][which] if name in seen.tallies else 0.0)


def errors_of(seen: FleetView) -> VehicleNumbers:
    return seen.errors()


def disagreements_of(seen: FleetView) -> VehicleNumbers:
    return seen.disagreements()


def absolute_turn_rate(seen: FleetView) -> VehicleNumbers:
    return abs(seen.turn_rate)


CONTRACT = (
    Metric("tail_mean", "m", errors_of, "tail", "mean", "mean", "mean error of the fleet"),
    Metric("tail_max", "m", errors_of, "tail", "max", "max", "greatest error of any vehicle"),
    Metric("tail_disagreement", "m", disagreements_of, "tail", "mean", "mean", "mean disagreement"),
    Metric("peak_error", "m", errors_of, "run", "max", "max", "greatest error at any time"),
    Metric("min_speed", "m/s", lambda seen: abs(seen.speed), "run", "min", "min", "least speed"),
    Metric(
        "peak_turn_rate", "rad/s", absolute_turn_rate, "run", "max", "max", "greatest turn rate"
    ),
)
