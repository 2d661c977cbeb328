from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import VehicleNumbers


def nearest(seen: FleetView) -> VehicleNumbers:
    """Distance [m] of each steered point to the nearest, (m, lanes); infinite for a single one."""
    xp, apart = seen.error.__array_namespace__(), seen.apart()
    itself = xp.eye(apart.shape[0], dtype=bool)[:, :, None]
    return xp.where(itself, xp.inf, apart).min(axis=0)


MIN_SEPARATION = Metric(
    "min_separation",
    "m",
    nearest,
    time="min",
    vehicles="min",
    words="least distance of any two steered points, liars included, in the whole run",
    undefined="infinite",
)
