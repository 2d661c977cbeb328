"""What is known of a cell before anything moves, in words: one line for each fact."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxnet.config.keys import Scenario
from jaxnet.config.naming import value_name, words_of_kind
from jaxnet.config.scenario import (
    BOUNDS,
    MOST_DRAWN_SETS,
    MOTION,
    missing,
    premise_words,
    situation_of,
    too_many_sets,
)
from jaxnet.kinds.fields import EachOrder, is_drawn, value_range
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.model.graph import Digraph, Links, unreachable
from jaxnet.model.safety import Vehicles
from jaxnet.model.wording import count, number_text, orders_in_words, plural_s, ranges
from jaxnet.theory.alarms import AlarmRuns, UnseenEffect, UnseenLie, deviations, tested
from jaxnet.theory.announced import Ultimate
from jaxnet.theory.case import Case
from jaxnet.theory.certificate import CutReach, HonestPaths
from jaxnet.theory.clipping import Unclipped
from jaxnet.theory.integer import RobustnessBracket
from jaxnet.theory.misjudged import Misjudged
from jaxnet.theory.rounds import Stability
from jaxnet.theory.run_lengths import MeanRun
from jaxnet.theory.safe import MOST_TRIED, Margin, SafeVehicles
from jaxnet.theory.solution import Decay
from jaxnet.theory.start import KeepsMoving, Start
from jaxnet.theory.theorems import OF_ALARMS, OF_LAWS, OF_SEPARATION, values
from jaxnet.theory.tolerance import Agreement, VehiclesAlone

ORDER_NAMES = ("position", "velocity", "acceleration", "jerk")
MOST_NAMED_VEHICLES = 60
MOST_NAMED_SETS = 12
NOT_TRIED = f"more than {MOST_DRAWN_SETS:,} sets of vehicles may be drawn, and are not tried"
ONE_LIVE_NETWORK = {"one network", "on time", "every message", "uncut"}
OF_NETWORKS, OF_SENSORS, OF_NOISE = ("reach", "nominal"), ("sensors leave",), ("messages leave",)
OF_LOSSES = ("in mean square", "while reached")
OF_DELAYS = ("lag", "follows lines", "greatest delay", "growth when late", "common margin")

UNSTABLE = "UNSTABLE"

UNPROVED = "none is proved; "
Facts = dict[str, str]


def facts(scenario: Scenario, seconds: float = 0.0) -> Facts:
    """Facts of a scenario by name; `seconds` is the time for searches over sets of vehicles."""
    case = Case(scenario, seconds)
    return lines_of(case, values(case))


def lines_of(case: Case, found: dict[str, Any]) -> Facts:
    """What theorems tell of a case, and what its kinds say of themselves."""
    scenario = case.scenario
    told = {name: PHRASES[name](value, scenario) for name, value in found.items()}
    attack, defence = scenario.attack, scenario.defence
    lines = {
        **network_lines(case, told),
        "attack": attack_line(case) if attack.present else "none",
        "Assumption 1": told.get("honest paths", ""),
        **defence_lines(scenario),
        "guarantee": told.get("agreement", defence.promise())
        + "; what alarms cut is not heard" * scenario.detector.acts,
        "misjudged": told.get("misjudged", ""),
        "cut off": told.get("cut off", ""),
        "apart": told.get("apart", why_not_apart(scenario)),
        "detector": detector_line(case, told) if scenario.detector.present else "",
        "alarms": told.get("runs", ""),
        "isolation": told.get("isolation", ""),
        "unseen": told.get("unseen lie", "") + told.get("unseen effect", ""),
        **world_lines(scenario, told),
        **motion_lines(scenario, found, told),
    }
    return {name: line for name, line in lines.items() if line}


def attacked_at_once(scenario: Scenario) -> tuple[Digraph, Links, Links]:
    """The graph, as many attacked links of each listener as one lane has, and trusted links."""
    graph, attacked, trusted, _ = situation_of(scenario)
    if not scenario.attack.targets():
        attacked = attacked & (attacked.cumsum(axis=1) <= scenario.attack.number())
    return graph, attacked, trusted


def dropping_all(scenario: Scenario) -> Vehicles:
    """Vehicles that drop all their sources, as their defence drops as many as they hear."""
    graph, _, trusted = attacked_at_once(scenario)
    heard, most = graph.heard.sum(axis=1), scenario.defence.tolerates() or 0
    drops = scenario.defence.may_drop(graph, trusted).links.sum(axis=1)
    return (heard > 0) & (heard <= most) & (heard == drops)


def cut_off_words(lost: list[int], scenario: Scenario) -> str:
    """The vehicles that are cut off in every run, and those that may be."""
    (graph, *_), silent = attacked_at_once(scenario), dropping_all(scenario)
    surely = unreachable(graph.only(graph.heard & ~silent[:, None])) if silent.any() else []
    maybe = [each for each in lost if each not in surely]
    told = {
        f"{ranges(surely)} drop all sources (F too great), or hear only vehicles that do": surely,
        f"{ranges(maybe)} may be cut off from the navigator, depending on values received": maybe,
    }
    return "; ".join(words for words, those in told.items() if those)


def defence_lines(scenario: Scenario) -> Facts:
    """What a defence says of itself; of attackers that are drawn, for the worst draw."""
    defence, given = scenario.defence, attacked_at_once(scenario)
    if scenario.topology.redrawn():
        return {}
    drawn = not scenario.attack.targets() and defence.outnumbered(*given).any()
    worst = "; each vehicle counts with its worst draw of attacked vehicles" * bool(drawn)
    lost = f"; {starved_words(scenario)}".removesuffix("; ")
    return {name: line + worst + lost for name, line in defence.describe(*given).items()}


def starved_words(scenario: Scenario) -> str:
    """How often lost messages, which nothing replaces, keep a vehicle from trimming, or ""."""
    (graph, _, trusted), loss = attacked_at_once(scenario), scenario.channel.loss
    if scenario.channel.missing != "drop" or loss.perfect():
        return ""
    share = None if len(scenario.topology.turns()) > 1 else loss.lost_apart()
    starved = scenario.defence.starved(graph, trusted, 0.5 if share is None else share)
    told = f"in up to {number_text(100 * starved, whole=100)} % of ticks a vehicle lacks messages"
    if share is None:
        told = "at some ticks a vehicle may lack messages"
    return f"{told} and cannot trim" * bool(starved)


def network_lines(case: Case, told: Facts) -> Facts:
    """The graph, the vehicles' names, robustness, and the navigator."""
    scenario, graph = case.scenario, case.situation.graph
    heard = graph.heard.sum(axis=1)
    who = {int(n): ranges((np.flatnonzero(heard == n) + 1).tolist()) for n in np.unique(heard)}
    hears = [f"{i} hear{plural_s(i)} {count(n, 'source')}" for n, i in who.items()]
    size = f"{count(scenario.vehicles, 'vehicle')}, {count(int(heard.sum()), 'link')}"
    names = [f"{number} {name}" for number, name in enumerate(scenario.topology.vehicle_names(), 1)]
    more = f", … ({len(names)} vehicles)" if len(names) > MOST_NAMED_VEHICLES else ""
    navigator = "none: rows measure the spread of honest vehicles, and how far one leaves"
    navigator += " the hull of their starts"
    if scenario.navigator.present:
        slowest, when = scenario.navigator.slowest(scenario.horizon)
        navigator = f"never slower than {slowest:.4g} m/s (t = {when:.4g} s)"
    links = f"{size}: {'; '.join(hears)}"
    if scenario.topology.redrawn():
        links = f"{count(scenario.vehicles, 'vehicle')}; each lane has links of its own"
    return {
        "graph": links,
        "names": ", ".join(names[:MOST_NAMED_VEHICLES]) + more,
        "‖L⁻¹‖₂": told.get("inverse norm", ""),
        "robustness": told.get("alone", ""),
        "navigator": navigator,
    }


