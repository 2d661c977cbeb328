"""Safety filters: they replace the velocity that the law asks for, after the law, before limits.

A filter knows what vehicles transmit of their places, with the lies of the attack in it. Vehicles
are of order 1; place and velocity are those of the output, such as the point ahead of an axle.
"""

from typing import ClassVar

from jaxnet.kinds.kind import Fault, Kind, KindError, broken
from jaxnet.kinds.protocols import ScenarioView
from jaxnet.kinds.shapes import VehicleMask, VehicleVectors
from jaxnet.outside.families import add_family


class Filter(Kind):
    """A safety filter. A subclass gives `breached` and `nearest`.

    Examples
    --------
    >>> import jaxnet
    >>> keys = {"vehicle": "single_integrator", "engine": "sampled", "horizon": 1.0, "tail": 0.5}
    >>> keys |= {"filter": "barrier", "metrics": ["min_separation"], "attack": "none"}
    >>> results = jaxnet.simulate(keys, samples=2, progress=False)
    >>> bool((results.lanes["min_separation"] > 0.15).all())
    True
    """

    present: ClassVar[bool] = True  # whether anything is filtered

    def breached(
        self, velocity: VehicleVectors, own: VehicleVectors, told: VehicleVectors
    ) -> VehicleMask:
        """Vehicles (m, lanes) whose velocity breaks a constraint.

        Parameters
        ----------
        velocity
            Velocity that the law asks for [m/s], (2, m, lanes).
        own, told
            True place of each vehicle [m], and the place that others know, (2, m, lanes).
        """
        raise KindError(f"{self.kind}: a filter gives breached(self, velocity, own, told)")

    def nearest(
        self, velocity: VehicleVectors, own: VehicleVectors, told: VehicleVectors
    ) -> VehicleVectors:
        """The nearest velocity under all constraints [m/s]; not-a-number where there is none."""
        raise KindError(f"{self.kind}: a filter gives nearest(self, velocity, own, told)")

    def asks(self) -> float | None:
        """Distance [m] that vehicles should keep, whether or not it is proved; None of none."""
        return None

    def keeps(self, scenario: ScenarioView) -> float | None:
        """Distance [m] that vehicles keep which start so far apart and tell their true places.

        None: nothing is proved.
        """
        return None

    def breaks(self):
        return broken(unfiltered=self.present)

    def faults(self, scenario):
        if not self.present:
            return
        attack, channel, engine = scenario.attack, scenario.channel, scenario.engine
        if scenario.vehicle.order != 1:
            message = f"filters vehicles of order 1 ({scenario.vehicle.kind}: order"
            keys = ("filter", "vehicle")
            yield Fault(keys, f"{self.kind} {message} {scenario.vehicle.order})")
        if not engine.limits or engine.presumes(scenario) != "nothing":
            message = "cannot filter: give engine: sampled, or {kind: nonlinear, solver: dopri5}"
            yield Fault(("filter", "engine"), f"the {engine.kind} engine {message}")
        if scenario.law.way() == "linearised":
            message = f"{self.kind} filters velocities, and {scenario.law.kind} asks for none"
            yield Fault(("filter", "law"), message)
        exact = scenario.sensing.exact() and channel.noise.exact()
        heard = channel.loss.perfect() and not scenario.detector.acts
        if not (exact and heard) or channel.late or channel.rounded:
            message = "needs exact sensors, and messages that arrive at once without errors"
            yield Fault(("filter", "channel", "sensing", "detector.cuts"), f"{self.kind} {message}")
        obeyed = attack.moves == "by_law" and not attack.replaces()
        if attack.by_link() or attack.identities() > 1 or not obeyed:
            message = "needs one place of each vehicle, told to all, that differs from the true one"
            keys = ("filter", "attack")
            yield Fault(keys, f"{self.kind} {message} by the attack's signal alone")


add_family("filter", Filter, "jaxnet.filters")
