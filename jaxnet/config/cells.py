"""From a document to a study: one validated config, and the cells of its sweep."""

import contextlib
import functools
import gc
import itertools
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
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
    known_metric,
)
from jaxnet.config.known import KnownKeys, explain, model_of, with_kind, written_keys
from jaxnet.config.naming import Key, full_kind, value_labels, without_empty_labels
from jaxnet.kinds import registry
from jaxnet.kinds.attacks import USUAL_TARGETS, usual_targets
from jaxnet.kinds.fields import Record
from jaxnet.kinds.graphs import ByIdentity, Graph
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.kinds.metrics import AGREEMENT, DETECTION
from jaxnet.kinds.refusals import suggestion

AnyScenario = TypeVar("AnyScenario", bound=Scenario)
# from candidate keys to the FILE:LINE:COL of the first that was written
Locate = Callable[..., str]
Validated = tuple[Any, list[Problem]]  # the value of a key, None with problems

MOST_SWEPT_CELLS = 1_000_000
DEFAULT_SCENARIO = Scenario()
FOLLOWED = {"topology", "vehicle", "navigator", "vehicles", "attack"}  # from which others follow


@dataclass(frozen=True)
class Cell:
    """One point of the sweep's grid: its number from 0, its swept keys as tables show them."""

    number: int
    labels: dict[str, Any]
    scenario: Scenario

    def __str__(self) -> str:
        return cell_name(self.number, self.labels)


def cell_name(number: int, labels: Mapping[str, object]) -> str:
    swept = ", ".join(f"{key}={value}" for key, value in labels.items())
    return f"cell {number}" + (f" ({swept})" if swept else "")


def is_leaderless(cells: Sequence[Cell]) -> bool:
    """Whether no cell has a navigator, so that tables and figures speak of agreement."""
    return all(cell.scenario.leaderless for cell in cells)


def judged_metric(cells: Sequence[Cell]) -> str:
    """Return the metric by which lanes are ranked: the spread if no cell has a navigator."""
    return "spread" if is_leaderless(cells) else "tail_mean"


def to_plain(model: BaseModel) -> dict[str, Plain]:
    return without_empty_labels(model)


def read_document(document: Document) -> tuple[Config, tuple[Cell, ...]]:
    """Return the config and cells of a document; raise ConfigError with all that is wrong."""
    judges = registry.scope().judges
    name_kinds(document)
    if judges:  # a stored study has passed these steps
        complete_kinds(document)
        ranges.write_distributions(document)
    keys, problems = validated_keys(document)
    values = {key: swept_values(each) for key, each in (keys.get("sweep") or {}).items()}
    settled = None
    if not problems:
        settled = settle(Config.model_construct({*keys}, **keys), document)
        settled = settle_metrics(settled, values) if judges else settled
        keys |= {key: each for key, each in settled if key != "topology"}  # cells have their own
    known = KnownKeys(document.data, values)
    problems += [
        Problem(document.place(("sweep", key)), f"sweep.{key}", message)
        for key, message in refuse_sweep(keys.get("save"), values, known)
    ]
    names = {key: escape_controls(each) for key, each in (keys.get("labels") or {}).items()}
    problems += [
        Problem(document.place(("labels", key)), f"labels.{key}", "unknown key")
        for key in names
        if not known.has(key)
    ]
    problems += [*document.problems, *idle_overrides(document, values)]
    spanned: dict[str, list[Plain]] = {
        Key(key, names.get(key)): each for key, each in values.items() if known.has(key)
    }
    cells: tuple[Cell, ...] = ()
    if math.prod(map(len, values.values())) <= MOST_SWEPT_CELLS:
        with pause_garbage_collection():
            cells, found = cells_of(document, keys, spanned, {*problems})
        problems += found
    if settled is not None and judges:
        scenarios = [cell.scenario for cell in cells]
        written = [key for key in values if is_written(document, split_key(key))]
        found = faults.study_faults(settled, scenarios)
        found = [*found, *faults.replaced_faults(settled, written, scenarios)]
        problems += [located(fault, document.place) for fault in found]
    if settled is None or problems:
        raise ConfigError(sorted(problems, key=line_order))
    return settled, cells


def validated_keys(document: Document) -> tuple[dict[str, Any], list[Problem]]:
    """Return the values of all keys that are right, and the problems of the others."""
    values: dict[str, Any] = {}
    problems: list[Problem] = []
    for key in dict.fromkeys(["name", *document.data]):
        if key in Config.model_fields:
            values[key], wrong = validated(key, document.data, document.place)
            problems += wrong
        else:
            told = f"unknown key{suggestion(str(key), list(Config.model_fields))}"
            problems.append(Problem(document.place((key,)), str(key), told))
    return values, problems