def attack_line(case: Case) -> str:
    """The attack, the attacked vehicles and links, and how it differs from the paper's."""
    scenario, (graph, attacked, *_) = case.scenario, case.situation
    attack, periods = scenario.attack, scenario.attack.periods()
    line = f"{attack.describe()} on {attack.whom()}"
    if not attacked.any():
        return f"{line}, heard by nobody"
    of_navigator = (graph.sources[attacked] == 0).any()
    where = " in what they hear of the navigator" if of_navigator else " in what they transmit"
    line += " in place of their inputs" if attack.misuses() else where
    line += ", in place of what is sent" * attack.replaces()
    line += ", and they move as they tell" * attack.as_told()
    over = "over all times " if periods else "over all draws " * (not attack.targets())
    on = f"; {over}the attack is on {count(int(attacked.sum()), 'link')}"
    line += on * (not scenario.topology.redrawn())
    if not attack.bounded:
        line += "; ā does not bound the attack, so no bound on errors holds"
    elif not (attack.consistent() or attack.misuses()):
        sizes = attack.by_order() or [1.0] * len(ORDER_NAMES)
        orders = [order for order in attack.falsified() if sum(sizes[order : order + 1])]
        which = ", ".join(ORDER_NAMES[order] for order in orders)
        line += f"; each order is falsified on its own ({which}), so the static bound does not hold"
    if too_many_sets(scenario) and not missing(scenario, BOUNDS):
        line += f"; bounds take all vehicles as attacked at once: {NOT_TRIED}"
    if periods:
        last = max(time for time, _ in periods if time < scenario.horizon)
        settled = scenario.horizon - scenario.tail - last
        tail = f"begins {settled:g} s after the last change"
        tail = tail if settled > 0 else "has the last change in it"
        line += f"; bounds and safety count all vehicles that are ever attacked; the tail {tail}"
    return line


