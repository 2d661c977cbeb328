"""No attack."""

from jaxnet.kinds.attacks import AnyAttack


class NoAttack(AnyAttack):
    """Nobody is attacked."""

    kind = "none"
