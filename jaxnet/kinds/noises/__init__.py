"""Noises: errors of the words on links."""

from collections.abc import Iterator

from jaxnet.kinds.kind import Fault, KindError
from jaxnet.kinds.protocols import ScenarioView
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, SlotJets, SlotSources
from jaxnet.kinds.ticks import DrawsAtTicks


class ChannelNoise(DrawsAtTicks):
    """A way in which words arrive with errors. A subclass gives `next_errors`.

    A listener hears `y_j + a_ij + n_ij`. An error is drawn at a tick and stays the same until the next tick.
    """

    def exact(self) -> bool:
        """Return whether all errors are 0."""
        return False

    def next_errors(
        self, last: SlotJets, time: LaneTimes, interval: LaneNumbers, sources: SlotSources
    ) -> SlotJets:
        """Return the errors of one tick.

        Parameters
        ----------
        last
            Errors of the last tick; 0 before the first.
        time
            Time of the tick [s], (lanes,).
        interval
            Time from tick to tick [s], (lanes,).
        sources
            Number of the source of each slot, (slots, m); 0 is the navigator.

        Returns
        -------
            Errors of position, velocity and acceleration [m, m/s, m/s²], each (2, slots, m, lanes).
        """
        raise KindError(f"{self.kind}: a noise gives next_errors(self, last, time, interval, sources)")

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield a fault if words arrive with errors and the scenario has no ticks."""
        if not self.exact() and scenario.tick == 0:
            yield Fault(("channel.noise", "tick"), "errors of words are drawn at ticks: give a tick")
