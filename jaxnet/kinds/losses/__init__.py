"""Losses: which messages a channel loses at a tick."""

from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

from jaxnet.kinds.kind import Fault, KindError, broken
from jaxnet.kinds.protocols import ScenarioView
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, Memory, SlotMask, SlotNumbers, SlotSources
from jaxnet.kinds.ticks import DrawsAtTicks


class Messages(NamedTuple):
    """The messages on their way at a tick, by slot. A listener has one for each source."""

    time: LaneTimes  # of the tick [s]
    sources: SlotSources  # number of the source, 0 is the navigator
    present: SlotMask  # whether the slot has a message
    distance: SlotNumbers  # from the source to the listener [m]
    interval: LaneNumbers  # time from tick to tick [s]


class Loss(DrawsAtTicks):
    """A rule by which a channel loses messages. A subclass gives `lost`, with a memory `start`.

    A message that is lost at a tick is missing until the next tick. Its listener drops the source,
    and divides the other weights by their sum. A vehicle that hears nobody keeps its last drive.

    Examples
    --------
    >>> import jaxnet
    >>> from jaxnet.kinds.losses import Loss
    >>> class Jammed(Loss):
    ...     '''No message arrives from the first second on.'''
    ...
    ...     def lost(self, messages, memory):
    ...         late = messages.time >= 1.0
    ...         return (messages.distance >= 0) & late[None, None], memory
    >>> keys = {"engine": "exact", "horizon": 2.0, "tail": 0.5, "channel": {"loss": Jammed()}}
    >>> jaxnet.simulate(keys, samples=2, progress=False).lanes["status"].to_list()
    ['ok', 'ok']
    """

    claims: ClassVar[frozenset[str]] = frozenset({"perfect", "of_whole_ticks", "lost_apart"})

    def perfect(self) -> bool:
        """Whether no message is ever lost."""
        return False

    def of_whole_ticks(self) -> float | None:
        """The probability with which all messages of a tick are lost together.

        None if messages are lost otherwise, or if ticks depend on each other.
        """
        return None

    def lost_apart(self) -> float | None:
        """The share of messages lost in the long run, each apart from others to its listener.

        0 if all are lost together; None, the default, if it is not known.
        """
        return None

    def start(self, messages: Messages) -> Memory:
        """The memory before the first tick: any pytree of arrays, lanes last; by default None."""
        return None

    def lost(self, messages: Messages, memory: Any) -> tuple[SlotMask, Memory]:
        """The messages that are lost at a tick.

        Parameters
        ----------
        messages
            The messages on their way.
        memory
            The memory from the last tick, or from `start`.

        Returns
        -------
            Whether a message is lost, (slots, m, lanes), and the memory. Slots without a message do
            not count.
        """
        raise KindError(f"{self.kind}: a loss gives lost(self, messages, memory)")

    def breaks(self):
        return broken(every_message=not self.perfect())

    def faults(self, scenario):
        if not self.perfect():
            yield from unheard_faults("channel.loss", scenario)


def unheard_faults(key: str, scenario: ScenarioView) -> Iterator[Fault]:
    """Faults of a key by which messages that were sent may not be heard."""
    if scenario.tick == 0:
        yield Fault((key, "tick"), "messages are lost at ticks: give a tick")
    instead = "give detector.cuts: never" if key == "detector.cuts" else "give loss: none"
    if scenario.defence.announcing():
        message = f"a defence by announcements needs every message: {instead}"
        yield Fault((key, "defence"), f"{message}, or another defence")
    if not scenario.law.takes_any_message():
        message = f"under {scenario.law.kind} a vehicle has no drive to keep: {instead}"
        yield Fault((key, "law"), message)
