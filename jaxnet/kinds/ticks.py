"""Kinds that draw random numbers at ticks."""

from typing import TYPE_CHECKING, Literal, TypeVar

from pydantic import Field

from jaxnet.kinds.fields import Uniform
from jaxnet.kinds.kind import Kind, KindError
from jaxnet.kinds.shapes import AnyNumbers, LaneTimes, SlotSources
from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    import jax.numpy as jnp

    from jaxnet.model import chance
else:
    jnp = LazyModule("jax.numpy")
    chance = LazyModule("jaxnet.model.chance")

TICK_ROUNDING = 1e-9  # [s] by which a tick may miss the time of something that begins or ends

Together = Literal["link", "transmitter", "all"]

AnyDrawer = TypeVar("AnyDrawer", bound="DrawsAtTicks")


class DrawsAtTicks(Kind):
    """A kind that may draw random numbers at ticks, independent at each tick and in each lane."""

    def draws(self) -> bool:
        """Whether the kind draws random numbers at ticks."""
        return False

    def drawn(self, draw, name):
        """The kind with drawn numbers, and with a key for its random numbers at ticks."""
        found = super().drawn(draw, name)
        if not self.draws():
            return found
        return self.filled(
            {**vars(found), "key": draw.one(Uniform(uniform=[0.0, 1.0]), f"{name}.key")}
        )

    def random(
        self,
        time: LaneTimes,
        purpose: str,
        distribution: str,
        shape: tuple[int, ...],
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

        Raises KindError unless `draws` returns True, and for another distribution.
        """
        if "key" not in vars(self):
            raise KindError(
                f"{self.kind}: a kind that calls random(…) gives draws(self), which returns True"
            )
        if distribution not in chance.SAMPLERS:
            raise KindError(
                f"{self.kind}: random(…) draws from 'uniform' or 'normal' (got {distribution!r})"
            )
        return chance.drawn(vars(self)["key"], time, purpose, distribution, shape)


class DrawsTogether(DrawsAtTicks):
    """A kind that draws one number for each link, for each transmitter, or for all links."""

    of: Together = Field(
        default="link",
        description="for whom a draw counts: one link, all links of a transmitter, or all links",
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
        shape = {"link": (slots, m), "transmitter": (m + 1,), "all": (1,)}[self.of]
        drawn = self.random(time, purpose, distribution, (*axes, *shape))
        if self.of == "link":
            return drawn
        number = sources if self.of == "transmitter" else jnp.zeros_like(sources)
        return jnp.take(drawn, number, axis=len(axes))
