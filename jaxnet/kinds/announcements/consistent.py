"""The announcement that belongs to what a link carries."""

from typing import Any, ClassVar

from jaxnet.kinds.announcements import Announcement


class Consistent(Announcement):
    """An attacked link announces R of what it carries (assumption B1): its source's announcement plus R of
    the signal, or R of the signal alone where the attack replaces what is sent.
    """

    kind = "consistent"
    consistent: ClassVar[bool] = True

    def received(self, honest: Any, carried: Any, attacked: Any, signals: Any, time: Any) -> Any:
        """R of what is carried, attacked or not."""
        return carried
