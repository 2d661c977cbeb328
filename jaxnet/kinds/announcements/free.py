from typing import Annotated

from pydantic import Field

from jaxnet.kinds.announcements import Announcement
from jaxnet.kinds.fields import FULL_TURN, Angle, Each, PerVehicle, Uniform, Within


class Free(Announcement):
    """An attacked link announces a turning vector, `size · [cos, sin](frequency · t + phase)`.

    Each attacked vehicle has a vector of its own, or each attacked link if `listeners` is `each`.
    """

    kind = "free"

    size: Annotated[PerVehicle, Within(ge=0.0), Each()] = Field(
        default=Uniform(uniform=[0.0, 10.0]), description="[m/s³], length of the vector"
    )
    frequency: Annotated[PerVehicle, Each()] = Field(
        default=Uniform(uniform=[0.0, 4.0]), description="[rad/s], of its turning"
    )
    phase: Angle = Field(default=FULL_TURN, description="[rad], its direction at t = 0")

    def received(self, honest, carried, attacked, signals, time):
        xp = honest.__array_namespace__()
        angle = self.frequency * time[None] + self.phase
        vectors = xp.stack([self.size * xp.cos(angle), self.size * xp.sin(angle)])
        return xp.where(attacked[None], vectors[:, signals], honest)
