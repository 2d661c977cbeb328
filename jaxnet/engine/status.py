"""Status of a lane at its end. A failed lane has no metrics, and its series end where it failed."""

from enum import IntEnum

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

LEAST_MARGIN = (
    1e-9  # of a vehicle, in its unit ([m/s] for wheeled ones); below it the law is singular
)
LARGEST = 1e100  # [m] of E; products of greater numbers overflow


class Status(IntEnum):
    """Reason for which a lane failed: the first to occur; of several at once, the first listed."""

    ok = 0
    singular = 1  # a margin under LEAST_MARGIN, or one that changes its sign
    nonfinite = 2  # a number is not finite, also where an iterative solver finds no solution
    max_steps = 3  # the step limit, or a step too small to move the time
    disconnected = 4  # decisions leave a vehicle without a path from the navigator
    diverged = 5  # an error over LARGEST
    unmeasured = 6  # a metric is no number that it may be


Code = Int[Array, "*lanes"]


def fail(status: Code, reason: Status, when: Bool[Array, "*lanes"]) -> Code:
    """The status, replaced by this reason where `when` holds and the lane was ok until now."""
    return jnp.where((status == Status.ok) & when, int(reason), status)


def within_bounds(status: Code, size: Float[Array, "m *lanes"]) -> Code:
    """The status after errors of this size; infinite ones are `nonfinite` in the end."""
    return fail(status, Status.diverged, ((size > LARGEST) & jnp.isfinite(size)).any(axis=0))
