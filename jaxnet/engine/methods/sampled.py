"""The sampled engine as a config names it (see `engine.sampling`)."""

from typing import ClassVar, Literal

from jaxnet.engine.methods import Engine
from jaxnet.kinds.fields import setting
from jaxnet.kinds.kind import Fault, broken


class Sampled(Engine):
    """A digital controller whose period is `tick`: vehicles hold their inputs from tick to tick.

    Every law is evaluated at ticks alone. A fleet converges to that of the exact engine, with order
    1 in the period.
    """

    shard: ClassVar[int] = 1024
    linearises: ClassVar[bool] = True
    holds: ClassVar[bool] = True
    samples: ClassVar[bool] = True
    limits: ClassVar[bool] = True

    move: Literal["euler", "exact"] = setting(
        "exact",
        "how a vehicle moves over a period: euler, by one step of Euler's method, with the old "
        "heading, as simulators of robots do; exact, as its equations say",
    )

    def options(self):
        return (self.move,)

    def breaks(self):
        return broken(continuous=True)

    @staticmethod
    def simulate(queue, count, network, clock, plan):
        """Advance all lanes in lockstep by `engine.sampling`."""
        from jaxnet.engine import loop, sampling

        return loop.in_lockstep(sampling.Sampling, queue, network, clock, plan)

    def faults(self, scenario):
        yield from super().faults(scenario)
        if scenario.tick == 0:
            yield Fault(("engine", "tick"), f"{self.kind} acts at ticks alone: give a tick")
