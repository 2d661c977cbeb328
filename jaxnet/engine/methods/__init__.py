"""Ways to advance lanes from tick to tick, a file each; which one, a config says by `engine`."""

from collections.abc import Iterator
from typing import Any, ClassVar

from jaxnet.kinds.families import add_family
from jaxnet.kinds.kind import Fault, Kind


class Engine(Kind):
    """A way to advance lanes. One of one's own gives `numbers` and `simulate`."""

    chunk: ClassVar[int] = 64  # lanes side by side, of fleets of twelve; fewer of larger ones
    cached: ClassVar[int] = 40_000  # vehicles of all lanes side by side, that they may stay in a core's cache
    queue: ClassVar[int] = 1  # chunks in a load
    shard: ClassVar[int] = 512  # lanes whose rows make one file, about a second's work
    accuracy: ClassVar[float] = 1e-5  # [m], what it may be off at its default tolerances
    one_block: ClassVar[int] = 12  # vehicles whose Laplacian is quicker solved as a dense one
    in_field: ClassVar[bool] = False  # whether it can decide inside the vector field (`tick: 0`)
    holds: ClassVar[bool] = False  # whether it can hold a jerk from tick to tick, as some laws do

    def options(self) -> tuple[Any, ...]:
        """What its compiled program depends on besides shapes: hashable."""
        return ()

    def numbers(self, draw: Any, gain: Any, interval: float) -> Any:
        """What it needs besides the lanes, a pytree of arrays with lanes first.

        `gain` (lanes, 3), `interval` [s] from tick to tick.
        """
        return ()

    @staticmethod
    def simulate(queue: Any, count: Any, network: Any, clock: Any, plan: Any) -> Any:
        """Outcome of the first `count` lanes of a queue of `Inputs`, traced by JAX; lanes last."""
        raise NotImplementedError

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """Deciding at every instant, or holding a jerk, is not for everybody."""
        if scenario.law.holds and not self.holds:
            message = (
                f"the {self.kind} engine cannot hold a jerk from tick to tick, as {scenario.law.kind} does"
            )
            yield Fault(("engine", "law"), message)
        if scenario.defence.decides and scenario.tick == 0 and not self.in_field:
            yield Fault(("engine", "tick"), f"the {self.kind} engine decides at ticks only: give a tick")


add_family("engine", Engine, "jaxnet.engines")
