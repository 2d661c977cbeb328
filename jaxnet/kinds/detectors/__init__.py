"""Detectors: which words raise an alarm at a tick (theorems.md O17)."""

from typing import Any, ClassVar, NamedTuple

from jaxtyping import Float, Int

from jaxnet.kinds.kind import Kind, KindError
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, Memory, SlotMask, SlotSources


class JudgedWords(NamedTuple):
    """The words that arrive at a tick against their predictions, by slot. A listener has a slot for
    each of its sources.

    - `time` (lanes,): time of the tick [s]
    - `sources` (slots, m): number of the source, 0 is the navigator
    - `residuals` (orders, 2, slots, m, lanes): received minus predicted jets, position first, each
      divided by the standard deviation of its error; 0 in an order without errors
    - `orders` (slots, m, lanes): number of orders with errors
    - `judged` (slots, m, lanes): whether a word arrived, and has errors
    - `interval` (lanes,): time from tick to tick [s]
    """

    time: LaneTimes
    sources: SlotSources
    residuals: Float[Any, "orders 2 slots m *lanes"]
    orders: Int[Any, "slots m *lanes"]
    judged: SlotMask
    interval: LaneNumbers


class Detector(Kind):
    """A test of words. A subclass gives `alarms`, and `start` if it has a memory.

    An alarm has no effect on the fleet. Rows have the share of words that raised one.
    """

    present: ClassVar[bool] = True

    def start(self, words: JudgedWords) -> Memory:
        """The memory before the first tick: any pytree of arrays, lanes last; by default None."""
        return None

    def alarms(self, words: JudgedWords, memory: Any) -> tuple[SlotMask, Memory]:
        """The words that raise an alarm at a tick.

        Parameters
        ----------
        words
            The words that arrive. Without attack their residuals are standard normal, if the errors
            are normal.
        memory
            The memory from the last tick, or from `start`.

        Returns
        -------
            Whether a word raises an alarm, (slots, m, lanes), and the memory. Words that are not
            judged do not count.
        """
        raise KindError(f"{self.kind}: a detector gives alarms(self, words, memory)")
