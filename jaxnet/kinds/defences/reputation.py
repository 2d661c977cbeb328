from typing import Annotated

from jaxnet.kinds.defences import Defence
from jaxnet.kinds.fields import Number, Within, setting
from jaxnet.kinds.shapes import AnyNumbers, SlotNumbers
from jaxnet.lazy import jnp
from jaxnet.model import ties
from jaxnet.model.plane import length


class Reputation(Defence):
    """Weigh a source by its reputation: how near it is, on average, to all sources of the listener.

    - d_j is the mean distance in the plane of source j from the listener's sources.
    - The reputation is `c_j = (D - d_j) / (D - min d)`, clipped to [0, 1].
    - D is the (f + 1)-th greatest of the distinct d without the least, or the last of fewer.
    - A reputation of 0 becomes `epsilon^(k + 1)` at tick k.
    - The weights are `c_j / Σ c` over all sources, without the vehicle itself. Weights of the
      network do not count.

    Source: Ramos, Silvestre and Silvestre, A discrete-time reputation-based resilient consensus
    algorithm for synchronous or asynchronous communications, 2023, for numbers on a line.
    """

    guarantee = "none: whoever stays near the others is believed"

    f: int = setting(
        1, "greatest number of attacked sources that a vehicle expects", ge=0, le=10_000
    )
    epsilon: Annotated[Number, Within(gt=0.0, lt=1.0)] = setting(
        0.1, "reputation at the first tick of a source that has none"
    )

    def start(self, around):
        """The number of ticks."""
        return jnp.zeros_like(around.time)

    def decide(self, own, received, last, memory, around):
        heard, place = around.weights > 0, received[0]
        apart = length(place[:, :, None] - place[:, None])
        number = jnp.maximum(1, heard.sum(axis=0, keepdims=True)).astype(float)
        distance = jnp.where(heard[None], apart, 0.0).sum(axis=1) / number
        least = jnp.where(heard, distance, jnp.inf).min(axis=0, keepdims=True)
        limit = self.limit(jnp.where(heard, distance, -jnp.inf))
        span = jnp.where(limit > least, limit - least, 1.0)
        known = jnp.clip((limit - distance) / span, 0.0, 1.0)
        faint = (self.epsilon ** (memory + 1.0))[None, None]
        weights = jnp.where(ties.apart(limit, distance), known, faint)
        return jnp.where(heard, weights, 0.0), memory + 1.0

    def limit(self, distance: SlotNumbers) -> AnyNumbers:
        """D of each listener, (1, m, lanes); distances of slots without a source are -inf."""
        sort = -jnp.sort(-distance, axis=0)
        new = jnp.isfinite(sort)
        new = new.at[1:].set(new[1:] & ties.apart(sort[:-1], sort[1:]))
        wanted = jnp.clip(new.sum(axis=0, keepdims=True) - 2, 0, self.f)
        chosen = new & (jnp.cumsum(new, axis=0) - 1 == wanted)
        return jnp.where(chosen, sort, 0.0).sum(axis=0, keepdims=True)
