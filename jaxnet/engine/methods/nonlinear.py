"""The nonlinear engine as a config names it (see `engine.collocation` and `engine.integration`)."""

from collections.abc import Hashable
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

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
from jaxnet.kinds.fields import Number, Positive, Within
from jaxnet.kinds.protocols import LaneDraw, ScenarioView

if TYPE_CHECKING:
    from jaxnet.engine.plan import Tolerances
else:
    Tolerances = Any


class Nonlinear(Engine):
    """The nonlinear vehicles under the law, integrated adaptively.

    `dopri5` runs in place of `gauss` in three cases: with `tick: 0` vehicles decide inside the
    vector field, which then jumps; the outputs of a vehicle such as `look_ahead` do not determine
    its state; and under `law: linearised` vehicles drive backwards too.
    """

    kind = "nonlinear"
    cached: ClassVar[int] = 1_200  # few, because the cache holds the slopes of all stages too
    queue: ClassVar[int] = 8
    in_field: ClassVar[bool] = True
    linearises: ClassVar[bool] = True
    holds: ClassVar[bool] = True

    solver: Literal["gauss", "dopri5", "dopri8"] = Field(
        default="gauss",
        description="collocation in the jets of the outputs (gauss), or a Runge–Kutta pair in the"
        " states",
    )
    rtol: Annotated[Number, Within(gt=0.0, lt=1.0)] = Field(
        default=1e-7, description="relative, of a step"
    )
    atol: Positive = Field(default=1e-9, description="absolute, of a step")
    max_steps: int = Field(
        default=100_000,
        ge=1,
        le=10**15,
        description="of a lane's whole fleet, refused ones included",
    )

    def presumes(self, scenario: ScenarioView) -> Presumed:
        """Return that jets tell the state where `gauss` integrates, which works with jets."""
        in_field = scenario.defence.decides and scenario.tick == 0
        states = (
            self.solver != "gauss"
            or in_field
            or scenario.vehicle.internal
            or scenario.law.way() == "linearised"
        )
        return "nothing" if states else "state"

    def options(self) -> tuple[Hashable, ...]:
        return (self.solver,)

    def numbers(self, draw: LaneDraw, gain: LaneGainRows, interval: float) -> Tolerances:
        """The tolerances and the most steps of each lane."""
        from jaxnet.engine import plan

        rtol, atol = draw.one(self.rtol, "engine.rtol"), draw.one(self.atol, "engine.atol")
        return plan.Tolerances(rtol, atol, draw.same(self.max_steps))

    @staticmethod
    def simulate(
        queue: Inputs, count: LaneCount, network: Network, clock: Clock, plan: Plan
    ) -> Outcome:
        """Advance the first `count` lanes by `engine.collocation` or `engine.integration`."""
        from jaxnet.engine import collocation, integration, loop

        (solver,) = plan.options
        lane = queue.lane
        if solver == "gauss" and (
            plan.in_field or lane.vehicle.internal or lane.law.way() == "linearised"
        ):
            plan = plan._replace(options=("dopri5",))
        motion = collocation.Collocation if plan.options == ("gauss",) else integration.Integration
        return loop.from_queue(motion, queue, count, network, clock, plan)
