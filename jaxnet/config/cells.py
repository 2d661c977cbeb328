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
from pydantic_core import ErrorDetails

from jaxnet.config import faults, ranges, spacings, wording
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
    spot,
)
from jaxnet.config.keys import (
    INNER_KINDS,
    KINDS,
    LARGEST_FLEET,
    Channel,
    Config,
    Geomspace,
    Initial,
    Linspace,
    Scenario,
    Sweep,
    known_metric,
)
from jaxnet.config.naming import Key
from jaxnet.kinds import registry
from jaxnet.kinds.attacks import USUAL_TARGETS, usual_targets
from jaxnet.kinds.fields import MARK, Record
from jaxnet.kinds.graphs import ByIdentity, Graph
from jaxnet.kinds.kind import Fault, Kind, KindError
from jaxnet.kinds.metrics import AGREEMENT, DETECTION

Model = TypeVar("Model", bound=BaseModel)
AnyScenario = TypeVar("AnyScenario", bound=Scenario)
Locate = Callable[
    ..., str
]  # from candidate keys to the FILE:LINE:COL of the first that was written

MOST_SWEPT_CELLS = 1_000_000
DEFAULT_SCENARIO = Scenario()
SINGLE_KEY_MODELS: dict[str, type[BaseModel]] = {  # a model for each key
    key: create_model(key, __base__=Record, **{key: (field.annotation, field)})  # pyright: ignore
    for key, field in Scenario.model_fields.items()
}
FOLLOWED = (
    "topology",
    "vehicle",
    "navigator",
    "vehicles",
    "attack",
)  # other keys may follow from these
RECORDS: dict[str, type[Record]] = {"initial": Initial, "channel": Channel}
UNLABELLED_KEYS = (
    "kind",
    "label",
    "edges",
    "content",
    "names",
)  # keys of kinds that labels leave out


@dataclass(frozen=True)
class Cell:
    """One point of the sweep's grid: its number from 0, its swept keys as tables show them, its scenario."""

    number: int
    labels: dict[str, Any]
    scenario: Scenario

    def __str__(self) -> str:
        """Return the name of the cell in messages."""
        return cell_name(self.number, self.labels)


def is_leaderless(cells: Sequence[Cell]) -> bool:
    """Return whether no cell has a navigator, so that tables and figures speak of agreement."""
    return all(cell.scenario.leaderless for cell in cells)


def judged_metric(cells: Sequence[Cell]) -> str:
    """Return the metric by which lanes of these cells are ranked: the spread if no cell has a navigator."""
    return "spread" if is_leaderless(cells) else "tail_mean"


def read_document(document: Document) -> tuple[Config, tuple[Cell, ...]]:
    """Return the config and cells of a document; raise ConfigError with everything that is wrong."""
    judges = registry.scope().judges
    name_kinds(document)
    if judges:  # a stored study has passed these steps
        complete_kinds(document)
        ranges.write_distributions(document)
    settled, problems = validate(Config, document.data, document.place)
    given, _ = validate(SweepAlone, document.data, document.place)
    values = {} if given is None else {key: swept_values(each) for key, each in given.sweep.items()}
    if settled is not None:
        settled = settle(settled, document)
        if judges:
            settled = settle_agreement(settled, values.get("navigator", []))
            settled = settle_detection(settled, values.get("detector", []))
    known = KnownKeys(document.data, values)
    wrong = list(refuse_sweep(settled, values, known))
    problems += [Problem(document.place(("sweep", key)), f"sweep.{key}", m) for key, m in wrong]
    names = (
        {} if settled is None else {k: escape_controls(each) for k, each in settled.labels.items()}
    )
    problems += [
        Problem(document.place(("labels", key)), f"labels.{key}", "unknown key")
        for key in names
        if not known.has(key)
    ]
    problems += [*document.problems, *idle_overrides(document, list(values))]
    spanned: dict[str, list[Plain]] = {
        Key(key, names.get(key)): each for key, each in values.items() if known.has(key)
    }
    cells: tuple[Cell, ...] = ()
    if math.prod(map(len, values.values())) <= MOST_SWEPT_CELLS:
        base = document.data if settled is None else to_plain(settled)
        with pause_garbage_collection():
            cells, found = cells_of(document, base, spanned, known=set(problems))
        problems += found
    if settled is not None and judges:
        scenarios = [cell.scenario for cell in cells]
        swept = [
            key
            for key in values
            if not document.settled and spot(split_key(key)) in document.places
        ]
        found = [
            *faults.study_faults(settled, scenarios),
            *faults.replaced_faults(settled, swept, scenarios),
        ]
        problems += [located(fault, document.place) for fault in found]
    if settled is None or problems:
        raise ConfigError(sorted(problems, key=line_order))
    return settled, cells


