"""The report of `jaxnet check`: cells, and the guarantees of each network. It needs no JAX."""

import re
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import lru_cache
from textwrap import fill
from time import monotonic

import numpy as np
from scipy.linalg import expm

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.idle import idle_keys
from jaxnet.config.keys import Scenario, Sequential
from jaxnet.config.naming import format_value
from jaxnet.config.scenario import (
    MOST_DRAWN_SETS,
    MOTION,
    Situation,
    attacked_draws,
    broken_premise,
    differs_by_lane,
    is_ideal,
    safe_in,
    safe_in_all,
    scenario_graph,
    situation_of,
)
from jaxnet.config.study import Study
from jaxnet.kinds.attacks import AnyAttack
from jaxnet.kinds.fields import EachOrder, is_drawn, median, value_range
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.kinds.noise import ErrorsAtTicks
from jaxnet.model import safety
from jaxnet.model.graph import Digraph, Links, Row, dense, unreachable
from jaxnet.model.retained import DropPolicy
from jaxnet.model.safety import Safe, Vehicles
from jaxnet.model.wording import cells_named, count, plural_s, ranges
from jaxnet.statistics.amplitude import amplitude_note
from jaxnet.statistics.reach import scenario_gain
from jaxnet.store import layout
from jaxnet.theory import (
    announced,
    certificate,
    delay,
    exact,
    integer,
    noise,
    response,
    robustness,
    rounds,
)
from jaxnet.theory.integer import RobustnessBracket
from jaxnet.view.text.width import cell_title, terminal_width

ORDER_UNITS = ("m", "m/s", "m/s²", "m/s³")
ORDER_NAMES = ("position", "velocity", "acceleration", "jerk")
MOST_LISTED_CELLS = 20  # told one by one; of more, what is swept
MOST_FULL_NETWORKS = 4  # networks told in full; of more, what is not as in the first
MOST_NETWORKS = 20
MOST_SWEPT_VALUES = 12  # values or cells that are named one by one
MOST_NAMED_VEHICLES = 60
PROCESS_BYTES = 600e6  # of a process that simulates, without arrays, measured
ARRAY_COPIES = 3  # of a shard's arrays, from the compiled program to the disk
NOT_TRIED = (
    f"more than {MOST_DRAWN_SETS:,} sets of vehicles may be drawn, which are not tried one by one"
)
NO_GUARANTEE = "nothing is proved; the theorems are of the law solved at every instant"
RETAINED = "; that is while everybody is retained"
NO_LEADER = "nothing is proved; the theorems presuppose a navigator"
NOT_IDEAL = "nothing is proved; the theorems presuppose exact sensors, one network, and words that arrive at once"
NOT_ROBUST = "not 1-robust, so not enough for W-MSR"
PROGRAM_SECONDS = 2.0  # for the integer programs of all networks together
ANNOUNCEMENT_PREMISE = (
    "as long as no vehicle stands still and nobody is cut off, outside the set either"
)


def check_text(study: Study) -> str:
    """Return the whole report."""
    amplitude = wrap_lines(amplitude_note(study.cells) + amplitude_advice(study))
    parts = [study_head(study), cell_list(study.cells), amplitude]
    parts += [*network_texts(study.cells), guarantees(study.cells)]
    if idle := idle_keys(study):
        parts.append(wrap_lines(network_text("keys without effect", idle)))
    return "\n\n".join(part for part in parts if part)


def amplitude_advice(study: Study) -> str:
    """Return the key that compares errors with the amplitude in force, where τ ā is more than that."""
    asked = study.config.recovery
    if asked is None or asked.of != "magnitude" or not amplitude_note(study.cells):
        return ""
    what = "spreads" if is_leaderless(study.cells) else "errors"
    return f"; recovery compares {what} with tau · ā: give recovery.of: amplitude to compare with the shift"


def certificates(cells: Sequence[Cell]) -> list[str]:
    """Return the certificate of each network in full, with the cells that share the network."""
    groups = group_by_network(cells)
    return [
        network_text(network_title(group, len(group)), network_rows(group, len(groups)))
        for group in groups
    ]


def network_texts(cells: Sequence[Cell]) -> list[str]:
    """Return the certificates for a terminal; of many networks, only lines that differ from the first."""
    found: dict[tuple[str, tuple[tuple[str, str], ...]], list[Cell]] = {}
    groups = group_by_network(cells)
    for group in groups:
        rows = network_rows(group, len(groups))
        key = group[0].scenario.topology.kind, tuple(rows.items())
        found.setdefault(key, []).extend(group)
    (_, first), *_ = found
    texts = []
    for (_, rows), group in list(found.items())[:MOST_NETWORKS]:
        told = rows if len(found) <= MOST_FULL_NETWORKS or rows == first else set(rows) - set(first)
        lines = {name: line for name, line in rows if (name, line) in told}
        texts.append(
            network_text(
                network_title(group, MOST_SWEPT_VALUES)
                + ": as the first, but" * (told is not rows),
                lines,
            )
        )
    if len(found) > MOST_NETWORKS:
        texts.append(f"… {len(found) - MOST_NETWORKS} more networks")
    return [wrap_lines(text) for text in texts]


def wrap_lines(text: str) -> str:
    """Wrap lines to a terminal's width; continuation lines keep the indent of the text column."""
    lines = []
    for line in text.splitlines():
        under = re.match(r"  \S.*?  +|", line)
        lines.append(
            fill(line, terminal_width(), subsequent_indent=" " * (under.end() if under else 0))
        )
    return "\n".join(lines)


