"""From a document to a study: one validated config, and the cells of its sweep."""

import contextlib
import functools
import itertools
import math
import re
from collections import Counter
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError, create_model

from jaxnet.config import faults, ranges, spacings
from jaxnet.config.document import (
    ConfigError,
    Document,
    Keys,
    Plain,
    PlainMapping,
    Problem,
    dotted_key,
    escape_controls,
    set_value,
    split_key,
)
from jaxnet.config.keys import (
    KINDS,
    LARGEST_FLEET,
    Config,
    Geomspace,
    Linspace,
    Save,
    Scenario,
)
from jaxnet.config.known import KnownKeys, explain, model_of, with_kind, written_keys
from jaxnet.config.naming import Key, full_kind, to_plain, value_labels
from jaxnet.config.scenario import for_any_signal
from jaxnet.config.sweep import Sweep, SweptColumn, holders, is_joint, keys_in, values_in
from jaxnet.kinds import registry
from jaxnet.kinds.attacks import USUAL_TARGETS, usual_targets
from jaxnet.kinds.fields import Record
from jaxnet.kinds.graphs import Graph, shared_by_cells
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.kinds.metrics import AGREEMENT, DETECTION
from jaxnet.kinds.refusals import suggestion

AnyModel = TypeVar("AnyModel", bound=BaseModel)
AnyScenario = TypeVar("AnyScenario", bound=Scenario)
# from candidate keys to the FILE:LINE:COL of the first that was written
Locate = Callable[..., str]
Validated = tuple[Any, list[Problem]]  # the value of a key, and what is wrong with it

MOST_SWEPT_CELLS = 1_000_000
DEFAULT_SCENARIO = Scenario()


@dataclass(frozen=True)
class Cell:
    """One point of the sweep's grid: its number from 0, its swept keys as tables show them."""

    number: int
    labels: dict[str, Any]
    scenario: Scenario

    def __str__(self) -> str:
        return cell_name(self.number, self.labels)


def cell_name(number: int, labels: Mapping[str, object]) -> str:
    words = (value if is_joint(key) else f"{key}={value}" for key, value in labels.items())
    swept = ", ".join(map(str, words))
    return f"cell {number}" + (f" ({swept})" if swept else "")


def is_leaderless(cells: Sequence[Cell]) -> bool:
    """Whether no cell has a navigator, so that tables and figures speak of agreement."""
    return all(cell.scenario.leaderless for cell in cells)


def judged_metric(cells: Sequence[Cell]) -> str:
    """Return the metric by which lanes are ranked: the spread if no cell has a navigator."""
    return "spread" if is_leaderless(cells) else "tail_mean"


def read_document(document: Document) -> tuple[Config, tuple[Cell, ...]]:
    """Return the config and cells of a document; raise ConfigError with all that is wrong."""
    judges = registry.scope().judges  # a stored study has been judged
    complete_kinds(document, judges)
    if judges:
        ranges.write_distributions(document)
    config, wrong, problems = validated(Config, document.data, document.place)
    problems += document.problems
    if "sweep" in wrong:
        listed, bad = right_sweep(document)
        config, wrong = config.model_copy(update={"sweep": listed}), wrong | bad
    sweep = Sweep({key: swept_values(each) for key, each in config.sweep.items()})
    values = {key: column.values for key, column in sweep.columns.items()}
    given = given_keys(document, judges)
    settled = settle(config, given)
    if judges:
        settled = settle_metrics(settled, values)
    known = KnownKeys(document.data, values)
    refused = [(("sweep", *way), dotted_key(("sweep", *way)), told) for way, told in sweep.faults]
    for key, told in refuse_sweep(config.save, sweep, known):
        refused.append((("sweep", sweep.columns[key].written), f"sweep.{key}", told))
    for key in itertools.filterfalse(known.has, config.labels):
        refused.append((split_key(f"labels.{key}"), f"labels.{key}", "unknown key"))
    problems += [Problem(document.place(keys), key, told) for keys, key, told in refused]
    problems += idle_overrides(document, sweep)
    names = {key: escape_controls(each) for key, each in config.labels.items()}
    spanned: dict[str, SweptColumn] = {
        Key(key, names.get(key)): each for key, each in sweep.columns.items() if known.has(key)
    }
    cells: tuple[Cell, ...] = ()
    nothing = [], {*wrong, *Scenario.model_fields}
    tried, unknown = nothing
    if math.prod(sweep.sizes) <= MOST_SWEPT_CELLS:
        start = settled.model_copy(update={"topology": config.topology})  # cells settle their own
        span = SweptCells(document, start, wrong, sweep.sizes, spanned, given)
        cells, found = span.cells({*problems})
        problems += found
        tried, unknown = span.tried, wrong | span.unknown
    if judges:
        whole = (tried, unknown) if not refused and "sweep" not in wrong else nothing
        found = [*faults.study_faults(settled, *whole)]
        if unknown.isdisjoint(Scenario.model_fields):
            written = [key for key in spanned if is_written(document, split_key(key))]
            found += faults.replaced_faults(settled, written, tried)
        problems += [located(fault, document.place) for fault in found]
    if problems:
        raise ConfigError(sorted(problems, key=line_order))
    return settled, cells


