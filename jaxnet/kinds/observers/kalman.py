from typing import TYPE_CHECKING, Any, NamedTuple

from jaxnet.kinds.fields import NotNegative, is_drawn, setting
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.observers import Compared, HeardMessages, Observer
from jaxnet.kinds.shapes import LaneNumbers, SlotMask, SlotNumbers, SlotVectors
from jaxnet.lazy import LazyModule, jax, jnp
from jaxnet.model.polynomial import powers_of, scaled

if TYPE_CHECKING:
    from jaxnet.model import xla
else:
    xla = LazyModule("jaxnet.model.xla")

SINGULAR = 1e-10  # of a variance: what is left of it once the orders before are known counts as 0

Covariance = dict[tuple[int, int], SlotNumbers]  # of two orders, the lower one first


class LinkEstimate(NamedTuple):
    """What listeners expect of the next message: jets, with their covariance on an axis."""

    jets: tuple[SlotVectors, ...]
    covariance: Covariance
    known: SlotMask  # whether any message has arrived


class Learnt(NamedTuple):
    """An estimate after a message, with the residual of each order once those before are known."""

    residuals: list[SlotVectors]
    variances: list[SlotNumbers]  # of a residual; 0 where it follows from those before
    estimate: LinkEstimate


class Kalman(Observer):
    """What a listener computes from the messages that it got: a Kalman filter for each link.

    The jets below the order move by Taylor from tick to tick. The derivative that is not told is
    normal at each tick, with mean 0. Errors of channel and sensors count as independent from tick
    to tick. The first message of a link begins the filter, and is not tested.
    """

    needs_variances = True
    presumes = "the derivative that is not told stays within `unknown`"

    unknown: NotNegative = setting(
        1.0, "[m/s^r], standard deviation on an axis of the derivative of order r that is not told"
    )

    def start(self, heard):
        each = range(len(heard.received))
        covariance = {(i, j): jnp.zeros_like(heard.variances[0]) for i in each for j in each[i:]}
        jets = tuple(jnp.zeros_like(jet) for jet in heard.received)
        return LinkEstimate(jets, covariance, jnp.zeros_like(heard.arrived))

    def later(self, estimate: LinkEstimate, interval: LaneNumbers) -> LinkEstimate:
        """The estimate after a tick without a message."""
        each = range(len(estimate.jets))
        powers = powers_of(interval, len(each) + 1)

        def moved(jets: Any) -> Any:
            return [sum(scaled(jets[j], powers[j - i]) for j in each[i:]) for i in each]

        halfway = zip(
            *(moved([of(estimate.covariance, i, j) for j in each]) for i in each), strict=True
        )
        there, pushed = [moved(row) for row in halfway], self.unknown[None] * powers[:0:-1]
        covariance = {
            (i, j): there[i][j] + (pushed[i] * pushed[j])[None, None]
            for i, j in estimate.covariance
        }
        return LinkEstimate(tuple(moved(estimate.jets)), covariance, estimate.known)

    def compared(self, heard, memory):
        found = learnt(heard, memory)
        residuals, variances = jnp.stack(found.residuals), jnp.stack(found.variances)
        return Compared(residuals, variances, heard.arrived & memory.known)

    def advance(self, heard, memory):
        begun = memory._replace(
            jets=tuple(heard.received),
            covariance={(i, j): heard.variances[i] * float(i == j) for i, j in memory.covariance},
        )

        def chosen(new: Any, known: Any, kept: Any) -> Any:
            lift = (None,) * (new.ndim - heard.arrived.ndim)
            fresh = jnp.where(memory.known[lift], known, new)
            return jnp.where(heard.arrived[lift], fresh, kept)

        after = learnt(heard, memory).estimate
        now = jax.tree.map(chosen, begun, after, memory)
        return self.later(now._replace(known=memory.known | heard.arrived), heard.interval)

    def faults(self, scenario):
        channel = scenario.channel
        if channel.late and channel.delay_of == "message" and is_drawn(channel.delay):
            told = "kalman knows messages in the order of their ticks: give delay_of: link"
            yield Fault(("channel.delay_of", "detector.predicts"), told)


def learnt(heard: HeardMessages, estimate: LinkEstimate) -> Learnt:
    """What each message tells: its orders one after the other, as their errors are independent."""
    jets, covariance, residuals, variances = [*estimate.jets], estimate.covariance, [], []
    each = range(len(jets))
    for k in each:
        column, residual = [of(covariance, k, i) for i in each], heard.received[k] - jets[k]
        variance = column[k] + heard.variances[k]
        noisy = variance > SINGULAR * (estimate.covariance[k, k] + heard.variances[k])
        by = jnp.where(noisy, 1.0 / jnp.where(noisy, variance, 1.0), 0.0)
        by, residual = xla.stored((by, residual))
        residuals.append(residual)
        variances.append(jnp.where(noisy, variance, 0.0))
        jets = [jets[i] + (by * column[i])[None] * residual for i in each]
        covariance = {(i, j): covariance[i, j] - by * column[i] * column[j] for i, j in covariance}
    return Learnt(residuals, variances, LinkEstimate(tuple(jets), covariance, estimate.known))


def of(covariance: Covariance, i: int, j: int) -> SlotNumbers:
    return covariance[min(i, j), max(i, j)]
