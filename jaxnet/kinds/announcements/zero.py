"""The announcement 0."""

from jaxnet.kinds.announcements import Announcement
from jaxnet.kinds.shapes import LaneTimes, SlotMask, SlotSources, SlotVectors


class Zero(Announcement):
    """An attacked link announces 0, as the navigator does, whatever the link carries."""

    kind = "zero"

    def received(
        self,
        honest: SlotVectors,
        carried: SlotVectors,
        attacked: SlotMask,
        signals: SlotSources,
        time: LaneTimes,
    ) -> SlotVectors:
        """Return 0 on attacked links."""
        xp = honest.__array_namespace__()
        return xp.where(attacked[None], 0.0, honest)
