from typing import Any, NamedTuple

from jaxtyping import Bool, Float

from jaxnet.kinds.fields import NotNegative, is_drawn, setting
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.observers import Compared, HeardWords, LinkJets, Observer
from jaxnet.kinds.shapes import LaneNumbers
from jaxnet.lazy import jax, jnp
from jaxnet.model import whitening
from jaxnet.model.polynomial import scaled

Covariances = Float[Any, "orders orders slots m *lanes"]


class LinkEstimate(NamedTuple):
    """What listeners expect of a source: jets, their covariance on an axis, and if they know it."""

    jets: LinkJets
    covariance: Covariances
    known: Bool[Any, "slots m *lanes"]


class Kalman(Observer):
    """What a listener computes from the messages that it got: a Kalman filter for each link.

    The jets below the order move by Taylor from tick to tick. The derivative that is not told is
    normal at each tick, with mean 0. Errors of channel and sensors count as independent from tick
    to tick. The first message of a link begins the filter, and is not tested.
    """

    needs_variances = True

    unknown: NotNegative = setting(
        1.0, "[m/s^r], standard deviation on an axis of the derivative of order r that is not told"
    )

    def start(self, heard):
        jets = jnp.zeros_like(heard.received)
        nothing = jnp.zeros((len(jets), *heard.variances.shape))
        return LinkEstimate(jets, nothing, jnp.zeros_like(heard.arrived))

    def later(self, estimate: LinkEstimate, interval: LaneNumbers) -> LinkEstimate:
        """The estimate after a tick without a message."""
        order = len(estimate.jets)
        powers = [interval**0]
        for k in range(1, order + 1):
            powers.append(powers[-1] * interval / k)

        def moved(jets: Any) -> Any:
            each = range(order)
            rows = (sum(scaled(jets[j], powers[j - i]) for j in each[i:]) for i in each)
            return jnp.stack([*rows])

        covariance = moved(moved(estimate.covariance).swapaxes(0, 1))
        pushed = self.unknown[None] * jnp.stack(powers[:0:-1])
        covariance = covariance + (pushed[:, None] * pushed[None])[:, :, None, None]
        return LinkEstimate(moved(estimate.jets), covariance, estimate.known)

    def compared(self, heard, memory):
        there = self.later(memory, heard.interval)
        residuals, covariance = heard.received - there.jets, of_residuals(there, heard)
        return Compared(residuals, covariance, heard.arrived & memory.known)

    def advance(self, heard, memory):
        there = self.later(memory, heard.interval)
        factor = whitening.cholesky(of_residuals(there, heard))
        white = whitening.from_factor(factor, heard.received - there.jets)
        spread = whitening.from_factor(factor, there.covariance)
        learnt = LinkEstimate(
            there.jets
            + sum(one[:, None] * by[None] for one, by in zip(spread, white, strict=True)),
            there.covariance - sum(one[:, None] * one[None] for one in spread),
            memory.known | heard.arrived,
        )
        begun = learnt._replace(jets=heard.received, covariance=diagonal(heard.variances))

        def chosen(new: Any, known: Any, kept: Any) -> Any:
            lift = (None,) * (new.ndim - heard.arrived.ndim)
            fresh = jnp.where(memory.known[lift], known, new)
            return jnp.where(heard.arrived[lift], fresh, kept)

        return jax.tree.map(chosen, begun, learnt, there)

    def faults(self, scenario):
        channel = scenario.channel
        if channel.late and channel.delay_of == "message" and is_drawn(channel.delay):
            told = "kalman knows messages in the order of their ticks: give delay_of: link"
            yield Fault(("channel.delay_of", "detector.predicts"), told)


def diagonal(variances: Any) -> Covariances:
    nothing = jnp.zeros_like(variances[0])
    each = range(len(variances))
    return jnp.stack([jnp.stack([variances[i] if i == j else nothing for j in each]) for i in each])


def of_residuals(estimate: LinkEstimate, heard: HeardWords) -> Covariances:
    """Covariance of what arrives minus what was expected."""
    return estimate.covariance + diagonal(heard.variances)
