from typing import Annotated

from jaxnet.kinds.detectors import AlarmRule, Detector
from jaxnet.kinds.fields import Number, Within, setting
from jaxnet.lazy import jnp, stats


class ChiSquared(Detector):
    """A message raises an alarm if its squared residual is improbable by the χ² law.

    The squared residual is the sum over both axes and all orders with errors, each divided by its
    variance. With errors of positions alone, 1 % of false alarms means a threshold of 9.210340
    (theorems.md O17).
    """

    words = "χ² test"

    false_alarms: Annotated[Number, Within(gt=0.0, lt=1.0)] = setting(
        0.01, "probability of an alarm about an honest message with normal errors"
    )

    def rule(self, orders):
        return AlarmRule(float(stats.chi2.isf(self.false_alarms, 2 * orders)))

    def alarms(self, words, memory):
        """The messages whose p-value is below `false_alarms`, with 2n degrees for n orders.

        `P(χ²_2n > x) = e^(-x/2) Σ_{k<n} (x/2)^k / k!`
        """
        half = (words.residuals**2).sum(axis=(0, 1)) / 2
        total, term = jnp.zeros_like(half), jnp.ones_like(half)
        for k in range(len(words.residuals)):
            total = total + jnp.where(k < words.orders, term, 0.0)
            term = term * half / (k + 1)
        return jnp.exp(-half) * total < self.false_alarms[None, None], memory
