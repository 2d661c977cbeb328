"""The liar that announces anything."""

from typing import Annotated, Any

from pydantic import Field

from jaxnet.kinds.announcements import Announcement
from jaxnet.kinds.fields import FULL_TURN, Angle, Each, PerVehicle, Uniform, Within


class Free(Announcement):
    """An attacked link announces a turning vector, `size · [cos, sin](frequency · t + phase)`.

    Each attacked vehicle, or link where listeners are told different signals, has a vector of its own.
    """

    kind = "free"

    size: Annotated[PerVehicle, Within(ge=0.0), Each()] = Field(
        default=Uniform(uniform=[0.0, 10.0]), description="[m/s³], length of the vector"
    )
    frequency: Annotated[PerVehicle, Each()] = Field(
        default=Uniform(uniform=[0.0, 4.0]), description="[rad/s], of its turning"
    )
    phase: Angle = Field(default=FULL_TURN, description="[rad], its direction at t = 0")

    def received(self, honest: Any, carried: Any, attacked: Any, signals: Any, time: Any) -> Any:
        """The vectors on attacked links."""
        xp = honest.__array_namespace__()
        angle = self.frequency * time[None] + self.phase
        vectors = xp.stack([self.size * xp.cos(angle), self.size * xp.sin(angle)])
        return xp.where(attacked[None], vectors[:, signals], honest)
