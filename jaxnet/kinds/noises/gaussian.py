"""Gaussian noise on links."""

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from jaxnet.kinds.noise import NormalErrors
from jaxnet.kinds.noises import ChannelNoise
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, SlotJets, SlotLinks, SlotSources, SlotVectors
from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    import jax
    import jax.numpy as jnp
else:
    jax = LazyModule("jax")
    jnp = LazyModule("jax.numpy")


class GaussianNoise(NormalErrors, ChannelNoise):
    """Normal errors of words, independent by axis and order.

    The errors drive the listener by `Σ_j w_ij P(n_ij)` until the next tick (theorems.md O15). With errors of
    transmitters, the navigator's word is exact.
    """

    kind = "gaussian"
    words = "Gaussian"

    of: Literal["link", "transmitter"] = Field(  # pyright: ignore[reportIncompatibleVariableOverride]
        default="link", description="what has errors of its own: each link, or each vehicle that transmits"
    )

    def exact_links(self, sources: SlotSources) -> SlotLinks:
        """Return the links from the navigator, if each transmitter has its own errors."""
        return (sources == 0) & (self.of == "transmitter")

    def next_errors(
        self, last: SlotJets, time: LaneTimes, interval: LaneNumbers, sources: SlotSources
    ) -> SlotJets:
        """Return normal errors of all three orders."""
        exact = self.exact_links(sources)[None, ..., None]

        def draw(order: str) -> SlotVectors:
            drawn = self.random_by_slot(time, order, jax.random.normal, sources, axes=(2,))
            return jnp.where(exact, 0.0, drawn)

        return self.after(last, self.white(last, draw), time, interval)
