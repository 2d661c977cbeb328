"""The nonlinear engine as a config names it (see `engine.collocation` and `engine.integration`)."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from jaxnet.engine.methods import Engine
from jaxnet.kinds.fields import Number, Positive, Within


class Nonlinear(Engine):
    """The nonlinear vehicles under the law, integrated adaptively.

    `dopri5` runs in place of `gauss` in these cases: with `tick: 0` vehicles decide inside the
    vector field, which then jumps; the outputs of a vehicle such as `look_ahead` do not determine
    its state, or their inputs have limits; and under `law: linearised` vehicles drive backwards
    too.
    """

    cached: ClassVar[int] = 1_200  # few, because the cache holds the slopes of all stages too
    queue: ClassVar[int] = 8
    in_field: ClassVar[bool] = True
    linearises: ClassVar[bool] = True
    holds: ClassVar[bool] = True
    limits: ClassVar[bool] = True

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
        default=100_000, ge=1, le=10**15, description="most steps of a lane, refused ones included"
    )

    def presumes(self, scenario):
        """Return that jets tell the state where `gauss` integrates, which works with jets."""
        in_field = scenario.defence.decides and scenario.tick == 0
        jets = self.solver == "gauss" and tells_motion(in_field, scenario.vehicle, scenario.law)
        return "state" if jets else "nothing"

    def options(self):
        return (self.solver,)

    def numbers(self, draw, gain, interval):
        """The tolerances and the most steps of each lane."""
        from jaxnet.engine import plan

        rtol, atol = draw.one(self.rtol, "engine.rtol"), draw.one(self.atol, "engine.atol")
        return plan.Tolerances(rtol, atol, draw.same(self.max_steps))

    @staticmethod
    def simulate(queue, count, network, clock, plan):
        """Advance the first `count` lanes by `engine.collocation` or `engine.integration`."""
        from jaxnet.engine import collocation, integration, loop

        motion, lane = integration.Integration, queue.lane
        if plan.options == ("gauss",):
            if tells_motion(plan.in_field, lane.vehicle, lane.law):
                motion = collocation.Collocation
            else:
                plan = plan._replace(options=("dopri5",))
        return loop.from_queue(motion, queue, count, network, clock, plan)


def tells_motion(in_field: bool, vehicle: Any, law: Any) -> bool:
    """Whether jets tell the state of vehicles, which move smoothly from tick to tick."""
    limited = bool(vehicle.limits)
    return not (in_field or limited or vehicle.internal or law.way() == "linearised")
