"""The law solved by rounds of exchanges with neighbours."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from jaxnet.kinds.laws import Law
from jaxnet.kinds.protocols import LaneDraw
from jaxnet.kinds.shapes import AnyCounts, VehicleVectors
from jaxnet.lazy import LazyModule

if TYPE_CHECKING:
    import jax
    import jax.numpy as jnp
else:
    jax = LazyModule("jax")
    jnp = LazyModule("jax.numpy")


class Rounds(Law):
    """At each tick, iterate `q ← A q + b` for `rounds` exchanges, from the q of the last tick.

    Neighbours send each other their q anew in every exchange. Vehicles hold the result until the
    next tick.
    """

    kind = "rounds"

    rounds: int = Field(
        default=1, ge=1, le=10_000, description="exchanges with the neighbours at each tick"
    )

    def drawn(self, draw: LaneDraw, name: str) -> "Rounds":
        """Return the law with `rounds` as a number of each lane: one program serves all values."""
        drawn = super().drawn(draw, name)
        return self.filled({**vars(drawn), "rounds": draw.same(self.rounds)})

    def exchange(
        self,
        last: VehicleVectors,
        demand: VehicleVectors,
        heard: Callable[[VehicleVectors], VehicleVectors],
    ) -> VehicleVectors:
        """Return the jerk after the rounds of Jacobi's iteration."""

        def once(number: AnyCounts, jerk: VehicleVectors) -> VehicleVectors:
            return jnp.where((number < self.rounds)[None, None], heard(jerk) + demand, jerk)

        return jax.lax.fori_loop(0, self.rounds.max(), once, last)  # pyright: ignore[reportAttributeAccessIssue]

    def exchanges(self) -> int:
        return self.rounds

    def iterates(self) -> bool:
        return True

    def left(self, eigenvalues: np.ndarray) -> np.ndarray | None:
        """Return λ^r, the factor after r rounds."""
        return eigenvalues**self.rounds
