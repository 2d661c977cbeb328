"""The exact engine as a config names it (see `engine.propagation`)."""

from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from jaxtyping import Float

from jaxnet.engine.methods import (
    Clock,
    Engine,
    Inputs,
    LaneCount,
    LaneGainRows,
    Network,
    Outcome,
    Plan,
    Presumed,
)
from jaxnet.kinds.protocols import LaneDraw, ScenarioView

if TYPE_CHECKING:
    from jaxtyping import Array
else:
    Array = Any  # jaxtyping's own imports JAX, which takes longer than a config that is read


class Flow(NamedTuple):
    """`expm(A_c h)` over one tick h, and E^(r) in a tick from E and its derivatives at its end."""

    # of gains that are matrices: blocks
    flow: Float[Array, "r r 2 2 *lanes"] | Float[Array, "r r *lanes"]
    reach: Float[Array, "r *lanes"]


class Exact(Engine):
    """The closed loop solved exactly from tick to tick."""

    kind = "exact"
    chunk: ClassVar[int] = 256
    shard: ClassVar[int] = 4096
    accuracy: ClassVar[float] = 1e-8
    holds: ClassVar[bool] = True
    by_functions: ClassVar[bool] = True

    def presumes(self, scenario: ScenarioView) -> Presumed:
        """Return that vehicles do what the law asks, by no equation of their own."""
        return "motion"

    def numbers(self, draw: LaneDraw, gain: LaneGainRows, interval: float) -> Flow:
        """The flow over one tick for each lane's gains."""
        from scipy.linalg import expm

        from jaxnet.model import axis

        alike = (gain == gain[0]).all()
        some = gain[:1] if alike else gain
        flow, reach = expm(axis.companion(some) * interval), axis.backward_reach(some, interval)
        if gain.ndim > 2:
            order = gain.shape[1]
            flow = flow.reshape(-1, order, 2, order, 2).transpose(0, 1, 3, 2, 4)
        return Flow(draw.same(flow[0]), draw.same(reach[0])) if alike else Flow(flow, reach)  # pyright: ignore[reportArgumentType]

    @staticmethod
    def simulate(
        queue: Inputs, count: LaneCount, network: Network, clock: Clock, plan: Plan
    ) -> Outcome:
        """Advance all lanes in lockstep by `engine.propagation`, or by `engine.local`."""
        from jaxnet.engine import local, loop, propagation

        ways = {"held": propagation.Held, "solved": propagation.Solved, "local": local.Local}
        return loop.in_lockstep(ways[queue.lane.law.way()], queue, network, clock, plan)