def threshold_words(case: Case) -> str:
    """When a detector raises an alarm, with the units of its statistic; "" if not known."""
    scenario = case.scenario
    rule, orders = (None, 0) if missing(scenario, ("white",)) else tested(case)
    if rule is None:
        return scenario.detector.limit_words()
    size, unit = "squared residual", "variances"
    if not rule.squared:
        size, unit = "residual along the direction", "standard deviations"
    if rule.drift is not None:
        size = f"sum of the {size} less {rule.drift:g} a message"
    elif rule.window > 1:
        size = f"sum of {rule.window} squared residuals"
    told = f"an alarm is raised by a {size} over {rule.limit:.4g} {unit}"
    if size == "squared residual" and orders == 1 and scenario.detector.predicts.exact:
        told += f", a position {rule.limit**0.5 * deviations(case)[0]:.4g} m off"
    return told


def detector_line(case: Case, told: Facts) -> str:
    """The test, its threshold, what starts add, and why nothing is known of its alarms."""
    scenario, detector = case.scenario, case.scenario.detector
    predicts, limit = detector.predicts, threshold_words(case)
    expected = "the true motion of the source (an ideal observer)"
    if not predicts.exact:
        expected = f"what {words_of_kind('detector.predicts', predicts.kind)} expects"
    line = f"{words_of_kind('detector', detector.kind)} against {expected}"
    line += f"; {limit}" * bool(limit)
    if detector.whitens and predicts.presumes:
        line += f"; false alarms are as rare as asked only while {predicts.presumes}"
    line += "; starts raise no alarm" if predicts.exact else told.get("start drive", "")
    if "runs" not in told:
        why = "; ".join(premise_words(scenario, each) for each in missing(scenario, OF_ALARMS))
        line += "; mean times to alarms are not known" + f": {why}" * bool(why)
    if scenario.leaderless and detector.acts:
        line += "; if cuts divide the fleet, each part agrees on a place of its own: no lane fails"
    return line


