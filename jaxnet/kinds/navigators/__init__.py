"""The navigator's path `y_0(t)` with its derivatives, written against the array API: for NumPy and JAX."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxnet.kinds.kind import Fault, Kind, KindError

LEAST_NAVIGATOR_SPEED = 0.05  # [m/s]
SPEED_SAMPLES = 100_001  # at which the speed of a path of one's own is looked at


class Navigator(Kind):
    """A smooth path that all vehicles are to track. One of one's own gives `jets`."""

    def jets(self, time: Any) -> Any:
        """Position and its first three derivatives: (4, 2, …) [m, m/s, …] for times (…) [s]."""
        raise KindError(f"{self.kind}: a navigator gives jets(self, time)")

    def slowest(self, horizon: float) -> tuple[float, float]:
        """Least speed [m/s] within [0, horizon] at INSTANTS, and when [s]."""
        times = np.linspace(0.0, horizon, SPEED_SAMPLES)
        speed = np.hypot(*np.asarray(self.jets(times))[1])
        return float(speed.min()), float(times[speed.argmin()])

    def sizes(self, start: float, end: float) -> np.ndarray:
        """Greatest norms of the path and its derivatives in [start, end], at INSTANTS: (4,)."""
        jets = np.asarray(self.jets(np.linspace(start, end, SPEED_SAMPLES)))
        return np.linalg.norm(jets, axis=1).max(axis=1)

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """A navigator that stops makes every vehicle singular."""
        slowest, when = self.slowest(scenario.horizon)
        if not slowest >= LEAST_NAVIGATOR_SPEED:
            yield Fault(
                ("navigator", "horizon"),
                f"slows to {slowest:.3g} m/s at t = {when:.4g} s; at least {LEAST_NAVIGATOR_SPEED} m/s is"
                " needed, for the law is singular where a vehicle stands still",
            )
