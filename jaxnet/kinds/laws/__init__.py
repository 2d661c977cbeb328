"""How vehicles come by the jerk q = y‴ that is asked of them, `L q = b` (SCIENCE O2b, O12)."""

from collections.abc import Callable, Iterator
from typing import Any, ClassVar

from jaxnet.kinds.kind import Fault, Kind, KindError


class Law(Kind):
    """A way to solve `L q = b`, where L couples everybody. One of one's own holds q, and gives `exchange`."""

    holds: ClassVar[bool] = True  # whether q is chosen at ticks and held between them
    jacobi: ClassVar[bool] = (
        False  # whether it makes rounds of Jacobi's iteration, of which it is known how many do
    )

    def exchange(self, last: Any, demand: Any, heard: Callable[[Any], Any]) -> Any:
        """The jerk (2, m, lanes) that vehicles hold from this tick on.

        `last` is what they held until now, 0 at first, `demand` the b of each, `heard(q)` the A q that each
        makes of what its neighbours tell it of theirs.
        """
        raise KindError(f"{self.kind}: a law gives exchange(self, last, demand, heard)")

    def left(self, eigenvalues: Any) -> Any:
        """What an exchange leaves of q's distance from L⁻¹b along eigenvectors of A with these eigenvalues.

        None, the default, where that is not known, for then `jaxnet check` says nothing of stability.
        """
        return None

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """What is held is held from tick to tick."""
        if self.holds and scenario.tick == 0:
            yield Fault(("law", "tick"), f"{self.kind} holds the jerk from tick to tick: give a tick")
