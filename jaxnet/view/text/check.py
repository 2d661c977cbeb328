"""What `jaxnet check` prints: the cells, and for each network what it promises. No JAX."""

from collections.abc import Sequence
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

ORDER_NAMES = ("position", "velocity", "acceleration", "jerk")
MOST_CELLS = 60
PROCESS_BYTES = 600e6  # of a process that simulates, without arrays, measured
COPIES = 3  # of a shard's arrays, from the compiled program to the disk


def text(study: Study) -> str:
    """The whole report."""
    parts = [head(study), cell_list(study.cells), *certificates(study.cells)]
    return "\n\n".join(part for part in parts if part)


def certificates(cells: Sequence[Cell]) -> list[str]:
    """What each network promises, with the cells that share it."""
    groups: dict[Any, list[Cell]] = {}
    for cell in cells:
        groups.setdefault(network_key(cell), []).append(cell)
    return [network_text(group) for group in groups.values()]


def head(study: Study) -> str:
    """Size of the study."""
    settled, lanes = study.config, study.lanes
    array_bytes = layout.lane_bytes(study.cells, settled.save)
    memory = PROCESS_BYTES + COPIES * array_bytes * layout.shard_size(study.cells, settled)
    disk = layout.disk_bytes(settled, study.cells, lanes)
    cells = count(len(study.cells), "cell")
    most = "at most " if isinstance(settled.samples, Sequential) else ""
    return (
        f"{settled.name}: {cells} × {most}{count(settled.most_samples, 'sample')} = {count(lanes, 'lane')}, "
        f"{settled.engine.kind} engine, nothing wrong\n"
        f"about {size(memory)} of memory; at most {size(float(disk))} on disk"
    )


def cell_list(cells: Sequence[Cell]) -> str:
    """The cells, one a line."""
    lines = [str(cell) for cell in cells[:MOST_CELLS]]
    if len(cells) > MOST_CELLS:
        lines.append(f"… {len(cells) - MOST_CELLS} more")
    return "\n".join(lines) if cells[0].labels else ""


def network_key(cell: Cell) -> Any:
    """What cells share that have one network, one kind of attack and of defence, and one navigator."""
    scenario = cell.scenario
    weights, attacked, trusted, _ = situation_of(scenario)
    words = scenario.navigator.model_dump_json(), scenario.defence.model_dump_json(), scenario.attack.kind
    return weights.tobytes(), attacked.tobytes(), trusted.tobytes(), words, scenario.horizon


def network_text(cells: Sequence[Cell]) -> str:
    """Certificate of the network that these cells share, where weights are drawn the one of their medians."""
    scenario = cells[0].scenario
    weights, attacked, trusted, _ = situation_of(scenario)
    facts = certificate.certify(weights, attacked)
    slowest, when = scenario.navigator.slowest(scenario.horizon)
    rows = {
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
    title = f"{scenario.topology.kind}, {cells_named([cell.number for cell in cells])}"
    width = max(map(len, rows))
    return "\n".join([title, *(f"  {name:<{width}}  {line}" for name, line in rows.items())])


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
    who = f"{attack.describe()} on {ranges(sorted(attack.targets()))}"
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