@functools.cache
def model_with(key: str) -> type[BaseModel]:
    field = Config.model_fields[key]
    return create_model(key, __base__=Record, **{key: (field.annotation, field)})  # pyright: ignore


def validated(key: str, data: PlainMapping, place: Locate) -> Validated:
    given = {key: data[key]} if key in data else {}
    try:
        return getattr(model_with(key).model_validate(given), key), []
    except ValidationError as error:
        wrong = [(written_keys(one), one) for one in error.errors(include_url=False)]
        return None, [
            Problem(place(keys), dotted_key(keys), explain(one, given)) for keys, one in wrong
        ]


def swept_values(given: list[Plain] | Linspace | Geomspace) -> list[Plain]:
    """Return the values of a swept key; a spacing whose values are all whole gives ints."""
    if isinstance(given, list):
        return given
    if isinstance(given, Linspace):
        spaced = spacings.linspace(*given.linspace)
    else:
        spaced = spacings.geomspace(*given.geomspace)
    return [int(value) for value in spaced] if all(map(float.is_integer, spaced)) else spaced


def refuse_sweep(
    save: Save | None, values: Mapping[str, list[Plain]], known: KnownKeys
) -> Iterator[tuple[str, str]]:
    """Yield the key and message of each fault of a sweep before its cells are validated."""
    if math.prod(map(len, values.values())) > MOST_SWEPT_CELLS:
        yield list(values)[-1], f"spans more than {MOST_SWEPT_CELLS:,} cells"
    over_time = save is not None and (save.errors or save.trajectories != "none")
    for number, (key, listed) in enumerate(values.items()):
        root = key.split(".")[0]
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
        elif key == "vehicles" and save is not None and save.vehicles:
            yield key, "cannot be swept while save stores the errors of each vehicle"
        twice = [name for name, times in Counter(value_labels(key, listed)).items() if times > 1]
        if twice:
            remedy = "; give each a label" if key in KINDS else ""
            remedy += ": jaxnet.network(…, label=…)" if key == "topology" else ""
            yield key, f"two values are named {twice[0]}{remedy}"


def idle_overrides(document: Document, swept: Mapping[str, object]) -> Iterator[Problem]:
    """Yield a problem for each override that the sweep would replace."""
    for key, other in itertools.product(document.overridden, swept):
        if f"{key}.".startswith(f"{other}."):
            message = f"has no effect, {other} is swept; override sweep.{other} instead"
            yield Problem(document.place(split_key(key)), key, message)


def located(fault: Fault, place: Locate) -> Problem:
    return Problem(place(*map(split_key, fault.keys)), fault.keys[0], fault.message)


def line_order(problem: Problem) -> tuple[int, ...]:
    """Sort problems by line; those of the command line come last."""
    match = re.search(r":([0-9]+):([0-9]+)$", problem.place)
    return (int(match[1]), int(match[2])) if match else (2**62,)


@contextlib.contextmanager
def pause_garbage_collection() -> Iterator[None]:
    """Pause Python's garbage collection, which costs time while many lasting objects are made."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


# --- kinds by their names, and what they read from files ------------------------------------------


def name_kinds(document: Document) -> None:
    """Replace the bare name of each kind, or a mapping without a name, by a mapping with a name."""
    for field in KINDS:
        if field in document.data:
            document.data[field] = with_kind(field, document.data[field])
            place = document.place((field, "kind"), (field,))
            document.places.setdefault((field, "kind"), place)


def complete_kinds(document: Document) -> None:
    """Add what kinds read from files, also in the sweep."""
    sweep = document.data.get("sweep")
    for field in KINDS:
        if field in document.data:
            complete(document, field, document.data, (field,))
        listed = sweep.get(field) if isinstance(sweep, dict) else None
        for number in range(len(listed) if isinstance(listed, list) else 0):
            complete(document, field, listed, ("sweep", field, number))


def complete(document: Document, field: str, holder: Plain, at: Keys) -> None:
    value = holder[at[-1]]
    model = model_of(field, value) if isinstance(value, dict) else None
    if model is None:
        return
    try:
        holder[at[-1]] = model.completed(value, document.folder)
    except KindError as error:
        key = (*at, "path")
        document.problems.append(Problem(document.place(key, at), dotted_key(key), str(error)))


# --- keys that follow from others -----------------------------------------------------------------


def settle(scenario: AnyScenario, document: Document) -> AnyScenario:
    """Complete a scenario by what follows from its kinds: a network's nodes, numbers not given."""
    found: dict[str, Any] = {}
    if not scenario.navigator.present:
        found["topology"] = without_leader(ByIdentity(scenario.topology))
    size = (
        None if gives(document, "vehicles") else size_of(found.get("topology", scenario.topology))
    )
    vehicles = scenario.vehicles if size is None else size
    found["vehicles"] = vehicles
    usual = getattr(scenario.attack, "vehicles", None) == USUAL_TARGETS
    if usual and usual_targets(vehicles) != USUAL_TARGETS and not gives_usual_targets(document):
        found["attack"] = scenario.attack.on(usual_targets(vehicles))
    order = scenario.vehicle.order
    if scenario.order_of_gain != order and not gives(document, "gain"):
        found["gain"] = [float(math.comb(order, k)) for k in range(order)]
    changed = {key: each for key, each in found.items() if each is not getattr(scenario, key)}
    return scenario.model_copy(update=changed) if changed else scenario


