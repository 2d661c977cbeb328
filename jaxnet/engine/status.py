"""How lanes end: why they fail, and which vehicles decisions cut off, since when and how long.

A failed lane has no metrics, and its series end where it failed.
"""

from enum import IntEnum
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

# Of a vehicle, in its unit ([m/s] for wheeled ones); below it the law is singular.
LEAST_MARGIN = 1e-9
LARGEST = 1e100  # [m] of E; products of greater numbers overflow


class Status(IntEnum):
    """Reason for which a lane failed: the first to occur; of several at once, the first listed."""

    ok = 0
    singular = 1  # a margin under LEAST_MARGIN, or one that changes its sign
    nonfinite = 2  # a number is not finite, also where an iterative solver finds no solution
    max_steps = 3  # the step limit, or a step too short to change the time
    disconnected = 4  # decisions leave a vehicle without a path from the navigator
    diverged = 5  # an error over LARGEST
    unmeasured = 6  # a metric is infinite or undefined and may not be


Code = Int[Array, "*lanes"]


def fail(status: Code, reason: Status, when: Bool[Array, "*lanes"]) -> Code:
    """The status, replaced by this reason where `when` holds and the lane was ok until now."""
    return jnp.where((status == Status.ok) & when, int(reason), status)


def within_bounds(status: Code, size: Float[Array, "m *lanes"]) -> Code:
    """The status after errors of this size; infinite ones are `nonfinite` in the end."""
    return fail(status, Status.diverged, ((size > LARGEST) & jnp.isfinite(size)).any(axis=0))


class Isolation(NamedTuple):
    """Vehicles that decisions have cut off from the navigator until now."""

    first: Int[Array, " lanes"]  # lowest number of the vehicles cut off first; 0 for none
    since: Float[Array, " lanes"]  # [s] time of the tick at which they were; not-a-number for none
    ever: Bool[Array, "m lanes"]
    pairs: Int[Array, " lanes"]  # (vehicle, tick) pairs

    def after(self, cut_off: Bool[Array, "m lanes"], time: Float[Array, " lanes"]) -> "Isolation":
        """The vehicles cut off until now, after a tick that cuts these vehicles off."""
        begins = cut_off.any(axis=0) & (self.first == 0)
        return Isolation(
            first=jnp.where(begins, cut_off.argmax(axis=0) + 1, self.first),
            since=jnp.where(begins, time, self.since),
            ever=self.ever | cut_off,
            pairs=self.pairs + cut_off.sum(axis=0),
        )

    def columns(self, ticks: Int[Array, ""]) -> dict[str, Array]:
        return {
            "cut_off": self.first,
            "cut_off_at": self.since,
            "cut_off_vehicles": self.ever.sum(axis=0),
            "cut_off_share": self.pairs / (len(self.ever) * ticks),
        }


def nobody_isolated(vehicles: int, lanes: int) -> Isolation:
    zero = jnp.zeros(lanes, int)
    return Isolation(zero, jnp.full(lanes, jnp.nan), jnp.zeros((vehicles, lanes), bool), zero)
