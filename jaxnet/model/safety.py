"""Vehicles that no attack can keep off the navigator, by what is known of whom they believe."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from jaxnet.model.graph import Links

Vehicles = Bool[np.ndarray, " m"]


class Safe(NamedTuple):
    """Vehicles that end on the navigator whatever attackers say, and in a few words why."""

    why: str
    vehicles: Vehicles


def untouched(believed: Links, attacked: Links) -> Vehicles:
    """Vehicles that believe no attacked link, and of the others none that does, however far upstream."""
    touched = (believed & attacked).any(axis=1)
    newest = touched
    while newest.any():
        newest = believed[:, 1:][:, newest].any(axis=1) & ~touched
        touched = touched | newest
    return np.asarray(~touched)


def contracting(heard: Links, attacked: Links, trusted: Links, theta: Int[np.ndarray, " m"]) -> Vehicles:
    """Vehicles whose announced disturbance shrinks to nothing when they drop the ϑ_i greatest announced.

    The greatest set in which each hears at most ϑ_i links that are attacked or come from outside the set,
    none of them trusted, drops fewer than it hears, and is reached by the navigator's zero: it hears one who
    is reached, and either trusts it or retains another who announces no more (SCIENCE, O11).
    """
    honest = heard & ~attacked
    inside = heard.sum(axis=1) > theta
    while True:
        good = honest & np.concatenate([[True], inside])[None]
        bad = heard & ~good
        able = inside & ((bad & ~trusted).sum(axis=1) <= theta) & ~(bad & trusted).any(axis=1)
        able = reached(good, trusted, (heard & ~trusted).sum(axis=1) > theta, able)
        if (able == inside).all():
            return inside
        inside = able


def reached(good: Links, trusted: Links, retains: Vehicles, among: Vehicles) -> Vehicles:
    """Those `among` vehicles that the navigator's zero reaches; `retains` hear more untrusted than they
    drop.
    """
    passes = good & (trusted | retains[:, None])
    found = passes[:, 0] & among
    newest = found
    while newest.any():
        newest = passes[:, 1:][:, newest].any(axis=1) & among & ~found
        found = found | newest
    return found
