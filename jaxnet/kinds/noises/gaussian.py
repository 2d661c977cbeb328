"""Gaussian noise on links."""

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from jaxnet.kinds.noise import NormalErrors
from jaxnet.kinds.noises import ChannelNoise
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, SlotJets, SlotSources
from jaxnet.kinds.ticks import DrawsTogether
from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    import jax
else:
    jax = LazyModule("jax")


class GaussianNoise(NormalErrors, DrawsTogether, ChannelNoise):
    """Normal errors of words, independent by axis and order.

    The errors drive the listener by `Σ_j w_ij P(n_ij)` until the next tick (theorems.md O13).
    """

    kind = "gaussian"
    words = "Gaussian"

    of: Literal["link", "transmitter"] = Field(
        default="link",
        description="whether each link has its own errors, or all links of a transmitter the same",
    )

    def next_errors(
        self, last: SlotJets, time: LaneTimes, interval: LaneNumbers, sources: SlotSources
    ) -> SlotJets:
        """Return normal errors of all three orders, correlated with the last ones if `correlation` is given."""
        white = self.white(
            last, lambda order: self.random_by_slot(time, order, jax.random.normal, sources, axes=(2,))
        )
        return self.after(last, white, time, interval)
