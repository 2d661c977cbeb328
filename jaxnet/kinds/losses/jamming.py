from typing import Annotated, NamedTuple

from annotated_types import Len
from pydantic import AfterValidator

from jaxnet.kinds.fields import NotNegative, Number, Positive, Within, ordered, setting
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.losses import Loss, Messages
from jaxnet.kinds.shapes import SlotMask, SlotNumbers
from jaxnet.kinds.ticks import TICK_ROUNDING, DrawsTogether, Together
from jaxnet.lazy import jnp

Interval = Annotated[list[float], Len(2, 2), AfterValidator(ordered)]


class Budget(NamedTuple):
    """What a jammer may still do, and whether it jams, by slot."""

    starts: SlotNumbers
    seconds: SlotNumbers
    jams: SlotMask


class Jamming(DrawsTogether, Loss):
    """All messages are lost in listed, periodic or drawn intervals.

    Between any times τ < t, at most `starts + (t - τ) / spacing` drawn intervals begin. Their
    length together is at most `seconds + (t - τ) / ratio`. At each tick the jammer turns on or off
    with probability 1/2, if both limits allow it.
    """

    of: Together = setting("all", "what has drawn intervals of its own, as in bernoulli")
    intervals: list[Interval] = setting([], "[s], begin and end of each listed interval")
    period: NotNegative = setting(0.0, "[s], from begin to begin of periodic intervals; 0: none")
    length: NotNegative = setting(0.0, "[s], of each periodic interval")
    first: Number = setting(0.0, "[s], begin of the first periodic interval")
    starts: NotNegative = setting(0.0, "η, drawn intervals that may begin at once, 0: none")
    spacing: Positive = setting(1.0, "τ_D [s], least mean time from begin to begin")
    seconds: NotNegative = setting(0.0, "κ [s], length of drawn intervals at once")
    ratio: Annotated[Number, Within(gt=1.0)] = setting(
        2.0, "T, least mean ratio of the time to the length of drawn intervals"
    )

    def periodic(self) -> bool:
        return not (self.period == 0 or self.length == 0)

    def draws(self):
        return not (self.starts == 0 or self.seconds == 0)

    def perfect(self):
        return not (self.intervals or self.periodic() or self.draws())

    def start(self, messages):
        if "key" not in vars(self):
            return None
        nobody = jnp.zeros_like(messages.present)
        limits = (each[None, None] for each in (self.starts, self.seconds))
        starts, seconds = (jnp.broadcast_to(each, nobody.shape) for each in limits)
        return Budget(starts, seconds, nobody)

    def lost(self, messages, memory):
        time = messages.time + TICK_ROUNDING
        phase = (time - self.first) % jnp.where(self.period > 0, self.period, 1.0)
        jams = (self.period > 0) & (time >= self.first) & (phase < self.length)
        for begin, end in self.intervals:
            jams = jams | ((time >= begin) & (time < end))
        jams = jnp.broadcast_to(jams[None, None], messages.present.shape)
        if memory is None:
            return jams, memory
        memory = self.spent(messages, memory)
        return jams | memory.jams, memory

    def spent(self, messages: Messages, left: Budget) -> Budget:
        """The budget after a tick: the jammer starts or goes on if it wants to and may."""
        numbers = messages.interval, self.starts, self.spacing, self.seconds, self.ratio
        interval, most_starts, spacing, most_seconds, ratio = (each[None, None] for each in numbers)
        coin = self.random_by_slot(messages.time, "jamming", "uniform", messages.sources) < 0.5
        allowed = (left.jams | (left.starts >= 1.0)) & (left.seconds + interval / ratio >= interval)
        jams = (left.jams ^ coin) & allowed
        starts = left.starts + interval / spacing - (jams & ~left.jams).astype(float)
        seconds = left.seconds + interval / ratio - jnp.where(jams, interval, 0.0)
        return Budget(jnp.minimum(starts, most_starts), jnp.minimum(seconds, most_seconds), jams)

    def faults(self, scenario):
        yield from super().faults(scenario)
        for whole, part in (("period", "length"), ("starts", "seconds")):
            if (getattr(self, whole) == 0) != (getattr(self, part) == 0):
                yield Fault((f"channel.loss.{whole}",), f"give {whole} and {part}, or none of them")