def validated(
    model: type[AnyModel], data: PlainMapping, place: Locate
) -> tuple[AnyModel, set[str], list[Problem]]:
    """Return a model of the right keys, the wrong keys, and what is wrong with them."""
    try:
        return model.model_validate(data), set(), []
    except ValidationError as error:
        found = [(written_keys(one), one) for one in error.errors(include_url=False)]
    told = [Problem(place(keys), dotted_key(keys), explain(one, data)) for keys, one in found]
    wrong = {str(keys[0]) for keys, _ in found}
    right = {key: each for key, each in data.items() if isinstance(key, str) and key not in wrong}
    return model.model_validate(dict.fromkeys(wrong & {"name"}, "study") | right), wrong, told


def right_sweep(document: Document) -> tuple[dict[str, Any], set[str]]:
    """Return the swept keys with right values and their values, and the keys with wrong ones.

    Keys inside wrong ones are left out.
    """
    listed, bad = dict[str, Any](), set[str]()
    for key, value in swept_in(document).items():
        made, wrong, _ = validated(Config, {"name": "study", "sweep": {key: value}}, str)
        listed |= made.sweep
        bad |= {*keys_in(key)} if wrong else set()

    def stands(written: str) -> bool:
        return not any(f"{key}.".startswith(f"{w}.") for key in keys_in(written) for w in bad)

    return {key: each for key, each in listed.items() if stands(key)}, bad


@functools.cache
def model_with(key: str) -> type[BaseModel]:
    """The model of one key of a scenario, which is validated sooner than all."""
    field = Scenario.model_fields[key]
    return create_model(key, __base__=Record, **{key: (field.annotation, field)})  # pyright: ignore


def swept_values(given: list[Plain] | Linspace | Geomspace) -> list[Plain]:
    """Return the values of a swept key; a spacing whose values are all whole gives ints."""
    if isinstance(given, list):
        return given
    if isinstance(given, Linspace):
        spaced = spacings.linspace(*given.linspace)
    else:
        spaced = spacings.geomspace(*given.geomspace)
    return [int(value) for value in spaced] if all(map(float.is_integer, spaced)) else spaced


