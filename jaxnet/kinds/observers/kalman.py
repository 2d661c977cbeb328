from typing import Any, NamedTuple

from jaxtyping import Bool, Float

from jaxnet.kinds.fields import NotNegative, is_drawn, setting
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.observers import Compared, HeardMessages, LinkJets, Observer
from jaxnet.kinds.shapes import LaneNumbers
from jaxnet.lazy import jax, jnp
from jaxnet.model import whitening
from jaxnet.model.polynomial import scaled

Covariances = Float[Any, "orders orders slots m *lanes"]


class LinkEstimate(NamedTuple):
    """What listeners expect at the next tick: jets, with their covariance on an axis."""

    jets: LinkJets
    covariance: Covariances
    known: Bool[Any, "slots m *lanes"]  # whether any message has arrived


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
        residuals = heard.received - memory.jets
        return Compared(residuals, of_residuals(memory, heard), heard.arrived & memory.known)

    def advance(self, heard, memory):
        residuals = heard.received - memory.jets

        def whitened() -> tuple[Any, Any]:
            factor = whitening.cholesky(of_residuals(memory, heard))
            return tuple(whitening.from_factor(factor, x) for x in (residuals, memory.covariance))

        white, spread = whitened()
        pairs = zip(spread, white, strict=True)
        learnt = LinkEstimate(
            memory.jets + sum(one[:, None] * by[None] for one, by in pairs),
            memory.covariance - sum(one[:, None] * one[None] for one in spread),
            memory.known | heard.arrived,
        )
        begun = learnt._replace(jets=heard.received, covariance=diagonal(heard.variances))

        def chosen(new: Any, known: Any, kept: Any) -> Any:
            lift = (None,) * (new.ndim - heard.arrived.ndim)
            fresh = jnp.where(memory.known[lift], known, new)
            return jnp.where(heard.arrived[lift], fresh, kept)

        now = jax.tree.map(chosen, begun, learnt, memory)
        return self.later(now, heard.interval)

    def faults(self, scenario):
        channel = scenario.channel
        if channel.late and channel.delay_of == "message" and is_drawn(channel.delay):
            told = "kalman knows messages in the order of their ticks: give delay_of: link"
            yield Fault(("channel.delay_of", "detector.predicts"), told)


def diagonal(variances: Any) -> Covariances:
    nothing = jnp.zeros_like(variances[0])
    each = range(len(variances))
    return jnp.stack([jnp.stack([variances[i] if i == j else nothing for j in each]) for i in each])


def of_residuals(estimate: LinkEstimate, heard: HeardMessages) -> Covariances:
    """Covariance of what arrives minus what was expected."""
    return estimate.covariance + diagonal(heard.variances)