def group_by_network(cells: Sequence[Cell]) -> list[list[Cell]]:
    """Group cells that share a network, in the order of their first cells."""
    groups: dict[Hashable, list[Cell]] = {}
    networks = NetworkKeys()
    for cell in cells:
        groups.setdefault(networks.key(cell.scenario), []).append(cell)
    return list(groups.values())


def study_head(study: Study) -> str:
    """Return the study's size, memory and disk space."""
    settled, lanes = study.config, study.lanes
    array_bytes = layout.lane_bytes(study.cells, settled.save)
    memory = PROCESS_BYTES + ARRAY_COPIES * array_bytes * layout.shard_size(study.cells, settled)
    disk = layout.disk_bytes(settled, study.cells, lanes)
    cells = count(len(study.cells), "cell")
    most = "at most " if isinstance(settled.samples, Sequential) else ""
    return wrap_lines(
        f"{settled.name}: {cells} × {most}{count(settled.most_samples, 'sample')} = {count(lanes, 'lane')}, "
        f"{settled.engine.kind} engine, nothing wrong\n"
        f"about {byte_size(memory)} of memory; at most {byte_size(float(disk))} on disk"
    )


def cell_list(cells: Sequence[Cell]) -> str:
    """Return a line per cell; for many cells, the swept values instead."""
    if not cells[0].labels:
        return ""
    if len(cells) <= MOST_LISTED_CELLS:
        return "\n".join(cell_title(cell, terminal_width()) for cell in cells)
    lines, longest = [], max(map(len, cells[0].labels))
    for key in cells[0].labels:
        values = list(dict.fromkeys(format_value(cell.labels[key]) for cell in cells))
        if len(values) > MOST_SWEPT_VALUES:
            values = [*values[: MOST_SWEPT_VALUES - 1], f"… {values[-1]} ({len(values)} values)"]
        lines.append(f"  {key:<{longest}}  {', '.join(values)}")
    return wrap_lines("\n".join(["swept, the last fastest:", *lines]))


def guarantees(cells: Sequence[Cell]) -> str:
    """Return the guarantee of each defence as it is configured, in words."""
    found: dict[str, list[str]] = {}
    for defence in (cell.scenario.defence for cell in cells):
        found.setdefault(defence.kind, []).append(defence.promise())
    rows = {kind: "; or ".join(dict.fromkeys(promises)) for kind, promises in found.items()}
    rows |= {
        f"law {cell.scenario.law.kind}": NO_GUARANTEE
        for cell in cells
        if not cell.scenario.law.solves()
    }
    moving = [
        each.scenario for each in cells if not broken_premise(each.scenario, ("leader", *MOTION))
    ]
    drawn = any(scenario.draws_gain for scenario in moving)
    unlike = {
        (id(one.topology), id(one.defence), repr(one.gain), one.horizon, one.tail): one
        for one in moving
        if not drawn
    }
    if words := [*dict.fromkeys(text for each in unlike.values() if (text := decay_text(each)))]:
        words = [*words[:MOST_SWEPT_VALUES], *["…"] * (len(words) > MOST_SWEPT_VALUES)]
        rows["without attack"] = "; or ".join(words)
    return wrap_lines(network_text("guarantees", rows))


DIED_AWAY = 1e-3  # of ‖η(0)‖: less is millimetres of a fleet that starts metres away


def decay_text(scenario: Scenario) -> str:
    """Return the paper's Lemma 1 with its constants, for the gain of a scenario.

    With one gain η is E with its derivatives, which does not jump where weights do, as local errors do. With
    gains of each vehicle η are local errors, and the text is "" where weights may switch.
    """
    graph, _, trusted, kept = situation_of(scenario)
    matrices, own = scenario.gain_matrices, scenario.own_gains
    if own is not None and (kept is None or kept.fixed is None):
        return ""
    gains = [np.array(scenario.gain) if matrices is None else matrices] if own is None else own
    factors, rates = zip(*map(exact.decay_constants, gains), strict=True)
    line = f"‖η(t)‖ ≤ {max(factors):.3g} exp(-{min(rates):.3g} t) ‖η(0)‖ (Lemma 1)"
    if own is None:
        joined = safety.stay_joined(
            scenario.defence.may_drop(graph, trusted), np.ones(graph.vehicles, bool)
        )
        line += ", η = (E, Ė, …)" + ", while nobody is cut off" * (not joined.all())
    else:
        norms = [response.impulse_norm(each) for each in own]
        line += f"; ‖h_i‖₁ of the vehicles from {min(norms):.3g} to {max(norms):.3g}"
    begins = scenario.horizon - scenario.tail
    left = max(np.linalg.norm(expm(exact.companion(gain) * begins), 2) for gain in gains)
    if left <= DIED_AWAY:
        return line
    return f"{line}; the start has not died away: up to {left:.2g} ‖η(0)‖ when the tail begins, at {begins:g} s"


