"""The report of `jaxnet check`: what holds in all cells, and what differs by which key."""

import re
from collections.abc import Hashable, Mapping, Sequence
from functools import partial
from textwrap import fill
from typing import NamedTuple

from rich.filesize import decimal

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.idle import idle_keys
from jaxnet.config.keys import Channel, Scenario, Sequential
from jaxnet.config.naming import Combination, boxes_of, format_value, value_alone
from jaxnet.config.scenario import for_any_signal, situation_of
from jaxnet.config.study import Study
from jaxnet.config.sweep import is_joint, keys_in
from jaxnet.kinds.attacks import Attack
from jaxnet.kinds.kind import Kind
from jaxnet.model.wording import cells_named, count
from jaxnet.statistics.amplitude import amplitude_note
from jaxnet.statistics.horizon import cuts_words, ending, errors_words
from jaxnet.statistics.separation import near_starts_words
from jaxnet.store import layout
from jaxnet.theory.case import Case
from jaxnet.theory.theorems import values
from jaxnet.view.text.facts import Facts, lines_of
from jaxnet.view.text.tables import held_words
from jaxnet.view.text.verdict import Claim, claims, verdict_lines
from jaxnet.view.text.width import numbered_words, terminal_width

MOST_NETWORKS = 20  # with searches over sets of vehicles
MOST_NAMED_VALUES = 12  # values of a swept key that are named one by one
MOST_DISTINCT = 6  # of a fact that are told one by one; of more, the ranges of their numbers
MOST_OF_A_KEY = 3  # values in a row, where fewer are left out
MOST_FACT_ROWS = 8  # of a fact
PROGRAM_SECONDS = 2.0  # for the integer programs of all networks together
PROCESS_BYTES = 600e6  # of a process that simulates, without arrays, measured
ARRAY_COPIES = 3  # of a shard's arrays, from the compiled program to the disk
MEASURED = re.compile(  # measured, no vehicle's number
    r"(?<![\w.(])(?:\d+\.\d+(?:e[+-]?\d+)?|\d+e[+-]?\d+|\d+(?:,\d{3})+"
    r"|\d+(?= (?:s|m|ā|rounds?|links?|ticks?)\b)|^\d+(?=$|;))"
)


class AlikeCells(NamedTuple):
    """Cells in which the same is known."""

    cells: list[Cell]
    facts: Facts
    claims: list[Claim]


TitledFacts = tuple[str, dict[str, list[str]]]  # a title, and the rows of each fact


def check_text(study: Study, number: int | None = None) -> str:
    """The whole report; of one cell if `number` is given."""
    cells = study.cells if number is None else [study.cells[number]]
    found, (times, said) = networks(cells), endings(study, cells)
    named = partial(numbered_words, cells=cells)
    warnings = errors_words(study.config, cells, named), cuts_words(cells, named)
    warnings += (f"lanes may fail; {held_words(slow)}",) if (slow := slow_cells(cells)) else ()
    first = [*study_head(study), *(f"WARNING: {each}" for each in warnings if each)]
    said += [(claim, cell.number) for each in found for cell in each.cells for claim in each.claims]
    texts = ["\n".join(verdict_lines(first, said, cells))]
    if number is None or len(found) > 1:
        texts.append(swept_text(study))
    texts.append(amplitude_advice(study))
    texts.append("\n".join(facts_text(*part) for part in parts(found, times)))
    if idle := idle_keys(study):
        texts.append(facts_text("keys without effect", {key: [why] for key, why in idle.items()}))
    lines = "\n\n".join(filter(None, texts)).splitlines()
    return "\n".join(fill(line, terminal_width()) for line in lines)


def certificates(found: Sequence[AlikeCells]) -> list[TitledFacts]:
    """Facts of all cells, then facts that differ, by the keys that decide them."""
    return parts(found, [{}] * sum(len(each.cells) for each in found))


