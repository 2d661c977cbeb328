"""What an engine is asked for and what it gives, the same for both."""

from typing import Any, NamedTuple

from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine.status import Code
from jaxnet.kinds.metrics import CONTRACT, Metric
from jaxnet.model.lane import Lane

CONNECTED = 1e-6  # residual of L⁻¹ a0 = 1: of order 1 if cut off, ‖L⁻¹‖ times rounding else


class Plan(NamedTuple):
    """What the compiled program is shaped by: hashable, a new one compiles anew."""

    engine: Any  # the class, one of `engine.methods.Engine`
    options: tuple[Any, ...] = ()  # of the method, what its program depends on
    metrics: tuple[Metric, ...] = CONTRACT
    decides: bool = True  # whether vehicles decide whom to retain
    strategic: bool = False  # whether attackers choose their vectors at ticks
    consistent: bool = True  # whether an attack's signals come with their true derivatives
    in_field: bool = False  # whether vehicles decide inside the vector field (tick: 0), not once an interval
    save: tuple[str, ...] = ()  # what is stacked over output times, of `metrics.SERIES`
    rows: int = 0  # of those stacks: the clock's outputs and t = 0, where anything is saved
    chunk: int = 0  # lanes side by side

    @property
    def choosing(self) -> bool:
        """Whether anybody chooses anything at ticks."""
        return self.decides or self.strategic


class Clock(NamedTuple):
    """When things happen."""

    interval: Float[Array, ""]  # [s] from tick to tick
    ticks: Int[Array, ""]  # intervals from one output time to the next
    outputs: Int[Array, ""]  # output times after t = 0
    tail_outputs: Int[Array, ""]  # how many of the last output times stand for t → ∞

    def at(self, number: Any) -> Float[Array, "*numbers"]:
        """Times [s] of the ticks with these numbers."""
        return number.astype(float) * self.interval

    def in_tail(self, output: Any) -> Bool[Array, "*numbers"]:
        """Whether these output times stand for t → ∞."""
        return output > self.outputs - self.tail_outputs


class Tolerances(NamedTuple):
    """Local error `rtol·|state| + atol` (root mean square over vehicles that step together) and the steps
    allowed per lane.
    """

    rtol: Float[Array, "*lanes"]
    atol: Float[Array, "*lanes"]
    max_steps: Int[Array, "*lanes"]


class Inputs(NamedTuple):
    """Everything about lanes that is a number."""

    lane: Lane
    numbers: Any  # of the engine: its tolerances, or its flow


class Outcome(NamedTuple):
    """What is left of lanes; `series` have a first axis over output times, t = 0 included."""

    status: Code
    metrics: dict[str, Float[Array, "*lanes"]]
    steps: Int[Array, "*lanes"]
    switches: Int[Array, "*lanes"]
    series: dict[str, Any]