def gives(document: Document, root: str) -> bool:
    """Return whether the user gave a key, or something in it, that otherwise follows from a kind."""
    given = root in document.data and registry.scope().judges and not document.settled
    swept = document.data.get("sweep")
    dotted = [*document.overridden, *(swept if isinstance(swept, dict) else [])]
    return given or any(str(key).split(".")[0] == root for key in dotted)


def settle(scenario: AnyScenario, document: Document) -> AnyScenario:
    """Return the scenario with what follows from its kinds: its network's nodes, and numbers not given."""
    if not scenario.navigator.present:
        scenario = scenario.model_copy(
            update={"topology": without_leader(ByIdentity(scenario.topology))}
        )
    scenario = scenario if gives(document, "vehicles") else settle_vehicles(scenario)
    scenario = scenario if gives_usual_targets(document) else settle_targets(scenario)
    return scenario if gives(document, "gain") else settle_gain(scenario)


@functools.lru_cache(maxsize=64)
def without_leader(itself: ByIdentity) -> Graph:
    """Return the leaderless graph; the cache keeps one object for the cells of a sweep."""
    return itself.one.leaderless()


def gives_usual_targets(document: Document) -> bool:
    """Return whether the user wrote the list of vehicles that are attacked by default.

    A stored study with fewer vehicles has this list from the default alone.
    """
    data, swept = document.data, document.data.get("sweep")
    swept = swept if isinstance(swept, dict) else {}
    listed = [swept.get(key) for key in ("attack", "attack.vehicles")]
    attacks, lists = (each if isinstance(each, list) else [] for each in listed)
    if registry.scope().judges and (
        not document.settled or "attack.vehicles" in document.overridden
    ):
        attacks = [data.get("attack"), *attacks]
    given = [each.get("vehicles") for each in attacks if isinstance(each, dict)]
    return registry.scope().judges and USUAL_TARGETS in [*given, *lists]


def settle_targets(scenario: AnyScenario) -> AnyScenario:
    """Return the scenario with the usual attacked vehicles that exist, where those are attacked."""
    attack, usual = scenario.attack, usual_targets(scenario.vehicles)
    if usual == USUAL_TARGETS or getattr(attack, "vehicles", None) != USUAL_TARGETS:
        return scenario
    return scenario.model_copy(update={"attack": attack.on(usual)})


def settle_gain(scenario: AnyScenario) -> AnyScenario:
    """Return the scenario with the binomial gain of its vehicle, unless the gain has as many numbers."""
    order = scenario.vehicle.order
    if scenario.order_of_gain == order:
        return scenario
    return scenario.model_copy(update={"gain": [float(math.comb(order, k)) for k in range(order)]})


def settle_agreement(study: Config, swept: Sequence[Plain]) -> Config:
    """Return the study with the metrics of agreement, if it or a swept navigator is none.

    If nobody leads in any cell, a search maximises the spread by default.
    """
    known = [model_of("navigator", with_kind("navigator", value)) for value in swept] or [
        study.navigator
    ]
    leads = [getattr(each, "present", True) for each in known]
    if all(leads):
        return study
    found, search = with_metrics(study, AGREEMENT), study.search
    if any(leads) or search is None or "maximise" in search.model_fields_set:
        return found
    return found.model_copy(update={"search": search.model_copy(update={"maximise": "spread"})})