def networks(cells: Sequence[Cell]) -> list[AlikeCells]:
    """Cells grouped by what is known of them, in the order of their first cells."""
    groups: dict[Hashable, list[Cell]] = {}
    for cell in cells:
        groups.setdefault(facts_key(cell.scenario), []).append(cell)
    seconds = PROGRAM_SECONDS / len(groups) if len(groups) <= MOST_NETWORKS else 0.0
    found: dict[Hashable, AlikeCells] = {}
    for group in groups.values():
        case = Case(group[0].scenario, seconds)
        proved = values(case)
        known = lines_of(case, proved)
        said = [*claims(case, proved, known)]
        key = case.scenario.topology.kind, (*known.items(), *said)
        found.setdefault(key, AlikeCells([], known, said)).cells.extend(group)
    return list(found.values())


SIGNAL = {"magnitude", "label"}  # keys of an attack that no fact depends on
NOT_OF_FACTS = {"attack", "metrics"}  # keys of a scenario that are told apart, or not at all


def facts_key(scenario: Scenario) -> Hashable:
    """A key that is equal for cells with equal facts; cells hold the objects of their kinds."""
    attack, announcing = scenario.attack, scenario.defence.announcing()
    signal = (attack.fastest(), attack.harmonic()) if announcing else ()
    signal += (repr(attack.amplitude()),) if scenario.detector.present else ()
    return network_key(scenario), signal


@for_any_signal
def network_key(scenario: Scenario) -> Hashable:
    """The part of `facts_key` that no number of the attack's signal changes."""
    attack = scenario.attack
    known = {*Attack.model_fields} - SIGNAL
    told = attack.describe(), attack.whom(), attack.model_dump_json(include=known)
    told += attack.by_order(), attack.falsified(), attack.periods(), attack.identities()
    told += attack.bounded, attack.consistent(), attack.strategic, attack.moves
    given = [getattr(scenario, key) for key in Scenario.model_fields if key not in NOT_OF_FACTS]
    shared = (id(each) if isinstance(each, Kind | Channel) else repr(each) for each in given)
    return *shared, repr(told)


def study_head(study: Study) -> list[str]:
    """The study's size, memory and disk space."""
    settled, lanes = study.config, study.lanes
    array_bytes = layout.lane_bytes(study.cells, settled.save)
    memory = PROCESS_BYTES + ARRAY_COPIES * array_bytes * layout.shard_size(study.cells, settled)
    disk = decimal(layout.disk_bytes(settled, study.cells, lanes))
    most = "at most " if isinstance(settled.samples, Sequential) else ""
    samples = f"{most}{count(settled.most_samples, 'sample')} = {count(lanes, 'lane')}"
    return [
        f"{settled.name}: {count(len(study.cells), 'cell')} × {samples},"
        f" {settled.engine.kind} engine",
        f"The config is valid; it needs {decimal(round(memory))} of memory and {disk} on disk.",
    ]


def slow_cells(cells: Sequence[Cell]) -> list[Cell]:
    """Cells whose vehicles hold inputs that grow without bound as a vehicle slows down."""
    return [
        cell
        for cell in cells
        if (known := cell.scenario).engine.samples
        and known.vehicle.singular == 1
        and known.law.singular_at_rest()
        and not (known.vehicle.standstill == "stop" and known.vehicle.limits)
    ]


def amplitude_advice(study: Study) -> str:
    """ā in force, and the key that compares errors with it, where τ ā is more than that."""
    asked, note = study.config.recovery, amplitude_note(study.cells)
    if not note or asked is None or asked.of != "magnitude":
        return note
    what = "spreads" if is_leaderless(study.cells) else "errors"
    told = f"recovery compares {what} with tau · ā: give recovery.of: amplitude to compare with the"
    return f"{note}; {told} shift"


