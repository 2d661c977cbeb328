from jaxnet.kinds.attacks import HeldOffset, unit_vectors
from jaxnet.kinds.fields import FULL_TURN, Angle, setting
from jaxnet.kinds.shapes import AnyNumbers, VehicleNumbers
from jaxnet.lazy import jax, jnp


class Mimic(HeldOffset):
    """An offset along a direction of each attacker, at every tick the greatest that all its
    listeners retain.

    The attacker tries `parts` fractions of ā, and sends 0 if its listeners drop every one. All
    attackers try the same fraction together, so a listener may drop one attacker because of
    another's offset.
    """

    direction: Angle = setting(FULL_TURN, "[rad], of the offset")
    parts: int = setting(16, "of ā that are tried", ge=1, le=1000)

    def aim(self, seen, memory):
        """Try the fractions of ā in ascending order; the greatest that every listener retains."""
        m = seen.errors[0].shape[1]
        unit = jnp.broadcast_to(unit_vectors(self.direction), seen.errors[0].shape)
        attacker = jnp.where(seen.sources > 0, seen.sources - 1, jnp.arange(m)[None])

        def try_part(greatest: VehicleNumbers, part: AnyNumbers) -> tuple[VehicleNumbers, None]:
            weights = seen.in_force((part * unit)[:, :, None])
            dropped = seen.attacked[:, :, None] & (seen.weights > 0) & ~(weights > 0).all(axis=0)
            refused = jnp.zeros(greatest.shape, int).at[attacker].add(dropped.astype(int))
            return jnp.where(refused == 0, part, greatest), None

        none = jnp.zeros(unit.shape[1:])
        parts = jnp.arange(1, self.parts + 1) / self.parts
        return (jax.lax.scan(try_part, none, parts)[0][None] * unit)[:, :, None], memory
