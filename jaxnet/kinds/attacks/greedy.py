import numpy as np

from jaxnet.kinds.attacks import HeldOffset, unit_vectors
from jaxnet.kinds.fields import setting
from jaxnet.kinds.shapes import LaneNumbers, PlaneVectors, SignalVectors
from jaxnet.lazy import jax, jnp
from jaxnet.model import ties
from jaxnet.model.plane import length


class Greedy(HeldOffset):
    """All attackers send the same offset ā, in that one of `directions` that pulls the fleet
    farthest off.

    The criterion is `Σ_i ‖E_i + Σ_j w̃_ij a_ij‖` with the weights that the offset would put in
    force.
    """

    directions: int = setting(16, "evenly around", ge=2, le=360)

    def aim(self, seen, memory):
        """The direction of the greatest criterion; the first one of equal values."""

        def vectors_of(direction: PlaneVectors) -> SignalVectors:
            return jnp.broadcast_to(direction, seen.errors[0].shape)[:, :, None]

        def harm(direction: PlaneVectors) -> LaneNumbers:
            direction = direction[:, None, None]
            weights = seen.in_force(vectors_of(direction))
            share = jnp.where(seen.attacked[None, :, :, None], weights, 0.0).sum(axis=1)
            pulled = seen.errors[0] + share * direction * seen.amplitude[None, None]
            return length(pulled).sum(axis=0)

        unit = jnp.asarray(unit_vectors(2 * np.pi * np.arange(self.directions) / self.directions).T)
        harms = jax.lax.map(harm, unit)
        first = (~ties.over(harms.max(axis=0)[None], harms)).argmax(axis=0)
        return vectors_of(unit[first].T[:, None]), memory
