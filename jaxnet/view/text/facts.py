"""What is known of a cell before anything moves, in words: one line for each fact."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import MOST_DRAWN_SETS, MOTION, missing, premise_words
from jaxnet.kinds.fields import EachOrder, is_drawn, value_range
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.model.graph import unreachable
from jaxnet.model.safety import Vehicles
from jaxnet.model.wording import count, plural_s, ranges
from jaxnet.theory import integer
from jaxnet.theory.announced import Ultimate
from jaxnet.theory.case import Case
from jaxnet.theory.certificate import HonestPaths, JointReach
from jaxnet.theory.exact import Decay
from jaxnet.theory.integer import RobustnessBracket
from jaxnet.theory.rounds import MeanSquare, Stability
from jaxnet.theory.safe import MOST_TRIED, Margin, SafeVehicles
from jaxnet.theory.theorems import OF_LAWS, values
from jaxnet.theory.tolerance import Led, VehiclesAlone

ORDER_UNITS = ("m", "m/s", "m/s²", "m/s³")
ORDER_NAMES = ("position", "velocity", "acceleration", "jerk")
MOST_NAMED_VEHICLES = 60
MOST_NAMED_SETS = 12
DIED_AWAY = 1e-3  # of ‖η(0)‖: less is millimetres of a fleet that starts metres away
NOT_TRIED = f"more than {MOST_DRAWN_SETS:,} sets of vehicles may be drawn, and are not tried"
NOT_ROBUST = "not 1-robust, so not enough for W-MSR"
ONE_LIVE_NETWORK = {"one network", "on time", "every message"}

Facts = dict[str, str]


def facts(scenario: Scenario, seconds: float = 0.0) -> Facts:
    """Facts of a scenario by name; `seconds` is the time for searches over sets of vehicles."""
    case = Case(scenario, seconds)
    found = values(case)
    told = {name: PHRASES[name](value, scenario) for name, value in found.items()}
    graph, _, trusted, _ = case.situation
    lines = {
        "graph": graph_line(case),
        "names": names_line(scenario),
        "‖L⁻¹‖₂": told.get("inverse norm", ""),
        "robustness": robustness_line(case),
        "alone": alone_line(case, told),
        "led": told.get("led", ""),
        "navigator": navigator_line(scenario),
        "attack": attack_line(case),
        "Assumption 1": told.get("honest paths", ""),
        **scenario.defence.describe(graph, at_once(case), trusted),
        "guarantee": f"{scenario.defence.kind}: {scenario.defence.promise()}",
        "cut off": told.get("cut off", ""),
        **world_lines(scenario, told),
        "law": law_line(scenario, told),
        "safe": safe_line(scenario, told),
        **announced_lines(scenario, found, told),
        "proof ends": told.get("proof ends", ""),
        **drawn_lines(scenario),
        "decay": told.get("decay", ""),
    }
    return {name: line for name, line in lines.items() if line}


def graph_line(case: Case) -> str:
    heard = case.situation.graph.heard.sum(axis=1)
    who = {int(n): ranges((np.flatnonzero(heard == n) + 1).tolist()) for n in np.unique(heard)}
    hears = [f"{i} hear{plural_s(i)} {count(n, 'source')}" for n, i in who.items()]
    size = f"{count(case.scenario.vehicles, 'vehicle')}, {count(int(heard.sum()), 'link')}"
    return f"{size}: {'; '.join(hears)}"


def names_line(scenario: Scenario) -> str:
    names = [f"{number} {name}" for number, name in enumerate(scenario.topology.vehicle_names(), 1)]
    more = f", … ({len(names)} vehicles)" if len(names) > MOST_NAMED_VEHICLES else ""
    return ", ".join(names[:MOST_NAMED_VEHICLES]) + more


def navigator_line(scenario: Scenario) -> str:
    if not scenario.navigator.present:
        return (
            "none: rows measure the spread of the vehicles that are not attacked, and their way out"
            " of the hull of their starts"
        )
    slowest, when = scenario.navigator.slowest(scenario.horizon)
    return f"never slower than {slowest:.4g} m/s (t = {when:.4g} s)"


def robustness_line(case: Case) -> str:
    """Robustness with the navigator, which hears nobody, and what W-MSR needs."""
    if not case.scenario.navigator.present:
        return ""
    exactly = "exactly 1-robust with the navigator, as every graph that it reaches"
    if unreachable(case.situation.graph):
        exactly = "not 1-robust with the navigator, which does not reach every vehicle"
    needs = "3-robustness against F-local attackers, (2, 2)-robustness against F-total attackers"
    return f"{exactly}, while W-MSR with F = 1 asks for {needs}"


def alone_line(case: Case, told: Facts) -> str:
    if case.seconds > 0 and case.scenario.vehicles > integer.MOST_PROGRAMMED:
        return f"not examined: the vehicles are more than {integer.MOST_PROGRAMMED}"
    return told.get("alone", "")


def alone_words(found: VehiclesAlone, scenario: Scenario) -> str:
    """Robustness of the vehicles without the navigator, and the attackers that W-MSR tolerates."""
    r, local, total = found.r, found.local, found.total
    if r.high == 0:
        return NOT_ROBUST
    line = f"{r.high}-robust"
    if found.pairs is not None:
        line = ", ".join(f"({r}, {s})" for r, s in enumerate(found.pairs, 1)) + "-robust"
    elif not r.known:
        line = f"r-robust, with the greatest r between {r.low} and {r.high}"
    if r.low == 0:
        return f"{line}, so nothing is proved of W-MSR"
    if local.low == total.low == 0:
        if local.known and total.known:
            return f"{line}, enough for W-MSR only without attackers"
        return f"{line}, enough for W-MSR without attackers; with attackers it is not known"
    ends = f"F-local attackers up to {at_least(local)}, F-total up to {at_least(total)}"
    return f"{line}, enough for W-MSR with {ends}"


def at_least(found: RobustnessBracket) -> str:
    return f"{'' if found.known else 'at least '}F = {found.low}"


def led_words(found: Led, scenario: Scenario) -> str:
    line = f"by {ranges(found.leaders)}, whom somebody trusts, strongly {found.strongly}-robust,"
    return f"{line} and percolation with F = 1 reaches {ranges(found.reached) or 'nobody else'}"


def attack_line(case: Case) -> str:
    """The attack, the attacked vehicles and links, and how it differs from the paper's."""
    scenario, (graph, attacked, *_) = case.scenario, case.situation
    attack = scenario.attack
    if not attack.present:
        return "none"
    who = f"{attack.describe()} on {attack.whom()}"
    if not attacked.any():
        return f"{who}, heard by nobody"
    of_navigator = (graph.sources[attacked] == 0).any()
    how = "in what they hear of the navigator" if of_navigator else "in what they transmit"
    instead = ", in place of what is sent" if attack.replaces() else ""
    instead += ", and they move as they tell" if attack.as_told() else ""
    among = "" if attack.targets() else " of all that may be drawn"
    among = " of all that are ever attacked" if attack.periods() else among
    links = count(int(attacked.sum()), "link")
    return f"{who} {how}{instead}, {links}{among}{orders_text(scenario)}{change_text(scenario)}"


