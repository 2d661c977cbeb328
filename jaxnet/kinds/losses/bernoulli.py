from jaxnet.kinds.fields import Probability, is_drawn, setting
from jaxnet.kinds.losses import Loss
from jaxnet.kinds.ticks import DrawsTogether


class Bernoulli(DrawsTogether, Loss):
    """Messages are lost with one probability, independently at each tick."""

    words = "Bernoulli"

    probability: Probability = setting(..., "that a message is lost, at each tick")

    def perfect(self):
        return self.probability == 0

    def of_whole_ticks(self):
        known = self.of == "all" and not is_drawn(self.probability)
        return float(self.probability) if known else None

    def lost_apart(self):
        known = None if is_drawn(self.probability) else float(self.probability)
        return 0.0 if self.of == "all" else known

    def draws(self):
        return not self.perfect()

    def lost(self, messages, memory):
        drawn = self.random_by_slot(messages.time, "loss", "uniform", messages.sources)
        return drawn < self.probability[None, None], memory
