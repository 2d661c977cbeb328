"""Noises: errors of the messages on links."""

from typing import ClassVar

from jaxnet.kinds.kind import Fault, KindError, broken
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, SlotJets, SlotLinks, SlotSources
from jaxnet.kinds.ticks import DrawsTogether, ErrorsAtTicks


class ChannelNoise(ErrorsAtTicks, DrawsTogether):
    """A way in which messages arrive with errors. A subclass gives `next_errors`.

    A listener hears `y_j + a_ij + n_ij`. An error is drawn at a tick and stays the same until the
    next tick.

    Examples
    --------
    >>> import jax.numpy as jnp, jaxnet
    >>> from jaxnet.kinds.noises import ChannelNoise
    >>> class East(ChannelNoise):
    ...     '''Every message is 1 m off to the east.'''
    ...
    ...     def next_errors(self, last, time, interval, sources):
    ...         return jnp.zeros_like(last[0]).at[0].set(1.0), *last[1:]
    >>> keys = {"engine": "exact", "attack": "none", "topology": "star", "defence": "none"}
    >>> results = jaxnet.simulate({**keys, "channel": {"noise": East()}}, 2, progress=False)
    >>> results.lanes["tail_mean"].round(2).to_list()
    [1.0, 1.0]
    """

    claims: ClassVar[frozenset[str]] = ErrorsAtTicks.claims  # `exact` is said by `erring` itself

    def next_errors(
        self, last: SlotJets, time: LaneTimes, interval: LaneNumbers, sources: SlotSources
    ) -> SlotJets:
        """The errors of position, velocity and acceleration of one tick, each (2, slots, m, lanes).

        Where `errs_in_highest`, the errors of the highest derivative come last. `last` are those of
        the last tick, 0 before the first. `time` and `interval` (lanes,) are the time of the tick
        and from tick to tick [s], `sources` (slots, m) the number of each slot's source.
        """
        gives = "next_errors(self, last, time, interval, sources)"
        raise KindError(f"{self.kind}: a noise gives {gives}")

    def exact(self) -> bool:
        """Whether messages have no errors in any order."""
        return not (any(self.erring()) or self.errs_in_highest())

    def erring(self) -> tuple[bool, bool, bool]:
        """Whether position, velocity and acceleration of messages may have errors."""
        return True, True, True

    def errs_in_highest(self) -> bool:
        """Whether the r-th derivative of messages has errors too, for vehicles of order r."""
        return False

    def exact_links(self, sources: SlotSources) -> SlotLinks:
        """The links on which messages have no errors, by default none."""
        return sources < 0

    def breaks(self):
        return broken(exact_messages=not self.exact())

    def faults(self, scenario):
        if not self.exact() and scenario.tick == 0:
            message = "errors of messages are drawn at ticks: give a tick"
            yield Fault(("channel.noise", "tick"), message)