def orders_text(scenario: Scenario) -> str:
    """Attacks that are unbounded, or whose signals are inconsistent between derivatives."""
    attack = scenario.attack
    if not attack.bounded:
        return "; not bounded by ā, so no bound says anything"
    if attack.consistent():
        return ""
    sizes = attack.by_order() or [1.0] * len(ORDER_NAMES)
    falsified = [order for order in attack.falsified() if sum(sizes[order : order + 1])]
    which = ", ".join(ORDER_NAMES[order] for order in falsified)
    return f"; {which} falsified each on its own, so the static bound says nothing"


def change_text(scenario: Scenario) -> str:
    """What a change of the attacked vehicles means for bounds and for the tail."""
    periods = scenario.attack.periods()
    if not periods:
        return ""
    last = max(time for time, _ in periods if time < scenario.horizon)
    settled = scenario.horizon - scenario.tail - last
    tail = f"begins {settled:g} s after the last change"
    tail = tail if settled > 0 else "has the last change in it"
    return f"; bounds and safety are of all that are ever attacked, and the tail {tail}"


def at_once(case: Case) -> np.ndarray:
    """Of the links that may be attacked, as many of each listener as one lane attacks."""
    attacked, attack = case.situation.attacked, case.scenario.attack
    return attacked if attack.targets() else attacked & (attacked.cumsum(axis=1) <= attack.number())