def settle_detection(study: Config, swept: Sequence[Plain]) -> Config:
    """Return the study with the shares of alarms, if it or a swept cell has a detector."""
    known = [model_of("detector", with_kind("detector", value)) for value in swept] or [
        study.detector
    ]
    return (
        with_metrics(study, DETECTION)
        if any(getattr(each, "present", False) for each in known)
        else study
    )


def with_metrics(study: Config, names: Sequence[str]) -> Config:
    """Return the study with these metrics beside its own."""
    measured = {metric.name for metric in study.metrics}
    more = [known_metric(name) for name in names if name not in measured]
    return study.model_copy(update={"metrics": [*study.metrics, *more]})


def settle_vehicles(scenario: AnyScenario) -> AnyScenario:
    """Return the scenario with as many vehicles as its network has, if the network has a number.

    A network whose code is missing keeps the number that was stored.
    """
    size = None
    with contextlib.suppress(KindError):
        size = scenario.topology.size()
    fits = size is not None and 1 <= size <= LARGEST_FLEET and size != scenario.vehicles
    return scenario.model_copy(update={"vehicles": size}) if fits else scenario


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


def line_order(problem: Problem) -> tuple[int, ...]:
    """Return the sort key of a problem: its place in the file; problems of the command line come last."""
    match = re.search(r":([0-9]+):([0-9]+)$", problem.place)
    return (int(match[1]), int(match[2])) if match else (2**62,)


def idle_overrides(document: Document, swept: Sequence[str]) -> Iterator[Problem]:
    """Yield a problem for each override that the sweep would replace."""
    for key in document.overridden:
        for other in swept:
            if key == other or key.startswith(f"{other}."):
                message = f"has no effect, {other} is swept; override sweep.{other} instead"
                yield Problem(document.place(split_key(key)), key, message)


class SweepAlone(BaseModel):
    """The sweep of a config whose other keys may be wrong."""

    model_config = Record.model_config | {"extra": "ignore"}

    sweep: Sweep = {}


def located(fault: Fault, place: Locate) -> Problem:
    """Return a fault as a problem at the place of its first key that was written."""
    return Problem(place(*map(split_key, fault.keys)), fault.keys[0], fault.message)


def name_kinds(document: Document) -> None:
    """Replace the bare name of each kind, or a mapping without a name, by a mapping with a name."""
    for field in KINDS:
        if field in document.data:
            document.data[field] = with_kind(field, document.data[field])
            place = document.place((field, "kind"), (field,))
            document.places.setdefault((field, "kind"), place)


def with_kind(field: str, value: Plain) -> Plain:
    """Return the mapping that a value of a kind's field means."""
    if isinstance(value, str):
        return {"kind": value}
    if isinstance(value, dict) and "kind" not in value and field in KINDS:
        return {"kind": Scenario.model_fields[field].default.reference(), **value}
    return value


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
    """Add what the kind at a place of a mapping or list reads from a file."""
    if model := model_of(field, holder[at[-1]]):
        try:
            holder[at[-1]] = model.completed(holder[at[-1]], document.folder)
        except KindError as error:
            key = (*at, "path")
            document.problems.append(Problem(document.place(key, at), dotted_key(key), str(error)))


def validate(
    model: type[Model], data: PlainMapping, place: Locate
) -> tuple[Model | None, list[Problem]]:
    """Return the model of the data, or None and the problem of each wrong key."""
    try:
        return model.model_validate(dict(data)), []
    except ValidationError as error:
        problems = []
        for one in error.errors(include_url=False):
            keys = keys_of(one)
            problems.append(Problem(place(keys), dotted_key(keys), wording.explain(one, data)))
        return None, problems


