from jaxnet.kinds.attacks import AnyAttack


class NoAttack(AnyAttack):
    """No vehicle is attacked."""

    kind = "none"