def path_words(found: HonestPaths, scenario: Scenario) -> str:
    """Whether the paper's Assumption 1 holds."""
    if found.cut_off == []:
        return "holds: an honest path from the navigator to every vehicle"
    if found.cut_off is None:
        return (
            f"not known where {ranges(found.perhaps)} have no path but through others: {NOT_TRIED}"
        )
    line = f"broken: no honest path from the navigator to {ranges(found.cut_off)}"
    if found.cut_off != found.perhaps or not found.all_attacked:
        return line
    lonely = ranges(found.all_attacked)
    return f"{line}; {lonely} hear{plural_s(lonely)} nobody honest"


def world_lines(scenario: Scenario, told: Facts) -> Facts:
    """What no bound covers: networks in turn, errors of sensors and messages, loss and delay."""
    channel, turns, lines = scenario.channel, len(scenario.topology.turns()), {}
    if turns > 1:
        union = "the lines above hold for the union, not for a network alone"
        lines["networks"] = f"{count(turns, 'network')} take turns; {union}"
        lines["networks"] += "; no bound holds" + told.get("reach", "") + told.get("nominal", "")
    if not scenario.sensing.exact():
        lines["sensing"] = f"{scenario.sensing.kind}: vehicles sense with errors; no bound holds"
        lines["sensing"] += told.get("sensors leave", "")
    if not channel.loss.perfect():
        lines["channel"] = f"loss {channel.loss.kind}: messages are lost; no bound holds"
        lines["channel"] += told.get("in mean square", "") + told.get("while reached", "")
    if not channel.noise.exact():
        lines["noise"] = f"{channel.noise.kind}: words arrive with errors; no bound holds"
        lines["noise"] += told.get("messages leave", "")
    if channel.rounded:
        lines["rounding"] = "jets in words are rounded; no bound holds" + rounding_text(scenario)
    if channel.late:
        lines["delay"] = f"words are {lateness_text(scenario)} late; no bound holds"
        lines["delay"] += "".join(told.get(each, "") for each in OF_DELAYS)
    return lines


OF_DELAYS = ("lag", "follows lines", "greatest delay", "growth when late")


def rounding_text(scenario: Scenario) -> str:
    """By how much rounded messages err at most."""
    steps = scenario.channel.quantisation
    if isinstance(steps, EachOrder):
        sizes = zip(steps.root, ORDER_UNITS, strict=False)
        told = " and ".join(f"{step / 2:g} {unit}" for step, unit in sizes)
    else:
        told = f"{value_range(steps)[1] / 2:g}"
    where = "on each axis, on every link and in every order told"
    return f"; they act like an attack of at most {told} {where}"


def lateness_text(scenario: Scenario) -> str:
    low, high = value_range(scenario.channel.delay)
    if not is_drawn(scenario.channel.delay):
        return f"{low:g} s"
    return f"{low:g} to {high:g} s, drawn for each {scenario.channel.delay_of},"


def reach_words(found: JointReach, scenario: Scenario) -> str:
    union, always = (vehicles_named(each, scenario) for each in (found.union, found.always))
    return f"; the navigator reaches {union} in the union and {always} in each of them"


def nominal_words(found: list[int], scenario: Scenario) -> str:
    rest = "" if len(found) == scenario.vehicles else ", of others nothing is known"
    rest += ", while decisions cut nobody off" * scenario.defence.decides
    named = vehicles_named(found, scenario)
    return f"; without attack, errors, loss and delay O1 holds of {named}{rest}"


def vehicles_named(numbers: Sequence[int], scenario: Scenario) -> str:
    return "every vehicle" if len(numbers) == scenario.vehicles else ranges(numbers) or "nobody"


