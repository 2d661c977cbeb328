from typing import Annotated

from jaxnet.kinds.detectors import AlarmRule, Detector
from jaxnet.kinds.fields import Number, Within, setting
from jaxnet.kinds.shapes import AnyCounts, AnyNumbers
from jaxnet.lazy import jax, jnp, stats
from jaxnet.model.shapes import LoopIndex
from jaxnet.model.whitening import squared_lengths

NEWTON_STEPS = 30  # from x = 2n
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
        title="false alarm rate",
    )
    window: int = setting(
        1, "number of messages of a link that are tested together, the last ones", ge=1, le=50
    )

    def rule(self, orders):
        limit = stats.chi2.isf(self.false_alarms, 2 * orders * self.window)
        return AlarmRule(float(limit), window=self.window)

    def start(self, messages):
        """The limits; in a window also squared residuals of the last messages, and their number."""
        found = limits(self.false_alarms, self.window * len(messages.residuals))
        if self.window == 1:
            return found
        squares = jnp.zeros((self.window, *messages.judged.shape))
        return found, squares, jnp.zeros(messages.judged.shape, int)

    def alarms(self, messages, memory):
        """Where the p-value is below `false_alarms`, with 2n degrees for n orders of a message."""
        squared, counted = squared_lengths(messages.residuals), messages.orders
        if self.window == 1:
            return squared > limit_of(memory, counted), memory
        found, squares, number = memory
        latest = jnp.concatenate([squares[1:], squared[None]])
        squares = jnp.where(messages.judged[None], latest, squares)
        number = jnp.minimum(number + messages.judged.astype(int), self.window)
        alarms = squares.sum(axis=0) > limit_of(found, number * messages.orders)
        return alarms, (found, squares, number)


def limit_of(limits: AnyNumbers, orders: AnyCounts) -> AnyNumbers:
    """The limit of each link, of those of 1, 2, … orders."""
    found = jnp.broadcast_to(limits[0], orders.shape)
    for k, limit in enumerate(limits[1:], 2):
        found = jnp.where(orders == k, limit[None, None], found)
    return found


def limits(rate: AnyNumbers, most: int) -> AnyNumbers:
    """The x at which `p_value` is a rate, of 1 to `most` orders, by Newton: log p is concave."""
    orders = jnp.broadcast_to(jnp.arange(1, most + 1)[:, None], (most, *rate.shape))

    def step(_: LoopIndex, x: AnyNumbers) -> AnyNumbers:
        p, less = (p_value(x, orders - k, most) for k in (0, 1))
        return jnp.minimum(x + 2 * p / (p - less) * jnp.log(p / rate[None]), 2 * MOST_HALVED)

    return jax.lax.fori_loop(0, NEWTON_STEPS, step, 2.0 * orders.astype(float))


def p_value(squared: AnyNumbers, orders: AnyCounts, most: int) -> AnyNumbers:
    """`P(χ²_2n > x) = e^(-x/2) Σ_{k<n} (x/2)^k / k!` for x `squared` and n, at most `most`."""
    half = jnp.minimum(squared / 2, MOST_HALVED)
    total, term = jnp.zeros_like(half), jnp.ones_like(half)
    for k in range(most):
        total = total + jnp.where(k < orders, term, 0.0)
        term = term * half / (k + 1)
    return jnp.exp(-half) * total
