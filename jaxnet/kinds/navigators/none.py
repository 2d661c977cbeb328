"""No navigator: vehicles agree with one another alone."""

from collections.abc import Iterator
from typing import ClassVar

from jaxnet.kinds.kind import Fault
from jaxnet.kinds.navigators import Navigator
from jaxnet.kinds.protocols import ScenarioView
from jaxnet.kinds.shapes import AnyTimes, PathJets


class NoNavigator(Navigator):
    """Nobody leads: links from the navigator do not exist, and the other weights of a vehicle sum to 1.

    Needs `law: local`. The error of a vehicle is its distance from the mean of the vehicles that are not
    attacked. Rows also have the metrics `spread` and `outside`, which measure agreement and safety, and
    `recovery` asks for the spread. A link that is replaced carries the attack's signal alone.
    """

    kind = "none"
    words = "no navigator"
    present: ClassVar[bool] = False

    def jets(self, time: AnyTimes) -> PathJets:
        """Return 0."""
        xp = time.__array_namespace__()
        return xp.zeros((4, 2, *time.shape))

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield a fault unless the law is local: L is singular without a navigator."""
        if scenario.law.couples():
            yield Fault(
                ("navigator", "law"), "without a navigator the law has no solution: give law: local"
            )
