"""The navigator's path `y_0(t)` with its derivatives, for arrays of NumPy and JAX."""

from typing import ClassVar

import numpy as np

from jaxnet.kinds.kind import Fault, Kind, KindError, broken
from jaxnet.kinds.protocols import NavigatorPath
from jaxnet.kinds.shapes import AnyTimes, PathJets
from jaxnet.model.signal import up_to

LEAST_NAVIGATOR_SPEED = 0.05  # [m/s]
SPEED_SAMPLES = 100_001  # times at which a path's speed is sampled


class Navigator(Kind):
    """A smooth path that all vehicles track. A subclass gives `jets`.

    Examples
    --------
    >>> import jaxnet
    >>> from jaxnet.kinds.navigators import Navigator
    >>> class Circle(Navigator):
    ...     '''A circle with a radius of 50 m at 1 rad/s.'''
    ...
    ...     def jets(self, time):
    ...         xp = time.__array_namespace__()
    ...         along = 50.0 * xp.stack([xp.cos(time), xp.sin(time)])
    ...         left = 50.0 * xp.stack([-xp.sin(time), xp.cos(time)])
    ...         return xp.stack([along, left, -along, -left])
    >>> keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5, "navigator": Circle()}
    >>> jaxnet.simulate(keys, samples=2, progress=False).lanes["status"].to_list()
    ['ok', 'ok']
    """

    claims: ClassVar[frozenset[str]] = frozenset({"slowest", "sizes"})
    present: ClassVar[bool] = True  # whether there is a navigator

    def jets(self, time: AnyTimes) -> PathJets:
        """The position and its first three derivatives.

        Parameters
        ----------
        time
            Times [s], of any shape (…), as an array of NumPy or JAX.

        Returns
        -------
            Position, velocity, acceleration and jerk, (4, 2, …) [m, m/s, m/s², m/s³].
        """
        raise KindError(f"{self.kind}: a navigator gives jets(self, time)")

    def slowest(self, horizon: float) -> tuple[float, float]:
        """The least speed [m/s] in [0, horizon] among SPEED_SAMPLES times, and its time [s]."""
        times = np.linspace(0.0, horizon, SPEED_SAMPLES)
        speed = np.hypot(*np.asarray(self.jets(times))[1])
        if np.isnan(speed).any():
            raise KindError(f"{type(self).__name__}.jets gives a number that is not finite")
        return float(speed.min()), float(times[speed.argmin()])

    def sizes(self, start: float, end: float) -> np.ndarray:
        """Greatest norms of path and derivatives at SPEED_SAMPLES times: (4,)."""
        jets = np.asarray(self.jets(np.linspace(start, end, SPEED_SAMPLES)))
        return np.linalg.norm(jets, axis=1).max(axis=1)

    def breaks(self):
        return broken(leader=not self.present)

    def faults(self, scenario):
        if scenario.vehicle.singular != 1:
            return
        slowest, when = self.slowest(scenario.horizon)
        if not slowest >= LEAST_NAVIGATOR_SPEED:
            least = f"at least {LEAST_NAVIGATOR_SPEED} m/s is needed"
            why = "the law is singular where a vehicle stands still"
            message = f"slows to {slowest:.3g} m/s at t = {when:.4g} s; {least}, for {why}"
            yield Fault(("navigator", "horizon"), message)


def sizes_up_to(order: int, navigator: NavigatorPath, start: float, end: float) -> np.ndarray:
    """Greatest norms of the path and its derivatives up to an order, or the third if higher.

    The norms of derivatives above the third are those at SPEED_SAMPLES times.
    """
    known = navigator.sizes(start, end)
    if len(known) > order:
        return known
    jets = np.asarray(up_to(order, navigator.jets, np.linspace(start, end, SPEED_SAMPLES)))
    return np.concatenate([known, np.linalg.norm(jets[len(known) :], axis=1).max(axis=1)])
