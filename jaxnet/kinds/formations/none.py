from jaxnet.kinds.formations import Formation


class NoFormation(Formation):
    """All vehicles go to one place."""

    present = False
