"""What `jaxnet check` prints: the cells, and for each network what it promises. No JAX."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnet.config import keys as config
from jaxnet.config.cells import Cell
from jaxnet.config.network import network_of, slowest_of, weights_are_drawn
from jaxnet.config.study import Study
from jaxnet.store import layout
from jaxnet.theory import certificate

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
    most = "at most " if isinstance(settled.samples, config.Sequential) else ""
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
    """What cells share that have one network, one kind of attack and one navigator."""
    scenario = cell.scenario
    arrays = tuple(part.tobytes() for part in network_of(scenario))
    horizon = scenario.horizon
    return (
        arrays,
        scenario.attack.kind,
        scenario.navigator.model_dump_json(),
        scenario.defence.kind,
        horizon,
    )


def network_text(cells: Sequence[Cell]) -> str:
    """Certificate of the network that these cells share, where weights are drawn the one of their medians."""
    scenario, network = cells[0].scenario, network_of(cells[0].scenario)
    facts = certificate.certify(network.weights, network.attacked, network.trusted, network.theta)
    slowest, when = slowest_of(scenario)
    rows = {
        "graph": graph_line(scenario, facts),
        "reach": "the navigator reaches every vehicle",
        "‖L⁻¹‖₂": f"{facts.inverse_norm:.4g}",
        "robustness": f"exactly {certificate.robustness(network.weights)}-robust with the navigator, as every"
        " graph that it reaches; W-MSR with F = 1 asks for 3",
        "navigator": f"never slower than {slowest:.4g} m/s (t = {when:.4g} s)",
        "attack": attack_line(scenario, facts),
        "Assumption 1": honest_line(facts),
        "trimming": trimming_line(scenario, network.theta, facts),
        **drawn_lines(cells),
    }
    title = f"{scenario.topology.kind}, cells {ranges([cell.number for cell in cells])}"
    width = max(map(len, rows))
    return "\n".join([title, *(f"  {name:<{width}}  {line}" for name, line in rows.items())])


def graph_line(scenario: config.Scenario, facts: certificate.Certificate) -> str:
    """How many hear how many."""
    degrees = {
        int(degree): ranges((np.flatnonzero(facts.heard == degree) + 1).tolist())
        for degree in sorted(set(facts.heard.tolist()))
    }
    hears = "; ".join(f"{who} hear{plural_s(who)} {count(n, 'source')}" for n, who in degrees.items())
    return f"{count(scenario.vehicles, 'vehicle')}, {count(int(facts.heard.sum()), 'link')}: {hears}"


def attack_line(scenario: config.Scenario, facts: certificate.Certificate) -> str:
    """Who is attacked and how."""
    attack = scenario.attack
    if not isinstance(attack, config.Attacked):
        return "none"
    if not facts.attacked_links:
        return f"{attack.kind} on {ranges(sorted(attack.vehicles))}, heard by nobody"
    if any(source == 0 for _, source in facts.attacked_links):
        how = "in what they hear of the navigator"
    else:
        how = "in what they transmit"
    return (
        f"{attack.kind} on {ranges(sorted(attack.vehicles))} {how},"
        f" {count(len(facts.attacked_links), 'link')}"
    )


def honest_line(facts: certificate.Certificate) -> str:
    """The paper's Assumption 1: an honest neighbour, and an honest path from the navigator, for each."""
    if not facts.cut_off:
        return "holds: an honest path from the navigator to every vehicle"
    line = f"broken: no honest path from the navigator to {ranges(facts.cut_off)}"
    if facts.all_lies:
        line += f"; {ranges(facts.all_lies)} hear{plural_s(ranges(facts.all_lies))} nobody honest"
    return line


def trimming_line(scenario: config.Scenario, theta: np.ndarray, facts: certificate.Certificate) -> str:
    """For whom |N_i| ≥ 2ϑ_i + 1 holds with ϑ_i trusted sources."""
    if isinstance(scenario.defence, config.NoDefence):
        return "no defence"
    values = ", ".join(str(value) for value in sorted(set(theta.tolist())))
    rule = f"ϑ = {values}, |N_i| ≥ 2ϑ + 1 with ϑ trusted: "
    unprotected = [i for i in range(1, scenario.vehicles + 1) if i not in facts.protected]
    if not facts.protected:
        return rule + "nobody is protected, so everybody keeps whom they hear"
    line = rule + (
        "holds for every vehicle"
        if not unprotected
        else f"holds for {ranges(facts.protected)} only; {ranges(unprotected)} unprotected"
    )
    if facts.outnumbered:
        line += f"; more than ϑ attacked sources, or a trusted one, at {ranges(facts.outnumbered)}"
    return line


def drawn_lines(cells: Sequence[Cell]) -> dict[str, str]:
    """Where weights or gains differ from lane to lane, and what that means for what is said."""
    weights = [cell.number for cell in cells if weights_are_drawn(cell.scenario)]
    gain = [cell.number for cell in cells if any(map(config.is_drawn, cell.scenario.gain))]
    lines = {}
    if weights:
        lines["weights"] = f"drawn in cells {ranges(weights)}; ‖L⁻¹‖₂ is of the graph of their medians"
    if gain:
        lines["gain"] = f"drawn in cells {ranges(gain)}; stable whatever is drawn"
    return lines


def ranges(numbers: Sequence[int]) -> str:
    """Numbers with runs drawn together: 1-3, 5."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs)


def plural_s(who: str) -> str:
    """The verb's ending for one or several."""
    return "s" if who.isdigit() else ""


def count(number: int, noun: str) -> str:
    """A number of things."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def size(count_bytes: float) -> str:
    """Bytes in the unit that suits."""
    for unit in ("B", "kB", "MB", "GB"):
        if count_bytes < 1000:
            return f"{count_bytes:.3g} {unit}"
        count_bytes /= 1000
    return f"{count_bytes:.3g} TB"
