"""The liar that announces as if it did not lie."""

from typing import Any

from jaxnet.kinds.announcements import Announcement


class Honest(Announcement):
    """An attacked link announces what its source would announce unattacked, whatever it carries."""

    kind = "honest"

    def received(self, honest: Any, carried: Any, attacked: Any, signals: Any, time: Any) -> Any:
        """What every source announces itself."""
        return honest