def refuse_sweep(save: Save, sweep: Sweep, known: KnownKeys) -> Iterator[tuple[str, str]]:
    """Yield the key and message of each fault of a sweep before its cells are validated."""
    values = {key: column.values for key, column in sweep.columns.items()}
    if math.prod(sweep.sizes) > MOST_SWEPT_CELLS:
        yield list(values)[-1], f"spans more than {MOST_SWEPT_CELLS:,} cells"
    over_time = save.errors or save.trajectories != "none"
    for number, key in enumerate(values):
        root = key.split(".")[0]
        if is_joint(key):
            continue
        if root not in Scenario.model_fields:
            wrong = "cannot be swept" if root in Config.model_fields else "unknown key"
            yield key, wrong + suggestion(root, list(Scenario.model_fields))
        elif root == "metrics":
            yield key, "cannot be swept: all rows have the same columns"
        elif root in KINDS and key == f"{root}.kind":
            yield key, f"sweep {root} instead: a kind comes with keys of its own"
        elif not known.has(key):
            yield key, known.unknown(key)
        if any(other.startswith(f"{key}.") for other in list(values)[:number]):
            yield key, "must stand before the dotted keys that set into it"
        if over_time and key in ("vehicles", "vehicle", "horizon", "output_step"):
            yield key, "cannot be swept while save stores errors or trajectories"
        elif key == "vehicles" and save.vehicles:
            yield key, "cannot be swept while save stores the errors of each vehicle"
    for axis in range(len(sweep.sizes)):
        keys = [key for key, column in sweep.columns.items() if column.axis == axis]
        key, labels = keys[0], [value_labels(key, values[key]) for key in keys]
        names = zip(*labels, strict=True) if len(keys) > 1 and not is_joint(key) else labels[0]
        if twice := [name for name, times in Counter(names).items() if times > 1]:
            remedy = "; give each a label" if key in KINDS else ""
            remedy += ": jaxnet.network(…, label=…)" if key == "topology" else ""
            yield key, f"two values are named {twice[0]}{remedy}"


def idle_overrides(document: Document, sweep: Sweep) -> Iterator[Problem]:
    """Yield a problem for each override that the sweep would replace."""
    for key, (other, column) in itertools.product(document.overridden, sweep.columns.items()):
        if f"{key}.".startswith(f"{other}."):
            message = f"has no effect, {other} is swept; override sweep.{column.written} instead"
            yield Problem(document.place(split_key(key)), key, message)


def located(fault: Fault, place: Locate) -> Problem:
    return Problem(place(*map(split_key, fault.keys)), fault.keys[0], fault.message)


def line_order(problem: Problem) -> tuple[int, ...]:
    """Sort problems by line; those of the command line come last."""
    match = re.search(r":([0-9]+):([0-9]+)$", problem.place)
    return (int(match[1]), int(match[2])) if match else (2**62,)


# --- kinds by their names, and what they read from files ------------------------------------------


def complete_kinds(document: Document, judges: bool) -> None:
    """Write each kind as a mapping with its name; if `judges`, add what kinds read from files."""
    for field in KINDS:
        found = holders(swept_in(document), field)
        mappings: list[tuple[Plain, Keys]] = [(row, ("sweep", *way)) for row, way in found]
        if field in document.data:
            document.data[field] = with_kind(field, document.data[field])
            place = document.place((field, "kind"), (field,))
            document.places.setdefault((field, "kind"), place)
            mappings.append((document.data, (field,)))
        for holder, at in mappings if judges else ():
            value = holder[at[-1]]
            model = model_of(field, value) if isinstance(value, dict) else None
            try:
                holder[at[-1]] = model.completed(value, document.folder) if model else value
            except KindError as error:
                key = (*at, "path")
                place = document.place(key, at)
                document.problems.append(Problem(place, dotted_key(key), str(error)))


# --- keys that follow from others -----------------------------------------------------------------


def swept_in(document: Document) -> PlainMapping:
    swept = document.data.get("sweep")
    return swept if isinstance(swept, dict) else {}


def given_keys(document: Document, judges: bool) -> set[str]:
    """Return the keys that the user gave, or swept, or in which a value was given.

    "attack.vehicles" is one of them if the user gave the list of vehicles that are attacked by
    default. A stored study, and a study with overrides, have every key; they were not given.
    """
    new, swept = judges and not document.settled, swept_in(document)
    keys = [key for written in swept for key in keys_in(written)]
    dotted = [*document.overridden, *keys, *(document.data if new else ())]
    given = {str(key).split(".")[0] for key in dotted}
    attacks, lists = (values_in(swept, key) for key in ("attack", "attack.vehicles"))
    if new or "attack.vehicles" in document.overridden:
        attacks = [document.data.get("attack"), *attacks]
    lists = [*lists, *(each.get("vehicles") for each in attacks if isinstance(each, dict))]
    return given | {"attack.vehicles"} if judges and USUAL_TARGETS in lists else given