def mean_square_words(found: MeanSquare, scenario: Scenario) -> str:
    told = f"; {stable(found.growth < 1)} in mean square, deviations times {found.growth:.4f}"
    up_to = f"; stable up to a loss of {found.critical:.4f}" if found.critical else ""
    return f"{told} at each tick{up_to}"


def stable(is_stable: bool) -> str:
    return "stable" if is_stable else "UNSTABLE"


def rms_words(each: np.ndarray, scenario: Scenario) -> str:
    who = f", the most of {int(each.argmax()) + 1}" if np.ptp(each) > 1e-9 * each.max() else ""
    return f"; without attack they leave {each.max():.4g} m rms on each axis at last{who}"


def lag_words(ends: np.ndarray, scenario: Scenario) -> str:
    between = f"{ends.min():.4g} to " if np.ptp(ends) > 1e-9 * ends.max() else ""
    return f"; behind a navigator on a line vehicles end late by {between}{ends.max():.4g} s"


def greatest_delay_words(margin: float, scenario: Scenario) -> str:
    state = "a necessary condition of stability holds"
    state = "unstable" if margin < scenario.channel.delay else state
    return f"; {state}: the delay must be below {margin:.6g} s"


def late_growth_words(grown: float, scenario: Scenario) -> str:
    tick = f"at each tick of {scenario.tick:g} s"
    return f"; {stable(grown < 1)}, deviations times {grown:.6f} {tick}"


def law_line(scenario: Scenario, told: Facts) -> str:
    """Stability of a law that is not solved at every instant, or why it is not known."""
    broken = missing(scenario, OF_LAWS)
    if scenario.law.solves() or {*broken} & ONE_LIVE_NETWORK:
        return ""
    if "stability" in told:
        return told["stability"]
    why = ": " + premise_words(scenario, broken[0]) if broken else ""
    return f"{scenario.law.kind}: nothing is known of its stability{why}"


def stability_words(found: Stability, scenario: Scenario) -> str:
    line = f"{stable(found.stable)}, deviations "
    if found.tick is None:
        line += f"behave as exp({found.growth:.4f} t) at last"
    else:
        line += f"times {found.growth:.4f} at each tick of {found.tick:g} s"
    if found.jacobi:
        line += f"; {rounds_words(found.least)}"
    if found.without_attack:
        line += "; that is without the attack, which replaces what vehicles send"
    return line + "; that is while everybody is retained" * found.while_retained


def rounds_words(least: tuple[int, int] | None) -> str:
    if least is None:
        return "no number of rounds is stable at this tick"
    few, surely = least
    line = f"{count(few, 'round')} {'is' if few == 1 else 'are'} the least that is stable"
    return line + f", and every number from {surely} on" * (surely > few)


def safe_line(scenario: Scenario, told: Facts) -> str:
    why = (premise_words(scenario, each) for each in missing(scenario, ("leader", *MOTION)))
    return told.get("safe") or f"nothing is proved; {'; '.join(why)}"


def safe_words(found: SafeVehicles, scenario: Scenario) -> str:
    """The safe vehicles, each with the strongest reason, or the weakest of all draws."""
    words, left = [], np.ones(scenario.vehicles, bool)
    for why, vehicles, *_ in found.reasons:
        words += [f"{flagged(vehicles & left)} {why}"] if (vehicles & left).any() else []
        left &= ~vehicles
    known = "; ".join(words) + ", whichever vehicles are drawn" * (found.drawn and bool(words))
    whose = "not known in every lane of" if found.drawn else "not known of"
    unknown = f"{whose} {ranges(vehicle_numbers(left))}" if left.any() else ""
    return "; ".join(filter(None, [known, unknown, "" if found.tried else NOT_TRIED]))


def flagged(vehicles: Vehicles) -> str:
    return "every vehicle" if vehicles.all() else ranges(vehicle_numbers(vehicles))