@functools.lru_cache(maxsize=64)
def without_leader(itself: ByIdentity) -> Graph:
    """Return the leaderless graph; the cache keeps one object for the cells of a sweep."""
    return itself.one.leaderless()


def size_of(topology: Graph) -> int | None:
    """Return the number of a network's vehicles, None if any number fits or its code is missing."""
    with contextlib.suppress(KindError):
        size = topology.size()
        return size if size is not None and 1 <= size <= LARGEST_FLEET else None
    return None


def swept_in(document: Document) -> PlainMapping:
    swept = document.data.get("sweep")
    return swept if isinstance(swept, dict) else {}


def gives(document: Document, root: str) -> bool:
    """Whether the user gave a key, or something in it, that otherwise follows from a kind."""
    dotted = [*document.overridden, *swept_in(document)]
    return is_written(document, (root,)) or any(str(key).split(".")[0] == root for key in dotted)


def is_written(document: Document, keys: Keys) -> bool:
    """Whether a new study, not one that was stored, has a value at these keys."""
    if not registry.scope().judges or document.settled:
        return False
    data: Plain = document.data
    for key in keys:
        inside = range(len(data)) if isinstance(data, list) else data
        if not isinstance(data, list | dict) or key not in inside:
            return False
        data = data[key]
    return True


def gives_usual_targets(document: Document) -> bool:
    """Whether the user wrote the list of vehicles that are attacked by default.

    A stored study with fewer vehicles has this list from the default alone.
    """
    if not registry.scope().judges:
        return False
    listed = [swept_in(document).get(key) for key in ("attack", "attack.vehicles")]
    attacks, lists = (each if isinstance(each, list) else [] for each in listed)
    if not document.settled or "attack.vehicles" in document.overridden:
        attacks = [document.data.get("attack"), *attacks]
    given = [each.get("vehicles") for each in attacks if isinstance(each, dict)]
    return USUAL_TARGETS in [*given, *lists]


def settle_metrics(study: Config, swept: Mapping[str, list[Plain]]) -> Config:
    """Add the metrics of agreement if a cell has no navigator, and of alarms if one has a detector.

    If nobody leads in any cell, a search maximises the spread by default.
    """

    def present(key: str, unknown: bool) -> list[bool]:
        kinds = [model_of(key, with_kind(key, value)) for value in swept.get(key, [])]
        return [getattr(each, "present", unknown) for each in kinds or [getattr(study, key)]]

    leads, detects = present("navigator", True), present("detector", False)
    names = [*(AGREEMENT if not all(leads) else ()), *(DETECTION if any(detects) else ())]
    measured = {metric.name for metric in study.metrics}
    more = [known_metric(name) for name in names if name not in measured]
    changed: dict[str, object] = {"metrics": [*study.metrics, *more]} if more else {}
    if not any(leads) and study.search and "maximise" not in study.search.model_fields_set:
        changed["search"] = study.search.model_copy(update={"maximise": "spread"})
    return study.model_copy(update=changed)


# --- cells ----------------------------------------------------------------------------------------