def world_lines(scenario: Scenario, told: Facts) -> Facts:
    """What no bound covers: networks in turn, errors of sensors and messages, loss and delay."""
    channel, turns = scenario.channel, len(scenario.topology.turns())
    sensing, loss, noise = scenario.sensing, channel.loss, channel.noise
    low, high = value_range(channel.delay)
    late = f"{low:g} s"
    if is_drawn(channel.delay):
        late = f"{low:g} to {high:g} s, drawn for each {channel.delay_of},"
    union = "other lines hold for the union of all networks, not for one network"
    lines = {  # whether it is so, in words, and the quantities of theorems that are told beside
        "networks": (turns > 1, f"{count(turns, 'network')} take turns; {union}", OF_NETWORKS),
        "sensing": (not sensing.exact(), f"{sensing.kind}: vehicles sense with errors", OF_SENSORS),
        "channel": (not loss.perfect(), f"loss {loss.kind}: messages are lost", OF_LOSSES),
        "noise": (not noise.exact(), f"{noise.kind}: messages arrive with errors", OF_NOISE),
        "rounding": (channel.rounded, "numbers in messages are rounded", ()),
        "delay": (channel.late, f"messages are {late} late", OF_DELAYS),
    }
    found = {
        name: f"{line}; no bound on errors holds" + "".join(told.get(each, "") for each in beside)
        for name, (is_so, line, beside) in lines.items()
        if is_so
    }
    if channel.rounded:
        steps = channel.quantisation
        size = f"{value_range(steps)[1] / 2:g}"
        if isinstance(steps, EachOrder):
            size = orders_in_words([step / 2 for step in steps.root])
        where = "on each axis, on every link and in every order transmitted"
        found["rounding"] += f"; rounding acts like an attack of at most {size} {where}"
    return found


def why_not_apart(scenario: Scenario) -> str:
    """What keeps a filter from a proved distance; "" without a filter."""
    if not scenario.filter.present:
        return ""
    unproved = (
        f"filter {scenario.filter.kind} proves no distance for {scenario.vehicle.kind} at this"
        " tick, gain and speed"
    )
    why = [premise_words(scenario, each) for each in missing(scenario, OF_SEPARATION)]
    return f"nothing is proved; {'; '.join(why or [unproved])}"


def motion_lines(scenario: Scenario, found: dict[str, Any], told: Facts) -> Facts:
    """Stability of the law, safe vehicles with what they presume, draws, and decay."""
    law, broken = told.get("stability", ""), missing(scenario, OF_LAWS)
    if {*broken} & ONE_LIVE_NETWORK:
        law = ""
    elif not law and not scenario.law.solves():
        why = ": " + premise_words(scenario, broken[0]) if broken else ""
        law = f"{scenario.law.kind}: nothing is known of its stability{why}"
    why = [f"; since {premise_words(scenario, each)}" for each in missing(scenario, MOTION)]
    unproved = f"nothing is proved{''.join(why)}" if why else ""
    safe, announced = told.get("safe") or unproved, {}
    if not scenario.navigator.present:  # nobody follows; `guarantee` tells of agreement
        safe = ""
    proved = "safe" in found and any(vehicles.any() for _, vehicles, *_ in found["safe"].reasons)
    announcing = scenario.defence.announcing() and scenario.attack.present
    if announcing and "safe" in found and found["safe"].tried:
        announced = {
            "B1": "assumed: attacked links announce what they carry (announces: consistent)",
            "theorem 3": told.get("ultimate error", ""),
        }
        if missing(scenario, ("consistent",)):
            broken_by = premise_words(scenario, "consistent")
            announced = {"B1": f"broken: {broken_by}; nobody is safe by majority"}
    medians = "this report uses their medians"
    gain = "stable whatever is drawn" if scenario.law.solves() else medians
    return {
        "law": law,
        "safe": safe,
        **announced,
        "proof ends": told.get("proof ends", "") if proved else "",  # where there is a proof
        "weights": f"drawn for each lane; {medians}" * bool(scenario.topology.drawn_keys()),
        "gain": f"drawn for each lane; {gain}" if scenario.draws_gain else "",
        "decay": told.get("decay", "") + ("; `start` is sharper" * ({"decay", "start"} <= {*told})),
        "start": told.get("start", ""),
        "at rest": told.get("keeps moving", ""),
        "limits": "; ".join(filter(None, map(told.get, ("never global", "unclipped")))),
    }