def keys_of(error: ErrorDetails) -> Keys:
    """Return the keys of an error's place as the user writes them, without the tags of unions."""
    keys = tuple(part for part in error["loc"] if not str(part).startswith((MARK, "[key]")))
    if error["type"] == "missing" and isinstance(keys[-1], int):
        return keys[:-1]
    in_mapping = error["type"] in ("kind", "kind_name") and isinstance(error["input"], dict)
    return (*keys, "kind") if in_mapping else keys


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
    settled: Config | None, values: Mapping[str, list[Plain]], known: "KnownKeys"
) -> Iterator[tuple[str, str]]:
    """Yield the key and message of each fault of a sweep before its cells are validated."""
    if math.prod(map(len, values.values())) > MOST_SWEPT_CELLS:
        yield list(values)[-1], f"spans more than {MOST_SWEPT_CELLS:,} cells"
    saves = settled is not None and (settled.save.errors or settled.save.trajectories != "none")
    for number, (key, listed) in enumerate(values.items()):
        root = key.split(".")[0]
        if root not in Scenario.model_fields:
            wrong = "cannot be swept" if root in Config.model_fields else "unknown key"
            yield key, wrong + wording.suggestion(root, list(Scenario.model_fields))
        elif root == "metrics":
            yield key, "cannot be swept: all rows have the same columns"
        elif root in KINDS and key == f"{root}.kind":
            yield key, f"sweep {root} instead: a kind comes with keys of its own"
        elif not known.has(key):
            renamed = wording.renamed_key(split_key(key))
            yield key, renamed or f"unknown key{known.hint(root, key.split('.')[1])}"
        if any(other.startswith(f"{key}.") for other in list(values)[:number]):
            yield key, "must stand before the dotted keys that set into it"
        if saves and key in ("vehicles", "vehicle", "horizon", "output_step"):
            yield key, "cannot be swept while save stores errors or trajectories"
        if settled is not None and settled.save.vehicles and key == "vehicles" and not saves:
            yield key, "cannot be swept while save stores the errors of each vehicle"
        twice = [name for name, times in Counter(value_labels(key, listed)).items() if times > 1]
        if twice:
            remedy = "; give each a label" if key in KINDS else ""
            remedy += ": jaxnet.network(…, label=…)" if key == "topology" else ""
            yield key, f"two values are named {twice[0]}{remedy}"


class KnownKeys:
    """The dotted keys of a study's cells, which depend on the kinds that the study names or sweeps."""

    def __init__(self, data: PlainMapping, values: Mapping[str, list[Plain]]):
        self.given = {
            root: [with_kind(root, value) for value in (data.get(root, {}), *values.get(root, []))]
            for root in KINDS
        }

    def has(self, key: str) -> bool:
        """Return whether a dotted key exists in some cell."""
        root, *inside = key.split(".")
        open_ended = any(
            model.model_config.get("extra") == "allow"
            for value in self.given.get(root, [])
            if (model := model_of(root, value))
        )
        return root in Scenario.model_fields and (
            open_ended or not inside or inside[0] in self.inside(root)
        )

    def hint(self, root: str, word: str) -> str:
        """Return a hint to the key that a word probably means, or a list of the keys that can be swept."""
        found = self.inside(root)
        if root in KINDS or root in RECORDS:
            return wording.suggestion(word, found)
        return f" (known here: {', '.join(found or [root])})"

    def inside(self, root: str) -> list[str]:
        """Return the keys inside a key, without `kind`; the indices if the key is a list."""
        if root in RECORDS:
            return list(RECORDS[root].model_fields)
        if root == "gain":
            return list(map(str, range(len(Scenario.model_fields[root].default))))
        models = [model_of(root, value) for value in self.given.get(root, [])]
        return list(dict.fromkeys(key for model in models if model for key in model.model_fields))


def model_of(field: str, value: object) -> type[Kind] | None:
    """Return the class of the kind in a field's value, None if there is none."""
    if not isinstance(value, dict) or not isinstance(value.get("kind"), str):
        return None
    with contextlib.suppress(KindError):
        return registry.find(field, value["kind"])


