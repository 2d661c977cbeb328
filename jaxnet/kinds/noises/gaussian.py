from typing import ClassVar, Literal

from jaxnet.kinds.fields import NotNegative, setting
from jaxnet.kinds.noises import ChannelNoise
from jaxnet.kinds.shapes import SlotNumbers, SlotVectors
from jaxnet.kinds.ticks import HIGHEST, JET_ORDERS, NormalErrors
from jaxnet.lazy import jnp


class GaussianNoise(NormalErrors, ChannelNoise):
    """Normal errors of messages, independent by axis and order.

    The errors drive the listener by `Σ_j w_ij (P(n_ij) + n_ij^(r))` until the next tick
    (theorems.md O15). With errors of transmitters, the navigator's message is exact.
    """

    words = "Gaussian"
    orders: ClassVar[tuple[str, ...]] = (*JET_ORDERS, HIGHEST)

    of: Literal["link", "transmitter"] = setting(  # pyright: ignore[reportIncompatibleVariableOverride]
        "link",
        "what has errors of its own: link, each link; transmitter, each vehicle that transmits",
    )
    jerk: NotNegative = setting(0.0, "[m/s³], standard deviation of the highest derivative")

    def erring(self):
        """Which of the standard deviations are not None, as those of 0 are in a drawn kind."""
        return self.position is not None, self.velocity is not None, self.acceleration is not None

    def errs_in_highest(self):
        """Whether `jerk` is not 0; it is None in a drawn kind without it."""
        return self.jerk is not None and not (isinstance(self.jerk, float) and self.jerk == 0)

    def exact_links(self, sources):
        """The links from the navigator, if each transmitter has its own errors."""
        return (sources == 0) & (self.of == "transmitter")

    def next_errors(self, last, time, interval, sources):
        exact = self.exact_links(sources)[None, ..., None]

        def draw(order: str) -> SlotVectors:
            drawn = self.random_by_slot(time, order, "normal", sources, axes=(2,))
            return jnp.where(exact, 0.0, drawn)

        def uniform() -> SlotNumbers:
            return self.random_by_slot(time, "outliers", "uniform", sources)

        return self.normal_errors(last, time, interval, draw, uniform)
