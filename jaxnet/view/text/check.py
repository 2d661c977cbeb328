"""What `jaxnet check` prints: the cells, and for each network what it promises. No JAX."""

import re
from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.config.keys import Scenario, Sequential
from jaxnet.config.scenario import situation_of
from jaxnet.config.study import Study
from jaxnet.kinds.attacks import AnyAttack
from jaxnet.kinds.fields import is_drawn
from jaxnet.kinds.kind import numbered
from jaxnet.model.safety import Safe
from jaxnet.model.wording import cells_named, count, plural_s, ranges
from jaxnet.store import layout
from jaxnet.theory import certificate
from jaxnet.view.text.width import WIDTH, clipped

ORDER_NAMES = ("position", "velocity", "acceleration", "jerk")
MOST_CELLS = 20  # told one by one; of more, what is swept
MOST_WHOLE = 4  # networks told in full; of more, what is not as in the first
MOST_NETWORKS = 20
SOME = 12  # values or cells that are named one by one
PROCESS_BYTES = 600e6  # of a process that simulates, without arrays, measured
COPIES = 3  # of a shard's arrays, from the compiled program to the disk


def text(study: Study) -> str:
    """The whole report."""
    parts = [head(study), cell_list(study.cells), *networks(study.cells)]
    return "\n\n".join(part for part in parts if part)


def certificates(cells: Sequence[Cell]) -> list[str]:
    """What each network promises, with the cells that share it."""
    return [network_text(title(group, len(group)), network_rows(group)) for group in alike(cells)]


def networks(cells: Sequence[Cell]) -> list[str]:
    """The same for a terminal, of which as much is said once: of many the first, and how others differ."""
    found: dict[Any, list[Cell]] = {}
    for group in alike(cells):
        key = group[0].scenario.topology.kind, tuple(network_rows(group).items())
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
    for cell in cells:
        groups.setdefault(network_key(cell), []).append(cell)
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


def network_key(cell: Cell) -> Any:
    """What cells share that have one network, one kind of attack and of defence, and one navigator."""
    scenario = cell.scenario
    weights, attacked, trusted, _ = situation_of(scenario)
    words = scenario.navigator.model_dump_json(), scenario.defence.model_dump_json(), scenario.attack.kind
    return weights.tobytes(), attacked.tobytes(), trusted.tobytes(), words, scenario.horizon


def title(cells: Sequence[Cell], most: int) -> str:
    """Which network, and the cells that have it, or the first of them."""
    named = cells_named(sorted(cell.number for cell in cells)[:most])
    more = f" and {len(cells) - most} more" if len(cells) > most else ""
    return f"{cells[0].scenario.topology.kind}, {named}{more}"


def network_text(title: str, rows: Mapping[str, str]) -> str:
    """A line per row, under the title."""
    width = max(map(len, rows), default=0)
    return "\n".join([title, *(f"  {name:<{width}}  {line}" for name, line in rows.items())])


def network_rows(cells: Sequence[Cell]) -> dict[str, str]:
    """Certificate of the network that these cells share, where weights are drawn the one of their medians."""
    scenario = cells[0].scenario
    weights, attacked, trusted, _ = situation_of(scenario)
    facts = certificate.certify(weights, attacked)
    slowest, when = scenario.navigator.slowest(scenario.horizon)
    return {
        "graph": graph_line(scenario, facts),
        "reach": "the navigator reaches every vehicle",
        "‖L⁻¹‖₂": f"{facts.inverse_norm:.4g}",
        "robustness": f"exactly {certificate.robustness(weights)}-robust with the navigator, as every"
        " graph that it reaches; W-MSR with F = 1 asks for 3",
        "navigator": f"never slower than {slowest:.4g} m/s (t = {when:.4g} s)",
        "attack": attack_line(scenario, facts),
        "Assumption 1": honest_line(facts),
        **scenario.defence.describe(weights, attacked, trusted),
        "safe": safe_line(scenario.defence.safe(weights, attacked, trusted)),
        **drawn_lines(cells),
    }


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


def safe_line(safe: Safe) -> str:
    """Who ends on the navigator whatever attackers say, and of whom that is not known."""
    if safe.vehicles.all():
        return f"every vehicle, {safe.why}"
    rest = f"not known of {ranges(numbered(~safe.vehicles))}"
    return f"{ranges(numbered(safe.vehicles))}, {safe.why}; {rest}" if safe.vehicles.any() else rest


def drawn_lines(cells: Sequence[Cell]) -> dict[str, str]:
    """Where weights or gains differ from lane to lane, and what that means for what is said."""
    weights = [cell.number for cell in cells if cell.scenario.topology.differs()]
    gain = [cell.number for cell in cells if any(map(is_drawn, cell.scenario.gain))]
    lines = {}
    if weights:
        lines["weights"] = f"drawn in {cells_named(weights)}; ‖L⁻¹‖₂ is of the graph of their medians"
    if gain:
        lines["gain"] = f"drawn in {cells_named(gain)}; stable whatever is drawn"
    return lines


def size(count_bytes: float) -> str:
    """Bytes in the unit that suits."""
    for unit in ("B", "kB", "MB", "GB"):
        if count_bytes < 1000:
            return f"{count_bytes:.3g} {unit}"
        count_bytes /= 1000
    return f"{count_bytes:.3g} TB"