class NetworkKeys:
    """Keys that tell networks apart; a cache by identity treats shared objects once."""

    def __init__(self):
        self.graphs: dict[Hashable, Digraph] = {}
        self.known: dict[Hashable, tuple[Digraph, tuple[Row, Row], Hashable]] = {}

    def key(self, scenario: Scenario) -> Hashable:
        """Return a key equal for cells with one network, kinds of attack and defence, and navigator.

        Where certificates depend on law, gain, tick and vehicle, the key includes them.
        """
        attack, law = scenario.attack, scenario.law
        graph, links, shared = self.without_attack(scenario)
        attacked = attack.attacked_links(graph)[links].tobytes()
        threat = (
            attack.kind,
            attack.number(),
            attack.replaces(),
            orders_text(attack),
            attack.identities(),
            repr(attack.periods()),
            attack.as_told(),
            attack.announcement().model_dump_json(),
        )
        moving: tuple[Hashable, ...] = law.model_dump_json(), scenario.vehicle.reference()
        if not law.solves() or scenario.defence.announcing() or scenario.own_gains is not None:
            moving += scenario.tick, repr(scenario.gain), attack.fastest(), attack.harmonic()
        world = tuple(world_lines(scenario).items())
        return shared, attacked, threat, scenario.horizon, moving, world

    def without_attack(self, scenario: Scenario) -> tuple[Digraph, tuple[Row, Row], Hashable]:
        """Return the graph, its links, and the part of the key that no attack changes."""
        topology, vehicles = scenario.topology, scenario.vehicles
        navigator, defence = scenario.navigator, scenario.defence
        by = id(topology), vehicles, id(navigator), id(defence)  # objects that the cells hold
        if by not in self.known:
            if by[:3] not in self.graphs:
                self.graphs[by[:3]] = scenario_graph(scenario)
            graph = self.graphs[by[:3]]
            links = graph.edges()
            network = links[0], *(each[links] for each in (*graph, defence.trusts(graph)))
            words = navigator.model_dump_json(), defence.model_dump_json()
            shared = vehicles, *(each.tobytes() for each in network), *words
            self.known[by] = graph, links, shared
        return self.known[by]


def network_title(cells: Sequence[Cell], most: int) -> str:
    """Return the topology of a group and at most `most` of its cells."""
    named = cells_named(sorted(cell.number for cell in cells)[:most])
    more = f" and {len(cells) - most} more" if len(cells) > most else ""
    return f"{cells[0].scenario.topology.kind}, {named}{more}"


def network_text(title: str, rows: Mapping[str, str]) -> str:
    """Return a title with a line per row below it."""
    width = max(map(len, rows), default=0)
    return "\n".join([title, *(f"  {name:<{width}}  {line}" for name, line in rows.items())])


def network_rows(cells: Sequence[Cell], networks: int) -> dict[str, str]:
    """Return the certificate of one of several networks, by line; random weights count with their medians.

    Lines that need a search over sets of vehicles appear only if the networks are few and small.
    """
    scenario = cells[0].scenario
    known = situation_of(scenario)
    graph, attacked, trusted, _ = known
    seconds = PROGRAM_SECONDS / networks if networks <= MOST_NETWORKS else 0.0
    closely = seconds > 0 and graph.vehicles <= robustness.MOST_NODES
    facts = certificate.certify(graph, attacked)
    if not scenario.navigator.present:
        return leaderless_rows(scenario, known, seconds)
    slowest, when = scenario.navigator.slowest(scenario.horizon)
    return {
        "graph": graph_line(scenario, facts),
        **names_line(scenario),
        **({} if facts.inverse_norm is None else {"‖L⁻¹‖₂": f"{facts.inverse_norm:.4g}"}),
        "robustness": robustness_line(graph, trusted, seconds),
        "navigator": f"never slower than {slowest:.4g} m/s (t = {when:.4g} s)",
        "attack": attack_line(scenario, facts),
        "Assumption 1": assumption_line(
            facts, cut_off_draws(scenario, graph) if facts.cut_off else []
        ),
        **scenario.defence.describe(graph, at_once(scenario, attacked), trusted),
        **cut_off_line(scenario.defence.may_drop(graph, trusted)),
        **promise_lines(scenario, known, closely),
        **drawn_lines(cells),
    }


def leaderless_rows(scenario: Scenario, known: Situation, seconds: float) -> dict[str, str]:
    """Return what is known of a network without navigator."""
    graph, attacked, trusted, _ = known
    facts = certificate.certify(graph, attacked)
    return {
        "graph": graph_line(scenario, facts),
        **names_line(scenario),
        **({"robustness": f"the vehicles are {alone_text(graph, seconds)}"} if seconds > 0 else {}),
        "navigator": "none: rows measure the spread of the vehicles that are not attacked, and their way out"
        " of the hull of their starts",
        "attack": attack_line(scenario, facts),
        **scenario.defence.describe(graph, at_once(scenario, attacked), trusted),
        **({"law": stability_line(scenario, known)} if one_live_network(scenario) else {}),
        **world_lines(scenario),
        "safe": NO_LEADER,
    }


def promise_lines(scenario: Scenario, known: Situation, closely: bool) -> dict[str, str]:
    """Return lines on who is safe, or why nothing is known of it."""
    if not is_ideal(scenario):
        return {**world_lines(scenario), "safe": NOT_IDEAL}
    if not scenario.law.solves():
        return held_lines(scenario, known)
    broken = broken_premise(scenario, MOTION)
    return (
        {"safe": f"nothing is proved; {broken}"} if broken else safe_lines(scenario, known, closely)
    )


