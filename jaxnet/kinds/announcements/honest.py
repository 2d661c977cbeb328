"""The announcement of a link as if it were not attacked."""

from jaxnet.kinds.announcements import Announcement
from jaxnet.kinds.shapes import LaneTimes, SlotMask, SlotSources, SlotVectors


class Honest(Announcement):
    """An attacked link announces what its source would announce without the attack."""

    kind = "honest"

    def received(
        self,
        honest: SlotVectors,
        carried: SlotVectors,
        attacked: SlotMask,
        signals: SlotSources,
        time: LaneTimes,
    ) -> SlotVectors:
        """Return `honest` for all links."""
        return honest
