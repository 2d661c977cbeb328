"""What `jaxnet check` prints: the cells, and for each network what it promises. No JAX."""

import re
from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Scenario, Sequential
from jaxnet.config.scenario import Situation, safe_in, situation_of
from jaxnet.config.study import Study
from jaxnet.kinds.attacks import AnyAttack
from jaxnet.kinds.fields import is_drawn, median
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.model import safety
from jaxnet.model.graph import Digraph, Links, dense
from jaxnet.model.retained import AnySubset
from jaxnet.model.safety import Safe, Vehicles
from jaxnet.model.wording import cells_named, count, plural_s, ranges
from jaxnet.statistics.reach import spread_of
from jaxnet.store import layout
from jaxnet.theory import announced, certificate, robustness, rounds
from jaxnet.view.text.width import WIDTH, clipped

ORDER_NAMES = ("position", "velocity", "acceleration", "jerk")
MOST_CELLS = 20  # told one by one; of more, what is swept
MOST_WHOLE = 4  # networks told in full; of more, what is not as in the first
MOST_NETWORKS = 20
SOME = 12  # values or cells that are named one by one
PROCESS_BYTES = 600e6  # of a process that simulates, without arrays, measured
COPIES = 3  # of a shard's arrays, from the compiled program to the disk
SOLVED_ALONE = "nothing is proved; the theorems are of the law solved at every instant"
ASSUMED = "as long as no vehicle stands still and nobody is cut off, outside the set either"


def text(study: Study) -> str:
    """The whole report."""
    parts = [head(study), cell_list(study.cells), *networks(study.cells), guarantees(study.cells)]
    return "\n\n".join(part for part in parts if part)


def certificates(cells: Sequence[Cell]) -> list[str]:
    """What each network promises, with the cells that share it."""
    groups = alike(cells)
    closely = len(groups) <= MOST_NETWORKS
    return [network_text(title(group, len(group)), network_rows(group, closely)) for group in groups]


def networks(cells: Sequence[Cell]) -> list[str]:
    """The same for a terminal, of which as much is said once: of many the first, and how others differ."""
    found: dict[Any, list[Cell]] = {}
    groups = alike(cells)
    for group in groups:
        rows = network_rows(group, len(groups) <= MOST_NETWORKS)
        key = group[0].scenario.topology.kind, tuple(rows.items())
        found.setdefault(key, []).extend(group)
    (_, first), *_ = found
    texts = []
    for (_, rows), group in list(found.items())[:MOST_NETWORKS]:
        told = rows if len(found) <= MOST_WHOLE or rows == first else set(rows) - set(first)
        lines = {name: line for name, line in rows if (name, line) in told}
        texts.append(network_text(title(group, SOME) + ": as the first, but" * (told is not rows), lines))
    if len(found) > MOST_NETWORKS:
        texts.append(f"… {len(found) - MOST_NETWORKS} more networks")
    return [wrapped(text) for text in texts]


def wrapped(text: str) -> str:
    """Lines no wider than a terminal; those that go on stand under where they began."""
    lines = []
    for line in text.splitlines():
        under = re.match(r"  \S.*?  +|", line)
        lines.append(fill(line, WIDTH, subsequent_indent=" " * (under.end() if under else 0)))
    return "\n".join(lines)


def alike(cells: Sequence[Cell]) -> list[list[Cell]]:
    """Cells that share a network, in the order of the first of each."""
    groups: dict[Any, list[Cell]] = {}
    networks = Networks()
    for cell in cells:
        groups.setdefault(networks.key(cell.scenario), []).append(cell)
    return list(groups.values())


def head(study: Study) -> str:
    """Size of the study."""
    settled, lanes = study.config, study.lanes
    array_bytes = layout.lane_bytes(study.cells, settled.save)
    memory = PROCESS_BYTES + COPIES * array_bytes * layout.shard_size(study.cells, settled)
    disk = layout.disk_bytes(settled, study.cells, lanes)
    cells = count(len(study.cells), "cell")
    most = "at most " if isinstance(settled.samples, Sequential) else ""
    return wrapped(
        f"{settled.name}: {cells} × {most}{count(settled.most_samples, 'sample')} = {count(lanes, 'lane')}, "
        f"{settled.engine.kind} engine, nothing wrong\n"
        f"about {size(memory)} of memory; at most {size(float(disk))} on disk"
    )