def world_lines(scenario: Scenario) -> dict[str, str]:
    """Return lines on what no bound covers: networks in turn, errors of sensors and lost messages."""
    lines = {}
    networks = scenario.topology.turns()
    if len(networks) > 1:
        union = "the lines above hold for the union, not for a network alone"
        told = f"{count(len(networks), 'network')} take turns; {union}; no bound holds"
        lines["networks"] = told + reach_text(scenario)
    if not scenario.sensing.exact():
        known = steady_text(scenario, scenario.sensing, lambda: np.ones(1))
        lines["sensing"] = (
            f"{scenario.sensing.kind}: vehicles sense with errors; no bound holds{known}"
        )
    if not scenario.channel.loss.perfect():
        lost = f"loss {scenario.channel.loss.kind}: messages are lost; no bound holds"
        lines["channel"] = lost + lost_text(scenario) + nominal_text(scenario)
    if not scenario.channel.noise.exact():
        known = ""
        if not scenario.defence.decides and scenario.vehicles <= certificate.MOST_INVERTED:
            weights, of = dense(scenario_graph(scenario)), scenario.channel.noise.of
            known = steady_text(
                scenario, scenario.channel.noise, lambda: noise.link_gains(weights, of)
            )
        lines["noise"] = (
            f"{scenario.channel.noise.kind}: words arrive with errors; no bound holds{known}"
        )
    if scenario.channel.rounded:
        lines["rounding"] = "jets in words are rounded; no bound holds" + rounding_text(scenario)
    if scenario.channel.late:
        lines["delay"] = (
            f"words are {lateness_text(scenario)} late; no bound holds{late_text(scenario)}"
        )
    return lines


def one_live_network(scenario: Scenario) -> bool:
    """Return whether one network is in force, all of whose words arrive at once."""
    channel = scenario.channel
    return len(scenario.topology.turns()) == 1 and not channel.late and channel.loss.perfect()


def reach_text(scenario: Scenario) -> str:
    """Return whom the navigator reaches in networks that take turns, and what stays certain of them."""
    if not scenario.navigator.present or scenario.vehicles > certificate.MOST_INVERTED:
        return ""
    networks = [each.normalised_rows(scenario.vehicles) for each in scenario.topology.turns()]
    union, always, nominal = (
        "every vehicle" if len(each) == scenario.vehicles else ranges(each) or "nobody"
        for each in certificate.joint_reach(networks)
    )
    told = f"; the navigator reaches {union} in the union and {always} in each of them"
    if broken_premise(scenario, ("solved", "flat")):
        return told
    rest = "" if nominal == "every vehicle" else ", of others nothing is known"
    rest += ", while decisions cut nobody off" * scenario.defence.decides
    return f"{told}; without attack, errors, loss and delay O1 holds of {nominal}{rest}"


def lost_text(scenario: Scenario) -> str:
    """Return the stability in mean square of a law by exchanges if whole ticks are lost, "" if not known."""
    lost = scenario.channel.loss.of_whole_ticks()
    channel, one_network = scenario.channel, len(scenario.topology.turns()) == 1
    if not one_network or channel.late or channel.missing != "drop" or not scenario.vehicle.flat:
        return ""
    if (
        lost is None
        or not scenario.law.needs_ticks()
        or scenario.defence.decides
        or scenario.gain_matrices is not None
    ):
        return ""
    if scenario.attack.replaces() or scenario.vehicles > certificate.MOST_INVERTED:
        return ""
    left = scenario.law.left(rounds.eigenvalues(dense(scenario_graph(scenario))))
    if left is None:
        return ""
    gain = np.array([median(each) for each in scenario.gain])
    grown, most = (
        rounds.mean_square_growth(left, gain, scenario.tick, lost),
        rounds.critical_loss(left, gain, scenario.tick),
    )
    state = "stable" if grown < 1 else "UNSTABLE"
    told = f"{state} in mean square, deviations times {grown:.4f} at each tick"
    return f"; {told}; stable up to a loss of {most:.4f}" if most else f"; {told}"


def rounding_text(scenario: Scenario) -> str:
    """Return by how much rounded words err at most."""
    steps = scenario.channel.quantisation
    listed = steps.root if isinstance(steps, EachOrder) else [value_range(steps)[1]]
    told = " and ".join(
        f"{step / 2:g} {unit}" for step, unit in zip(listed, ORDER_UNITS, strict=False)
    )
    told = told if isinstance(steps, EachOrder) else f"{listed[0] / 2:g}"
    return f"; they act like an attack of at most {told} on each axis, on every link and in every order told"


def lateness_text(scenario: Scenario) -> str:
    """Return by how much words are late."""
    low, high = value_range(scenario.channel.delay)
    if not is_drawn(scenario.channel.delay):
        return f"{low:g} s"
    return f"{low:g} to {high:g} s, drawn for each {scenario.channel.delay_of},"


def nominal_text(scenario: Scenario) -> str:
    """Return until when O1 holds without attack if lost words are dropped, "" if nothing is known."""
    plain = not (broken_premise(scenario, ("leader", "solved", "flat")) or scenario.channel.late)
    if not plain or scenario.channel.missing != "drop" or len(scenario.topology.turns()) > 1:
        return ""
    return "; without attack and errors O1 holds while the navigator reaches every vehicle at each tick"