def announced_lines(scenario: Scenario, found: dict[str, Any], told: Facts) -> Facts:
    """The premise of safety by announcements, B1, and the bound of theorem 3."""
    known = found.get("safe")
    announced = scenario.defence.announcing() and scenario.attack.present
    if known is None or not known.tried or not announced:
        return {}
    if missing(scenario, ("consistent",)):
        why = premise_words(scenario, "consistent")
        return {"B1": f"broken: {why}; nobody is safe by majority"}
    consistent = "assumed: attacked links announce what they carry (announces: consistent)"
    return {"B1": consistent, "theorem 3": told.get("ultimate error", "")}


def ultimate_words(found: Ultimate, scenario: Scenario) -> str:
    told = f" = {found.slope:.3g} ā"
    if np.isnan(found.slope):
        told = ", of which Λ is not known here"
    elif found.rounding:
        rest = (
            f" + {found.rounding:.3g} m"
            if np.isfinite(found.rounding)
            else " and what the tolerance leaves"
        )
        told += rest
    premise = "as long as no vehicle stands still and nobody is cut off, outside the set either"
    return f"‖E‖ ends within ‖h‖₁ γ Λ h{told}; {premise}"


def margin_words(found: Margin, scenario: Scenario) -> str:
    """The attacked sets, and the numbers of further attackers, that leave no proof."""
    by: dict[str, list[int]] = {}
    for number, sets in enumerate(found.sets, 1):
        if any(sets):
            by.setdefault(" or ".join(map(set_words, sets)), []).append(number)
    words = [f"for {ranges(those)} with {sets} alone" for sets, those in by.items()]
    for more in np.unique(found.further[found.further > 0]).tolist():
        far = f"no {MOST_TRIED}" if more > MOST_TRIED else str(more)
        words.append(f"for {flagged(found.further == more)} with {far} more")
    return "; ".join([*words[:MOST_NAMED_SETS], *["…"] * (len(words) > MOST_NAMED_SETS)])


def set_words(vehicles: Sequence[int]) -> str:
    words = ", ".join(map(str, vehicles))
    return f"{{{words}}}" if len(vehicles) > 1 else words


def drawn_lines(scenario: Scenario) -> Facts:
    lines = {}
    if scenario.topology.differs():
        lines["weights"] = "drawn for each lane; what is said is of their medians"
    if scenario.draws_gain:
        told = (
            "stable whatever is drawn"
            if scenario.law.solves()
            else "what is said is of their medians"
        )
        lines["gain"] = f"drawn for each lane; {told}"
    return lines


def decay_words(found: Decay, scenario: Scenario) -> str:
    """The paper's Lemma 1 with its constants."""
    line = f"‖η(t)‖ ≤ {found.factor:.3g} exp(-{found.rate:.3g} t) ‖η(0)‖ (Lemma 1)"
    if found.norms:
        least, most = min(found.norms), max(found.norms)
        line += f"; ‖h_i‖₁ of the vehicles from {least:.3g} to {most:.3g}"
    else:
        line += ", η = (E, Ė, …)" + ", while nobody is cut off" * (not found.joined)
    if found.left <= DIED_AWAY:
        return line
    left = f"up to {found.left:.2g} ‖η(0)‖ when the tail begins, at {found.begins:g} s"
    return f"{line}; the start has not died away: {left}"


# What a theorem's value says, by its quantity.
PHRASES: dict[str, Callable[[Any, Scenario], str]] = {
    "inverse norm": lambda norm, scenario: f"{norm:.4g}",
    "honest paths": path_words,
    "cut off": lambda lost, scenario: f"{ranges(lost)} may be, by whom they drop",
    "reach": reach_words,
    "nominal": nominal_words,
    "alone": alone_words,
    "led": led_words,
    "sensors leave": rms_words,
    "messages leave": rms_words,
    "stability": stability_words,
    "in mean square": mean_square_words,
    "while reached": lambda is_so, scenario: (
        "; without attack and errors O1 holds while the navigator reaches every vehicle at each"
        " tick"
    ),
    "lag": lag_words,
    "follows lines": lambda is_so, scenario: "; a navigator on a line is followed without error",
    "greatest delay": greatest_delay_words,
    "growth when late": late_growth_words,
    "safe": safe_words,
    "proof ends": margin_words,
    "ultimate error": ultimate_words,
    "decay": decay_words,
}
