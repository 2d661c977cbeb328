from jaxnet.kinds.filters import Filter


class NoFilter(Filter):
    """Vehicles move as the law asks."""

    present = False
