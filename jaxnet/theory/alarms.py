"""What a cell's detector does: runs to alarms, unseen lies and their effect (theorems.md O19)."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm

from jaxnet.kinds.detectors import AlarmRule
from jaxnet.kinds.fields import is_drawn
from jaxnet.kinds.ticks import JET_ORDERS
from jaxnet.model import graph
from jaxnet.model.axis import companion
from jaxnet.model.graph import Links
from jaxnet.theory.case import Case
from jaxnet.theory.response import DECAYED, LawGain
from jaxnet.theory.run_lengths import MeanRun, Unseen, mean_run, unseen

MOST_TICKS = 100_000  # in which a law forgets a held drive


def deviations(case: Case) -> list[float]:
    """Standard deviation of what a vehicle tells, by order below the vehicles'."""
    scenario = case.scenario
    sizes = [errors.white() or {} for errors in (scenario.sensing, scenario.channel.noise)]
    orders = JET_ORDERS[: scenario.vehicle.order]
    return [math.hypot(*(each.get(order, 0.0) for each in sizes)) for order in orders]


def tested(case: Case) -> tuple[AlarmRule | None, int]:
    """The rule of a link from a vehicle, and the number of orders with errors."""
    detector, orders = case.scenario.detector, sum(size > 0 for size in deviations(case))
    return (detector.rule(orders) if orders and not detector.drawn_keys() else None), orders


class AlarmRuns(NamedTuple):
    """Mean runs to the first alarm, in ticks."""

    link: MeanRun  # a false one about a link
    number: int  # of honest links, or of honest vehicles if all who hear one share its errors
    of: str  # link or vehicle
    fleet: MeanRun | None  # a false one about any of these; None where their errors depend
    lie: MeanRun | None  # one about a steady lie of ā in positions
    along: bool  # whether that lie is along the direction of the test


def alarm_runs(case: Case) -> AlarmRuns | None:
    """Runs of independent normal residuals; None for a detector of which no run is known."""
    scenario, (rule, orders) = case.scenario, tested(case)
    link = rule and mean_run(rule, orders)
    if rule is None or link is None:
        return None
    attack, position = scenario.attack, deviations(case)[0]
    given, lie = attack.amplitude(), None
    sized = attack.present and not is_drawn(given) and given > 0
    if sized and 0 in attack.falsified() and position:
        lie = mean_run(rule, orders, given / position)
    number, of = independent(case)
    fleet = mean_run(rule, orders, links=number) if number else None
    return AlarmRuns(link, number, of, fleet, lie, not rule.squared)


def independent(case: Case) -> tuple[int, str]:
    """The most honest links, or vehicles, whose residuals are independent; 0 if none are."""
    network, attacked, *_ = case.situation
    sensing, noise = case.scenario.sensing, case.scenario.channel.noise
    of_links = not noise.exact() and noise.of == "link"
    if of_links and not sensing.exact():
        return 0, "link"
    attack, sets = case.scenario.attack, case.draws or [attacked]
    if attack.bounded and attack.amplitude() == 0:
        sets = [np.zeros_like(attacked)]
    honest = [network.sources[network.heard & ~links] for links in sets]
    if of_links:
        return max(map(len, honest)), "link"
    return max(len(np.unique(each[each > 0])) for each in honest), "vehicle"


class UnseenLie(NamedTuple):
    """Lies about positions on a link that raise no alarm."""

    first: float  # [m], the greatest at one tick
    steady: float  # [m], the greatest at all ticks after it


def unseen_bound(case: Case) -> Unseen | None:
    """Rate and burst of unseen lies by vehicles, in squared deviations."""
    attacked = case.situation.attacked
    rule, _ = tested(case)
    of_vehicles = attacked.any() and (case.situation.graph.sources[attacked] > 0).all()
    return unseen(rule) if rule and of_vehicles and deviations(case)[0] else None


def unseen_lie(case: Case) -> UnseenLie | None:
    found = unseen_bound(case)
    if found is None:
        return None
    position = deviations(case)[0]
    first, steady = position * np.sqrt([found.first, found.rate])
    return UnseenLie(float(first), float(steady))


class UnseenEffect(NamedTuple):
    """What unseen lies of positions do to a vehicle's error, beside the effect of errors [m]."""

    steady: float  # of the greatest steady lie in phase, which attains it
    most: float  # no lie that is held from tick to tick does more


def unseen_effect(case: Case) -> UnseenEffect | None:
    """Effect on the vehicle that is moved farthest.

    With `s = L⁻¹ W_a 1` and `g_k` the effect of a held drive of one tick after k ticks, made not
    increasing, `(Σ g_k √z_k)² ≤ Σ g_k · Σ g_k z_k ≤ G (G rate + g_0 burst)`.
    """
    found, network = unseen_bound(case), case.situation.graph
    if found is None or case.draws is None or graph.unreachable(network):
        return None
    first, total = held_effect(case.gain, case.scenario.tick) or (np.nan, np.nan)
    slope = max(static_slope(case, links) for links in case.draws) * deviations(case)[0]
    most = np.sqrt(total * (total * found.rate + first * found.burst))
    return UnseenEffect(float(slope * np.sqrt(found.rate)), float(slope * most))


def static_slope(case: Case, attacked: Links) -> float:
    """Greatest of `L⁻¹ W_a 1`."""
    network = case.situation.graph
    return float(graph.solver(network)(network.only(attacked).weights.sum(axis=1)).max())


def held_effect(gain: LawGain, interval: float) -> tuple[float, float] | None:
    """The first, and the sum, of the effects on E of a held lie of 1 m, one for each later tick.

    They are made not increasing: each is the greatest from its tick on. None for very slow laws.
    """
    order = len(gain)
    rate = -np.roots([1.0, *gain[::-1]]).real.max()
    ticks = int(np.ceil(DECAYED / rate / interval))
    if ticks > MOST_TICKS:
        return None
    motion = np.zeros((order + 1, order + 1))
    motion[:order, :order] = companion(gain)
    motion[order - 1, order] = gain[0]
    flow = expm(motion * interval)
    state, effects = flow[:order, order], np.empty(ticks)
    for tick in range(ticks):
        effects[tick], state = abs(state[0]), flow[:order, :order] @ state
    falling: Float[np.ndarray, " ticks"] = np.maximum.accumulate(effects[::-1])
    return float(falling[-1]), float(falling.sum())
