"""The misused inputs of rescue.yaml."""

from typing import Annotated

import jax.numpy as jnp

from jaxnet.kinds.attacks import Attack, unit_vectors
from jaxnet.kinds.fields import Angle, Each, PerVehicle, setting


class Ramp(Attack):
    """A signal that grows in proportion to time, without bound."""

    bounded = False

    slope: Annotated[PerVehicle, Each()] = setting(1.0, "[m/s^r a second], of each vehicle")
    direction: Angle = setting(0.0, "[rad], along which it acts")

    def basis(self, time):
        still = jnp.zeros_like(time)
        return jnp.stack([time, jnp.ones_like(time), still, still])[:, None]

    def vectors(self):
        return (unit_vectors(self.direction) * self.slope)[:, :, None]
