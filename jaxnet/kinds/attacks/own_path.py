"""A path of the attacker's own, as malicious agents of the literature have."""

from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Discriminator, Field

from jaxnet.kinds.attacks import Attack, constant_basis
from jaxnet.kinds.fields import (
    MARK,
    Angle,
    NotNegative,
    PerVehicle,
    Vector,
    union_member,
    value_range,
)
from jaxnet.kinds.navigators import sizes_up_to
from jaxnet.kinds.protocols import NavigatorPath
from jaxnet.kinds.shapes import AnyTimes, SignalBasis
from jaxnet.model.plane import length
from jaxnet.model.signal import Harmonic


def centre_tag(value: object) -> str:
    return MARK + ("word" if isinstance(value, str) else "place")


class OwnPath(Attack):
    """An attacked link carries `centre + swing · cos(frequency · t + phase)`, whatever its source
    does.

    The path follows neither the navigator nor the source. With a swing of [0, 0] it is a constant
    place.
    """

    kind = "own_path"
    words = "path of its own"
    highest = 4
    bounded = False

    magnitude: NotNegative = Field(
        default=5.0, description="[m], what recovery is judged by; nothing is scaled to it"
    )
    threat: Literal["replaces"] = Field(  # pyright: ignore[reportIncompatibleVariableOverride]
        default="replaces", description="what is sent is replaced"
    )
    centre: Annotated[
        Annotated[Literal["start"], union_member("word")]
        | Annotated[Vector, union_member("place")],
        Discriminator(centre_tag),
    ] = Field(default="start", description="[m], a place [x, y], or start: where the source starts")
    swing: Vector = Field(default=[10.0, 0.0], description="[m], of the oscillation on each axis")
    frequency: PerVehicle = Field(default=0.7, description="[rad/s], of the oscillation")
    phase: Angle = Field(default=0.0, description="[rad], at t = 0")

    def fastest(self):
        return max(map(abs, value_range(self.frequency)))

    def told(self, navigator, start):
        """The signal and vectors of the path minus the navigator's.

        The functions are a constant, cosine and sine, and the navigator's two coordinates. The
        constant is as great as the farthest centre, so that the vectors have similar lengths.
        """
        m, lanes = start.shape[1:]
        centre = start if isinstance(self.centre, str) else np.asarray(self.centre)[:, None]
        centre, swing = (
            np.broadcast_to(each, start.shape) for each in (centre, np.asarray(self.swing)[:, None])
        )
        far = np.maximum(1.0, length(centre).max(axis=0))
        cosine, sine = (np.broadcast_to(turn(self.phase), (m, lanes)) for turn in (np.cos, np.sin))
        axes = np.broadcast_to(-np.eye(2)[:, None, :, None], (2, m, 2, lanes))
        own = np.stack([centre / far, swing * cosine, -swing * sine], axis=2)
        return Oscillation(Harmonic(self.frequency), navigator, far), np.concatenate(
            [own, axes], axis=2
        )

    def reach(self, navigator, signal: Any, horizon):
        """The sizes of the constant and the oscillation, plus those of the navigator's path."""
        path = sizes_up_to(self.told_order, navigator, 0.0, horizon)
        orders = np.arange(float(len(path)))
        return (
            path[:, None]
            + np.eye(len(path), 1) * signal.far
            + np.abs(self.frequency) ** orders[:, None]
        )


class Oscillation(NamedTuple):
    """A constant function, a harmonic, and the two coordinates of the navigator."""

    harmonic: Harmonic
    navigator: NavigatorPath
    far: Any  # (lanes,) [m]

    def basis(self, time: AnyTimes) -> SignalBasis:
        """Five functions: the constant, cosine, sine, and the navigator's two coordinates."""
        xp, constant = time.__array_namespace__(), self.far[None, None] * constant_basis(time)
        return xp.concatenate(
            [constant, self.harmonic.basis(time), self.navigator.jets(time)], axis=1
        )
