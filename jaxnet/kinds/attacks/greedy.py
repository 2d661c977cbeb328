"""The greedy attack: at every tick the direction after which the fleet is worst off."""

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, constant_basis, unit_vectors
from jaxnet.model import ties
from jaxnet.model.plane import length


class Greedy(Attack):
    """All attackers' offset ā in the one of `directions` that pulls the fleet farthest off.

    That is judged by `Σ_i ‖E_i + Σ_j w̃_ij a_ij‖` with the weights that would be in force.
    """

    kind = "greedy"
    strategic: ClassVar[bool] = True

    directions: int = Field(default=16, ge=2, le=360, description="evenly around")

    def basis(self, time: Any) -> Any:
        """Held from tick to tick."""
        return constant_basis(time)

    def sizes(self, horizon: float) -> np.ndarray:
        """1, and no derivatives."""
        return np.eye(4, 1)

    def aim(self, seen: Any, memory: Any) -> tuple[Any, Any]:
        """Try all of them."""
        import jax
        import jax.numpy as jnp

        shape = (2, *seen.errors[0].shape[1:])

        def vectors_of(direction: Any) -> Any:
            return jnp.broadcast_to(direction[:, None, None], shape)[:, :, None]

        def harm(direction: Any) -> Any:
            weights = seen.in_force(vectors_of(direction))
            share = jnp.where(seen.attacked[None, :, :, None], weights, 0.0).sum(axis=1)
            pulled = seen.errors[0] + share * direction[:, None, None] * seen.amplitude[None, None]
            return length(pulled).sum(axis=0)

        unit = jnp.asarray(unit_vectors(2 * np.pi * np.arange(self.directions) / self.directions).T)
        harms = jax.lax.map(harm, unit)
        first = (~ties.over(harms.max(axis=0)[None], harms)).argmax(axis=0)  # of equal ones
        worst = unit[first].T  # (2, lanes)
        return jnp.broadcast_to(worst[:, None], shape)[:, :, None], memory
