from typing import Annotated

from jaxnet.kinds.detectors import AlarmRule, Detector
from jaxnet.kinds.fields import Number, Within, setting
from jaxnet.kinds.shapes import AnyCounts, AnyNumbers
from jaxnet.lazy import jnp, stats

MOST_HALVED = 700.0  # half a squared residual: no window holds as many degrees, and e^-700 is no 0


class ChiSquared(Detector):
    """A message raises an alarm if its squared residual is improbable by the χ² law.

    The squared residual is the sum over both axes and all orders with errors, each divided by its
    variance. With errors of positions alone, 1 % of false alarms means a threshold of 9.210340
    (theorems.md O17). With a window the squared residuals of the last messages of a link are added.
    """

    words = "χ² test"

    false_alarms: Annotated[Number, Within(gt=0.0, lt=1.0)] = setting(
        0.01,
        "probability of an alarm about an honest message with normal errors",
        title="nominal rate",
    )
    window: int = setting(
        1, "number of messages of a link that are tested together, the last ones", ge=1, le=50
    )

    def rule(self, orders):
        limit = stats.chi2.isf(self.false_alarms, 2 * orders * self.window)
        return AlarmRule(float(limit), window=self.window)

    def start(self, words):
        """Squared residuals of the last messages, and their number."""
        if self.window == 1:
            return None
        squares = jnp.zeros((self.window, *words.judged.shape))
        return squares, jnp.zeros(words.judged.shape, int)

    def alarms(self, words, memory):
        """Where the p-value is below `false_alarms`, with 2n degrees for n orders of a message."""
        squared, counted = (words.residuals**2).sum(axis=(0, 1)), words.orders
        if self.window > 1:
            squares, number = memory
            latest = jnp.concatenate([squares[1:], squared[None]])
            squares = jnp.where(words.judged[None], latest, squares)
            number = jnp.minimum(number + words.judged.astype(int), self.window)
            squared, counted = squares.sum(axis=0), number * words.orders
            memory = squares, number
        most = self.window * len(words.residuals)
        return p_value(squared, counted, most) < self.false_alarms[None, None], memory


def p_value(squared: AnyNumbers, orders: AnyCounts, most: int) -> AnyNumbers:
    """`P(χ²_2n > x) = e^(-x/2) Σ_{k<n} (x/2)^k / k!` for x `squared` and n, at most `most`."""
    half = jnp.minimum(squared / 2, MOST_HALVED)
    total, term = jnp.zeros_like(half), jnp.ones_like(half)
    for k in range(most):
        total = total + jnp.where(k < orders, term, 0.0)
        term = term * half / (k + 1)
    return jnp.exp(-half) * total
