"""Normal errors of jets, white or correlated in time, drawn at ticks and held until the next."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pydantic import Field

from jaxnet.kinds.fields import NotNegative
from jaxnet.kinds.protocols import LaneDraw
from jaxnet.kinds.shapes import AnyNumbers, ErrorJets, LaneNumbers, LaneTimes
from jaxnet.kinds.ticks import DrawsAtTicks
from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    import jax.numpy as jnp
else:
    jnp = LazyModule("jax.numpy")


class NormalErrors(DrawsAtTicks):
    """Normal errors of position, velocity and acceleration, independent by axis and order.

    With a correlation time τ, the errors of successive ticks are correlated by φ = e^(-h/τ). Their standard
    deviation is the same at all ticks.
    """

    position: NotNegative = Field(default=0.0, description="[m], standard deviation on each axis")
    velocity: NotNegative = Field(default=0.0, description="[m/s], standard deviation on each axis")
    acceleration: NotNegative = Field(default=0.0, description="[m/s²], standard deviation on each axis")
    correlation: NotNegative = Field(
        default=0.0,
        description="[s], in which the correlation falls to 1/e; 0: independent ticks",
    )

    def sizes(self) -> dict[str, Any]:
        """Return the standard deviations, by order of derivative."""
        return {order: getattr(self, order) for order in ("position", "velocity", "acceleration")}

    def exact(self) -> bool:
        """Return whether all standard deviations are 0."""
        return all(size == 0 for size in self.sizes().values())

    def draws(self) -> bool:
        """Return whether a standard deviation is not 0."""
        return not self.exact()

    def drawn(self, draw: LaneDraw, name: str) -> "NormalErrors":
        """Return the kind with drawn numbers; a number that is 0 is None, and draws nothing."""
        numbers = {**self.sizes(), "correlation": self.correlation}
        unused = {key: None for key, number in numbers.items() if number == 0}
        return self.filled({**vars(super().drawn(draw, name)), **unused})

    def white(self, last: ErrorJets, draw: Callable[[str], AnyNumbers]) -> ErrorJets:
        """Return independent errors of all three orders; `draw(order)` gives normal numbers."""

        def of_order(order: str, size: Any, zero: AnyNumbers) -> AnyNumbers:
            if size is None:
                return jnp.zeros_like(zero)
            return size.reshape(*[1] * (zero.ndim - 1), -1) * draw(order)

        position, velocity, acceleration = (
            of_order(*each, zero) for each, zero in zip(self.sizes().items(), last, strict=True)
        )
        return position, velocity, acceleration

    def after(self, last: ErrorJets, white: ErrorJets, time: LaneTimes, interval: LaneNumbers) -> ErrorJets:
        """Return errors correlated with those of the last tick, from independent ones."""
        if self.correlation is None:
            return white
        kept = jnp.where(time > 0, jnp.exp(-interval / self.correlation), 0.0)
        kept = kept.reshape(*[1] * (white[0].ndim - 1), -1)
        first, second, third = (
            kept * old + jnp.sqrt(1.0 - kept**2) * new for old, new in zip(last, white, strict=True)
        )
        return first, second, third
