"""Normal errors of jets, white or correlated in time, drawn at ticks and held until the next."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field

from jaxnet.kinds.fields import NotNegative, Number, Positive, Within
from jaxnet.kinds.kind import KindError
from jaxnet.kinds.shapes import AnyNumbers, HeldErrors, LaneNumbers, LaneTimes
from jaxnet.kinds.ticks import DrawsAtTicks
from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    import jax.numpy as jnp
else:
    jnp = LazyModule("jax.numpy")


JET_ORDERS = ("position", "velocity", "acceleration")
HIGHEST = "jerk"


class ErrorsAtTicks(DrawsAtTicks):
    """A kind of errors that are drawn at ticks and held until the next."""

    claims: ClassVar[frozenset[str]] = frozenset({"exact", "strength", "tells_deviations"})

    def exact(self) -> bool:
        """Whether all errors are 0."""
        return False

    def strength(self, gain: Sequence[float]) -> tuple[float, float] | None:
        """The variance s² of P of the errors, and their correlation time [s], or None if unknown."""
        return None

    def tells_deviations(self) -> bool:
        """Whether `deviations` is known, which detectors need."""
        return False

    def deviations(self) -> Sequence[LaneNumbers | None]:
        """The standard deviation of the errors on an axis, (lanes,), by order of derivative.

        None stands for an order without errors.
        """
        raise KindError(f"{self.kind}: tells_deviations needs deviations(self)")


class NormalErrors(ErrorsAtTicks):
    """Normal errors of position, velocity and acceleration, independent by axis and order.

    With a correlation time τ, the errors of successive ticks are correlated by φ = e^(-h/τ). Their standard
    deviation is the same at all ticks. An outlier multiplies all errors of a reading by a factor f: outliers
    of probability p multiply variances by 1 + p (f² - 1).
    """

    orders: ClassVar[tuple[str, ...]] = JET_ORDERS  # names of the keys with standard deviations

    position: NotNegative = Field(default=0.0, description="[m], standard deviation on each axis")
    velocity: NotNegative = Field(default=0.0, description="[m/s], standard deviation on each axis")
    acceleration: NotNegative = Field(
        default=0.0, description="[m/s²], standard deviation on each axis"
    )
    correlation: NotNegative = Field(
        default=0.0,
        description="[s], in which the correlation falls to 1/e; 0: independent ticks",
    )

    outliers: Annotated[Number, Within(ge=0.0, le=1.0)] = Field(
        default=0.0, description="probability that a reading is an outlier, at each tick"
    )
    outlier_factor: Positive = Field(
        default=10.0, description="by which an outlier multiplies the errors drawn at its tick"
    )

    def sizes(self) -> dict[str, Any]:
        """The standard deviations without outliers, by order of derivative."""
        found = {order: getattr(self, order) for order in self.orders}
        return {
            order: size for order, size in found.items() if order in JET_ORDERS or size is not None
        }

    def exact(self):
        return all(size == 0 for size in self.sizes().values())

    def strength(self, gain):
        """`Σ_k k_k² σ_k²`, with k_r = 1, and the correlation time; None where they are drawn."""
        if self.drawn_keys():
            return None
        factors = dict(zip(JET_ORDERS, gain, strict=False)) | {HIGHEST: 1.0}
        squares = [(factors.get(order, 0.0) * size) ** 2 for order, size in self.sizes().items()]
        return sum(squares) * (1 + self.outliers * (self.outlier_factor**2 - 1)), self.correlation

    def tells_deviations(self):
        return True

    def deviations(self):
        """The standard deviations with outliers, up to the acceleration."""
        sizes = [self.sizes()[order] for order in JET_ORDERS]
        if self.outliers is None:
            return sizes
        grown = jnp.sqrt(1 + self.outliers * (self.outlier_factor**2 - 1))
        return [None if size is None else size * grown for size in sizes]

    def draws(self):
        return not self.exact()

    def drawn(self, draw, name):
        """The kind with drawn numbers; a number that is 0 is None, and draws nothing."""
        numbers = {**self.sizes(), "correlation": self.correlation, "outliers": self.outliers}
        unused = {key: None for key, number in numbers.items() if number == 0}
        return self.filled({**vars(super().drawn(draw, name)), **unused})

    def white(
        self, last: HeldErrors, draw: Callable[[str], AnyNumbers], uniform: Callable[[], AnyNumbers]
    ) -> HeldErrors:
        """Independent errors of all orders.

        `draw(order)` gives normal numbers, `uniform()` a uniform number for each reading.
        """

        def scaled(order: str, size: Any, zero: AnyNumbers) -> AnyNumbers:
            return zero if size is None else size.reshape(*[1] * (zero.ndim - 1), -1) * draw(order)

        zeros = map(jnp.zeros_like, last)
        errors = tuple(
            scaled(*each, zero) for each, zero in zip(self.sizes().items(), zeros, strict=True)
        )
        if self.outliers is None:
            return errors
        lifted = uniform()
        share, factor = (
            each.reshape(*[1] * (lifted.ndim - 1), -1)
            for each in (self.outliers, self.outlier_factor)
        )
        grown = jnp.where(lifted < share, factor, 1.0)[None]
        return tuple(grown * each for each in errors)

    def after(
        self, last: HeldErrors, white: HeldErrors, time: LaneTimes, interval: LaneNumbers
    ) -> HeldErrors:
        """Errors correlated with those of the last tick, from independent ones."""
        if self.correlation is None:
            return white
        kept = jnp.where(time > 0, jnp.exp(-interval / self.correlation), 0.0)
        kept = kept.reshape(*[1] * (white[0].ndim - 1), -1)
        fresh = jnp.sqrt(1.0 - kept**2)
        return tuple(kept * old + fresh * new for old, new in zip(last, white, strict=True))
