"""What a row measures, one declaration each: rows, cells, tables and figures follow from it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from jaxnet.kinds import modules, provenance

Reduction = Literal["mean", "max", "min"]


@dataclass(frozen=True)
class Metric:
    """A number of a lane, gathered over output times.

    `of(seen)` gives (m, lanes) from what is seen of the fleet (`engine.metrics.Observation`); that is reduced
    over the run's output times, or the tail's, and then over the vehicles.
    """

    name: str  # of the column
    unit: str
    of: Callable[[Any], Any]
    over: Literal["run", "tail"] = "run"
    time: Reduction = "max"
    vehicles: Reduction = "max"
    words: str = ""  # what it is, for tables and axes

    def __reduce__(self) -> Any:
        """Another process is told in which file the metric is, and what that file must hold."""
        return restore_metric, (provenance.origin_of(self), provenance.name_in(self))


def restore_metric(origin: Any, name: str) -> Metric:
    """A metric that another process has sent; raises KindError if its module is not the same here."""
    return modules.attribute(modules.load_origin(origin), name)


CONTRACT = (
    Metric("tail_mean", "m", lambda seen: seen.errors(), "tail", "mean", "mean", "mean error of the fleet"),
    Metric(
        "tail_max", "m", lambda seen: seen.errors(), "tail", "max", "max", "greatest error of any vehicle"
    ),
    Metric(
        "tail_disagreement",
        "m",
        lambda seen: seen.disagreements(),
        "tail",
        "mean",
        "mean",
        "mean disagreement",
    ),
    Metric("peak_error", "m", lambda seen: seen.errors(), "run", "max", "max", "greatest error at any time"),
    Metric("min_speed", "m/s", lambda seen: abs(seen.speed), "run", "min", "min", "least speed"),
    Metric(
        "peak_turn_rate", "rad/s", lambda seen: abs(seen.turn_rate), "run", "max", "max", "greatest turn rate"
    ),
)
