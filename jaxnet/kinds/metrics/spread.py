from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import VehicleNumbers
from jaxnet.model.plane import length


def farthest_honest(seen: FleetView) -> VehicleNumbers:
    """Distance [m] of each honest vehicle to the farthest other honest one, (m, lanes)."""
    xp, honest = seen.error.__array_namespace__(), ~seen.attacked
    apart = length(seen.error[:, :, None] - seen.error[:, None])
    return xp.where(honest[:, None] & honest[None], apart, 0.0).max(axis=0)


FARTHEST = "greatest distance of two honest vehicles"
SPREAD = Metric("spread", "m", farthest_honest, "tail", "max", "max", FARTHEST)
