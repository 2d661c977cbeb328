from jaxnet.kinds.announcements import Announcement


class Consistent(Announcement):
    """An attacked link announces R of what it carries (assumption B1).

    That is the source's announcement plus R of the signal, or R of the signal alone if `threat` is
    `replaces`.
    """

    consistent = True

    def received(self, honest, carried, attacked, signals, time):
        return carried