def alone_words(found: VehiclesAlone, scenario: Scenario) -> str:
    """Robustness of the vehicles without the navigator, and what W-MSR needs of it."""
    s, name = RobustnessBracket(*(each + 1 for each in found.total)), scenario.defence.kind
    one = "; with one navigator no graph is more than 1-robust" * scenario.navigator.present
    return (
        f"r = {between(found.r)}, s = {between(s)}; {value_name('defence', name)} bears F attackers"
        " among the sources of each vehicle (F-local) if the vehicles alone are r-robust with r ≥"
        f" 2F + 1, or F in all (F-total) if (s, s)-robust with s ≥ F + 1 (glossary.md){one}"
    )


def between(found: RobustnessBracket) -> str:
    return f"{found.low}" if found.known else f"{found.low} to {found.high}"


def agreement_words(found: Agreement, scenario: Scenario) -> str:
    if not found.proved:
        return f"{UNPROVED}{found.why}"
    box = "on each axis inside the range of their starts (this box is proved, not the hull)"
    return f"honest vehicles agree, {box}; {found.why}"


def norm_words(norm: float, scenario: Scenario) -> str:
    if not np.isfinite(norm):
        return f"{norm}; the navigator does not reach every vehicle"
    return (
        f"{norm:.4g}; ‖E‖ ≤ ‖L⁻¹‖₂ ‖d‖ under a steady attack while all sources are retained (d:"
        " weighted sums of the attacks on them)"
    )


def path_words(found: HonestPaths, scenario: Scenario) -> str:
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
    return f"{line}; {lonely} hear{plural_s(lonely)} no honest source"


def nominal_words(found: list[int], scenario: Scenario) -> str:
    rest = "" if len(found) == scenario.vehicles else ", of others nothing is known"
    rest += ", while decisions cut nobody off" * scenario.defence.decides
    named = vehicles_named(found, scenario)
    return f"; without attack, errors, loss and delay O1 holds of {named}{rest}"


def vehicles_named(numbers: Sequence[int], scenario: Scenario) -> str:
    return "every vehicle" if len(numbers) == scenario.vehicles else ranges(numbers) or "nobody"


def stable(is_stable: bool) -> str:
    return "stable" if is_stable else UNSTABLE


def rms_words(each: np.ndarray, scenario: Scenario) -> str:
    told = f"{each.max():.4g} m rms"
    if np.ptp(each) > 1e-9 * each.max():
        told = f"{each.min():.4g} to {told} (vehicle {int(each.argmax()) + 1})"
    return f"; without attack such errors leave {told} on each axis in the end"


def greatest_delay_words(margin: float, scenario: Scenario) -> str:
    state = "a necessary condition of stability holds"
    state = UNSTABLE if margin < scenario.channel.delay else state
    return f"; {state}: the delay must be below {margin:.6g} s"


def common_margin_words(margin: float, scenario: Scenario) -> str:
    if scenario.law.needs_ticks():
        return f"; with short ticks the delay must be below {margin:.6g} s"
    return f"; {stable(scenario.channel.delay < margin)}: the delay must be below {margin:.6g} s"


