"""Laws: how vehicles find the jerk q = y‴ that solves `L q = b` (theorems.md O2b, O12)."""

from collections.abc import Callable, Iterator
from typing import ClassVar

import numpy as np

from jaxnet.kinds.kind import Fault, Kind, KindError, broken
from jaxnet.kinds.protocols import ScenarioView
from jaxnet.kinds.shapes import VehicleVectors


class Law(Kind):
    """A way to solve `L q = b`, which couples all vehicles. A subclass holds q from tick to tick; it gives
    `exchange`.
    """

    claims: ClassVar[frozenset[str]] = frozenset({"left", "jacobi", "demanded"})
    holds: ClassVar[bool] = True  # whether vehicles hold q from tick to tick
    local: ClassVar[bool] = False  # whether neighbours tell no highest derivative, as q = y‴
    linearised: ClassVar[bool] = False  # whether inputs are linear in the error of the state
    jacobi: ClassVar[bool] = (
        False  # whether it is Jacobi's iteration, for which a sufficient number of rounds is known
    )
    demanded: ClassVar[bool] = False  # whether q is the demand itself, of which stability is known

    @property
    def solved(self) -> bool:
        """Return whether the law is solved for all vehicles together at every instant, as the theory asks."""
        return not (self.holds or self.local or self.linearised)

    def exchange(
        self,
        last: VehicleVectors,
        demand: VehicleVectors,
        heard: Callable[[VehicleVectors], VehicleVectors],
    ) -> VehicleVectors:
        """Return the jerk that vehicles hold from this tick until the next.

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
        """Return the factor by which an exchange multiplies q - L⁻¹b along eigenvectors of A with these
        eigenvalues.

        None, the default, means that the factor is not known; `jaxnet check` then reports nothing on
        stability.
        """
        return None

    def exchanges(self) -> int:
        """Return how often neighbours tell each other q at a tick."""
        return 1

    def breaks(self) -> frozenset[str]:
        return broken(not_held=self.holds, solved=not self.solved)

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield a fault if the law holds the jerk and the scenario has no ticks."""
        if self.holds and scenario.tick == 0:
            yield Fault(
                ("law", "tick"), f"{self.kind} holds the jerk from tick to tick: give a tick"
            )
