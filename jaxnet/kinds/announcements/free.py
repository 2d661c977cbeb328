from typing import Annotated

from jaxnet.kinds.announcements import Announcement
from jaxnet.kinds.fields import FULL_TURN, Angle, Each, PerVehicle, Uniform, Within, setting


class Free(Announcement):
    """An attacked link announces a turning vector, `size · [cos, sin](frequency · t + phase)`.

    Each attacked vehicle has a vector of its own, or each attacked link if `listeners` is `each`.
    """

    size: Annotated[PerVehicle, Within(ge=0.0), Each()] = setting(
        Uniform(uniform=[0.0, 10.0]), "[m/s³], length of the vector"
    )
    frequency: Annotated[PerVehicle, Each()] = setting(
        Uniform(uniform=[0.0, 4.0]), "[rad/s], of its turning"
    )
    phase: Angle = setting(FULL_TURN, "[rad], its direction at t = 0")

    def received(self, honest, carried, attacked, signals, time):
        xp = honest.__array_namespace__()
        angle = self.frequency * time[None] + self.phase
        vectors = xp.stack([self.size * xp.cos(angle), self.size * xp.sin(angle)])
        return xp.where(attacked[None], vectors[:, signals], honest)
