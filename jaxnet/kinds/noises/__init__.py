"""Noises: errors of the words on links."""

from collections.abc import Iterator
from typing import ClassVar

from jaxnet.kinds.kind import Fault, KindError, broken
from jaxnet.kinds.noise import ErrorsAtTicks
from jaxnet.kinds.protocols import ScenarioView
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, SlotJets, SlotLinks, SlotSources
from jaxnet.kinds.ticks import DrawsTogether


class ChannelNoise(ErrorsAtTicks, DrawsTogether):
    """A way in which words arrive with errors. A subclass gives `next_errors`.

    A listener hears `y_j + a_ij + n_ij`. An error is drawn at a tick and stays the same until the next tick.
    """

    claims: ClassVar[frozenset[str]] = ErrorsAtTicks.claims  # `exact` is said by `erring` itself

    def next_errors(
        self, last: SlotJets, time: LaneTimes, interval: LaneNumbers, sources: SlotSources
    ) -> SlotJets:
        """Return the errors of position, velocity and acceleration of one tick, each (2, slots, m, lanes).

        Where `errs_in_highest`, the errors of the highest derivative come last. `last` are those of the last
        tick, 0 before the first. `time` and `interval` (lanes,) are the time of the tick and from tick to
        tick [s], `sources` (slots, m) the number of each slot's source.
        """
        raise KindError(
            f"{self.kind}: a noise gives next_errors(self, last, time, interval, sources)"
        )

    def exact(self) -> bool:
        """Return whether words have no errors in any order."""
        return not (any(self.erring()) or self.errs_in_highest())

    def erring(self) -> tuple[bool, bool, bool]:
        """Return whether position, velocity and acceleration of words may have errors."""
        return True, True, True

    def errs_in_highest(self) -> bool:
        """Return whether the r-th derivative of words has errors too, for vehicles of order r."""
        return False

    def exact_links(self, sources: SlotSources) -> SlotLinks:
        """Return the links on which words have no errors, by default none."""
        return sources < 0

    def breaks(self) -> frozenset[str]:
        return broken(exact_messages=not self.exact())

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield a fault if words arrive with errors and the scenario has no ticks."""
        if not self.exact() and scenario.tick == 0:
            yield Fault(
                ("channel.noise", "tick"), "errors of words are drawn at ticks: give a tick"
            )
