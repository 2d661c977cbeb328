"""The law without the highest derivative of neighbours: the protocol of most of the literature."""

from typing import Literal

import numpy as np

from jaxnet.kinds.fields import setting
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.laws import Law


class LocalLaw(Law):
    """`q_i = -P(ε_i)`, plus the navigator's derivative where a vehicle hears it, held from tick to
    tick or not.

    q is the derivative of the vehicles' order r. No neighbour sends its q, so a fleet lags behind a
    navigator that moves. A vehicle that hears or retains nobody has q = 0: an agent of order 1
    stands still, one of order 2 keeps its velocity. No lane fails as disconnected, whatever the
    defence's `isolated` is. Single integrators with the gain k0 = 1/tick that hold q step by `x ← W
    x`, with W the weights in force.

    With `damping: absolute` a vehicle compares its position alone with those of its neighbours, and
    damps its own derivatives: `q_i = -s_i k0 (y_i - Σ_j w_ij y_j) - k1 ẏ_i - …`, with s_i the
    strength of the row. It then follows no derivative of the navigator's path.

    Source: Olfati-Saber, Fax and Murray, Consensus and cooperation in networked multi-agent
    systems, 2007.
    """

    local = True

    hold: bool = setting(True, "whether q is held for a tick; false: q follows at every instant")

    damping: Literal["relative", "absolute"] = setting(
        "relative",
        "relative: derivatives are compared with those of neighbours; absolute: own derivatives"
        " are brought to 0, as in the double integrator's protocol `ẍ = -k0 Σ a_ij (x_i - x_j) -"
        " k1 ẋ_i`",
    )

    @property
    def holds(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.hold

    @property
    def absolute(self) -> bool:
        return self.damping == "absolute"

    def heeds_highest(self, sources):
        """None with absolute damping, which heeds positions alone."""
        return (sources < 0) if self.absolute else super().heeds_highest(sources)

    def parts(self, gain):
        """Only k0 compares where damping is absolute; gains (lanes, r), or matrices."""
        if not self.absolute:
            return super().parts(gain)
        first = (np.arange(gain.shape[1]) == 0).reshape(-1, *[1] * (gain.ndim - 2))
        return np.where(first, gain, 0.0), np.where(first, 0.0, gain)

    def exchange(self, last, demand, heard):
        return demand

    def gives_demand(self):
        return True

    def faults(self, scenario):
        yield from super().faults(scenario)
        if self.absolute and scenario.vehicle.order == 1:
            told = f"absolute damps derivatives below the order: {scenario.vehicle.kind} has none"
            yield Fault(("law.damping", "vehicle"), told)
        if self.absolute and scenario.defence.hears_messages():
            told = f"{scenario.defence.kind} compares all derivatives: give damping: relative"
            yield Fault(("law.damping", "defence"), told)