def stability_words(found: Stability, scenario: Scenario) -> str:
    line = f"{stable(found.stable)}, deviations "
    if found.tick is None:
        line += f"behave as exp({found.growth:.4f} t) in the end"
    else:
        line += f"times {found.growth:.4f} at each tick of {found.tick:g} s"
    if found.jacobi:
        few, surely = found.least or (0, 0)
        least = f"{count(few, 'round')} {'is' if few == 1 else 'are'} the least that is stable"
        least += f", and every number from {surely} on" * (surely > few)
        line += f"; {least if found.least else 'no number of rounds is stable at this tick'}"
    if found.without_attack:
        line += "; stability counts no attack: replaced messages may change it"
    elif scenario.attack.replaces():
        line += f"; stability takes the replaced messages of {scenario.attack.whom()} as fixed"
    return line + "; stability is known only while all sources are retained" * found.while_retained


def runs_words(found: AlarmRuns, scenario: Scenario) -> str:
    line = f"a false alarm about one link comes after {ticks_of(found.link, scenario)}"
    if found.fleet is not None:
        fleet = f"any of {count(found.number, f'honest {found.of}')}"
        line += f"; a false alarm about {fleet} comes after {ticks_of(found.fleet, scenario)}"
    if found.lie is not None:
        where = " along the direction" * found.along
        line += f"; an alarm about a steady lie of ā{where} comes after"
        line += f" {ticks_of(found.lie, scenario)}"
    return line


def ticks_of(run: MeanRun, scenario: Scenario) -> str:
    """A mean run in ticks and seconds, or its two ends."""
    ends = [run.least] if run.least == run.most else [*run]
    ticks, seconds = (
        " to ".join(
            f"{end * each:,.0f}" if 1e3 <= end * each < 1e9 else f"{end * each:.4g}" for end in ends
        )
        for each in (1.0, scenario.tick)
    )
    return f"{ticks} tick{'s' * (ticks != '1')} = {seconds} s in the mean"


def isolation_words(found: CutReach, scenario: Scenario) -> str:
    if found.lost is None:
        return f"not known: {NOT_TRIED}"
    kept = [i for i in range(1, scenario.vehicles + 1) if i not in found.lost]
    line = "if alarms cut all attacked links and no other, the navigator reaches"
    line += f" {vehicles_named(kept, scenario)}"
    if found.lost and scenario.law.couples() and not scenario.defence.coasts():
        who = "any of " * (len(found.lost) > 1) + ranges(found.lost)
        line += f"; a lane ends as disconnected once {who} is cut off"
        line += "; a defence with isolated: coast keeps such a lane"
    if found.wrong:
        other = " other" * bool(found.lost)
        line += f"; no{other} vehicle is cut off from the navigator by fewer than"
        line += f" {count(found.wrong, 'wrong cut')}"
        if found.whom != kept:
            line += f"; {count(found.wrong, 'wrong cut')} may cut off {ranges(found.whom)}"
    return line


def unseen_words(found: UnseenLie, scenario: Scenario) -> str:
    line = f"a liar that knows the errors may be {found.steady:.4g} m off at each tick"
    if found.first > found.steady:
        line += f", after one tick of {found.first:.4g} m,"
    return f"{line} and raise no alarm"


def unseen_effect_words(found: UnseenEffect, scenario: Scenario) -> str:
    line = f"; lies without alarm, in phase, move a vehicle by {found.steady:.4g} m beside errors"
    if np.isfinite(found.most):
        line += f"; such lies about positions move no vehicle by more than {found.most:.4g} m"
    held = "; lies without alarm: these lengths hold while alarms cut nothing"
    return line + held * scenario.detector.acts


