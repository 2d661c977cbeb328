"""What a network promises before anything moves: reach, gain, and the paper's Assumption 1.

NumPy alone, so that a config is checked at once.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxnet.model import graph


class Certificate(NamedTuple):
    """Facts about one network; vehicles are listed by number, from 1."""

    heard: Int[np.ndarray, " m"]  # |N_i|, sources that each vehicle hears
    unreachable: list[int]
    inverse_norm: float  # ‖L⁻¹‖₂, infinite if L is singular
    attacked_links: list[tuple[int, int]]  # (i, j): what i hears of j is corrupted
    all_attacked: list[int]  # vehicles all of whose links are attacked
    cut_off: list[int]  # vehicles that no honest path joins to the navigator


def certify(
    weights: Float[np.ndarray, "m sources"],
    attacked: Bool[np.ndarray, "m sources"],
) -> Certificate:
    """Certificate of a graph and the links attacked on it."""
    heard = weights > 0
    honest = heard & ~attacked
    lost = graph.unreachable(weights)
    norm = np.inf if lost else float(np.linalg.norm(np.linalg.inv(graph.laplacian(weights)), 2))
    return Certificate(
        heard=heard.sum(axis=1),
        unreachable=lost,
        inverse_norm=norm,
        attacked_links=[(int(i) + 1, int(j)) for i, j in np.argwhere(attacked)],
        all_attacked=vehicles(np.asarray(~honest.any(axis=1))),
        cut_off=graph.unreachable(honest.astype(float)),
    )


def vehicles(mask: Bool[np.ndarray, " m"]) -> list[int]:
    """Numbers of the vehicles in a mask."""
    return [int(i) for i in np.flatnonzero(mask) + 1]


def robustness(weights: Float[np.ndarray, "m sources"]) -> int:
    """The r for which the graph with its navigator is exactly r-robust (LeBlanc et al., 2013): 0 or 1.

    The navigator hears nobody and all vehicles together hear one node outside, itself, so r ≤ 1; and of two
    disjoint sets one lacks the navigator, hence hears somebody outside if everyone is reached, so r ≥ 1.
    """
    return 0 if graph.unreachable(weights) else 1
