from typing import Annotated

from pydantic import Field

from jaxnet.kinds.fields import NotNegative, setting
from jaxnet.kinds.losses import Loss
from jaxnet.lazy import jnp


class Range(Loss):
    """A message arrives if its source is within a radius of the listener at the tick."""

    radius: Annotated[float, Field(ge=0.0, allow_inf_nan=True)] = setting(
        ..., "[m], greatest distance at which a source is heard; .inf: every message arrives"
    )
    hysteresis: NotNegative = setting(0.0, "[m], by how much farther a source is lost again")

    def perfect(self):
        return self.radius == float("inf")

    def start(self, messages):
        return jnp.zeros_like(messages.present)

    def lost(self, messages, memory):
        """The messages from too far away; `memory` holds those that were heard at the last tick."""
        farther = jnp.where(memory, self.hysteresis[None, None], 0.0)
        heard = messages.distance <= jnp.asarray(self.radius)[None, None] + farther
        return ~heard, heard
