"""Attack gains of a network: the γ of theorems.md O5.

For each vehicle, `γ_i = max over retained neighbours of Σ_j w̃_ij (γ_j + 1[link (i, j) attacked])`,
where w̃ are the weights in force. This is a Markov decision process that ends at the navigator. If
an attack replaces the transmitted signal, γ_j of an attacked link is the navigator's, 0. If only
one set of neighbours may be retained, γ is the static gain `s = L⁻¹ W_a 1`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import (
    BOUNDS,
    MOST_INVERTED,
    attacked_draws,
    for_any_signal,
    missing,
    situation_of,
)
from jaxnet.kinds.attacks import heard_orders, magnitude_shares
from jaxnet.model import graph
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.retained import DropPolicy
from jaxnet.model.safety import percolate, stay_joined
from jaxnet.model.signal import ORDERS
from jaxnet.theory.response import LawGain

Gains = Float[np.ndarray, " m"]
GAIN_TOLERANCE = 1e-12  # relative; a smaller improvement ends the iteration
# of the greatest gain; smaller gains, far from every attack, are not improved
LEAST_GAIN_SHARE = 1e-15
LEAST_NORMAL = float(np.finfo(float).tiny)  # smaller numbers have no relative precision


class AttackGain(NamedTuple):
    """Gains from attacks to the errors of a network's vehicles, each the greatest of all sets."""

    gains: Gains  # γ
    fleet: float  # ‖γ‖₂
    # weights in force for good; None where retained neighbours, or attacks, may jump
    fixed: Digraph | None
    norms: float  # `‖L⁻¹‖₂ ‖W_a 1‖₂` of the fixed weights; not-a-number without, or if too large
    orders: tuple[int, ...] = ORDERS  # of the received derivatives that attacks falsify
    shares: tuple[float, ...] | None = None  # of ā, the magnitudes of these orders; None: each is ā

    def disturbance(self, gain: LawGain) -> float:
        """`β`: the greatest ρ, per ā, of attacks on the falsified orders."""
        return float(self.factors(gain).sum())

    def factors(self, gain: LawGain) -> Float[np.ndarray, " orders"]:
        """Factors in R of the falsified orders, each times its share of ā."""
        factors = np.append(gain, 1.0)[list(self.orders)]
        return factors if self.shares is None else factors * self.shares


def attack_gain(
    retained: DropPolicy,
    sets: Sequence[tuple[Links, Links]],
    smooth: bool = True,
    orders: tuple[int, ...] = ORDERS,
    shares: tuple[float, ...] | None = None,
) -> AttackGain:
    """Gains for attacks on any one of some sets of links.

    A set is the attacked links, and the links that transmit their source's signal: the same links
    in all sets if attacks are `smooth`, paths with their derivatives. `orders` are the derivatives
    that the attacks falsify, and `shares` their magnitudes per ā if these differ.
    """
    fixed = retained.fixed if smooth else None
    if fixed is None or graph.unreachable(fixed):
        each = np.array([worst_gains(retained, *links) for links in sets])
        norms = np.nan if fixed is None else np.inf
    else:
        word = fixed.only(sets[0][1])
        added = np.array([fixed.only(attacked).weights.sum(axis=1) for attacked, _ in sets])
        each = graph.solver(word)(added.T).T
        inverse = graph.inverse_norm(word) if fixed.vehicles <= MOST_INVERTED else np.nan
        norms = float(inverse * np.linalg.norm(added, axis=1).max())
    fleet = float(np.linalg.norm(each, axis=1).max())
    return AttackGain(each.max(axis=0), fleet, fixed, norms, orders, shares)


def disconnected_vehicles(retained: DropPolicy) -> Bool[np.ndarray, " m"]:
    """Vehicles that the navigator may not reach, and those that may keep a path from them."""
    network, links, number = retained
    cut = ~stay_joined(retained, np.ones(network.vehicles, bool))
    may_keep = network.only(~(links & (number == links.sum(axis=1))[:, None]))
    one, each = np.ones(network.vehicles, int), np.ones(links.shape, int)
    return percolate(may_keep, each, one, np.append(False, cut))[1:]