def value_labels(key: str, listed: list[Plain]) -> list[Plain]:
    """Return the labels of one key's swept values in tables: all numbers, or all text.

    A kind is labelled by its `label`, or by its name with the keys that tell it apart from others of that
    name; a record, such as a channel, by its `label` or its keys.
    """
    if key not in KINDS and key not in INNER_KINDS:
        if all(isinstance(value, int | float) for value in listed):
            fits = all(isinstance(value, float) or -(2**63) <= value < 2**63 for value in listed)
            return listed if fits else list(map(float, listed))  # integers in columns have 64 bits
        return [escape_controls(own_label(value) or wording.value_text(value)) for value in listed]
    family = INNER_KINDS.get(key, key)
    kinds = [full_kind(family, with_kind(family, value)) for value in listed]
    telling = telling_keys(kinds)
    return [escape_controls(kind_label(kind, telling)) for kind in kinds]


def own_label(value: Plain) -> str:
    """Return text itself, or the `label` of a mapping; "" of another value."""
    told = value.get("label") if isinstance(value, dict) else value
    return told if isinstance(told, str) else ""


def telling_keys(kinds: list[Plain]) -> dict[str, list[object]]:
    """Return, by name of a kind, the keys in which swept kinds of this name differ."""
    found: dict[str, list[object]] = {}
    first: dict[str, PlainMapping] = {}
    for kind in filter(lambda each: isinstance(each, dict) and "kind" in each, kinds):
        name = wording.value_text(kind["kind"])
        other, keys = first.setdefault(name, kind), found.setdefault(name, [])
        differing = (key for key in {**other, **kind} if other.get(key) != kind.get(key))
        keys += [key for key in differing if key not in (*UNLABELLED_KEYS, *keys)]
    return found


def full_kind(field: str, value: Plain) -> Plain:
    """Return the mapping of a kind with its defaults."""
    model = model_of(field, value)
    if model is None:
        return value
    fields = model.model_fields
    defaults = {key: each.default for key, each in fields.items() if not each.is_required()}
    return {key: without_empty_labels(each) for key, each in (defaults | value).items()}


def kind_label(kind: Plain, telling: Mapping[str, list[object]]) -> str:
    """Return the label of one swept kind: its own label, or its name with the keys that tell it apart."""
    if not isinstance(kind, dict) or "kind" not in kind:
        return wording.shorten_value(kind)
    if own := own_label(kind):
        return own
    keys = telling[wording.value_text(kind["kind"])]
    words = [f"{key}={wording.shorten_value(value)}" for key, value in kind.items() if key in keys]
    name = str(kind["kind"]).rpartition(":")[2]
    return name + (f"({', '.join(words)})" if words else "")