def endings(study: Study, cells: Sequence[Cell]) -> tuple[list[Facts], list[tuple[Claim, int]]]:
    """What the study's own draws and lengths tell of each cell, and what they come to."""
    found, ends = list[Facts](), dict[int, str]()
    needed, early, enough = 0.0, "early", "Without attack starts die away before the tail begins"
    for cell in cells:
        near = near_starts_words(study.config, cell.scenario)
        known, apart = ending(cell, study.config), {"apart": near} if near else {}
        if isinstance(known, str):
            told = f"the end of the effect of the start is not known: {known}"
            found.append(apart | {"time": told})
            ends[cell.number] = "It is not known whether starts die away before the tail begins"
            continue
        told = f"the effect of the start is below {known.length:.3g} m after {known.after:.3g} s"
        retained = situation_of(cell.scenario).retained
        if cell.scenario.attack.present and (retained is None or retained.fixed is None):
            told += "; under attack the defence decides when"
        found.append(apart | {"time": f"{told}; the tail begins at {known.begins:g} s"})
        late = known.after > known.begins
        ends[cell.number] = early if late else enough
        needed = max(needed, known.horizon * late)
    words = "WARNING: the tail begins before the effect of the start ends"
    told = {early: (0, f"{words} (`horizon: {needed:g}` is enough)")}
    return found, [(told.get(each, (7, each)), number) for number, each in ends.items()]


def swept_text(study: Study) -> str:
    def told(cell: Cell, written: str) -> str:
        row = ", ".join(value_alone(key, cell.labels[key]) for key in keys_in(written))
        named = is_joint(written) and written in cell.labels
        return f"{cell.labels[written]} [{row}]" if named else f"[{row}]" if "," in row else row

    values = {key: [told(cell, key) for cell in study.cells] for key in study.config.sweep}
    lines = [f"  {key}: {few_values([*dict.fromkeys(each)])}" for key, each in values.items()]
    return "\n".join(["swept, the last fastest:", *lines] if lines else [])


def facts_text(title: str, facts: Mapping[str, Sequence[str]]) -> str:
    """Facts in a terminal's width, in two columns; short rows share a line."""
    lines, width = [title], max(map(len, facts), default=0)
    for name, rows in facts.items():
        lead, line = f"  {name:<{width}}  ", ""
        room = terminal_width() - len(lead)
        packed = []
        for row in rows:
            if line and len(line) + len(row) + 2 > room:
                packed, line = [*packed, line], ""
            line += "  " * bool(line) + row
        for row in [*packed, line]:
            indent = " " * len(lead)
            lines.append(fill(row, terminal_width(), initial_indent=lead, subsequent_indent=indent))
            lead = indent
    return "\n".join(lines)


CellLabels = Sequence[Mapping[str, str]]  # of each cell, the values of the swept keys


def parts(found: Sequence[AlikeCells], more: Sequence[Facts]) -> list[TitledFacts]:
    """The facts of all cells, then those that differ, under the keys that decide them.

    `more` are other facts of each cell, in the order of the cells' numbers.
    """
    ordered = sorted(
        ((cell, one.facts) for one in found for cell in one.cells), key=lambda each: each[0].number
    )
    known = [
        facts | {k: "; ".join(filter(None, (facts.get(k), told))) for k, told in other.items()}
        for (_, facts), other in zip(ordered, more, strict=True)
    ]
    own = [{k: format_value(v) for k, v in cell.labels.items()} for cell, _ in ordered]
    labels = [{k: value_alone(k, v) for k, v in cell.labels.items()} for cell, _ in ordered]
    names = dict.fromkeys(name for each in [*(one.facts for one in found), *more] for name in each)
    first, numbers = ordered[0][0], cells_named([cell.number for cell, _ in ordered])
    title = "in all cells" if len(found) > 1 else f"{first.scenario.topology.kind}, {numbers}"
    by_keys: dict[Combination, dict[str, list[str]]] = {(): {}}
    for name in names:
        told = own if len(found) > 1 else [{}] * len(known)  # what the label says already
        lines = [each.get(name, "") for each in known]
        lines = [
            "" if line == one.get(name) else line for line, one in zip(lines, told, strict=True)
        ]
        for part in by_deciding_keys(labels, lines):
            keys, rows = factor_rows(labels, part)
            if rows:
                by_keys.setdefault(keys, {}).setdefault(name, []).extend(rows)
    shared, *others = sorted(by_keys.items(), key=lambda each: len(each[0]))
    return [(title, shared[1]), *((f"by {'; '.join(keys)}", told) for keys, told in others)]


