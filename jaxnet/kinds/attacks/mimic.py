"""The mimic: as far off as it is still believed."""

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import Attack, constant_basis, unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Angle


class Mimic(Attack):
    """An offset along each attacker's direction, at every tick the greatest that all its listeners retain.

    Of so many parts of ā; none where it is dropped whatever it says. Attackers try it all at once, so that
    one is at times dropped for what another says.
    """

    kind = "mimic"
    strategic: ClassVar[bool] = True

    direction: Angle = Field(default=FULL_TURN, description="[rad], of the offset")
    parts: int = Field(default=16, ge=1, le=1000, description="of ā that are tried")

    def basis(self, time: Any) -> Any:
        """Held from tick to tick."""
        return constant_basis(time)

    def sizes(self, horizon: float) -> np.ndarray:
        """1, and no derivatives."""
        return np.eye(4, 1)

    def aim(self, seen: Any, memory: Any) -> tuple[Any, Any]:
        """Try smaller and greater parts; the greatest that passes stays."""
        import jax
        import jax.numpy as jnp

        m = seen.errors[0].shape[1]
        unit = jnp.broadcast_to(unit_vectors(self.direction), seen.errors[0].shape)
        attacker = jnp.where(seen.sources > 0, seen.sources - 1, jnp.arange(m)[None])

        def try_part(greatest: Any, part: Any) -> Any:
            weights = seen.in_force((part * unit)[:, :, None])
            dropped = seen.attacked[:, :, None] & (seen.weights > 0) & ~(weights > 0).all(axis=0)
            refused = jnp.zeros(greatest.shape, int).at[attacker].add(dropped.astype(int))
            return jnp.where(refused == 0, part, greatest), None

        none = jnp.zeros(unit.shape[1:])
        parts = jnp.arange(1, self.parts + 1) / self.parts
        return (jax.lax.scan(try_part, none, parts)[0][None] * unit)[:, :, None], memory