class CellParts:
    """The validated values from which cells are composed. Each value is validated once for all its cells.

    Values are set into the study with all defaults written out, in the form in which it is stored. The stored
    study therefore has the same cells.
    """

    def __init__(self, document: Document, study: PlainMapping, values: Mapping[str, list[Plain]]):
        given = {key: value for key, value in study.items() if key in Scenario.model_fields}
        kinds = {key: full_kind(key, value) for key, value in given.items() if key in KINDS}
        self.document, self.values = document, values
        self.base: dict[str, Any] = to_plain(DEFAULT_SCENARIO) | given | kinds
        self.swept: dict[str, list[str]] = {}
        for key in values:
            self.swept.setdefault(key.split(".")[0], []).append(key)
        self.found: dict[tuple[str | int, ...], tuple[object, list[Problem]]] = {}
        fixed = {root: self.validated(root, {}) for root in self.base if root not in self.swept}
        self.problems = [problem for _, wrong in fixed.values() for problem in wrong]
        self.wrong = {root for root, (_, wrong) in fixed.items() if wrong}
        right = {root: value for root, (value, wrong) in fixed.items() if not wrong}
        self.shared = settle(DEFAULT_SCENARIO.model_copy(update=right), document)
        self.follows = not self.swept.keys().isdisjoint(FOLLOWED)

    def scenario(self, chosen: Mapping[str, int]) -> tuple[Scenario | None, list[Problem]]:
        """Return a cell's scenario by the indices of its swept values, or None and all problems.

        Faults of several keys together are also reported if other keys are wrong.
        """
        problems, wrong, right = list(self.problems), set(self.wrong), {}
        for root, keys in self.swept.items():
            right[root], found = self.part(root, {key: chosen[key] for key in keys})
            problems += found
            if found:
                wrong.add(root)
                del right[root]
        made = self.shared.model_copy(update=right)
        if self.follows:
            made = settle(made, self.document)
        place = functools.partial(place_in_cell, self.document, chosen)
        if registry.scope().judges:
            problems += [
                located(fault, place)
                for fault in faults.scenario_faults(made)
                if not wrong & {key.split(".")[0] for key in fault.keys}
            ]
        return None if wrong else made, problems

    def part(self, root: str, chosen: Mapping[str, int]) -> tuple[object, list[Problem]]:
        """Return the value of a key by the indices of the swept values in it, or its problems; cached."""
        mine = root, *chosen.values()
        if mine not in self.found:
            self.found[mine] = self.validated(root, chosen)
        return self.found[mine]

    def validated(self, root: str, chosen: Mapping[str, int]) -> tuple[object, list[Problem]]:
        """Return the value of a key with swept values set into it, or its problems."""
        data = {root: self.base[root]}
        for key, index in chosen.items():
            try:
                set_swept(data, key, self.values[key][index])
            except LookupError as error:
                place = self.document.place(("sweep", key))
                return None, [Problem(place, f"sweep.{key}", str(error.args[0]))]
        found, problems = validate(
            SINGLE_KEY_MODELS[root], data, functools.partial(place_in_cell, self.document, chosen)
        )
        return getattr(found, root, None), problems


def cells_of(
    document: Document, study: PlainMapping, values: Mapping[str, list[Plain]], known: set[Problem]
) -> tuple[tuple[Cell, ...], list[Problem]]:
    """Return the cells, the first key slowest, and each new problem once with the first cell that has it."""
    parts = CellParts(document, study, values)
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
    roots = {key.split(".")[0] for key in values}
    return tuple(cells), [
        problem._replace(message=f"{problem.message}, in {where[0]}")
        if len(where) < len(grid) or problem.key.split(".")[0] in roots
        else problem
        for problem, where in found.items()
    ]


def cell_name(number: int, labels: Mapping[str, object]) -> str:
    """Return the name of a cell in messages."""
    swept = ", ".join(f"{key}={value}" for key, value in labels.items())
    return f"cell {number}" + (f" ({swept})" if swept else "")


def set_swept(data: dict[str, Plain], key: str, value: Plain) -> None:
    """Set one swept key into a cell's data: a kind replaces the whole mapping, a dotted key sets into it.

    Raises LookupError if the parent of a dotted key is no mapping or list.
    """
    root = key.split(".")[0]
    set_value(data, split_key(key), value)
    if root in KINDS:
        data[root] = with_kind(root, data[root])


def place_in_cell(document: Document, chosen: Mapping[str, int], *candidates: Keys) -> str:
    """Return the place of a cell's fault: the swept value that set the key, or else the key itself."""
    for keys in candidates:
        for key in sorted(chosen, key=lambda key: -key.count(".")):
            swept, here = split_key(key), ("sweep", key, chosen[key])
            if swept[: len(keys)] == keys[: len(swept)]:
                inside = (*here, *keys[len(swept) :])
                return document.place(inside, here)
    return document.place(*candidates)


def to_plain(model: BaseModel) -> dict[str, Plain]:
    """Return a model as plain data for YAML and JSON."""
    return without_empty_labels(model.model_dump(mode="python"))


def without_empty_labels(value: Plain) -> Plain:
    """Return models, mappings and lists as plain data, without labels that are None."""
    if isinstance(value, BaseModel):
        return to_plain(value)
    if isinstance(value, dict):
        return {
            key: without_empty_labels(each)
            for key, each in value.items()
            if not (key == "label" and each is None)
        }
    return (
        [without_empty_labels(each) for each in value] if isinstance(value, list | tuple) else value
    )
