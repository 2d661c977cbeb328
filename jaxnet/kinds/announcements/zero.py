from jaxnet.kinds.announcements import Announcement


class Zero(Announcement):
    """An attacked link announces 0, as the navigator does, whatever the link carries."""

    def received(self, honest, carried, attacked, signals, time):
        xp = honest.__array_namespace__()
        return xp.where(attacked[None], 0.0, honest)
