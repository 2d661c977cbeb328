"""What other rooms pass to methods of kinds: a scenario, draws for lanes, the fleet at an instant.

At run time each of these types is `Any`, so that a test may pass a stand-in.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy as np

    from jaxnet.kinds.attacks import AnyAttack
    from jaxnet.kinds.defences import AnyDefence
    from jaxnet.kinds.fields import Number
    from jaxnet.kinds.graphs import Graph
    from jaxnet.kinds.laws import Law
    from jaxnet.kinds.navigators import Navigator
    from jaxnet.kinds.shapes import (
        AnyTimes,
        Decision,
        LaneNumbers,
        PathJets,
        SignalBasis,
        SignalVectors,
        SlotLinks,
        SlotNumbers,
        SlotSources,
        VehicleInput,
        VehicleMask,
        VehicleNumbers,
        VehicleState,
        VehicleVectors,
    )
    from jaxnet.kinds.vehicles import Vehicle

    class ScenarioView(Protocol):
        """Keys of a scenario that several kinds must fulfil together (`config.keys.Scenario`)."""

        @property
        def vehicles(self) -> int:
            """Number of vehicles besides the navigator."""
            ...

        @property
        def horizon(self) -> float:
            """Length of a lane in seconds."""
            ...

        @property
        def tick(self) -> float:
            """Communication period in seconds."""
            ...

        @property
        def navigator(self) -> Navigator: ...

        @property
        def vehicle(self) -> Vehicle: ...

        @property
        def topology(self) -> Graph: ...

        @property
        def law(self) -> Law: ...

        @property
        def attack(self) -> AnyAttack: ...

        @property
        def defence(self) -> AnyDefence: ...

    class LaneDraw(Protocol):
        """Draws numbers for samples (`lanes.draws.Draw`); samples are the arrays' first axis."""

        @property
        def samples(self) -> Sequence[int]:
            """Numbers of the samples."""
            ...

        @property
        def everyone(self) -> range:
            """Numbers of all vehicles, from 1."""
            ...

        def same(self, value: float | np.ndarray) -> np.ndarray:
            """Repeat a value for every sample."""
            ...

        def one(self, number: Number, name: str) -> np.ndarray:
            """Draw one number for each sample: (samples,)."""
            ...

        def each(self, number: Number, name: str, components: int = 1) -> np.ndarray:
            """Draw numbers for each vehicle: (samples, m, components)."""
            ...

        def several(self, numbers: Sequence[Number], name: str) -> np.ndarray:
            """Draw a list of numbers for each sample: (samples, n)."""
            ...

        def placed(
            self, numbers: Sequence[Number], name: str, places: Sequence[tuple[int, int]]
        ) -> np.ndarray:
            """Draw numbers by vehicle and component: (samples, n)."""
            ...

        def generators(self, name: str) -> Iterator[np.random.Generator]:
            """Yield a random generator for each sample."""
            ...

    class TickView(Protocol):
        """What a strategic attack sees at a tick (`engine.tick.Seen`)."""

        @property
        def errors(self) -> tuple[VehicleVectors, ...]:
            """E, Ė and Ë, relative to the navigator."""
            ...

        @property
        def weights(self) -> SlotNumbers:
            """Weights of the graph."""
            ...

        @property
        def sources(self) -> SlotSources:
            """Number of each slot's source, 0 is the navigator."""
            ...

        @property
        def attacked(self) -> SlotLinks:
            """Slots whose link carries the attack."""
            ...

        @property
        def amplitude(self) -> LaneNumbers:
            """Factor of the unit vectors [m]."""
            ...

        @property
        def in_force(self) -> Callable[[SignalVectors], Decision]:
            """Function from attack vectors to weights then in force, (axes, slots, m, lanes)."""
            ...

    class Signal(Protocol):
        """Scalar functions of time, by which vectors are multiplied (`model.signal`)."""

        def basis(self, time: AnyTimes) -> SignalBasis:
            """Return functions with three derivatives, (4, B, lanes), for times (lanes,) [s]."""
            ...

    class NavigatorPath(Protocol):
        """The navigator's path with its derivatives (`kinds.navigators.Navigator`)."""

        def jets(self, time: AnyTimes) -> PathJets:
            """Return position and three derivatives, (4, 2, …) [m, m/s, …], for times (…) [s]."""
            ...

        def sizes(self, start: float, end: float) -> np.ndarray:
            """Return the greatest norms of the path and its derivatives in [start, end]: (4,)."""
            ...

    class FleetView(Protocol):
        """The fleet at one output time (`engine.metrics.Observation`)."""

        @property
        def error(self) -> VehicleVectors:
            """`y_i - y_0` [m]."""
            ...

        @property
        def speed(self) -> VehicleNumbers:
            """Speed of each vehicle [m/s]."""
            ...

        @property
        def turn_rate(self) -> VehicleNumbers:
            """Turn rate of each vehicle [rad/s]."""
            ...

        @property
        def state(self) -> VehicleState:
            """States of the vehicles, (n, m, lanes), as `Vehicle.states`, `Vehicle.units` tell."""
            ...

        @property
        def attacked(self) -> VehicleMask:
            """Whether each vehicle is attacked, (m, lanes)."""
            ...

        @property
        def start(self) -> VehicleVectors:
            """Position of each vehicle at t = 0 [m], (2, m, lanes)."""
            ...

        @property
        def alarms(self) -> LaneNumbers | None:
            """Alarms over words of attacked and honest links, (2, lanes); None if not judged."""
            ...

        @property
        def inputs(self) -> VehicleInput:
            """Control input u of each vehicle, (2, m, lanes), as `Vehicle.inputs` and
            `Vehicle.input_units` tell.
            """
            ...

        def errors(self) -> VehicleNumbers:
            """Return `‖y_i - y_0‖` [m]."""
            ...

        def disagreements(self) -> VehicleNumbers:
            """Return `‖y_i - Σ_j w_ij y_j‖` [m]."""
            ...

else:
    ScenarioView = LaneDraw = TickView = FleetView = Signal = NavigatorPath = Any
