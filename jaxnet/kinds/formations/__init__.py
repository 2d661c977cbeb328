"""Formations: where each vehicle goes, relative to what the law steers all vehicles to.

The law acts on `y - δ`, and vehicles transmit and judge that. So the errors of a fleet do not
depend on its formation.
"""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from jaxnet.kinds.kind import Fault, Kind, KindError
from jaxnet.kinds.shapes import AnyTimes, LaneNumbers, StackedJets


class Formation(Kind):
    """The offset δ of each vehicle. A subclass gives `jets`.

    Examples
    --------
    >>> import jaxnet
    >>> keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5}
    >>> plain = jaxnet.simulate(keys, samples=2, progress=False)
    >>> keys["formation"] = {"kind": "line", "spacing": 5.0}
    >>> shaped = jaxnet.simulate(keys, samples=2, progress=False)
    >>> bool((plain.lanes["tail_mean"] == shaped.lanes["tail_mean"]).all())
    True
    """

    present: ClassVar[bool] = True  # whether any vehicle has an offset

    @property
    def moves(self) -> bool:
        """Whether offsets change in time."""
        return False

    def jets(self, time: AnyTimes, vehicles: int) -> StackedJets:
        """The offset [m] of each vehicle and its first three derivatives.

        Parameters
        ----------
        time
            Times [s], (lanes,), as an array of NumPy or JAX.
        vehicles
            Number m of vehicles.

        Returns
        -------
            Offset and derivatives [m, m/s, m/s², m/s³], (4, 2, m, lanes).
        """
        raise KindError(f"{self.kind}: a formation gives jets(self, time, vehicles)")

    def greatest(self, order: int) -> LaneNumbers:
        """A bound on the norm of an offset's derivative of this order at any time [m, m/s, …]."""
        raise KindError(f"{self.kind}: a formation that moves gives greatest(self, order)")

    def faults(self, scenario):
        vehicle, engine = scenario.vehicle, scenario.engine
        unknown = type(self).greatest is Formation.greatest
        if self.moves and unknown and vehicle.singular and not engine.samples:
            message = f"cannot move {vehicle.kind} vehicles: give greatest, or engine: sampled"
            yield Fault(("formation", "engine"), f"the {engine.kind} engine {message}")
        if self.moves and vehicle.singular and scenario.defence.coasts():
            message = "a vehicle that coasts may stop, but not in a formation that moves: fail"
            yield Fault(("defence.isolated", "formation"), message)


class Still(Formation):
    """A formation whose offsets do not change. A subclass gives `places`."""

    def places(self, vehicles: int) -> Sequence[Sequence[Any]]:
        """The offsets on both axes [m], each a list of numbers (lanes,), one for each vehicle."""
        raise KindError(f"{self.kind}: a formation that stands gives places(self, vehicles)")

    def greatest(self, order):
        return np.zeros(())

    def jets(self, time, vehicles):
        xp, zero = time.__array_namespace__(), 0.0 * time
        each = xp.stack([xp.stack([zero + one for one in axis]) for axis in self.places(vehicles)])
        return xp.stack([each, *[0.0 * each] * 3])
