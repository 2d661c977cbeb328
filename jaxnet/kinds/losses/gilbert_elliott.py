from typing import Annotated, Any

from jaxnet.kinds.fields import Number, Probability, Within, setting
from jaxnet.kinds.losses import Loss, Messages
from jaxnet.kinds.ticks import DrawsTogether
from jaxnet.lazy import jnp


class GilbertElliott(DrawsTogether, Loss):
    """A channel is good or bad, a Markov chain, and loses every message while it is bad.

    The share of lost messages is `fail / (fail + recover)`, and the mean burst takes `1 / recover`
    ticks. A channel starts in the stationary distribution.
    """

    words = "Gilbert–Elliott"

    fail: Probability = setting(..., "probability that a good channel turns bad, at each tick")
    recover: Annotated[Number, Within(gt=0.0, le=1.0)] = setting(
        ..., "probability that a bad channel turns good, at each tick"
    )

    def perfect(self):
        return self.fail == 0

    def lost_apart(self):
        known = None if self.drawn_keys() else self.fail / (self.fail + self.recover)
        return 0.0 if self.of == "all" else known

    def draws(self):
        return not self.perfect()

    def start(self, messages):
        share = self.fail / (self.fail + self.recover)
        return self.uniform(messages, "start") < share[None, None]

    def lost(self, messages, memory):
        then_bad = jnp.where(memory, 1.0 - self.recover[None, None], self.fail[None, None])
        bad = self.uniform(messages, "loss") < then_bad
        return bad, bad

    def uniform(self, messages: Messages, purpose: str) -> Any:
        return self.random_by_slot(messages.time, purpose, "uniform", messages.sources)