def is_written(document: Document, keys: Keys) -> bool:
    """Whether a new study, not one that was stored, has a value at these keys."""
    data: Plain = {} if document.settled else document.data
    for key in keys:
        inside = range(len(data)) if isinstance(data, list) else data
        if not isinstance(data, list | dict) or key not in inside:
            return False
        data = data[key]
    return True


def settle(scenario: AnyScenario, given: Container[str]) -> AnyScenario:
    """Complete a scenario by what follows from its kinds: a network's nodes, numbers not given."""
    found: dict[str, Any] = {}
    topology, vehicles = scenario.topology, scenario.vehicles
    if not scenario.navigator.present:
        topology = found["topology"] = without_leader(topology)
    if "vehicles" not in given:
        with contextlib.suppress(KindError):  # the code of a kind from outside may be missing
            size = topology.size()
            if size is not None and 1 <= size <= LARGEST_FLEET:
                vehicles = found["vehicles"] = size
    usual = getattr(scenario.attack, "vehicles", None) == USUAL_TARGETS
    if usual and usual_targets(vehicles) != USUAL_TARGETS and "attack.vehicles" not in given:
        found["attack"] = scenario.attack.on(usual_targets(vehicles))
    order = scenario.vehicle.order
    if scenario.order_of_gain != order and "gain" not in given:
        found["gain"] = [float(math.comb(order, k)) for k in range(order)]
    return scenario.model_copy(update=found) if found else scenario


@shared_by_cells
def without_leader(graph: Graph) -> Graph:
    """Return the leaderless graph: one object for the cells of a sweep."""
    return graph.leaderless()


def settle_metrics(study: Config, swept: Mapping[str, list[Plain]]) -> Config:
    """Add the metrics of agreement if a cell has no navigator, of alarms if one has a detector, of
    saturation if one has limits, of a filter if one has one, of standing if one has vehicles that
    stop.

    If nobody leads in any cell, a search maximises the spread by default.
    """

    def of_kinds(key: str, name: str, unknown: object) -> list[Any]:
        kinds = [model_of(key, with_kind(key, value)) for value in swept.get(key, [])]
        return [getattr(each, name, unknown) for each in kinds or [getattr(study, key)]]

    leads, detects = of_kinds("navigator", "present", True), of_kinds("detector", "present", False)
    limited = [
        *of_kinds("vehicle", "limits", {}),
        *(key.startswith("vehicle.limits") for key in swept),
    ]
    names = [*(AGREEMENT if not all(leads) else ()), *(DETECTION if any(detects) else ())]
    names += ["saturated"] * any(limited)
    names += ["infeasible"] * any(of_kinds("filter", "present", False))
    stops = [*of_kinds("vehicle", "standstill", ""), *swept.get("vehicle.standstill", [])]
    names += ["standing"] * ("stop" in stops)
    measured = {metric.name for metric in study.metrics}
    more = [registry.find("metrics", name) for name in names if name not in measured]
    changed: dict[str, object] = {"metrics": [*study.metrics, *more]} if more else {}
    if not any(leads) and study.search and "maximise" not in study.search.model_fields_set:
        changed["search"] = study.search.model_copy(update={"maximise": "spread"})
    return study.model_copy(update=changed)


# --- cells ----------------------------------------------------------------------------------------


