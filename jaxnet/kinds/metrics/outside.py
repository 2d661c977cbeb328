import math

import numpy as np

from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.protocols import FleetView
from jaxnet.kinds.shapes import VehicleNumbers

DIRECTIONS = 64  # of half-planes that make up the hull: distances are at most 0.12 % too short


def beyond(seen: FleetView) -> VehicleNumbers:
    """How far [m] each honest vehicle is outside the convex hull of the starts, (m, lanes)."""
    xp, honest = seen.error.__array_namespace__(), ~seen.attacked
    angle = 2 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
    outside = xp.zeros_like(seen.error[0])
    for cosine, sine in zip(np.cos(angle).tolist(), np.sin(angle).tolist(), strict=True):
        start, now = (cosine * each[0] + sine * each[1] for each in (seen.start, seen.steered))
        edge = xp.where(honest, start, -xp.inf).max(axis=0)
        outside = xp.maximum(outside, now - edge[None])
    return xp.where(honest, outside, 0.0)


LEAVES = "how far an honest vehicle leaves the convex hull of the honest starts"
OUTSIDE_HULL = Metric("outside", "m", beyond, words=LEAVES)
