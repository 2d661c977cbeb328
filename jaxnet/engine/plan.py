"""Inputs and results of all engines: plan, clock, tolerances, numbers of lanes, and outcome."""

from typing import Any, NamedTuple

from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.status import Code
from jaxnet.kinds.metrics import CONTRACT, Metric
from jaxnet.model.lane import Lane

# Residual of L⁻¹ a0 = 1: of order 1 where a vehicle is cut off, else ‖L⁻¹‖ times rounding.
CONNECTED = 1e-6


class Plan(NamedTuple):
    """Static choices that shape the compiled program: hashable; JAX compiles once for each plan."""

    engine: Any  # a subclass of `engine.methods.Engine`
    options: tuple[Any, ...] = ()  # of the engine, for which its program is compiled
    metrics: tuple[Metric, ...] = CONTRACT
    decides: bool = True  # whether vehicles decide which sources to retain
    strategic: bool = False  # whether attackers choose their vectors at ticks
    consistent: bool = True  # whether an attack's signals come with their true derivatives
    missing: str = "drop"  # what stands in for a lost message: a key of `channel.MISSING`
    late: int = 0  # most ticks by which messages are delayed
    estimates: bool = False  # whether listeners estimate the motion of their sources
    own_delay: bool = False  # whether delayed messages are compared with what was so long ago
    extrapolate: str = "none"  # what listeners make of delayed messages (`late.message_gains`)
    as_told: bool = False  # whether attacked vehicles move as they tell
    in_field: bool = False  # whether vehicles decide inside the vector field (tick: 0)
    save: tuple[str, ...] = ()  # names in `metrics.SERIES` and `metrics.VEHICLE_ERRORS`
    rows: int = 0  # of these stacks: the clock's outputs and t = 0; 0 where nothing is saved
    chunk: int = 0  # lanes side by side

    def at_ticks(self, law: Any) -> bool:
        """Whether vehicles under a law hear messages at ticks alone."""
        return self.engine.samples or law.needs_ticks()

    @property
    def choosing(self) -> bool:
        """Whether vehicles or attackers choose anything at ticks."""
        return self.decides or self.strategic


class Clock(NamedTuple):
    """Times of ticks and of outputs."""

    interval: Float[Array, ""]  # [s] from tick to tick
    ticks: Int[Array, ""]  # intervals from one output time to the next
    outputs: Int[Array, ""]  # output times after t = 0
    tail_outputs: Int[Array, ""]  # output times of the tail

    def at(self, number: Int[Array, "*numbers"]) -> Float[Array, "*numbers"]:
        """The times [s] of the ticks with these numbers."""
        return number.astype(float) * self.interval

    def in_tail(self, output: Int[Array, "*numbers"]) -> Bool[Array, "*numbers"]:
        """Whether these output times are in the tail."""
        return output > self.outputs - self.tail_outputs


class Tolerances(NamedTuple):
    """Tolerance of a step's local error, `rtol * |state| + atol`, and the most steps of a lane.

    The error is the root mean square over the vehicles of a lane.
    """

    rtol: Float[Any, "*lanes"]
    atol: Float[Any, "*lanes"]
    max_steps: Int[Any, "*lanes"]


class Inputs(NamedTuple):
    """Numbers that describe lanes: each leaf is an array that may differ from lane to lane."""

    lane: Lane
    numbers: Any  # of the engine: its tolerances, or its flow


class Outcome(NamedTuple):
    """Results of lanes; `series` have a first axis over output times, t = 0 included.

    The errors of each vehicle over the tail, among the series, have no such axis.
    """

    status: Code
    metrics: dict[str, Float[Array, "*lanes"]]
    steps: Int[Array, "*lanes"]
    switches: Int[Array, "*lanes"]
    unheard: Int[Array, "*lanes"]  # (vehicle, tick) pairs at which a vehicle kept its drive
    series: dict[str, Any]
    cut_off: dict[str, Any]  # by column, of vehicles that decisions cut off (`status.Isolation`)
    tail_fall: Float[Array, "*lanes"]  # how far the tail still falls (`metrics.Windows.fall`)