def cell_list(cells: Sequence[Cell]) -> str:
    """The cells, one a line; where they are many, what is swept."""
    if not cells[0].labels:
        return ""
    if len(cells) <= MOST_CELLS:
        return "\n".join(clipped(cell, WIDTH) for cell in cells)
    lines, longest = [], max(map(len, cells[0].labels))
    for key in cells[0].labels:
        values = list(dict.fromkeys(str(cell.labels[key]) for cell in cells))
        if len(values) > SOME:
            values = [*values[: SOME - 1], f"… {values[-1]} ({len(values)} values)"]
        lines.append(f"  {key:<{longest}}  {', '.join(values)}")
    return wrapped("\n".join(["swept, the last fastest:", *lines]))


def guarantees(cells: Sequence[Cell]) -> str:
    """What each kind of defence promises, in words."""
    rows = {cell.scenario.defence.kind: cell.scenario.defence.guarantee for cell in cells}
    rows |= {f"law {cell.scenario.law.kind}": SOLVED_ALONE for cell in cells if cell.scenario.law.holds}
    return wrapped(network_text("guarantees", rows))


class Networks:
    """Keys of the networks of cells. What cells share is looked at once, by the objects that they share."""

    def __init__(self):
        self.graphs: dict[Any, Any] = {}
        self.known: dict[Any, Any] = {}

    def key(self, scenario: Scenario) -> Any:
        """What cells share that have one network, one kind of attack and of defence, and one navigator.

        Where a jerk is held, one law, gain and tick as well.
        """
        attack, law = scenario.attack, scenario.law
        graph, links, shared = self.without_attack(scenario)
        attacked = attack.links(graph)[links].tobytes()
        threat = attack.kind, attack.replaces(), attack.falsified(), attack.identities()
        held = (law.model_dump_json(), scenario.tick, repr(scenario.gain)) if law.holds else ()
        return shared, attacked, threat, scenario.horizon, held

    def without_attack(self, scenario: Scenario) -> tuple[Digraph, Any, Any]:
        """The graph, its links, and the part of the key that no attack changes."""
        topology, vehicles = scenario.topology, scenario.vehicles
        navigator, defence = scenario.navigator, scenario.defence
        by = id(topology), vehicles, id(navigator), id(defence)  # objects that the cells hold
        if by not in self.known:
            if by[:2] not in self.graphs:
                self.graphs[by[:2]] = topology.normalised(vehicles)
            graph = self.graphs[by[:2]]
            links = graph.edges()
            network = links[0], *(each[links] for each in (*graph, defence.trusts(graph)))
            words = navigator.model_dump_json(), defence.model_dump_json()
            shared = vehicles, *(each.tobytes() for each in network), *words
            self.known[by] = graph, links, shared
        return self.known[by]


def title(cells: Sequence[Cell], most: int) -> str:
    """Which network, and the cells that have it, or the first of them."""
    named = cells_named(sorted(cell.number for cell in cells)[:most])
    more = f" and {len(cells) - most} more" if len(cells) > most else ""
    return f"{cells[0].scenario.topology.kind}, {named}{more}"


def network_text(title: str, rows: Mapping[str, str]) -> str:
    """A line per row, under the title."""
    width = max(map(len, rows), default=0)
    return "\n".join([title, *(f"  {name:<{width}}  {line}" for name, line in rows.items())])


def network_rows(cells: Sequence[Cell], closely: bool) -> dict[str, str]:
    """Certificate of the network that these cells share, where weights are drawn the one of their medians.

    What takes trying sets of vehicles is told of small ones, if they are looked at closely.
    """
    scenario = cells[0].scenario
    known = situation_of(scenario)
    graph, attacked, trusted, _ = known
    closely = closely and graph.vehicles <= robustness.MOST_NODES
    facts = certificate.certify(graph, attacked)
    slowest, when = scenario.navigator.slowest(scenario.horizon)
    return {
        "graph": graph_line(scenario, facts),
        **({} if facts.inverse_norm is None else {"‖L⁻¹‖₂": f"{facts.inverse_norm:.4g}"}),
        "robustness": robustness_line(graph, trusted, closely),
        "navigator": f"never slower than {slowest:.4g} m/s (t = {when:.4g} s)",
        "attack": attack_line(scenario, facts),
        "Assumption 1": honest_line(facts),
        **scenario.defence.describe(graph, attacked, trusted),
        **cut_off_line(scenario.defence.may_drop(graph, trusted)),
        **(held_lines(scenario, known) if scenario.law.holds else safe_lines(scenario, known, closely)),
        **drawn_lines(cells),
    }


def safe_lines(scenario: Scenario, known: Situation, closely: bool) -> dict[str, str]:
    """Who is safe, and what breaks it."""
    reasons = safe_in(scenario, known.graph, known.attacked)
    lines = {"safe": safe_line(reasons), **announcement_lines(scenario, reasons)}
    return lines | (margin_lines(scenario, known.graph) if closely and scenario.attack.present else {})


