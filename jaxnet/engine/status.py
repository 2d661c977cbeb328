"""Status of a lane at its end. A failed lane stops where it failed and affects no other lane."""

from enum import IntEnum

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

LEAST_SPEED = 1e-9  # [m/s] below it the law is singular


class Status(IntEnum):
    """Reason for which a lane ended: the first reason that applies, in this order."""

    ok = 0
    singular = 1  # |v| < 1e-9 m/s, or v changes its sign
    nonfinite = 2  # a state not finite or not found, or a vector field for which no step is small enough
    max_steps = 3  # the step limit, or a step too small to move the time
    disconnected = 4  # the weights in force cut a vehicle off from the navigator


Code = Int[Array, "*lanes"]


def fail(status: Code, reason: Status, when: Bool[Array, "*lanes"]) -> Code:
    """Return the status, replaced by this reason where `when` holds and the lane was ok until now."""
    return jnp.where((status == Status.ok) & when, int(reason), status)
