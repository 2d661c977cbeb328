from jaxnet.kinds.attacks import HeldOffset, unit_vectors
from jaxnet.kinds.fields import Angle, Number, Positive, Probability, setting
from jaxnet.kinds.ticks import TICK_ROUNDING
from jaxnet.lazy import jnp


class Sleeper(HeldOffset):
    """No offset before `start`, then ā for `burst` seconds, then a share of ā for ever.

    Trust, or a detector with memory, lets more pass from a source that was honest before
    (theorems.md O19). This attack sends it at once; it jumps at ticks.
    """

    direction: Angle = setting(0.0, "[rad], of the offset")
    start: Number = setting(0.0, "[s], before which it tells the truth")
    burst: Positive = setting(1.0, "[s], how long it sends ā, from its first tick on")
    share: Probability = setting(1.0, "of ā, sent after the burst")

    def begin(self, seen):
        """The time of the first tick with an offset [s], infinite before."""
        return jnp.full_like(seen.time, jnp.inf)

    def aim(self, seen, memory):
        awake = seen.time >= self.start - TICK_ROUNDING
        first = jnp.where(awake, jnp.minimum(memory, seen.time), memory)
        bursts = seen.time < first + self.burst - TICK_ROUNDING
        part = jnp.where(awake, jnp.where(bursts, 1.0, self.share), 0.0)
        unit = jnp.broadcast_to(unit_vectors(self.direction), seen.errors[0].shape)
        return (part[None, None] * unit)[:, :, None], first
