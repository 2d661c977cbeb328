"""The report of `jaxnet check`: what holds in all cells, and what differs by which key."""

import re
from collections.abc import Hashable, Mapping, Sequence
from textwrap import fill
from typing import NamedTuple

from rich.filesize import decimal

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.idle import idle_keys
from jaxnet.config.keys import Channel, Scenario, Sequential
from jaxnet.config.naming import format_value
from jaxnet.config.scenario import for_any_signal, situation_of
from jaxnet.config.study import Study
from jaxnet.config.sweep import is_joint, keys_in
from jaxnet.kinds.attacks import Attack
from jaxnet.kinds.kind import Kind
from jaxnet.model.wording import cells_named, count
from jaxnet.statistics.amplitude import amplitude_note
from jaxnet.statistics.horizon import ending, errors_words
from jaxnet.store import layout
from jaxnet.view.text.facts import UNSTABLE, Facts, facts
from jaxnet.view.text.printer import table_text
from jaxnet.view.text.width import terminal_width

MOST_NETWORKS = 20  # with searches over sets of vehicles
MOST_NAMED_VALUES = 12  # values of a swept key that are named one by one
MOST_DISTINCT = 6  # of a fact that are told one by one; of more, the ranges of their numbers
MOST_OF_A_KEY = 3  # values in a row, where fewer are left out
MOST_TABLE_ROWS = 8  # of the table of a fact
MOST_KEY_LETTERS = 24  # of a key's column
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

    @property
    def text(self) -> str:
        numbers = sorted(cell.number for cell in self.cells)
        title = f"{self.cells[0].scenario.topology.kind}, {cells_named(numbers)}"
        return titled(title, self.facts)


def check_text(study: Study, number: int | None = None) -> str:
    """The whole report; of one cell if `number` is given."""
    cells = study.cells if number is None else [study.cells[number]]
    found = networks(cells)
    noise = errors_words(study.config, study.cells)
    warnings = [*unstable_words(found), *[wrap_lines(f"WARNING: {noise}")] * bool(noise)]
    parts = ["\n".join([study_head(study), *warnings])]
    if number is None or len(found) > 1:
        parts.append(wrap_lines(swept_text(study)))
    parts.append(wrap_lines(amplitude_note(study.cells) + amplitude_advice(study)))
    parts += [wrap_lines(found[0].text)] if len(found) == 1 else differing(found)
    parts.append(endings_text(study, cells))
    if idle := idle_keys(study):
        parts.append(wrap_lines(titled("keys without effect", idle)))
    return "\n\n".join(filter(None, parts))


def certificates(cells: Sequence[Cell]) -> list[str]:
    """What is known of all cells, then what differs, by the keys that decide it."""
    found = networks(cells)
    return differing(found) if len(found) > 1 else [found[0].text]


def networks(cells: Sequence[Cell]) -> list[AlikeCells]:
    """Cells grouped by what is known of them, in the order of their first cells."""
    groups: dict[Hashable, list[Cell]] = {}
    for cell in cells:
        groups.setdefault(facts_key(cell.scenario), []).append(cell)
    seconds = PROGRAM_SECONDS / len(groups) if len(groups) <= MOST_NETWORKS else 0.0
    found: dict[Hashable, AlikeCells] = {}
    for group in groups.values():
        known = facts(group[0].scenario, seconds)
        key = group[0].scenario.topology.kind, tuple(known.items())
        found.setdefault(key, AlikeCells([], known)).cells.extend(group)
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


def study_head(study: Study) -> str:
    """The study's size, memory and disk space."""
    settled, lanes = study.config, study.lanes
    array_bytes = layout.lane_bytes(study.cells, settled.save)
    memory = PROCESS_BYTES + ARRAY_COPIES * array_bytes * layout.shard_size(study.cells, settled)
    disk = layout.disk_bytes(settled, study.cells, lanes)
    most = "at most " if isinstance(settled.samples, Sequential) else ""
    samples = f"{most}{count(settled.most_samples, 'sample')} = {count(lanes, 'lane')}"
    return wrap_lines(
        f"{settled.name}: {count(len(study.cells), 'cell')} × {samples},"
        f" {settled.engine.kind} engine, no faults\n"
        f"about {decimal(round(memory))} of memory; about {decimal(disk)} on disk"
    )