def late_text(scenario: Scenario) -> str:
    """Return how far behind a fleet ends whose words are late, or its margin; "" where weights change."""
    if scenario.defence.decides or scenario.vehicles > certificate.MOST_INVERTED:
        return ""
    if len(scenario.topology.turns()) > 1 or not scenario.channel.loss.perfect():
        return ""
    if is_drawn(scenario.channel.delay) or not scenario.vehicle.flat:
        return ""
    weights, told = dense(scenario_graph(scenario)), scenario.channel.extrapolate
    if not scenario.law.solves():
        return late_law_text(scenario, weights)
    if told == "none":
        ends = delay.lags(weights, scenario.channel.delay)
        between = f"{ends.min():.4g} to " if np.ptp(ends) > 1e-9 * ends.max() else ""
        return f"; behind a navigator on a line vehicles end late by {between}{ends.max():.4g} s"
    if told == "jets":
        return "; a navigator on a line is followed without error"
    margin = delay.jerk_margin(weights, np.array([median(each) for each in scenario.gain]))
    state = (
        "unstable"
        if margin < scenario.channel.delay
        else "a necessary condition of stability holds"
    )
    return f"; {state}: the delay must be below {margin:.6g} s" if np.isfinite(margin) else ""


def late_law_text(scenario: Scenario, weights: np.ndarray) -> str:
    """Return the stability of a law that holds a derivative and hears late words, "" where not known."""
    law, lateness, told = scenario.law, scenario.channel.delay, scenario.channel.extrapolate
    rows, leads = scenario_graph(scenario).weights.T[None], scenario.navigator.present
    strength = scenario.topology.strength(rows, leads) if not law.couples() else None
    known = (
        law.needs_ticks()
        and (law.gives_demand() or law.iterates())
        and strength is None
        and scenario.gain_matrices is None
    )
    if not known or scenario.attack.replaces():
        return ""
    gain, along = np.array([median(each) for each in scenario.gain]), rounds.eigenvalues(weights)
    if not leads:  # an eigenvalue of 1 belongs to agreement
        along = along[np.abs(along - 1) > 1e-9]
    word, late = (
        delay.word_factors(gain, lateness, told, not law.couples()),
        round(lateness / scenario.tick),
    )
    grown = rounds.late_growth(along, gain, word, scenario.tick, late)
    state = "stable" if grown < 1 else "UNSTABLE"
    return f"; {state}, deviations times {grown:.6f} at each tick of {scenario.tick:g} s"


def steady_text(scenario: Scenario, errors: ErrorsAtTicks, gains: Callable[[], np.ndarray]) -> str:
    """Return the root mean square of E that errors leave at last, "" where it is not known.

    `gains()` returns the variance of each vehicle over that of one drive.
    """
    one_network = len(scenario.topology.turns()) == 1 and not differs_by_lane(scenario)
    at_once = scenario.channel.loss.perfect() and not scenario.channel.late
    at_once = at_once and not scenario.channel.rounded
    plain = not broken_premise(scenario, ("solved", "flat", "one gain"))
    if not (plain and one_network and at_once and scenario.tick > 0):
        return ""
    strength = errors.strength(scenario.gain)
    if strength is None:
        return ""
    variance, correlation = strength
    variance = variance * noise.held_variance(scenario.gain, scenario.tick, correlation)
    each = np.sqrt(variance * gains())
    who = f", the most of {int(each.argmax()) + 1}" if np.ptp(each) > 1e-9 * each.max() else ""
    return f"; without attack they leave {each.max():.4g} m rms on each axis at last{who}"


def safe_lines(scenario: Scenario, known: Situation, closely: bool) -> dict[str, str]:
    """Return lines on the safe vehicles and on the sets that break their safety."""
    draws = attacked_draws(scenario, known.graph)
    reasons = safe_in_all(scenario, known.graph, [known.attacked] if draws is None else draws)
    if draws is None:
        return {"safe": f"{safe_line(reasons)}; {NOT_TRIED}"}
    lines = {"safe": safe_line(reasons, len(draws) > 1), **announcement_lines(scenario, reasons)}
    return lines | (
        margin_lines(scenario, known.graph) if closely and scenario.attack.present else {}
    )


def announcement_lines(scenario: Scenario, reasons: Sequence[Safe]) -> dict[str, str]:
    """Return the premises of safety by announcements, and the bound of theorem 3."""
    if not scenario.defence.announcing() or not scenario.attack.present:
        return {}
    announcement = scenario.attack.announcement()
    if not announcement.consistent:
        told = f"attacked links announce {announcement.kind}, not what they carry; nobody is safe by majority"
        return {"B1": f"broken: {told}"}
    lines = {"B1": "assumed: attacked links announce what they carry (announces: consistent)"}
    majority = np.zeros(scenario.vehicles, bool)
    for each in sorted(reasons, key=lambda each: not each.consistent):
        majority = majority | each.vehicles if each.consistent else majority & ~each.vehicles
    left = max((each.left for each in reasons), default=0.0)
    return lines | ({"theorem 3": theorem_line(scenario, majority, left)} if majority.any() else {})