class CellParts:
    """The validated values from which cells are composed. Each is validated once for all its cells.

    Swept values are set into the study with all defaults written out, the form in which it is
    stored: the stored study has the same cells.
    """

    def __init__(self, document: Document, keys: PlainMapping, values: Mapping[str, list[Plain]]):
        self.document, self.values = document, values
        self.swept: dict[str, list[str]] = {}
        for key in values:
            self.swept.setdefault(key.split(".")[0], []).append(key)
        scenario = {key: each for key, each in keys.items() if key in Scenario.model_fields}
        self.wrong = {key for key, each in scenario.items() if each is None} - {*self.swept}
        fixed = {*scenario} - {*self.swept} - self.wrong
        right = {key: scenario[key] for key in fixed}
        self.shared = settle(DEFAULT_SCENARIO.model_copy(update=right), document)
        self.follows = not FOLLOWED.isdisjoint(self.swept)
        self.base = {root: self.plain(root, scenario.get(root)) for root in self.swept}
        self.found: dict[tuple[str | int, ...], Validated] = {}

    def plain(self, root: str, value: object) -> Plain:
        """Return a key's value before anything is swept, as it is or was written."""
        if value is None and root in self.document.data:
            written = self.document.data[root]
            return full_kind(root, written) if root in KINDS else written
        return without_empty_labels(getattr(DEFAULT_SCENARIO, root) if value is None else value)

    def scenario(self, chosen: Mapping[str, int]) -> tuple[Scenario | None, list[Problem]]:
        """Return a cell's scenario by the indices of its swept values, or None, and all problems.

        Faults of several keys together are reported although other keys are wrong.
        """
        problems: list[Problem] = []
        wrong, right = {*self.wrong}, {}
        for root, keys in self.swept.items():
            value, found = self.part(root, {key: chosen[key] for key in keys})
            problems += found
            if found:
                wrong.add(root)
            else:
                right[root] = value
        made = self.shared.model_copy(update=right)
        made = settle(made, self.document) if self.follows else made
        if registry.scope().judges:
            place = functools.partial(place_in_cell, self.document, chosen)
            problems += [
                located(fault, place)
                for fault in faults.scenario_faults(made)
                if not wrong & {key.split(".")[0] for key in fault.keys}
            ]
        return None if wrong else made, problems

    def part(self, root: str, chosen: Mapping[str, int]) -> Validated:
        """Return the value of a key by the indices of the swept values in it; cached."""
        mine = root, *chosen.values()
        if mine not in self.found:
            self.found[mine] = self.validated(root, chosen)
        return self.found[mine]

    def validated(self, root: str, chosen: Mapping[str, int]) -> Validated:
        data = {root: self.base[root]}
        for key, index in chosen.items():
            try:
                set_value(data, split_key(key), self.values[key][index])
            except LookupError as error:
                place = self.document.place(("sweep", key))
                return None, [Problem(place, f"sweep.{key}", str(error.args[0]))]
            data[root] = with_kind(root, data[root]) if root in KINDS else data[root]
        return validated(root, data, functools.partial(place_in_cell, self.document, chosen))


def cells_of(
    document: Document, keys: PlainMapping, values: Mapping[str, list[Plain]], known: set[Problem]
) -> tuple[tuple[Cell, ...], list[Problem]]:
    """Return the cells, the first key slowest, and each new problem with its first cell."""
    parts = CellParts(document, keys, values)
    labels = {key: value_labels(key, listed) for key, listed in values.items()}
    cells: list[Cell] = []
    found: dict[Problem, list[str]] = {}
    grid = list(itertools.product(*(range(len(listed)) for listed in values.values())))
    for number, indices in enumerate(grid):
        chosen = dict(zip(values, indices, strict=True))
        named = {key: labels[key][index] for key, index in chosen.items()}
        scenario, problems = parts.scenario(chosen)
        if scenario is not None:
            cells.append(Cell(number, named, scenario))
        for problem in dict.fromkeys(problems):
            if problem not in known:
                found.setdefault(problem, []).append(cell_name(number, named))
    told = []
    for problem, where in found.items():
        some = len(where) < len(grid) or problem.key.split(".")[0] in parts.swept
        message = f"{problem.message}, in {where[0]}" if some else problem.message
        told.append(problem._replace(message=message))
    return tuple(cells), told


def place_in_cell(document: Document, chosen: Mapping[str, int], *candidates: Keys) -> str:
    """Return the place of a cell's fault: the swept value that set the key, or the key itself."""
    for keys in candidates:
        for key in sorted(chosen, key=lambda key: -key.count(".")):
            swept, here = split_key(key), ("sweep", key, chosen[key])
            if swept[: len(keys)] == keys[: len(swept)]:
                return document.place((*here, *keys[len(swept) :]), here)
    return document.place(*candidates)
