from typing import Annotated

from annotated_types import Len

from jaxnet.kinds.detectors import AlarmRule, Detector
from jaxnet.kinds.fields import Number, Positive, is_drawn, setting, value_range
from jaxnet.kinds.kind import Fault
from jaxnet.lazy import jnp
from jaxnet.model.plane import length
from jaxnet.model.whitening import squared_lengths


class Cusum(Detector):
    """A sum for each link raises an alarm where it passes a threshold: `S ← max(0, S + z - drift)`.

    z is the squared residual of a message as the χ² test has it, or the residual of its position
    along a direction. The sum is 0 after an alarm, and stays where no message arrives.
    """

    words = "CUSUM"

    drift: Positive = setting(4.0, "by which S falls at each message, more than the mean of z")
    threshold: Positive = setting(8.0, "of S")
    direction: Annotated[list[Number], Len(2, 2)] | None = setting(
        None, "[x, y], along which residuals count, of any length; null: squared residuals"
    )

    def rule(self, orders):
        if is_drawn(self.drift) or is_drawn(self.threshold):
            return None
        return AlarmRule(self.threshold, drift=self.drift, squared=self.direction is None)

    def start(self, messages):
        return jnp.zeros(messages.judged.shape)

    def alarms(self, messages, memory):
        if self.direction is None:
            z = squared_lengths(messages.residuals)
        else:
            along = (self.direction / length(self.direction)[None])[:, None, None]
            z = (along * messages.residuals[0]).sum(axis=0)
        total = jnp.maximum(0.0, memory + z - self.drift[None, None])
        total = jnp.where(messages.judged, total, memory)
        passed = total > self.threshold[None, None]
        return passed & messages.judged, jnp.where(passed, 0.0, total)

    def faults(self, scenario):
        yield from super().faults(scenario)
        low = value_range(self.drift)[0]
        if self.direction is None and low <= 2:
            told = "must be more than 2, the mean of the squared residual of a position"
            yield Fault(("detector.drift",), f"{told} (got {low:g})")
        if self.direction is not None and not any(map(any, map(value_range, self.direction))):
            yield Fault(("detector.direction",), "must have a length")