def theorem_line(scenario: Scenario, majority: Vehicles, left: float) -> str:
    """Return the ultimate error that theorem 3 allows for vehicles that are safe by majority.

    `left` is 2M + δ [m/s³], what a tolerance leaves (corollary 1).
    """
    reach, fastest = scenario_gain(scenario), scenario.attack.fastest()
    if reach is None or not np.isfinite(fastest):
        return f"‖E‖ ends within ‖h‖₁ γ Λ h, of which Λ is not known here; {ANNOUNCEMENT_PREMISE}"
    gain = np.array([median(each) for each in scenario.gain])
    slopes = announced.between_ticks(
        reach, gain, fastest, scenario.tick, scenario.attack.harmonic()
    )
    told = f"{slopes[majority].max():.3g} ā"
    if left:
        rounding = response.impulse_norm(gain) * reach.gains[majority].max() * left
        told += f" + {rounding:.3g} m" if np.isfinite(left) else " and what the tolerance leaves"
    return f"‖E‖ ends within ‖h‖₁ γ Λ h = {told}; {ANNOUNCEMENT_PREMISE}"


def held_lines(scenario: Scenario, known: Situation) -> dict[str, str]:
    """Return lines on the stability of a loop with held jerk, which has no proof of safety."""
    return {"law": stability_line(scenario, known), "safe": NO_GUARANTEE}


def stability_line(scenario: Scenario, known: Situation) -> str:
    """Return the growth of deviations per tick, and the least number of rounds if the law has rounds."""
    law, tick, kept = scenario.law, scenario.tick, known.retained
    if scenario.vehicles > certificate.MOST_INVERTED:
        return f"stability is told of {certificate.MOST_INVERTED:,} vehicles at most"
    if broken := broken_premise(scenario, ("flat",)):
        return f"nothing is known of its stability: {broken}"
    fixed = None if kept is None else kept.fixed
    changing = bool(scenario.attack.periods()) or not scenario.attack.targets()
    drawn = (
        scenario.attack.replaces() and changing
    )  # other vehicles are replaced elsewhere, or later
    honest = ~(known.attacked & (scenario.attack.replaces() and not drawn))
    weights = dense((known.graph if fixed is None else fixed).only(honest))
    if not law.couples():
        weights = followed_weights(scenario, known.graph, fixed, weights)
    along = rounds.eigenvalues(weights)
    if not scenario.navigator.present:  # an eigenvalue of 1 belongs to agreement
        along = along[np.abs(along - 1) > 1e-9]
    left = law.left(along)
    if scenario.gain_matrices is not None:
        return f"{law.kind}: nothing is known of its stability where gains differ by axis"
    if left is None and not law.gives_demand():
        return f"{law.kind}: nothing is known of its stability"
    gain = np.array([median(each) for each in scenario.gain])
    if not law.needs_ticks():
        rate = rounds.local_rate(along, gain)
        line = f"{'stable' if rate < 0 else 'UNSTABLE'}, deviations behave as exp({rate:.4f} t) at last"
        return line + RETAINED * (fixed is None)
    grown = (
        rounds.local_growth(along, gain, tick) if left is None else rounds.growth(left, gain, tick)
    )
    line = f"{'stable' if grown < 1 else 'UNSTABLE'}, deviations times {grown:.4f} at each tick of {tick:g} s"
    if law.iterates():
        line += f"; {rounds_text(rounds.least_rounds(weights, gain, tick))}"
    line += "; that is without the attack, which replaces what vehicles send" * drawn
    return line + RETAINED * (fixed is None)


def followed_weights(
    scenario: Scenario, graph: Digraph, fixed: Digraph | None, weights: np.ndarray
) -> np.ndarray:
    """Return the matrix `I - S (I - A)` of a local law, where S holds the strengths of the rows.

    `weights` is [a0 | A] of the vehicles retained for good, which are those of `fixed`, or of everybody.
    """
    kept = graph if fixed is None else graph.only(fixed.heard)
    strength = scenario.topology.strength(graph.weights.T[None], scenario.navigator.present)
    if strength is None:
        return weights
    factor = strength.of(kept.weights.sum(axis=1)[None, None])[0, 0][:, None]
    own = np.concatenate([np.zeros_like(factor), np.eye(len(weights))], axis=1)
    return own - factor * (own - weights)


def rounds_text(least: tuple[int, int] | None) -> str:
    """Describe the least stable number of rounds, and the number from which all are stable."""
    if least is None:
        return "no number of rounds is stable at this tick"
    few, surely = least
    line = f"{count(few, 'round')} {'is' if few == 1 else 'are'} the least that is stable"
    return line + f", and every number from {surely} on" * (surely > few)


def graph_line(scenario: Scenario, facts: certificate.Certificate) -> str:
    """Return the numbers of vehicles and links, and the number of sources that each vehicle hears."""
    degrees = {
        int(degree): ranges((np.flatnonzero(facts.heard == degree) + 1).tolist())
        for degree in sorted(set(facts.heard.tolist()))
    }
    hears = "; ".join(
        f"{who} hear{plural_s(who)} {count(n, 'source')}" for n, who in degrees.items()
    )
    return (
        f"{count(scenario.vehicles, 'vehicle')}, {count(int(facts.heard.sum()), 'link')}: {hears}"
    )


def names_line(scenario: Scenario) -> dict[str, str]:
    """Return a line with the number and name of each vehicle, if the network has names."""
    names = [f"{number} {name}" for number, name in enumerate(scenario.topology.vehicle_names(), 1)]
    more = f", … ({len(names)} vehicles)" if len(names) > MOST_NAMED_VEHICLES else ""
    return {"names": ", ".join(names[:MOST_NAMED_VEHICLES]) + more} if names else {}


