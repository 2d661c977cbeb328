"""The law by exchanges with neighbours."""

from collections.abc import Callable
from typing import Any, ClassVar

from pydantic import Field

from jaxnet.kinds.laws import Law


class Rounds(Law):
    """`q ← A q + b` at each tick, so many times, from the q of the tick before, which neighbours tell each
    other anew every time. What comes of it is held until the next tick.
    """

    kind = "rounds"
    jacobi: ClassVar[bool] = True

    rounds: int = Field(default=1, ge=1, le=10_000, description="exchanges with the neighbours at each tick")

    def drawn(self, draw: Any, name: str) -> Any:
        """With the rounds as a number of each lane, by which no program is told apart."""
        drawn = super().drawn(draw, name)
        return self.filled({**vars(drawn), "rounds": draw.same(self.rounds)})

    def exchange(self, last: Any, demand: Any, heard: Callable[[Any], Any]) -> Any:
        """Jacobi's iteration."""
        import jax
        import jax.numpy as jnp

        def once(number: Any, jerk: Any) -> Any:
            return jnp.where((number < self.rounds)[None, None], heard(jerk) + demand, jerk)

        return jax.lax.fori_loop(0, self.rounds.max(), once, last)  # pyright: ignore[reportAttributeAccessIssue]

    def left(self, eigenvalues: Any) -> Any:
        """λ^r."""
        return eigenvalues**self.rounds
