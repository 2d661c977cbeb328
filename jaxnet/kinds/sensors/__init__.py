"""Sensors: how vehicles sense their own position, velocity and acceleration."""

from jaxnet.kinds.kind import Fault, KindError, broken
from jaxnet.kinds.shapes import LaneNumbers, LaneTimes, VehicleJets, VehicleMask
from jaxnet.kinds.ticks import ErrorsAtTicks


class Sensor(ErrorsAtTicks):
    """A way in which vehicles sense their own jets. A subclass gives `errors`.

    A vehicle senses at a tick, and its errors stay the same until the next tick. A vehicle controls
    itself by what it senses, and tells its listeners what it senses. Nobody senses the navigator's
    path with errors.

    Examples
    --------
    >>> import jax.numpy as jnp, jaxnet
    >>> from jaxnet.kinds.sensors import Sensor
    >>> class Shifted(Sensor):
    ...     '''Each vehicle believes to be 3 m farther east and 4 m farther north than it is.'''
    ...
    ...     def errors(self, time, vehicles):
    ...         none = jnp.zeros((2, vehicles, len(time)))
    ...         return none.at[0].set(3.0).at[1].set(4.0), none, none
    >>> keys = {"engine": "exact", "attack": "none", "topology": "star", "sensing": Shifted()}
    >>> results = jaxnet.simulate(keys, samples=2, progress=False)
    >>> results.lanes["tail_mean"].round(2).to_list()
    [5.0, 5.0]
    """

    def errors(self, time: LaneTimes, vehicles: int) -> VehicleJets:
        """The errors of one tick.

        Parameters
        ----------
        time
            Time of the tick [s], (lanes,).
        vehicles
            Number m of vehicles.

        Returns
        -------
            Errors of position, velocity and acceleration [m, m/s, m/s²], each (2, m, lanes).
        """
        raise KindError(f"{self.kind}: a sensor gives errors(self, time, vehicles)")

    def next_errors(self, last: VehicleJets, time: LaneTimes, interval: LaneNumbers) -> VehicleJets:
        """The errors of one tick after those of the last tick, by default independent of them.

        `interval` (lanes,) is the time from tick to tick [s]. Before the first tick, `last` is 0.
        """
        return self.errors(time, last[0].shape[1])

    def stays(self, time: LaneTimes, vehicles: int) -> VehicleMask | None:
        """Whether each vehicle senses what it did at the last tick, (m, lanes); None: never."""
        return None

    def breaks(self):
        return broken(exact_sensors=not self.exact())

    def faults(self, scenario):
        if not self.exact() and scenario.tick == 0:
            yield Fault(("sensing", "tick"), "vehicles sense at ticks: give a tick")