class SweptCells:
    """The grid of a sweep. Each value of a key is validated once for all its cells.

    Swept values are set into the study with all defaults written out, the form in which it is
    stored: the stored study has the same cells.
    """

    def __init__(
        self,
        document: Document,
        config: Config,
        wrong: set[str],
        sizes: Sequence[int],
        columns: Mapping[str, SweptColumn],
        given: set[str],
    ):
        self.document, self.sizes, self.columns, self.given = document, sizes, columns, given
        self.roots: dict[str, list[str]] = {}
        for key in itertools.filterfalse(is_joint, columns):
            self.roots.setdefault(key.split(".")[0], []).append(key)
        self.wrong = (wrong & {*Scenario.model_fields}) - {*self.roots}
        fields = {key: getattr(config, key) for key in Scenario.model_fields}
        fixed = {key: each for key, each in fields.items() if key not in self.roots}
        self.shared = settle(DEFAULT_SCENARIO.model_copy(update=fixed), given)
        self.base = {root: to_plain(fields[root]) for root in self.roots}
        for root in wrong & {*self.roots} & {*document.data}:  # as it was written
            written = document.data[root]
            self.base[root] = full_kind(root, written) if root in KINDS else written
        self.parts: dict[tuple[str | int, ...], Validated] = {}
        self.tried: list[Scenario] = []  # of all cells, with defaults for keys that are wrong
        self.unknown: set[str] = set()  # these keys
        self.faults = for_any_signal(lambda cell: [*faults.scenario_faults(cell)])

    def cells(self, known: set[Problem]) -> tuple[tuple[Cell, ...], list[Problem]]:
        """Return the cells, the first key slowest, and each new problem with its first cell."""
        labels = {key: value_labels(key, each.values) for key, each in self.columns.items()}
        axes = [(key, each.axis, each.firsts) for key, each in self.columns.items()]
        cells: list[Cell] = []
        found: dict[Problem, list[str]] = {}
        grid = list(itertools.product(*map(range, self.sizes)))
        for number, indices in enumerate(grid):
            chosen = {key: firsts[indices[axis]] for key, axis, firsts in axes}
            named = {key: labels[key][index] for key, index in chosen.items()}
            scenario, wrong, problems = self.scenario(chosen)
            self.tried.append(scenario)
            self.unknown |= wrong
            if not wrong:
                cells.append(Cell(number, named, scenario))
            for problem in dict.fromkeys(problems):
                if problem not in known:
                    found.setdefault(problem, []).append(cell_name(number, named))
        told = []
        for problem, where in found.items():
            some = len(where) < len(grid) or problem.key.split(".")[0] in self.roots
            message = f"{problem.message}, in {where[0]}" if some else problem.message
            told.append(problem._replace(message=message))
        return tuple(cells), told

    def scenario(self, chosen: Mapping[str, int]) -> tuple[Scenario, set[str], list[Problem]]:
        """Return a cell's scenario by the indices of its swept values, wrong keys, and problems.

        Faults of several keys together are reported although other keys are wrong.
        """
        problems: list[Problem] = []
        wrong, right = {*self.wrong}, {}
        for root, keys in self.roots.items():
            mine = root, *(chosen[key] for key in keys)
            if mine not in self.parts:
                self.parts[mine] = self.part(root, {key: chosen[key] for key in keys})
            right[root], found = self.parts[mine]
            problems += found
            if found:
                wrong.add(root)
                del right[root]
        made = settle(self.shared.with_values(**right), self.given)
        for fault in self.faults(made) if registry.scope().judges else ():
            if not wrong & {key.split(".")[0] for key in fault.keys}:
                problems.append(located(fault, functools.partial(self.place, chosen)))
        return made, wrong, problems

    def part(self, root: str, chosen: Mapping[str, int]) -> Validated:
        """Return the value of a key by the indices of the swept values in it, and its problems."""
        data = {root: self.base[root]}
        for key, index in chosen.items():
            try:
                set_value(data, split_key(key), self.columns[key].values[index])
            except LookupError as error:
                place = self.document.place(("sweep", self.columns[key].written))
                return None, [Problem(place, f"sweep.{key}", str(error.args[0]))]
            data[root] = with_kind(root, data[root]) if root in KINDS else data[root]
        made, _, problems = validated(model_with(root), data, functools.partial(self.place, chosen))
        return getattr(made, root), problems

    def place(self, chosen: Mapping[str, int], *candidates: Keys) -> str:
        """Return the place of a fault in a cell: the swept value that set the key, or the key."""
        for keys in candidates:
            swept_keys = itertools.filterfalse(is_joint, chosen)
            for key in sorted(swept_keys, key=lambda key: -key.count(".")):
                column, number, swept = self.columns[key], chosen[key], split_key(key)
                here = ("sweep", *(column.ways[number] if column.ways else (key, number)))
                if swept[: len(keys)] == keys[: len(swept)]:
                    return self.document.place((*here, *keys[len(swept) :]), here)
        return self.document.place(*candidates)
