"""What attacked links announce, where the defence has vehicles announce what drives them (SCIENCE O11)."""

from typing import Any, ClassVar

from jaxnet.kinds.kind import Kind, KindError


class Announcement(Kind):
    """One way in which attacked links announce. A kind from outside gives `received`."""

    consistent: ClassVar[bool] = False  # assumption B1: each link announces R of what it carries

    def received(self, honest: Any, carried: Any, attacked: Any, signals: Any, time: Any) -> Any:
        """Announcements as listeners receive them, slot by slot.

        Parameters
        ----------
        honest
            What each slot's source announces itself [m/s³], (2, slots, m, lanes).
        carried
            R of what the link carries, less R of the navigator's path [m/s³], (2, slots, m, lanes).
        attacked
            Which links are attacked, (slots, m, lanes).
        signals
            Number of each link's signal, (slots, m): a vehicle's, or a link's where listeners are told
            different signals.
        time
            Time [s], (lanes,).

        Returns
        -------
            Announcements [m/s³], (2, slots, m, lanes). Links that are not attacked announce `honest`.
        """
        raise KindError(f"{self.kind}: an announcement gives received(…)")
