from jaxnet.kinds.announcements import Announcement


class Honest(Announcement):
    """An attacked link announces what its source would announce without the attack."""

    def received(self, honest, carried, attacked, signals, time):
        return honest
