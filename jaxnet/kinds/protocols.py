"""What other rooms pass to methods of kinds, as a type checker sees it.

At run time each of these types is `Any`, so that a test may pass a stand-in.
"""

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from jaxnet.config.keys import Scenario as ScenarioView
    from jaxnet.engine.metrics import Observation as FleetView
    from jaxnet.engine.tick import Seen as TickView
    from jaxnet.kinds.navigators import Navigator as NavigatorPath
    from jaxnet.kinds.shapes import AnyTimes, SignalBasis
    from jaxnet.lanes.draws import Draw as LaneDraw

    class Signal(Protocol):
        """Scalar functions of time, by which vectors are multiplied (`model.signal`)."""

        def basis(self, time: AnyTimes) -> SignalBasis:
            """Functions with three derivatives, (4, B, lanes), for times (lanes,) [s]."""
            ...

else:
    ScenarioView = LaneDraw = TickView = FleetView = Signal = NavigatorPath = Any
