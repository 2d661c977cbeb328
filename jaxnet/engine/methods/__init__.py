"""Engines, the ways to advance lanes from tick to tick, one per file. A config chooses one by `engine`."""

from collections.abc import Iterator
from typing import Any, ClassVar

from jaxnet.kinds.families import add_family
from jaxnet.kinds.kind import Fault, Kind


class Engine(Kind):
    """A way to advance lanes. A subclass defines `numbers` and `simulate`."""

    chunk: ClassVar[int] = 64  # lanes side by side in fleets of twelve vehicles; fewer in larger fleets
    cached: ClassVar[int] = 40_000  # most vehicles side by side that a core's cache can hold
    queue: ClassVar[int] = 1  # chunks in a load
    shard: ClassVar[int] = 512  # lanes whose rows make one file: about a second of work
    accuracy: ClassVar[float] = 1e-5  # [m] bound on the error at default tolerances
    in_field: ClassVar[bool] = False  # whether vehicles can decide inside the vector field (`tick: 0`)
    holds: ClassVar[bool] = False  # whether vehicles can hold a jerk from tick to tick, as some laws ask

    def options(self) -> tuple[Any, ...]:
        """Return the options that shape the compiled program: hashable."""
        return ()

    def numbers(self, draw: Any, gain: Any, interval: float) -> Any:
        """Return the engine's own inputs, a pytree of arrays with lanes first.

        `gain` has shape (lanes, 3); `interval` [s] is the time from tick to tick.
        """
        return ()

    @staticmethod
    def simulate(queue: Any, count: Any, network: Any, clock: Any, plan: Any) -> Any:
        """Return the outcome of the first `count` lanes of a queue of `Inputs`, traced by JAX; lanes last."""
        raise NotImplementedError

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """Yield a fault if the scenario holds a jerk or decides at every instant, and the engine cannot."""
        if scenario.law.holds and not self.holds:
            message = (
                f"the {self.kind} engine cannot hold a jerk from tick to tick, as {scenario.law.kind} does"
            )
            yield Fault(("engine", "law"), message)
        if scenario.defence.decides and scenario.tick == 0 and not self.in_field:
            yield Fault(("engine", "tick"), f"the {self.kind} engine decides at ticks only: give a tick")


add_family("engine", Engine, "jaxnet.engines")
