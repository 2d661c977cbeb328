"""How far attacks spread through a network: the γ of SCIENCE, O5.

Of each vehicle, `γ_i = max over retained neighbours of Σ_j w̃_ij (γ_j + 1[link (i, j) attacked])`, w̃ the
weights in force: a Markov decision process that ends at the navigator. Where an attack replaces what is sent,
γ_j of an attacked link is the navigator's, 0. Where only one set of neighbours may be retained, γ is the
static gain `s = L⁻¹ W_a 1`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxnet.model import graph
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.retained import AnySubset
from jaxnet.model.signal import ORDERS
from jaxnet.theory.certificate import MOST_INVERTED
from jaxnet.theory.response import Gain

Gains = Float[np.ndarray, " m"]
ROUNDING = 1e-12  # relative; less is no improvement
NOTHING = 1e-15  # of the greatest gain; less is not made better, as it is far from every attack
LEAST_NORMAL = float(np.finfo(float).tiny)  # what is smaller has no relative precision


class Spread(NamedTuple):
    """How far attacks spread through a network."""

    gains: Gains  # γ
    fixed: Digraph | None  # in force for good; None where retained neighbours, or attacks, may jump
    norms: float  # `‖L⁻¹‖₂ ‖W_a 1‖₂` of the weights in force for good, else, or of large fleets, not-a-number
    orders: tuple[int, ...] = ORDERS  # of the received derivatives, those that are falsified

    def disturbance(self, gain: Gain) -> float:
        """β, what attacks of size 1 on these orders come to in ρ."""
        return float(np.append(gain, 1.0)[list(self.orders)].sum())


def spread_of(
    retained: AnySubset,
    attacked: Links,
    carried: Links,
    smooth: bool = True,
    orders: tuple[int, ...] = ORDERS,
) -> Spread:
    """How far attacks on some links spread, `carried` those that carry what their source says.

    `smooth` attacks are paths with their derivatives; `orders` are those that they falsify.
    """
    gains = worst_gains(retained, attacked, carried)
    fixed = retained.fixed if smooth else None
    if fixed is None:
        return Spread(gains, None, np.nan, orders)
    if graph.unreachable(fixed):
        return Spread(gains, fixed, np.inf, orders)
    inverse = graph.inverse_norm(fixed.only(carried)) if fixed.vehicles <= MOST_INVERTED else np.nan
    added = fixed.only(attacked).weights.sum(axis=1)
    return Spread(gains, fixed, float(inverse * np.linalg.norm(added)), orders)


def severed(retained: AnySubset) -> Bool[np.ndarray, " m"]:
    """Vehicles that the navigator may not reach, or that may keep a link from such a one.

    The first are the largest set of which everybody can drop whatever they hear from outside it, found by
    taking out, again and again, those who cannot.
    """
    network, links, number = retained
    heard, cut = network.heard, np.ones(network.vehicles, bool)
    while True:
        outside = heard & ~np.append(False, cut)[network.sources]
        tied = (outside & ~links).any(axis=1) | ((outside & links).sum(axis=1) > number)
        if not (cut & tied).any():
            break
        cut &= ~tied
    may_keep = heard & ~(links & (number == links.sum(axis=1))[:, None])
    newest = cut
    while newest.any():
        newest = (may_keep & np.append(False, newest)[network.sources]).any(axis=1) & ~cut
        cut = cut | newest
    return cut


def worst_gains(retained: AnySubset, attacked: Links, carried: Links) -> Gains:
    """γ, by policy iteration; infinite where some choice disconnects a vehicle (`severed`).

    `carried` are the links that carry what their source says. Holds for whatever neighbours are retained one
    after the other, within what is allowed. Source: Howard's policy iteration (Puterman, Markov Decision
    Processes, 1994, section 7.2): all policies left end at the navigator, so the values of all vehicles rise
    together and the last are the greatest. The first policy looks at what gains are where nobody is dropped,
    for from gains of 0 they would grow by one vehicle a round.
    """
    joined = ~severed(retained)
    given = *retained.graph, *retained[1:], attacked, carried
    sources, weights, links, number, attacked, carried = (each[joined] for each in given)

    def gains_of(kept: Float[np.ndarray, "some slots"]) -> Gains:
        word, added = np.zeros(retained.graph.weights.shape), np.zeros(len(joined))
        word[joined], added[joined] = kept * carried, (kept * attacked).sum(axis=1)
        return graph.solver(retained.graph._replace(weights=word))(added)

    gains, better = np.zeros(len(joined)), gains_of(weights)
    while True:
        reward = attacked + carried * np.append(0.0, better)[sources]
        better = gains_of(worst_kept(weights, reward, links, number))
        if (better <= np.maximum(gains * (1 + ROUNDING), NOTHING * better.max())).all():
            return np.where(joined, better, np.inf)
        gains = better


def worst_kept(
    weights: Float[np.ndarray, "some slots"],
    reward: Float[np.ndarray, "some slots"],
    links: Bool[np.ndarray, "some slots"],
    number: Int[np.ndarray, " some"],
) -> Float[np.ndarray, "some slots"]:
    """Weights in force that make `Σ w r / Σ w` over kept sources greatest, so many `links` being dropped.

    At a ratio λ the best is to drop those of least w (r - λ); its own ratio is the next λ, until none is
    greater (Dinkelbach, 1967).
    """
    ratio = np.zeros(len(weights))
    while True:
        merit = np.where(links, weights * (reward - ratio[:, None]), np.inf)
        dropped = merit.argsort(axis=1).argsort(axis=1) < number[:, None]
        kept = np.where(dropped, 0.0, weights)
        kept = kept / kept.sum(axis=1, keepdims=True)
        better = (kept * reward).sum(axis=1)
        if (better <= ratio * (1 + ROUNDING) + LEAST_NORMAL).all():
            return kept
        ratio = better