def by_deciding_keys(labels: CellLabels, lines: Sequence[str]) -> list[list[str]]:
    """Lines in parts, each with the clauses that the same keys decide.

    Clauses that begin alike are of one kind. Lines whose first clauses differ are told whole.
    """
    found = [[(clause_kind(each), each) for each in line.split("; ") if each] for line in lines]
    if len({*lines}) == 1 or len({each[0][0] for each in found if each}) > 1:
        return [[*lines]]
    parts: dict[Combination, list[list[str]]] = {}
    for kind in dict.fromkeys(kind for each in found for kind, _ in each):
        told = ["; ".join(clause for own, clause in each if own == kind) for each in found]
        parts.setdefault((*deciding_keys(labels, told),), []).append(told)
    return [
        ["; ".join(filter(None, row)) for row in zip(*part, strict=True)] for part in parts.values()
    ]


def clause_kind(clause: str) -> str:
    """The first words of a clause, without numbers."""
    return " ".join([word for word in clause.split() if not any(map(str.isdigit, word))][:5])


def factor_rows(labels: CellLabels, lines: Sequence[str]) -> tuple[Combination, list[str]]:
    """The names of the fewest keys that decide a fact, and a row for each text with its values."""
    if len(set(lines)) > MOST_DISTINCT:
        lines = with_ranges(lines)
    keys = deciding_keys(labels, lines)
    where: dict[str, set[Combination]] = {}
    for one, line in zip(labels, lines, strict=True):
        where.setdefault(line, set()).add(tuple(one[key] for key in keys))
    if not keys:
        return (), [*filter(None, where)]
    every = [list(dict.fromkeys(one[key] for one in labels)) for key in keys]
    rows = []
    for line, combinations in where.items():
        boxes = ("; ".join(map(values_text, box, every)) for box in boxes_of(sorted(combinations)))
        rows += [f"{' '.join(f'[{box}]' for box in boxes)} {line}"] * bool(line)
    if len(rows) > MOST_FACT_ROWS:
        rows[MOST_FACT_ROWS:] = [f"and {count(len(rows) - MOST_FACT_ROWS, 'row')} more …"]
    last = {key: key.rpartition(".")[2] for key in labels[0]}
    short = {key: key if each.isdigit() else each for key, each in last.items()}
    last_words = [*short.values()]
    return tuple(short[key] if last_words.count(short[key]) == 1 else key for key in keys), rows


def values_text(values: Combination, known: Sequence[str]) -> str:
    """Values of a key in their order, or those that are not among them if these are fewer."""
    others = [value for value in known if value not in values]
    if not others:
        return "any"
    if len(others) < len(values) > MOST_OF_A_KEY:
        return f"not {', '.join(others)}"
    return few_values(sorted(values, key=known.index))


def few_values(values: Sequence[str]) -> str:
    if len(values) <= MOST_NAMED_VALUES:
        return ", ".join(values)
    return f"{', '.join(values[: MOST_NAMED_VALUES - 1])}, … {values[-1]} ({len(values)} values)"


def with_ranges(lines: Sequence[str]) -> list[str]:
    """Lines that differ in numbers alone, with the least and greatest of these."""
    groups: dict[str, list[list[str]]] = {}
    for line in lines:
        groups.setdefault(MEASURED.sub("#", line), []).append(MEASURED.findall(line))
    merged = {}
    for template, numbers in groups.items():
        spans = [
            sorted(set(each), key=lambda one: float(one.replace(",", "")))
            for each in zip(*numbers, strict=True)
        ]
        told = iter([each[0] if len(each) == 1 else f"{each[0]} to {each[-1]}" for each in spans])
        merged[template] = "".join(next(told) if each == "#" else each for each in template)
    return [merged[MEASURED.sub("#", line)] for line in lines]


def deciding_keys(labels: CellLabels, lines: Sequence[str]) -> list[str]:
    """Keys that decide a line, of which none can be left out."""
    keys = list(labels[0])
    for key in reversed([*labels[0]]):
        fewer = [each for each in keys if each != key]
        decided: dict[Combination, str] = {}
        values = [tuple(one[each] for each in fewer) for one in labels]
        pairs = zip(values, lines, strict=True)
        if all(decided.setdefault(each, line) == line for each, line in pairs):
            keys = fewer
    return keys
