from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from jaxnet.kinds.attacks import PathInstead, constant_basis
from jaxnet.kinds.fields import Angle, OneOf, PerVehicle, Vector, setting, value_range
from jaxnet.kinds.navigators import sizes_up_to
from jaxnet.kinds.protocols import NavigatorPath
from jaxnet.kinds.shapes import AnyTimes, SignalBasis
from jaxnet.model.plane import length
from jaxnet.model.signal import Harmonic


class OwnPath(PathInstead):
    """An attacked link carries `centre + swing · cos(frequency · t + phase)`.

    The path follows neither the navigator nor the source, as that of malicious agents of the
    literature. With a swing of [0, 0] it is a constant place.
    """

    words = "path of its own"

    centre: Annotated[Literal["start"] | Vector, OneOf("must be start, or a place [x, y]")] = (
        setting("start", "[m], a place [x, y], or start: where the source starts")
    )
    swing: Vector = setting([10.0, 0.0], "[m], of the oscillation on each axis")
    frequency: PerVehicle = setting(0.7, "[rad/s], of the oscillation")
    phase: Angle = setting(0.0, "[rad], at t = 0")

    def fastest(self):
        return max(map(abs, value_range(self.frequency)))

    def told(self, navigator, start):
        centre = start if isinstance(self.centre, str) else np.asarray(self.centre)[:, None]
        swing, phase = np.asarray(self.swing)[:, None], np.asarray(self.phase)
        parts = (centre, swing * np.cos(phase), -swing * np.sin(phase))
        own = [np.broadcast_to(each, start.shape) for each in parts]
        return path_about(navigator, *own, harmonic=Harmonic(self.frequency))

    def reach(self, navigator, signal: Any, horizon):
        return signal.sizes(sizes_up_to(self.told_order, navigator, 0.0, horizon))


class PlacedPath(NamedTuple):
    """The functions of a path minus the navigator's: a constant, a harmonic, both coordinates."""

    navigator: NavigatorPath
    far: Any  # (lanes,) [m]
    harmonic: Harmonic | None

    def basis(self, time: AnyTimes) -> SignalBasis:
        own = [] if self.harmonic is None else [self.harmonic.basis(time)]
        constant = self.far[None, None] * constant_basis(time)
        parts = [constant, *own, self.navigator.jets(time)]
        return time.__array_namespace__().concatenate(parts, axis=1)

    def sizes(self, path: np.ndarray) -> np.ndarray:
        """The sizes of the constant and the harmonic, plus those of the navigator's path."""
        found = path[:, None] + np.eye(len(path), 1) * self.far
        if self.harmonic is None:
            return found
        return found + np.abs(self.harmonic.frequency) ** np.arange(float(len(path)))[:, None]


def path_about(
    navigator: NavigatorPath, centre: np.ndarray, *swings: np.ndarray, harmonic: Harmonic | None
) -> tuple[PlacedPath, np.ndarray]:
    """Signal and vectors of a path about a centre (2, m, lanes) [m], minus the navigator's.

    The constant is as great as the farthest centre, so that the vectors have similar lengths.
    """
    far = np.maximum(1.0, length(centre).max(axis=0))
    axes = np.broadcast_to(-np.eye(2)[:, None, :, None], (*centre.shape[:2], 2, centre.shape[2]))
    own = np.stack([centre / far, *swings], axis=2)
    return PlacedPath(navigator, far, harmonic), np.concatenate([own, axes], axis=2)