def safe_words(found: SafeVehicles, scenario: Scenario) -> str:
    """The safe vehicles, each with the strongest reason, or the weakest of all draws."""
    words, left = [], np.ones(scenario.vehicles, bool)
    for why, vehicles, *_ in found.reasons:
        words += [f"{flagged(vehicles & left)} {why}"] if (vehicles & left).any() else []
        left &= ~vehicles
    known = "; ".join(words) + ", whichever vehicles are drawn" * (found.drawn and bool(words))
    if left.all() and found.tried:
        return f"no vehicle is proved safe{' in every lane' * found.drawn}"
    whose = "not known in every lane for" if found.drawn else "not known for"
    unknown = f"{whose} {ranges(vehicle_numbers(left))}" if left.any() else ""
    return "; ".join(filter(None, [known, unknown, "" if found.tried else NOT_TRIED]))


def flagged(vehicles: Vehicles) -> str:
    return "every vehicle" if vehicles.all() else ranges(vehicle_numbers(vehicles))


def ultimate_words(found: Ultimate, scenario: Scenario) -> str:
    told = f" = {found.slope:.3g} ā"
    if np.isnan(found.slope):
        told = ", of which Λ is not known here"
    elif found.rounding:
        known = np.isfinite(found.rounding)
        told += f" + {found.rounding:.3g} m" if known else " and what the tolerance leaves"
    premise = "this end holds if no vehicle stands still or is cut off, safe or not"
    return f"‖E‖ ends within ‖H‖₁ γ Λ h{told}; {premise}"


def margin_words(found: Margin, scenario: Scenario) -> str:
    """The attacked sets that leave no proof, and how many more vehicles may be attacked."""
    by: dict[str, list[int]] = {}
    for number, sets in enumerate(found.sets, 1):
        if any(sets):
            own = [*sets] == [(number,)]
            by.setdefault("" if own else f"{set_words(sets)} attacked", []).append(number)
    words = [
        f"no proof for {ranges(those)} if {sets or 'attacked itself'}" for sets, those in by.items()
    ]
    for more in np.unique(found.further[found.further > 0]).tolist():
        who = flagged(found.further == more)
        far = f"a proof for {who} even if any {MOST_TRIED} more are attacked"
        if more <= MOST_TRIED:
            are = "is" if more == 1 else "are"
            far = f"perhaps no proof for {who} if {more} more {are} attacked"
        words.append(far)
    return "; ".join([*words[:MOST_NAMED_SETS], *["…"] * (len(words) > MOST_NAMED_SETS)])


def set_words(sets: Sequence[tuple[int, ...]]) -> str:
    """Alternative sets of vehicles, with the verb."""
    if len(sets) > 1 and all(len(each) == 1 for each in sets):
        return f"any one of {ranges(sorted(each[0] for each in sets))} is"
    names = [ranges(each) if len(each) < 2 else f"{{{', '.join(map(str, each))}}}" for each in sets]
    return f"{' or '.join(names)} {'is' if len(sets[-1]) < 2 else 'are'}"


def decay_words(found: Decay, scenario: Scenario) -> str:
    """The paper's Lemma 1 with its constants."""
    x = "η" if found.norms else "x"  # local errors, or errors against the navigator
    line = f"‖{x}(t)‖ ≤ {found.factor:.3g} exp(-{found.rate:.3g} t) ‖{x}(0)‖ (Lemma 1)"
    if found.norms:
        least, most = min(found.norms), max(found.norms)
        line += f"; ‖H_i‖₁ of the vehicles from {least:.3g} to {most:.3g}"
    else:
        line += ", x = (E, Ė, …)" + "; Lemma 1 holds while nobody is cut off" * (not found.joined)
    return line


def start_words(found: Start, scenario: Scenario) -> str:
    below = (f"{length:g} m after {found.after(length):.3g} s" for length in (1.0, 1e-3))
    told = f"vehicles start at most {found.distance:.4g} m from the navigator"
    return f"{told}; without attack errors are below {', '.join(below)}"


