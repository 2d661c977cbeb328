"""Independent loss of messages."""

from typing import Annotated, Any

from pydantic import Field

from jaxnet.kinds.fields import Number, Within, is_drawn
from jaxnet.kinds.losses import Loss, Messages
from jaxnet.kinds.shapes import Memory, SlotMask
from jaxnet.kinds.ticks import DrawsTogether


class Bernoulli(DrawsTogether, Loss):
    """Messages are lost with one probability, independently at each tick."""

    kind = "bernoulli"
    words = "Bernoulli"

    probability: Annotated[Number, Within(ge=0.0, le=1.0)] = Field(
        description="that a message is lost, at each tick"
    )

    def perfect(self) -> bool:
        """Return whether the probability is 0."""
        return self.probability == 0

    def of_whole_ticks(self) -> float | None:
        """Return the probability if all messages of a tick are lost together."""
        return (
            float(self.probability) if self.of == "all" and not is_drawn(self.probability) else None
        )

    def draws(self) -> bool:
        """Return whether a message may be lost, because every loss is drawn."""
        return not self.perfect()

    def lost(self, messages: Messages, memory: Any) -> tuple[SlotMask, Memory]:
        """Return the slots whose random number is below the probability."""
        drawn = self.random_by_slot(messages.time, "loss", "uniform", messages.sources)
        return drawn < self.probability[None, None], memory
