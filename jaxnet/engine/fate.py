"""Fate of vehicles cut off from the navigator by decisions: who, since when, how many, how long."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


class Isolation(NamedTuple):
    """Vehicles that decisions have cut off until now."""

    first: Int[Array, " lanes"]  # lowest number of the vehicles cut off first; 0 for none
    since: Float[Array, " lanes"]  # [s] time of the tick at which they were; not-a-number for none
    ever: Bool[Array, "m lanes"]
    pairs: Int[Array, " lanes"]  # (vehicle, tick) pairs


def nobody(vehicles: int, lanes: int) -> Isolation:
    zero = jnp.zeros(lanes, int)
    return Isolation(zero, jnp.full(lanes, jnp.nan), jnp.zeros((vehicles, lanes), bool), zero)


def passed(
    before: Isolation, cut_off: Bool[Array, "m lanes"], time: Float[Array, " lanes"]
) -> Isolation:
    """The vehicles cut off until now, after a tick at which decisions cut these vehicles off."""
    begins = cut_off.any(axis=0) & (before.first == 0)
    return Isolation(
        first=jnp.where(begins, cut_off.argmax(axis=0) + 1, before.first),
        since=jnp.where(begins, time, before.since),
        ever=before.ever | cut_off,
        pairs=before.pairs + cut_off.sum(axis=0),
    )


def isolation_counts(isolation: Isolation, ticks: Int[Array, ""]) -> dict[str, Array]:
    vehicles = len(isolation.ever)
    return {
        "cut_off": isolation.first,
        "cut_off_at": isolation.since,
        "cut_off_vehicles": isolation.ever.sum(axis=0),
        "cut_off_share": isolation.pairs / (vehicles * ticks),
    }
