from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import VehicleNumbers
from jaxnet.model.plane import length


def nearest(seen: FleetView) -> VehicleNumbers:
    """Distance [m] of each vehicle to the nearest other, (m, lanes); infinite for a single one."""
    xp = seen.error.__array_namespace__()
    apart = length(seen.error[:, :, None] - seen.error[:, None])
    itself = xp.eye(apart.shape[0], dtype=bool)[:, :, None]
    return xp.where(itself, xp.inf, apart).min(axis=0)


MIN_SEPARATION = Metric(
    "min_separation",
    "m",
    nearest,
    time="min",
    vehicles="min",
    words="least distance of two vehicles",
    undefined="infinite",
)
