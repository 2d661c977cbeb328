from jaxnet.kinds.losses import Loss


class NoLoss(Loss):
    """Every message arrives at every tick."""

    def perfect(self):
        return True
