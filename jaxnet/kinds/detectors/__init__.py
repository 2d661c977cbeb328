"""Detectors: which messages raise an alarm at a tick (theorems.md O17)."""

from typing import Any, ClassVar, NamedTuple

from jaxtyping import Float, Int

from jaxnet.kinds.kind import Kind, KindError
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, Memory, SlotMask, SlotSources


class JudgedWords(NamedTuple):
    """The messages that arrive at a tick against their predictions, by slot.

    `residuals` are received minus predicted jets, position first, each divided by the standard
    deviation of its error; 0 in an order without errors. A listener has a slot for each source.
    """

    time: LaneTimes  # of the tick [s]
    sources: SlotSources  # number of the source, 0 is the navigator
    residuals: Float[Any, "orders 2 slots m *lanes"]
    orders: Int[Any, "slots m *lanes"]  # number of orders with errors
    judged: SlotMask  # whether a message arrived, and has errors
    interval: LaneNumbers  # time from tick to tick [s]


class AlarmRule(NamedTuple):
    """The test of a link: an alarm if S is over the limit.

    S is the sum of the squared residuals of the last `window` ticks. With a drift S becomes
    `max(0, S + z - drift)` at each tick, and 0 after an alarm; z is the squared residual, or if not
    `squared` the residual along a direction.
    """

    limit: float
    window: int = 1
    drift: float | None = None
    squared: bool = True


class Detector(Kind):
    """A test of messages. A subclass gives `alarms`, and `start` if it has a memory.

    An alarm has no effect on the fleet. Rows have the share of messages that raised one.
    """

    present: ClassVar[bool] = True

    def start(self, words: JudgedWords) -> Memory:
        """The memory before the first tick: any pytree of arrays, lanes last; by default None."""
        return None

    def rule(self, orders: int) -> AlarmRule | None:
        """The test of a link with so many orders with errors; by default None, which is unknown."""
        return None

    def alarms(self, words: JudgedWords, memory: Any) -> tuple[SlotMask, Memory]:
        """The messages that raise an alarm at a tick.

        Parameters
        ----------
        words
            The messages that arrive. Without attack their residuals are standard normal if the
            errors are normal.
        memory
            The memory from the last tick, or from `start`.

        Returns
        -------
            Whether a message raises an alarm, (slots, m, lanes), and the memory. Messages that are
            not judged do not count.
        """
        raise KindError(f"{self.kind}: a detector gives alarms(self, words, memory)")
