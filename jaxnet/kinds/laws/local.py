"""The law without the highest derivative of neighbours: the protocol of most of the literature."""

from collections.abc import Callable
from typing import ClassVar

from jaxnet.kinds.laws import Law
from jaxnet.kinds.shapes import VehicleVectors


class LocalLaw(Law):
    """Hold `q_i = -P(ε_i)` from tick to tick, plus the navigator's derivative where a vehicle hears it.

    q is the derivative of the vehicles' order r. No neighbour tells its q, so a fleet lags behind a navigator
    that moves. A vehicle that hears or retains nobody has q = 0: an agent of order 1 stands still, one of
    order 2 keeps its velocity. No lane fails as disconnected, whatever the defence's `isolated` is. Single
    integrators with the gain k0 = 1/tick step by `x ← W x`, with W the weights in force.

    Source: Olfati-Saber, Fax and Murray, Consensus and cooperation in networked multi-agent systems, 2007.
    """

    kind = "local"
    local: ClassVar[bool] = True

    def exchange(
        self, last: VehicleVectors, demand: VehicleVectors, heard: Callable[[VehicleVectors], VehicleVectors]
    ) -> VehicleVectors:
        """Return the demand: nothing is exchanged."""
        return demand
