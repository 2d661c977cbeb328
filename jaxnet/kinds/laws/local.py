"""The law without the highest derivative of neighbours: the protocol of most of the literature."""

from jaxnet.kinds.fields import setting
from jaxnet.kinds.laws import Law


class LocalLaw(Law):
    """`q_i = -P(ε_i)`, plus the navigator's derivative where a vehicle hears it, held from tick to
    tick or not.

    q is the derivative of the vehicles' order r. No neighbour sends its q, so a fleet lags behind a
    navigator that moves. A vehicle that hears or retains nobody has q = 0: an agent of order 1
    stands still, one of order 2 keeps its velocity. No lane fails as disconnected, whatever the
    defence's `isolated` is. Single integrators with the gain k0 = 1/tick that hold q step by `x ← W
    x`, with W the weights in force.

    Source: Olfati-Saber, Fax and Murray, Consensus and cooperation in networked multi-agent
    systems, 2007.
    """

    local = True

    hold: bool = setting(True, "whether q is held for a tick; false: q follows at every instant")

    @property
    def holds(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.hold

    def exchange(self, last, demand, heard):
        return demand

    def gives_demand(self):
        return True
