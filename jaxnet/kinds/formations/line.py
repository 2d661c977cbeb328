from jaxnet.kinds.fields import Number, Positive, setting
from jaxnet.kinds.formations import Still
from jaxnet.model.circle import circle


class LineFormation(Still):
    """Vehicles on a line at equal distances, in the order of their numbers, about its middle."""

    spacing: Positive = setting(..., "[m], from vehicle to vehicle")
    heading: Number = setting(0.0, "[rad], of the line, from the first axis")

    def places(self, vehicles):
        return tuple(
            [self.spacing * along * (number - (vehicles - 1) / 2) for number in range(vehicles)]
            for along in circle(self.heading)
        )
