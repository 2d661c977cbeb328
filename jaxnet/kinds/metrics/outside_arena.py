from jaxnet.kinds.fields import setting
from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.metrics.collisions import StepCount


class OutsideArena(StepCount):
    """Steps from output to output in which the centre of any robot is outside the arena.

    The arena's public simulator counts so, with these defaults.
    """

    x: float = setting(1.6, "[m], half of the arena's length", gt=0)
    y: float = setting(1.0, "[m], half of the arena's width", gt=0)

    def words(self):
        return f"steps with a robot outside ±{self.x:g} m × ±{self.y:g} m"

    def counted(self, seen):
        x, y = abs(seen.state[:2])
        return ((x > self.x) | (y > self.y)).any(axis=0).astype(float)


OUTSIDE_ARENA = Metric("outside_arena", "", OutsideArena(), time="sum")