def attack_line(scenario: Scenario, facts: certificate.Certificate) -> str:
    """Return the attack and the attacked vehicles."""
    attack = scenario.attack
    if not attack.present:
        return "none"
    who = f"{attack.describe()} on {attack.whom()}"
    if not facts.attacked_links:
        return f"{who}, heard by nobody"
    if any(source == 0 for _, source in facts.attacked_links):
        how = "in what they hear of the navigator"
    else:
        how = "in what they transmit"
    instead = ", in place of what is sent" if attack.replaces() else ""
    instead += ", and they move as they tell" if attack.as_told() else ""
    among = "" if attack.targets() else " of all that may be drawn"
    among = " of all that are ever attacked" if attack.periods() else among
    links = count(len(facts.attacked_links), "link")
    return f"{who} {how}{instead}, {links}{among}{orders_text(attack)}{change_text(scenario)}"


def change_text(scenario: Scenario) -> str:
    """Return what a change of the attacked vehicles means for bounds and for the tail, "" without one."""
    periods = scenario.attack.periods()
    if not periods:
        return ""
    last = max(time for time, _ in periods if time < scenario.horizon)
    settled = scenario.horizon - scenario.tail - last
    tail = (
        f"begins {settled:g} s after the last change"
        if settled > 0
        else "has the last change in it"
    )
    return f"; bounds and safety are of all that are ever attacked, and the tail {tail}"


def orders_text(attack: AnyAttack) -> str:
    """Describe attacks that are unbounded, or whose signals are inconsistent between derivatives."""
    if not attack.bounded:
        return "; not bounded by ā, so no bound says anything"
    if attack.consistent():
        return ""
    sizes = attack.by_order() or [1.0] * len(ORDER_NAMES)
    falsified = [order for order in attack.falsified() if sum(sizes[order : order + 1])]
    which = ", ".join(ORDER_NAMES[order] for order in falsified)
    return f"; {which} falsified each on its own, so the static bound says nothing"


def at_once(scenario: Scenario, attacked: Links) -> Links:
    """Return, of the links that may be attacked, as many of each listener as one lane attacks."""
    if scenario.attack.targets():
        return attacked
    return attacked & (attacked.cumsum(axis=1) <= scenario.attack.number())


def cut_off_draws(scenario: Scenario, graph: Digraph) -> list[int] | None:
    """Return the vehicles without an honest path in some lane; None if there are too many sets to try."""
    draws = attacked_draws(scenario, graph)
    if draws is None:
        return None
    return sorted(
        {i for attacked in draws for i in unreachable(graph.only(graph.heard & ~attacked))}
    )


def assumption_line(facts: certificate.Certificate, cut_off: list[int] | None) -> str:
    """Return whether the paper's Assumption 1 holds: an honest path from navigator to every vehicle."""
    if cut_off == []:
        return "holds: an honest path from the navigator to every vehicle"
    if cut_off is None:
        return (
            f"not known where {ranges(facts.cut_off)} have no path but through others: {NOT_TRIED}"
        )
    if cut_off != facts.cut_off or not facts.all_attacked:
        return f"broken: no honest path from the navigator to {ranges(cut_off)}"
    line = f"broken: no honest path from the navigator to {ranges(facts.cut_off)}"
    return (
        line
        + f"; {ranges(facts.all_attacked)} hear{plural_s(ranges(facts.all_attacked))} nobody honest"
    )


def robustness_line(graph: Digraph, trusted: Links, seconds: float) -> str:
    """Return the robustness measures of rules in the literature; a search takes at most some seconds."""
    line = with_navigator(graph)
    if seconds > 0:
        line += f"; the vehicles alone {alone_text(graph, seconds)}"
    leaders = np.isin(np.arange(graph.vehicles + 1), graph.sources[trusted])
    if leaders[1:].any() and not leaders[1:].all():
        names = ranges(np.flatnonzero(leaders).tolist())
        reached = vehicle_numbers(
            robustness.percolated_vehicles(graph, trusted, leaders) & ~leaders[1:]
        )
        most = robustness.leader_robustness(graph, leaders)
        line += f"; led by {names}, whom somebody trusts, strongly {most}-robust,"
        line += f" and percolation with F = 1 reaches {ranges(reached) or 'nobody else'}"
    return line


def with_navigator(graph: Digraph) -> str:
    """Return the robustness of a graph with its navigator, which hears nobody, and what W-MSR needs."""
    exactly = "exactly 1-robust with the navigator, as every graph that it reaches"
    line = (
        "not 1-robust with the navigator, which does not reach every vehicle"
        if unreachable(graph)
        else exactly
    )
    needs = "3-robustness against F-local attackers, (2, 2)-robustness against F-total attackers"
    return f"{line}, while W-MSR with F = 1 asks for {needs}"


def alone_text(graph: Digraph, seconds: float) -> str:
    """Return the robustness of the vehicles without the navigator, and the attackers that W-MSR tolerates."""
    if graph.vehicles > integer.MOST_PROGRAMMED:
        return f"not examined: they are more than {integer.MOST_PROGRAMMED}"
    heard = dense(graph)[:, 1:] > 0
    if graph.vehicles > robustness.MOST_NODES:
        return bracket_text(*brackets(len(heard), heard.tobytes(), seconds))
    found = robustness.robustness(heard)
    if not found:
        return NOT_ROBUST
    pairs = ", ".join(f"({r}, {s})" for r, s in enumerate(found, 1))
    local, total = robustness.most_local(len(found)), robustness.most_total(found)
    return f"{pairs}-robust, {tolerance_text(f'F = {local}', f'F = {total}')}"