def announcement_lines(scenario: Scenario, reasons: Sequence[Safe]) -> dict[str, str]:
    """What safety by announcements rests on, and what theorem 3 allows of the motion."""
    if not scenario.defence.announcing() or not scenario.attack.present:
        return {}
    announcement = scenario.attack.announcement()
    if not announcement.consistent:
        told = f"attacked links announce {announcement.kind}, not what they carry; nobody is safe by majority"
        return {"B1": f"broken: {told}"}
    lines = {"B1": "assumed: attacked links announce what they carry (announces: consistent)"}
    majority = np.any([each.vehicles for each in reasons if each.consistent] or [[False]], axis=0)
    majority &= ~np.any([each.vehicles for each in reasons if not each.consistent], axis=0)
    return lines | ({"theorem 3": theorem_line(scenario, majority)} if majority.any() else {})


def theorem_line(scenario: Scenario, majority: Vehicles) -> str:
    """The ultimate error that theorem 3 allows vehicles that are safe by majority."""
    reach, fastest = spread_of(scenario), scenario.attack.fastest()
    if reach is None or not np.isfinite(fastest):
        return f"‖E‖ ends within ‖h‖₁ γ Λ h, of which Λ is not known here; {ASSUMED}"
    gain = np.array([median(each) for each in scenario.gain])
    slopes = announced.between_ticks(reach, gain, fastest, scenario.tick, scenario.attack.harmonic())
    return f"‖E‖ ends within ‖h‖₁ γ Λ h = {slopes[majority].max():.3g} ā; {ASSUMED}"


def held_lines(scenario: Scenario, known: Situation) -> dict[str, str]:
    """Whether the loop is stable where the law has a jerk held, and that nobody is known to be safe."""
    return {"law": stability_line(scenario, known), "safe": SOLVED_ALONE}


def stability_line(scenario: Scenario, known: Situation) -> str:
    """By what deviations are multiplied at a tick, and how many rounds it takes, where the law makes such."""
    law, tick, kept = scenario.law, scenario.tick, known.retained
    if scenario.vehicles > certificate.MOST_INVERTED:
        return f"stability is told of {certificate.MOST_INVERTED:,} vehicles at most"
    fixed = None if kept is None else kept.fixed
    honest = ~(known.attacked & scenario.attack.replaces())
    weights = dense((known.graph if fixed is None else fixed).only(honest))
    left = law.left(rounds.eigenvalues(weights))
    if left is None:
        return f"{law.kind}: nothing is known of its stability"
    gain = np.array([median(each) for each in scenario.gain])
    grown = rounds.growth(left, gain, tick)
    line = f"{'stable' if grown < 1 else 'UNSTABLE'}, deviations times {grown:.4f} at each tick of {tick:g} s"
    if law.jacobi:
        line += f"; {rounds_told(rounds.least_rounds(weights, gain, tick))}"
    return line + "; that is while everybody is retained" * (fixed is None)


def rounds_told(least: tuple[int, int] | None) -> str:
    """How many rounds it takes, of the least number and one from which on all are stable."""
    if least is None:
        return "no number of rounds is stable at this tick"
    few, surely = least
    line = f"{count(few, 'round')} {'is' if few == 1 else 'are'} the least that is stable"
    return line + f", and every number from {surely} on" * (surely > few)


def graph_line(scenario: Scenario, facts: certificate.Certificate) -> str:
    """How many hear how many."""
    degrees = {
        int(degree): ranges((np.flatnonzero(facts.heard == degree) + 1).tolist())
        for degree in sorted(set(facts.heard.tolist()))
    }
    hears = "; ".join(f"{who} hear{plural_s(who)} {count(n, 'source')}" for n, who in degrees.items())
    return f"{count(scenario.vehicles, 'vehicle')}, {count(int(facts.heard.sum()), 'link')}: {hears}"


def attack_line(scenario: Scenario, facts: certificate.Certificate) -> str:
    """Who is attacked and how."""
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
    return f"{who} {how}{instead}, {count(len(facts.attacked_links), 'link')}{orders_told(attack)}"


def orders_told(attack: AnyAttack) -> str:
    """Where what is received of an attacked source is not a path with its derivatives, or is not bounded."""
    if not attack.bounded:
        return "; not bounded by ā, so no bound says anything"
    if attack.consistent():
        return ""
    which = ", ".join(ORDER_NAMES[order] for order in attack.falsified())
    return f"; {which} falsified each on its own, so the static bound says nothing"


def honest_line(facts: certificate.Certificate) -> str:
    """The paper's Assumption 1: an honest neighbour, and an honest path from the navigator, for each."""
    if not facts.cut_off:
        return "holds: an honest path from the navigator to every vehicle"
    line = f"broken: no honest path from the navigator to {ranges(facts.cut_off)}"
    if facts.all_attacked:
        line += f"; {ranges(facts.all_attacked)} hear{plural_s(ranges(facts.all_attacked))} nobody honest"
    return line


