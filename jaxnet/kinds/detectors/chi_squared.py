from typing import Annotated

from pydantic import Field

from jaxnet.kinds.detectors import Detector
from jaxnet.kinds.fields import Number, Within
from jaxnet.lazy import jnp


class ChiSquared(Detector):
    """A word raises an alarm if its squared residual is improbable by the χ² law.

    The squared residual is the sum over both axes and all orders with errors, each divided by its
    variance. With errors of positions alone, 1 % of false alarms means a threshold of 9.210340
    (theorems.md O17).
    """

    kind = "chi_squared"
    words = "χ² test"

    false_alarms: Annotated[Number, Within(gt=0.0, lt=1.0)] = Field(
        default=0.01, description="probability of an alarm about an honest word with normal errors"
    )

    def alarms(self, words, memory):
        """The words whose p-value is below `false_alarms`; n orders give χ² 2n degrees of freedom.

        `P(χ²_2n > x) = e^(-x/2) Σ_{k<n} (x/2)^k / k!`
        """
        half = (words.residuals**2).sum(axis=(0, 1)) / 2
        total, term = jnp.zeros_like(half), jnp.ones_like(half)
        for k in range(len(words.residuals)):
            total = total + jnp.where(k < words.orders, term, 0.0)
            term = term * half / (k + 1)
        return jnp.exp(-half) * total < self.false_alarms[None, None], memory