def worst_gains(retained: DropPolicy, attacked: Links, carried: Links) -> Gains:
    """`γ` by policy iteration; infinite where some choice disconnects a vehicle.

    `carried` are the links that transmit the signal of their source. The gains hold for every
    sequence of allowed retained neighbours. Source: Howard's policy iteration (Puterman, Markov
    Decision Processes, 1994, section 7.2). All remaining policies end at the navigator, so the
    values of all vehicles rise together and the last values are the greatest. The first policy uses
    the gains without dropped sources. From gains of 0 the iteration would extend by one vehicle a
    round.
    """
    joined = ~disconnected_vehicles(retained)
    given = *retained.graph, *retained[1:], attacked, carried
    sources, weights, links, number, attacked, carried = (each[joined] for each in given)

    def gains_of(kept: Float[np.ndarray, "some slots"]) -> Gains:
        weights, added = np.zeros(retained.graph.weights.shape), np.zeros(len(joined))
        weights[joined] = kept * carried
        added[joined] = (kept * attacked).sum(axis=1)
        return graph.solver(retained.graph._replace(weights=weights))(added)

    gains, better = np.zeros(len(joined)), gains_of(weights)
    while True:
        reward = attacked + carried * np.append(0.0, better)[sources]
        better = gains_of(worst_kept_weights(weights, reward, links, number))
        enough = np.maximum(gains * (1 + GAIN_TOLERANCE), LEAST_GAIN_SHARE * better.max())
        if (better <= enough).all():
            return np.where(joined, better, np.inf)
        gains = better


def worst_kept_weights(
    weights: Float[np.ndarray, "some slots"],
    reward: Float[np.ndarray, "some slots"],
    links: Bool[np.ndarray, "some slots"],
    number: Int[np.ndarray, " some"],
) -> Float[np.ndarray, "some slots"]:
    """Weights in force that maximise `Σ w r / Σ w` over kept sources; `number` links are dropped.

    At a ratio λ the best choice drops the sources with the least w (r - λ). The ratio of that
    choice is the next λ, until the ratio no longer rises (Dinkelbach, 1967).
    """
    ratio = np.zeros(len(weights))
    while True:
        merit = np.where(links, weights * (reward - ratio[:, None]), np.inf)
        dropped = merit.argsort(axis=1).argsort(axis=1) < number[:, None]
        kept = np.where(dropped, 0.0, weights)
        kept = kept / kept.sum(axis=1, keepdims=True)
        better = (kept * reward).sum(axis=1)
        if (better <= ratio * (1 + GAIN_TOLERANCE) + LEAST_NORMAL).all():
            return kept
        ratio = better


@for_any_signal
def bounded_vehicles(scenario: Scenario) -> Bool[np.ndarray, " m"] | None:
    """Vehicles whose `scenario_gain` is finite; None without the premises of BOUNDS."""
    if missing(scenario, BOUNDS):
        return None
    retained = situation_of(scenario).retained
    assert retained is not None
    return ~disconnected_vehicles(retained)


@for_any_signal
def scenario_gain(scenario: Scenario) -> AttackGain | None:
    """Gains γ of a scenario's network, by which bounds multiply ā.

    None without the premises of BOUNDS. If the attacked vehicles are drawn, the gains are the
    greatest of all sets. For too many sets they are those of an attack on all vehicles.
    """
    if missing(scenario, BOUNDS):
        return None
    known = situation_of(scenario)
    assert known.retained is not None
    attack, order = scenario.attack, scenario.vehicle.order
    draws = attacked_draws(scenario, known.graph) or [known.attacked]
    sets = [(links, ~(links & attack.replaces())) for links in draws]
    orders, shares = tuple(heard_orders(attack, order)), magnitude_shares(attack, order)
    jumps = attack.strategic or attack.splits() or bool(attack.periods())
    smooth = attack.consistent() and not jumps
    return attack_gain(known.retained, sets, smooth, orders, shares)
