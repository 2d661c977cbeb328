from typing import Any

from jaxnet.kinds.fields import setting
from jaxnet.kinds.laws import Law
from jaxnet.kinds.shapes import AnyCounts, VehicleVectors
from jaxnet.lazy import jax, jnp


class Rounds(Law):
    """At each tick, iterate `q ← A q + b` for `rounds` exchanges, from the q of the last tick.

    Neighbours send each other their q anew in every exchange. Vehicles hold the result until the
    next tick.
    """

    rounds: int = setting(1, "exchanges with the neighbours at each tick", ge=1, le=10_000)

    def drawn(self, draw, name):
        """The law with `rounds` as a number of each lane: one program serves all values."""
        return super().drawn(draw, name).with_values(rounds=draw.same(self.rounds))

    def exchange(self, last, demand, heard):
        """The jerk after the rounds of Jacobi's iteration."""
        rounds: Any = self.rounds

        def once(number: AnyCounts, jerk: VehicleVectors) -> VehicleVectors:
            return jnp.where((number < rounds)[None, None], heard(jerk) + demand, jerk)

        return jax.lax.fori_loop(0, rounds.max(), once, last)

    def exchanges(self):
        return self.rounds

    def iterates(self):
        return True

    def left(self, eigenvalues):
        """λ^r, the factor after r rounds."""
        return eigenvalues**self.rounds