@lru_cache(maxsize=MOST_NETWORKS)  # the cells of several attacks share one graph
def brackets(n: int, heard: bytes, seconds: float) -> tuple[RobustnessBracket, RobustnessBracket]:
    """Return bounds on the greatest r, and on the greatest F of F-total attackers, of a matrix as bytes."""
    matrix, end = np.frombuffer(heard, bool).reshape(n, n), monotonic() + seconds
    known = integer.robustness_bracket(matrix, seconds)
    return known, integer.total_bracket(matrix, known, end - monotonic())


def bracket_text(known: RobustnessBracket, total: RobustnessBracket) -> str:
    """Return bounds on the greatest r, and the attackers that W-MSR surely tolerates."""
    if known.high == 0:
        return NOT_ROBUST
    between = f"r-robust, with the greatest r between {known.low} and {known.high}"
    line = f"{known.high}-robust" if known.known else between
    local = RobustnessBracket(*map(robustness.most_local, known))
    if local.low == total.low == 0 and not (local.known and total.known):
        return f"{line}, enough for W-MSR without attackers; with attackers it is not known"
    borne = [f"{'' if each.known else 'at least '}F = {each.low}" for each in (local, total)]
    return (
        f"{line}, {tolerance_text(*borne)}"
        if known.low > 0
        else f"{line}, so nothing is proved of W-MSR"
    )


def tolerance_text(local: str, total: str) -> str:
    """Return the greatest F of F-local and of F-total attackers, both as text."""
    if local == total == "F = 0":
        return "enough for W-MSR only without attackers"
    return f"enough for W-MSR with F-local attackers up to {local}, F-total up to {total}"


def cut_off_line(drops: DropPolicy) -> dict[str, str]:
    """Return a line on vehicles that dropped links may cut off from the navigator, if there are any."""
    lost = vehicle_numbers(~safety.stay_joined(drops, np.ones(drops.graph.vehicles, bool)))
    return {"cut off": f"{ranges(lost)} may be, by whom they drop"} if lost else {}


def safe_line(reasons: Sequence[Safe], drawn: bool = False) -> str:
    """Return the safe vehicles, each with the strongest reason, or the weakest of all draws."""
    words, left = [], np.ones(len(reasons[0].vehicles), bool)
    for why, vehicles, *_ in reasons:
        words += [f"{vehicles_text(vehicles & left)} {why}"] if (vehicles & left).any() else []
        left &= ~vehicles
    known = "; ".join(words) + ", whichever vehicles are drawn" * (drawn and bool(words))
    whose = "not known in every lane of" if drawn else "not known of"
    return "; ".join(
        filter(None, [known, f"{whose} {ranges(vehicle_numbers(left))}" * bool(left.any())])
    )


def vehicles_text(vehicles: Vehicles) -> str:
    """Return the numbers of vehicles, given as flags."""
    return "every vehicle" if vehicles.all() else ranges(vehicle_numbers(vehicles))


def margin_lines(scenario: Scenario, graph: Digraph) -> dict[str, str]:
    """Return a line on the attacked sets, and the numbers of further attackers, that leave no proof."""

    def safe(attacked: list[int]) -> Vehicles:
        reasons = safe_in(scenario, graph, scenario.attack.on(attacked).attacked_links(graph))
        return np.any([each.vehicles for each in reasons], axis=0)

    everyone = range(1, graph.vehicles + 1)
    found, by = certificate.margin(safe, scenario.attack.targets() or everyone, graph.vehicles), {}
    for i, sets in zip(everyone, found.sets, strict=True):
        if any(sets):
            by.setdefault(" or ".join(map(set_text, sets)), []).append(i)
    words = [f"for {ranges(those)} with {sets} alone" for sets, those in by.items()]
    for more in np.unique(found.further[found.further > 0]).tolist():
        far = f"no {certificate.MOST_TRIED}" if more > certificate.MOST_TRIED else str(more)
        words.append(f"for {vehicles_text(found.further == more)} with {far} more")
    words = [*words[:MOST_SWEPT_VALUES], *["…"] * (len(words) > MOST_SWEPT_VALUES)]
    return {"proof ends": "; ".join(words)} if words else {}


def set_text(vehicles: Sequence[int]) -> str:
    """Return a set of vehicles as text: 2, or {2, 5}."""
    words = ", ".join(map(str, vehicles))
    return f"{{{words}}}" if len(vehicles) > 1 else words


def drawn_lines(cells: Sequence[Cell]) -> dict[str, str]:
    """Return lines on weights and gains that differ between lanes."""
    weights = [cell.number for cell in cells if cell.scenario.topology.differs()]
    gain = [cell.number for cell in cells if cell.scenario.draws_gain]
    lines = {}
    if weights:
        lines["weights"] = f"drawn in {cells_named(weights)}; what is said is of their medians"
    if gain:
        held = not cells[0].scenario.law.solves()
        told = "what is said is of their medians" if held else "stable whatever is drawn"
        lines["gain"] = f"drawn in {cells_named(gain)}; {told}"
    return lines


def byte_size(count_bytes: float) -> str:
    """Return a number of bytes with a suitable unit."""
    for unit in ("B", "kB", "MB", "GB"):
        if count_bytes < 1000:
            return f"{count_bytes:.3g} {unit}"
        count_bytes /= 1000
    return f"{count_bytes:.3g} TB"
