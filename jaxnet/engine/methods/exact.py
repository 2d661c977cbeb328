"""The exact engine as a config names it (see `engine.propagation`)."""

from typing import ClassVar

from jaxnet.engine.methods import Engine


class Exact(Engine):
    """The closed loop solved exactly from tick to tick."""

    chunk: ClassVar[int] = 256
    shard: ClassVar[int] = 4096
    accuracy: ClassVar[float] = 1e-8
    holds: ClassVar[bool] = True
    by_functions: ClassVar[bool] = True

    def presumes(self, scenario):
        """Return that vehicles do what the law asks, by no equation of their own."""
        return "motion"

    @staticmethod
    def simulate(queue, count, network, clock, plan):
        """Advance all lanes in lockstep by `engine.propagation`, or by `engine.local`."""
        from jaxnet.engine import local, loop, propagation

        ways = {"held": propagation.Held, "solved": propagation.Solved, "local": local.Local}
        return loop.in_lockstep(ways[queue.lane.law.way()], queue, network, clock, plan)
