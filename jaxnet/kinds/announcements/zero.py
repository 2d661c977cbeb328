"""The liar that announces nothing."""

from typing import Any

from jaxnet.kinds.announcements import Announcement


class Zero(Announcement):
    """An attacked link announces 0, as the navigator does, whatever it carries."""

    kind = "zero"

    def received(self, honest: Any, carried: Any, attacked: Any, signals: Any, time: Any) -> Any:
        """0 on attacked links."""
        xp = honest.__array_namespace__()
        return xp.where(attacked[None], 0.0, honest)