def robustness_line(graph: Digraph, trusted: Links, closely: bool) -> str:
    """What rules of the literature ask for, as far as it tells anything where there is one navigator."""
    line = "exactly 1-robust with the navigator, as every graph that it reaches; W-MSR with F = 1 asks for 3"
    if closely:
        found = robustness.robustness(dense(graph)[:, 1:] > 0)
        line += f"; the vehicles alone {len(found)}-robust"
        if found:
            most = max(r for r, s in enumerate(found, 1) if s >= r)
            line += f" and ({most}, {found[most - 1]})-robust"
    leaders = np.isin(np.arange(graph.vehicles + 1), graph.sources[trusted])
    if leaders[1:].any() and not leaders[1:].all():
        names = ranges(np.flatnonzero(leaders).tolist())
        reached = vehicle_numbers(robustness.followers(graph, trusted, leaders) & ~leaders[1:])
        line += f"; led by {names}, whom somebody trusts, strongly {robustness.led(graph, leaders)}-robust,"
        line += f" and percolation with F = 1 reaches {ranges(reached) or 'nobody else'}"
    return line


def cut_off_line(drops: AnySubset) -> dict[str, str]:
    """Who may lose the navigator by whom vehicles drop, if anybody."""
    lost = vehicle_numbers(~safety.stay_joined(drops, np.ones(drops.graph.vehicles, bool)))
    return {"cut off": f"{ranges(lost)} may be, by whom they drop"} if lost else {}


def safe_line(reasons: Sequence[Safe]) -> str:
    """Who ends on the navigator whatever attackers say, each by the strongest reason."""
    words, left = [], np.ones(len(reasons[0].vehicles), bool)
    for why, vehicles, _ in reasons:
        words += [f"{vehicles_named(vehicles & left)} {why}"] if (vehicles & left).any() else []
        left &= ~vehicles
    return "; ".join(words + [f"not known of {ranges(vehicle_numbers(left))}"] * bool(left.any()))


def vehicles_named(vehicles: Vehicles) -> str:
    """Vehicles by their numbers."""
    return "every vehicle" if vehicles.all() else ranges(vehicle_numbers(vehicles))


def margin_lines(scenario: Scenario, graph: Digraph) -> dict[str, str]:
    """By which attacked vehicles it is not known who is safe, and how many more it takes of the others."""

    def safe(attacked: list[int]) -> Vehicles:
        reasons = safe_in(scenario, graph, scenario.attack.on(attacked).links(graph))
        return np.any([each.vehicles for each in reasons], axis=0)

    everyone = range(1, graph.vehicles + 1)
    found, by = certificate.margin(safe, scenario.attack.targets() or everyone, graph.vehicles), {}
    for i, sets in zip(everyone, found.sets, strict=True):
        if any(sets):
            by.setdefault(" or ".join(map(set_named, sets)), []).append(i)
    words = [f"{ranges(those)} by {sets} alone" for sets, those in by.items()]
    for more in np.unique(found.further[found.further > 0]).tolist():
        far = f"no {certificate.MOST_TRIED}" if more > certificate.MOST_TRIED else str(more)
        words.append(f"{vehicles_named(found.further == more)} by {far} more")
    words = [*words[:SOME], *["…"] * (len(words) > SOME)]
    return {"broken": "; ".join(words)} if words else {}


def set_named(vehicles: Sequence[int]) -> str:
    """A set of vehicles: 2, {2, 5}."""
    words = ", ".join(map(str, vehicles))
    return f"{{{words}}}" if len(vehicles) > 1 else words


def drawn_lines(cells: Sequence[Cell]) -> dict[str, str]:
    """Where weights or gains differ from lane to lane, and what that means for what is said."""
    weights = [cell.number for cell in cells if cell.scenario.topology.differs()]
    gain = [cell.number for cell in cells if any(map(is_drawn, cell.scenario.gain))]
    lines = {}
    if weights:
        lines["weights"] = f"drawn in {cells_named(weights)}; what is said is of their medians"
    if gain:
        held = cells[0].scenario.law.holds
        told = "what is said is of their medians" if held else "stable whatever is drawn"
        lines["gain"] = f"drawn in {cells_named(gain)}; {told}"
    return lines


def size(count_bytes: float) -> str:
    """Bytes in the unit that suits."""
    for unit in ("B", "kB", "MB", "GB"):
        if count_bytes < 1000:
            return f"{count_bytes:.3g} {unit}"
        count_bytes /= 1000
    return f"{count_bytes:.3g} TB"