def unstable_words(found: Sequence[AlikeCells]) -> list[str]:
    """A warning for each fact that tells of an unstable law, with its cells."""
    where: dict[str, list[int]] = {}
    for each in found:
        for name, line in each.facts.items():
            if UNSTABLE in line:
                where.setdefault(name, []).extend(cell.number for cell in each.cells)
    words = "WARNING: unstable, deviations grow, in"
    return [
        wrap_lines(f"{words} {cells_named(sorted(numbers))}: see {name}")
        for name, numbers in where.items()
    ]


def amplitude_advice(study: Study) -> str:
    """The key that compares errors with the amplitude in force, where τ ā is more than that."""
    asked = study.config.recovery
    if asked is None or asked.of != "magnitude" or not amplitude_note(study.cells):
        return ""
    what = "spreads" if is_leaderless(study.cells) else "errors"
    return (
        f"; recovery compares {what} with tau · ā: give recovery.of: amplitude to compare with the"
        " shift"
    )


def endings_text(study: Study, cells: Sequence[Cell]) -> str:
    """From when a start is below what the study asks for, and which cells' tails begin sooner."""
    lines, early, needed = [], list[int](), 0.0
    for cell in cells:
        found = ending(cell, study.config)
        if isinstance(found, str):
            lines.append(f"it is not known when the effect of the start ends: {found}")
            continue
        when = f"the effect of the start is below {found.length:.3g} m after {found.after:.3g} s"
        retained = situation_of(cell.scenario).retained
        if cell.scenario.attack.present and (retained is None or retained.fixed is None):
            when += "; under attack this is not known, as the defence decides"
        lines.append(f"{when}; the tail begins at {found.begins:g} s")
        if found.after > found.begins:
            early.append(cell.number)
            needed = max(needed, found.horizon)
    labels = [{k: format_value(v) for k, v in cell.labels.items()} for cell in cells]
    told = "\n".join(
        wrap_lines(f"time: {part[0]}")
        if len(set(part)) == 1
        else factor_table("time", labels, part)
        for part in by_deciding_keys(labels, lines)
    )
    if early:
        words = "WARNING: the tail begins before the effect of the start ends, in"
        enough = f"horizon: {needed:g} is enough for the start"
        told += "\n" + wrap_lines(f"{words} {cells_named(early)}: {enough}")
    return told


def swept_text(study: Study) -> str:
    def told(cell: Cell, written: str) -> str:
        row = ", ".join(format_value(cell.labels[key]) for key in keys_in(written))
        named = is_joint(written) and written in cell.labels
        return f"{cell.labels[written]} [{row}]" if named else f"[{row}]" if "," in row else row

    values = {key: [told(cell, key) for cell in study.cells] for key in study.config.sweep}
    lines = [f"  {key}: {few_values([*dict.fromkeys(each)])}" for key, each in values.items()]
    return "\n".join(["swept, the last fastest:", *lines] if lines else [])


def titled(title: str, lines: Mapping[str, str]) -> str:
    width = max(map(len, lines), default=0)
    return "\n".join([title, *(f"  {name:<{width}}  {line}" for name, line in lines.items())])


def wrap_lines(text: str) -> str:
    """Wrap lines to a terminal's width; continuation lines keep the indent of the text column."""
    lines = []
    for line in text.splitlines():
        under = re.match(r"  \S.*?  +|", line)
        indent = " " * (under.end() if under else 0)
        lines.append(fill(line, terminal_width(), subsequent_indent=indent))
    return "\n".join(lines)


CellLabels = Sequence[Mapping[str, str]]  # of each cell, the values of the swept keys
Combination = tuple[str, ...]  # values of some swept keys


