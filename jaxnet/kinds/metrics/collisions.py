from jaxnet.kinds.fields import setting
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.metrics import Metric, MetricKeys, of_fleet
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import AnyMask, LaneNumbers, VehicleState
from jaxnet.kinds.vehicles import HEADING
from jaxnet.model.circle import circle
from jaxnet.model.plane import length


class StepCount(MetricKeys):
    """A count over the steps of a run, on the places before each move."""

    def counted(self, seen: FleetView) -> LaneNumbers:
        """What one step adds, (lanes,)."""
        raise NotImplementedError

    def __call__(self, seen):
        xp = seen.error.__array_namespace__()
        return of_fleet(seen, xp.where(seen.next_time < xp.inf, self.counted(seen), 0.0))

    def faults(self, scenario):
        if scenario.engine.samples and scenario.output_step != scenario.tick:
            told = "the sampled engine's steps, which a metric counts, are ticks"
            told += ": output_step must be equal to tick"
            yield Fault(("output_step", "tick", "metrics"), told)


class Collisions(StepCount):
    """Pairs of robots that touch, counted in each step from output to output.

    The centre of each robot is moved forward along its heading. Two robots touch if these points
    are no further apart than `distance`. The arena's public simulator counts so, with
    these defaults.
    """

    distance: float = setting(0.135, "[m], from centre to centre", ge=0)
    forward: float = setting(0.025, "[m], by which centres are moved; 0 without a heading")

    def words(self):
        return f"pairs of robots within {self.distance:g} m, summed over steps"

    def pairs(self, states: VehicleState) -> AnyMask:
        """Whether one vehicle touches another of a greater number, (m, m, lanes)."""
        xp, centre = states.__array_namespace__(), states[:2]
        if self.forward:
            centre = centre + self.forward * xp.stack([*circle(states[HEADING])])
        near = length(centre[:, :, None] - centre[:, None]) <= self.distance
        number = xp.arange(near.shape[0])
        return near & (number[:, None] < number[None])[:, :, None]

    def counted(self, seen):
        return self.pairs(seen.state).sum(axis=(0, 1)).astype(float)

    def faults(self, scenario):
        yield from super().faults(scenario)
        vehicle = scenario.vehicle
        if self.forward and vehicle.states[HEADING : HEADING + 1] != ("heading",):
            told = f"collisions: {vehicle.kind} has no heading: give forward: 0"
            yield Fault(("metrics", "vehicle"), f"{told} (got {self.forward:g})")


COLLISIONS = Metric("collisions", "", Collisions(), time="sum")
