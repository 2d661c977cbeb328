"""Losses: which messages a channel loses at a tick."""

from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

from jaxnet.kinds.kind import Fault, KindError
from jaxnet.kinds.protocols import ScenarioView
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, Memory, SlotMask, SlotNumbers, SlotSources
from jaxnet.kinds.ticks import DrawsAtTicks


class Messages(NamedTuple):
    """The messages on their way at a tick, by slot. A listener has a slot for each of its sources.

    - `time` (lanes,): time of the tick [s]
    - `sources` (slots, m): number of the source, 0 is the navigator
    - `present` (slots, m, lanes): whether the slot has a message
    - `distance` (slots, m, lanes): distance from the source to the listener [m]
    - `interval` (lanes,): time from tick to tick [s]
    """

    time: LaneTimes
    sources: SlotSources
    present: SlotMask
    distance: SlotNumbers
    interval: LaneNumbers


class Loss(DrawsAtTicks):
    """A rule by which a channel loses messages. A subclass gives `lost`, and `start` if it has a memory.

    A message that is lost at a tick is missing until the next tick. Its listener drops the source, and
    divides the other weights by their sum. A vehicle that hears nobody keeps its last drive.
    """

    claims: ClassVar[frozenset[str]] = frozenset({"perfect", "of_whole_ticks"})

    def perfect(self) -> bool:
        """Return whether no message is ever lost."""
        return False

    def of_whole_ticks(self) -> float | None:
        """Return the probability with which all messages of a tick are lost together.

        None if messages are lost otherwise, or if ticks depend on each other.
        """
        return None

    def start(self, messages: Messages) -> Memory:
        """Return the memory before the first tick: any pytree of arrays with lanes last; by default None."""
        return None

    def lost(self, messages: Messages, memory: Any) -> tuple[SlotMask, Memory]:
        """Return the messages that are lost at a tick.

        Parameters
        ----------
        messages
            The messages on their way.
        memory
            The memory from the last tick, or from `start`.

        Returns
        -------
            Whether a message is lost, (slots, m, lanes), and the memory. Slots without a message do not
            count.
        """
        raise KindError(f"{self.kind}: a loss gives lost(self, messages, memory)")

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield faults of messages that can be lost, if the scenario has no ticks, a defence announces, or
        the law is linearised.
        """
        if self.perfect():
            return
        if scenario.tick == 0:
            yield Fault(("channel.loss", "tick"), "messages are lost at ticks: give a tick")
        if scenario.defence.announcing():
            message = "a defence by announcements needs every message: give loss: none, or another defence"
            yield Fault(("channel.loss", "defence"), message)
        if not scenario.law.takes_any_message():
            message = f"under {scenario.law.kind} a vehicle has no drive to keep: give loss: none"
            yield Fault(("channel.loss", "law"), message)
