"""What attacked links announce, where vehicles announce what drives them (theorems.md O11)."""

from typing import ClassVar

from jaxnet.kinds.kind import Kind, KindError, broken
from jaxnet.kinds.shapes import LaneTimes, SlotMask, SlotSources, SlotVectors


class Announcement(Kind):
    """A way in which attacked links announce. A subclass gives `received`.

    Examples
    --------
    >>> import jax.numpy as jnp, jaxnet
    >>> from jaxnet.kinds.announcements import Announcement
    >>> class Doubled(Announcement):
    ...     '''An attacked link announces twice what its source does.'''
    ...
    ...     def received(self, honest, carried, attacked, signals, time):
    ...         return jnp.where(attacked[None], 2.0 * honest, honest)
    >>> attack = {"kind": "rotating", "magnitude": 1.0, "announces": Doubled()}
    >>> defence = {"kind": "trusted_trim", "score": "announced"}
    >>> keys = {"engine": "exact", "attack": attack, "defence": defence}
    >>> jaxnet.simulate(keys, samples=2, progress=False).lanes["status"].to_list()
    ['ok', 'ok']
    """

    claims: ClassVar[frozenset[str]] = frozenset({"consistent"})
    consistent: ClassVar[bool] = False  # assumption B1: each link announces R of what it carries

    def breaks(self):
        return broken(consistent=not self.consistent)

    def received(
        self,
        honest: SlotVectors,
        carried: SlotVectors,
        attacked: SlotMask,
        signals: SlotSources,
        time: LaneTimes,
    ) -> SlotVectors:
        """The announcements that listeners receive, slot by slot.

        Parameters
        ----------
        honest
            Announcement of each slot's source itself [m/s³], (2, slots, m, lanes).
        carried
            R of what the link carries, minus R of the navigator's path [m/s³], (2, slots, m,
            lanes).
        attacked
            Whether a link is attacked, (slots, m, lanes).
        signals
            Number of each link's signal, (slots, m): the number of a vehicle, or of a link where
            each listener receives a different signal.
        time
            Time [s], (lanes,).

        Returns
        -------
            Announcements [m/s³], (2, slots, m, lanes). A link that is not attacked announces
            `honest`.
        """
        raise KindError(f"{self.kind}: an announcement gives received(…)")
