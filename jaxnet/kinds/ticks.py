"""Kinds that draw random numbers at ticks, and normal errors of jets among them."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

from jaxnet.kinds.fields import NotNegative, Positive, Probability, Uniform, setting
from jaxnet.kinds.kind import Kind, KindError
from jaxnet.kinds.protocols import LaneDraw
from jaxnet.kinds.shapes import AnyNumbers, HeldErrors, LaneNumbers, LaneTimes, SlotSources
from jaxnet.lazy import LazyModule, jnp

if TYPE_CHECKING:
    from jaxnet.model import chance
else:
    chance = LazyModule("jaxnet.model.chance")

TICK_ROUNDING = 1e-9  # [s] by which a tick may miss the time of something that begins or ends
JET_ORDERS = ("position", "velocity", "acceleration")
HIGHEST = "jerk"

Together = Literal["link", "pair", "transmitter", "all"]


class DrawsAtTicks(Kind):
    """A kind that may draw random numbers at ticks, independent at each tick and in each lane."""

    def draws(self) -> bool:
        """Whether the kind draws random numbers at ticks."""
        return False

    def drawn(self, draw: LaneDraw, name: str) -> Self:
        """The kind with drawn numbers, and with a key for its random numbers at ticks."""
        found = super().drawn(draw, name)
        if not self.draws():
            return found
        return found.with_values(key=draw.one(Uniform(uniform=[0.0, 1.0]), f"{name}.key"))

    def random(
        self, time: LaneTimes, purpose: str, distribution: str, shape: tuple[int, ...]
    ) -> AnyNumbers:
        """Random numbers at a tick.

        Parameters
        ----------
        time
            Time of the tick [s], (lanes,).
        purpose
            A name; draws with different purposes are independent.
        distribution
            "uniform", from 0 to less than 1, or "normal", of mean 0 and standard deviation 1.
        shape
            Shape of the numbers of one lane.

        Returns
        -------
            The numbers, with an axis over lanes after those of `shape`.

        Raises
        ------
        KindError
            `draws` does not return True, or the distribution is another one.
        """
        if "key" not in vars(self):
            told = "a kind that calls random(…) gives draws(self), which returns True"
            raise KindError(f"{self.kind}: {told}")
        if distribution not in chance.SAMPLERS:
            told = f"random(…) draws from 'uniform' or 'normal' (got {distribution!r})"
            raise KindError(f"{self.kind}: {told}")
        return chance.drawn(vars(self)["key"], time, purpose, distribution, shape)

    def noisy(self, given: Any, size: LaneNumbers, time: LaneTimes, first: int = 0) -> Any:
        """Arrays of the orders from `first` on, with normal errors of this standard deviation."""
        return chance.noisy(given, size, vars(self)["key"], time, first=first)


class DrawsTogether(DrawsAtTicks):
    """A kind that draws one number for each link, pair or transmitter, or for all links."""

    of: Together = setting(
        "link",
        "what has draws of its own: link, each link; pair, each pair of vehicles, in both "
        "directions; transmitter, each vehicle that transmits; all, all links together",
    )

    def random_by_slot(
        self,
        time: LaneTimes,
        purpose: str,
        distribution: str,
        sources: SlotSources,
        axes: tuple[int, ...] = (),
    ) -> AnyNumbers:
        """Random numbers at a tick as `random` does, by slot: (*axes, slots, m, lanes).

        `sources` (slots, m) are the numbers of the sources.
        """
        slots, m = sources.shape
        if self.of == "link":
            return self.random(time, purpose, distribution, (*axes, slots, m))
        number, many = sources, m + 1
        if self.of == "all":
            number, many = jnp.zeros_like(sources), 1
        elif self.of == "pair":
            listeners = jnp.arange(1, m + 1)[None]
            ends = jnp.minimum(sources, listeners), jnp.maximum(sources, listeners)
            number, many = ends[0] * many + ends[1], many**2
        drawn = self.random(time, purpose, distribution, (*axes, many))
        return jnp.take(drawn, number, axis=len(axes))


class ErrorsAtTicks(DrawsAtTicks):
    """A kind of errors that are drawn at ticks and held until the next."""

    claims: ClassVar[frozenset[str]] = frozenset({"exact", "strength", "tells_deviations"})

    def exact(self) -> bool:
        """Whether all errors are 0."""
        return False

    def strength(self, gain: Sequence[float]) -> tuple[float, float] | None:
        """Variance s² of P of the errors, and their correlation time [s], or None if unknown."""
        return None

    def white(self) -> dict[str, float] | None:
        """Standard deviations by order of errors that are normal and independent at each tick.

        None where errors are not so, or their deviations are drawn.
        """
        return {} if self.exact() else None

    def tells_deviations(self) -> bool:
        """Whether `deviations` is known, which detectors need."""
        return False

    def deviations(self) -> Sequence[LaneNumbers | None]:
        """Standard deviation on an axis, (lanes,), by order; None for an order without errors."""
        raise KindError(f"{self.kind}: tells_deviations needs deviations(self)")


class NormalErrors(ErrorsAtTicks):
    """Normal errors of position, velocity and acceleration, independent by axis and order.

    With a correlation time τ, the errors of successive ticks are correlated by φ = e^(-h/τ). Their
    standard deviation is the same at all ticks. An outlier multiplies all errors of a reading by a
    factor f: outliers of probability p multiply variances by 1 + p (f² - 1).
    """

    orders: ClassVar[tuple[str, ...]] = JET_ORDERS  # names of the keys with standard deviations
    off_at_zero = frozenset({*JET_ORDERS, HIGHEST, "correlation", "outliers", "dropout"})

    position: NotNegative = setting(0.0, "[m], standard deviation on each axis")
    velocity: NotNegative = setting(0.0, "[m/s], standard deviation on each axis")
    acceleration: NotNegative = setting(0.0, "[m/s²], standard deviation on each axis")
    correlation: NotNegative = setting(
        0.0, "[s], correlation time, of the fall to 1/e; 0: ticks are independent"
    )
    outliers: Probability = setting(0.0, "probability that a reading is an outlier, at each tick")
    outlier_factor: Positive = setting(10.0, "factor of the errors of an outlier")

    def sizes(self) -> dict[str, Any]:
        """The standard deviations without outliers, by order of derivative."""
        found = {order: getattr(self, order) for order in self.orders}
        return {k: size for k, size in found.items() if k in JET_ORDERS or size is not None}

    def exact(self):
        return all(size == 0 for size in self.sizes().values())

    def draws(self):
        return not self.exact()

    def strength(self, gain):
        """`Σ_k k_k² σ_k²`, with k_r = 1, and the correlation time; None where they are drawn."""
        if self.drawn_keys():
            return None
        factors = dict(zip(JET_ORDERS, gain, strict=False)) | {HIGHEST: 1.0}
        squares = [(factors.get(order, 0.0) * size) ** 2 for order, size in self.sizes().items()]
        return sum(squares) * (1 + self.outliers * (self.outlier_factor**2 - 1)), self.correlation

    def white(self):
        return None if self.drawn_keys() or self.correlation or self.outliers else self.sizes()

    def tells_deviations(self):
        return True

    def deviations(self):
        """The standard deviations with outliers, up to the acceleration."""
        sizes = [self.sizes()[order] for order in JET_ORDERS]
        if self.outliers is None:
            return sizes
        grown = jnp.sqrt(1 + self.outliers * (self.outlier_factor**2 - 1))
        return [None if size is None else size * grown for size in sizes]

    def normal_errors(
        self,
        last: HeldErrors,
        time: LaneTimes,
        interval: LaneNumbers,
        draw: Callable[[str], AnyNumbers],
        uniform: Callable[[], AnyNumbers],
    ) -> HeldErrors:
        """Errors of all orders, correlated with those of the last tick.

        `draw(order)` gives normal numbers, `uniform()` a uniform number for each reading.
        """
        errors = [
            jnp.zeros_like(old) if size is None else with_lanes_last(size, old.ndim) * draw(order)
            for old, (order, size) in zip(last, self.sizes().items(), strict=True)
        ]
        if self.outliers is not None:
            lifted = uniform()
            share = with_lanes_last(self.outliers, lifted.ndim)
            factor = with_lanes_last(self.outlier_factor, lifted.ndim)
            grown = jnp.where(lifted < share, factor, 1.0)[None]
            errors = [grown * each for each in errors]
        if self.correlation is not None:
            kept = jnp.where(time > 0, jnp.exp(-interval / self.correlation), 0.0)
            kept = with_lanes_last(kept, errors[0].ndim)
            fresh = jnp.sqrt(1.0 - kept**2)
            pairs = zip(last, errors, strict=True)
            errors = [kept * old + fresh * new for old, new in pairs]
        return tuple(errors)


def with_lanes_last(numbers: LaneNumbers, axes: int) -> AnyNumbers:
    """Numbers (lanes,) with so many axes, of which lanes are the last."""
    return numbers.reshape(*[1] * (axes - 1), -1)