def differing(found: Sequence[AlikeCells]) -> list[str]:
    """The facts of all cells, and a table for each fact that differs: where it is so."""
    names = dict.fromkeys(name for network in found for name in network.facts)
    by_cell = [(cell, network.facts) for network in found for cell in network.cells]
    labels = [{k: format_value(v) for k, v in cell.labels.items()} for cell, _ in by_cell]
    common, tables = {}, []
    for name in names:
        lines = [known.get(name, "") for _, known in by_cell]
        if any(line not in ("", one.get(name)) for line, one in zip(lines, labels, strict=True)):
            for part in by_deciding_keys(labels, lines):
                if len(set(part)) == 1:
                    common[name] = part[0]
                else:
                    tables.append(factor_table(name, labels, part))
    return [wrap_lines(titled("in all cells", common)) if common else "", "\n".join(tables)]


def by_deciding_keys(labels: CellLabels, lines: Sequence[str]) -> list[list[str]]:
    """Lines in parts, each with the clauses that the same keys decide.

    Lines that do not begin with the same words are told whole.
    """
    found = [
        [(MEASURED.sub("#", each).replace("# ticks", "# tick"), each) for each in line.split("; ")]
        for line in lines
    ]
    if len({*lines}) == 1 or len({each[0][0] for each in found if each[0][0]}) > 1:
        return [[*lines]]
    parts: dict[Combination, list[list[str]]] = {}
    for words in dict.fromkeys(words for each in found for words, _ in each if words):
        told = ["; ".join(clause for own, clause in each if own == words) for each in found]
        parts.setdefault((*deciding_keys(labels, told),), []).append(told)
    return [
        ["; ".join(filter(None, row)) for row in zip(*part, strict=True)] for part in parts.values()
    ]


def factor_table(name: str, labels: CellLabels, lines: Sequence[str]) -> str:
    """A fact by the fewest keys that decide it."""
    if len(set(lines)) > MOST_DISTINCT:
        lines = with_ranges(lines)
    keys = deciding_keys(labels, lines)
    where: dict[str, set[Combination]] = {}
    for one, line in zip(labels, lines, strict=True):
        where.setdefault(line, set()).add(tuple(one[key] for key in keys))
    every = [list(dict.fromkeys(one[key] for one in labels)) for key in keys]
    short = {key: key.rpartition(".")[2] for key in labels[0]}
    last_words = [*short.values()]
    titles = [short[key] if last_words.count(short[key]) == 1 else key for key in keys]
    boxes = [(box, line) for line, those in where.items() if line for box in boxes_of(those)]
    rows, before = [], ""
    for box, line in boxes[:MOST_TABLE_ROWS]:
        told = "as above" if line == before else line
        values = map(values_text, box, every)
        rows.append([*(fill(each, MOST_KEY_LETTERS) for each in values), told])
        before = line
    if len(boxes) > MOST_TABLE_ROWS:
        more = f"and {count(len(boxes) - MOST_TABLE_ROWS, 'row')} more …"
        rows.append([*[""] * len(keys), more])
    titles.append(f"{name} " if name in titles else name)  # a key and a fact may have one name
    columns = dict(zip(titles, zip(*rows, strict=True), strict=True))
    return table_text(columns, [*columns], terminal_width() - 2).replace("\n", "\n  ")


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


def boxes_of(combinations: set[Combination]) -> list[list[Combination]]:
    """Few products of sets of values, one set a key, that make up these combinations."""
    if combinations == {()}:
        return [[]]
    rests: dict[str, set[Combination]] = {}
    for first, *rest in sorted(combinations):
        rests.setdefault(first, set()).add(tuple(rest))
    alike: dict[frozenset[Combination], list[str]] = {}
    for first, rest in rests.items():
        alike.setdefault(frozenset(rest), []).append(first)
    return [[tuple(firsts), *box] for rest, firsts in alike.items() for box in boxes_of({*rest})]
