"""Laws: how vehicles find the jerk q = y‴ that solves `L q = b` (theorems.md O2b, O12)."""

from collections.abc import Callable
from typing import Any, ClassVar, Literal

import numpy as np

from jaxnet.kinds.kind import Fault, Kind, KindError, broken
from jaxnet.kinds.shapes import VehicleVectors

Way = Literal["solved", "held", "local", "linearised"]


class Law(Kind):
    """A way to solve `L q = b`, which couples all vehicles.

    A subclass holds q from tick to tick; it gives `exchange`.
    """

    claims: ClassVar[frozenset[str]] = frozenset({"left", "iterates", "gives_demand"})
    holds: ClassVar[bool] = True  # whether vehicles hold q from tick to tick
    local: ClassVar[bool] = False  # whether neighbours transmit no highest derivative, as q = y‴

    def exchange(
        self,
        last: VehicleVectors,
        demand: VehicleVectors,
        heard: Callable[[VehicleVectors], VehicleVectors],
    ) -> VehicleVectors:
        """The jerk that vehicles hold from this tick until the next.

        Parameters
        ----------
        last
            The jerk that vehicles held until now [m/s³], (2, m, lanes); 0 at first.
        demand
            The right-hand side b of each vehicle [m/s³], (2, m, lanes).
        heard
            Function from q to A q, which each vehicle computes from the q that its neighbours send.

        Returns
        -------
            The jerk [m/s³], (2, m, lanes).
        """
        raise KindError(f"{self.kind}: a law gives exchange(self, last, demand, heard)")

    def left(self, eigenvalues: np.ndarray) -> np.ndarray | None:
        """The factor by which an exchange multiplies q - L⁻¹b along eigenvectors of A.

        None, the default, means that it is not known; `jaxnet check` then says nothing of
        stability.
        """
        return None

    def exchanges(self) -> int:
        """How often neighbours send each other q at a tick."""
        return 1

    def way(self) -> Way:
        """How vehicles follow the law between ticks.

        `solved`: for all vehicles together at every instant, as the theory asks. `held`: by the q
        of the last tick. `local`: at every instant, each vehicle alone. `linearised`: by inputs
        that are linear in the error of the state.
        """
        return "held" if self.holds else "local" if self.local else "solved"

    def needs_ticks(self) -> bool:
        return self.way() == "held"

    def solves(self) -> bool:
        """Whether the law is solved for all vehicles at every instant, as the theory asks."""
        return self.way() == "solved"

    def couples(self) -> bool:
        """Whether a vehicle's q depends on those that its neighbours send.

        Such a law needs a navigator and has no solution for vehicles that are cut off, which may
        keep their drive. It does not depend on the strength of a row of weights.
        """
        return not self.local

    def takes_any_message(self) -> bool:
        """Whether messages may be lost, delayed or err."""
        return self.way() != "linearised"

    def tells_motion(self, extrapolated: bool) -> bool:
        """Whether delayed messages are power series of the vehicles' motion over a tick."""
        return not self.holds and (self.local or extrapolated)

    def iterates(self) -> bool:
        """Whether it is Jacobi's iteration, of which a sufficient number of rounds is known."""
        return False

    def gives_demand(self) -> bool:
        """Whether q is the demand itself, of which stability is known."""
        return False

    def own_gain(self, gain: Any) -> Any:
        """The gains by which a vehicle's own jets move it between ticks: 0 where it holds q."""
        return 0.0 * gain if self.needs_ticks() else gain

    def singular_at_rest(self) -> bool:
        """Whether the inputs are those of `ψ⁻¹`, undefined where ψ is singular."""
        return self.way() != "linearised"

    def breaks(self):
        return broken(solved=not self.solves())

    def faults(self, scenario):
        if self.needs_ticks() and scenario.tick == 0:
            message = f"{self.kind} holds the jerk from tick to tick: give a tick"
            yield Fault(("law", "tick"), message)