def moving_words(found: KeepsMoving, scenario: Scenario) -> str:
    sizes = ("‖E‖", "‖Ė‖", "‖Ë‖")
    each = [
        size if factor == 1 else f"{factor:.4g} {size}"
        for factor, size in zip(found.factors.round(9), sizes, strict=False)
    ]
    met = "every start has this" if found.every_start else "other starts may bring one to rest"
    alone = found.slowest / found.factors[0]
    return (
        f"no vehicle comes to rest without attack if its start has {' + '.join(each)} <"
        f" {found.slowest:.4g} m/s (‖E‖ < {alone:.5g} m at the navigator's motion); {met}"
    )


def within_limits_words(found: Unclipped, scenario: Scenario) -> str:
    met = "every start is in this set" if found.every_start else "starts may be outside this set"
    return (
        f"no input saturates while x'Px ≤ {found.left:.4g}² / {found.ratio:.8g} ="
        f" {found.level:.4g} on each axis, with x = (E, Ė, …) and A'P + PA = -1; {met}"
    )


def misjudged_words(found: list[Misjudged], scenario: Scenario) -> str:
    """Probabilities after numbers of observations, exact where known, and their bounds."""
    told = "probabilities that an honest source is dropped, and a liar kept:"
    for number, each in enumerate(found):
        known = "at most {:.4g}, {:.4g}".format(*each.bounds)
        if np.isfinite(each.dropped):
            exact = (f"{one:.4g}" if one >= 1e-12 else "below 1e-12" for one in each[1:3])
            known = f"{', '.join(exact)} ({known})"
        told += f"{';' * (number > 0)} {known} after {each.after}" + " observation" * (number == 0)
    return told


# What a theorem's value says, by its quantity.
PHRASES: dict[str, Callable[[Any, Scenario], str]] = {
    "inverse norm": norm_words,
    "honest paths": path_words,
    "apart": lambda least, scenario: f"steered points that start {least:g} m apart or more stay so",
    "misjudged": misjudged_words,
    "cut off": cut_off_words,
    "reach": lambda found, scenario: (
        f"; the navigator reaches {vehicles_named(found.union, scenario)} in the union and"
        f" {vehicles_named(found.always, scenario)} in each of them"
    ),
    "nominal": nominal_words,
    "alone": alone_words,
    "agreement": agreement_words,
    "sensors leave": rms_words,
    "messages leave": rms_words,
    "stability": stability_words,
    "in mean square": lambda found, scenario: (
        f"; {stable(found.growth < 1)} in mean square, deviations times {found.growth:.4f} at each"
        " tick" + (f"; stable up to a loss of {found.critical:.4f}" if found.critical else "")
    ),
    "while reached": lambda is_so, scenario: (
        "; without attack and errors O1 holds while the navigator reaches every vehicle at each"
        " tick"
    ),
    "lag": lambda ends, scenario: (
        "; behind a navigator on a line vehicles end late by "
        + (f"{ends.min():.4g} to " if np.ptp(ends) > 1e-9 * ends.max() else "")
        + f"{ends.max():.4g} s"
    ),
    "follows lines": lambda is_so, scenario: "; a navigator on a line is followed without error",
    "greatest delay": greatest_delay_words,
    "growth when late": lambda growth, scenario: (
        f"; {stable(growth < 1)}, deviations times {growth:.6f} at each tick of {scenario.tick:g} s"
    ),
    "common margin": common_margin_words,
    "runs": runs_words,
    "isolation": isolation_words,
    "unseen lie": unseen_words,
    "unseen effect": unseen_effect_words,
    "safe": safe_words,
    "proof ends": margin_words,
    "ultimate error": ultimate_words,
    "decay": decay_words,
    "start": start_words,
    "start drive": lambda drive, scenario: (
        f"; after a start the derivative that no message carries may be {drive:.4g}"
        f" m/s^{scenario.vehicle.order}"
    ),
    "keeps moving": moving_words,
    "never global": lambda is_so, scenario: (
        "no saturated linear feedback stabilises three integrators globally (Sussmann and Yang"
        " 1991), so far starts may not come back"
    ),
    "unclipped": within_limits_words,
}
