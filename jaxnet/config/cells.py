"""A document becomes a study: one validated config, and the cells that its sweep spans."""

import contextlib
import functools
import gc
import itertools
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ValidationError, create_model

from jaxnet.config import faults, ranges, spacings, wording
from jaxnet.config.document import ConfigError, Document, Keys, Problem, dotted_key, set_value, split_key
from jaxnet.config.keys import KINDS, Config, Initial, Linspace, Scenario, Sweep
from jaxnet.kinds import registry
from jaxnet.kinds.fields import MARK, Record
from jaxnet.kinds.kind import Fault, Kind, KindError

Locate = Callable[..., str]  # places of keys: FILE:LINE:COL of the first that was written

MOST_SWEPT_CELLS = 1_000_000
DEFAULT_SCENARIO = Scenario()
SINGLE_KEY_MODELS: dict[str, type[BaseModel]] = {  # models of one key each
    key: create_model(key, __base__=Record, **{key: (field.annotation, field)})  # pyright: ignore
    for key, field in Scenario.model_fields.items()
}
UNLABELLED_KEYS = ("kind", "label", "edges", "content")  # keys of kinds that no label tells


@dataclass(frozen=True)
class Cell:
    """One point of the sweep's grid: its number from 0, its swept keys as tables show them, its scenario."""

    number: int
    labels: dict[str, Any]
    scenario: Scenario

    def __str__(self) -> str:
        """How messages name it."""
        return cell_name(self.number, self.labels)


def read_document(document: Document) -> tuple[Config, tuple[Cell, ...]]:
    """The study that a document describes; raises ConfigError with everything that is wrong."""
    judges = registry.scope().judges
    name_kinds(document)
    if judges:  # else it has been done before the study was stored
        complete_kinds(document)
        ranges.write_distributions(document)
    settled, problems = validate(Config, document.data, document.place)
    given, _ = validate(SweepAlone, document.data, document.place)
    values = {} if given is None else {key: swept_values(each) for key, each in given.sweep.items()}
    known = KnownKeys(document.data, values)
    wrong = list(refuse_sweep(settled, values, known))
    problems += [Problem(document.place(("sweep", key)), f"sweep.{key}", m) for key, m in wrong]
    problems += [*document.problems, *idle_overrides(document, list(values))]
    spanned = {key: listed for key, listed in values.items() if known.has(key)}
    cells: tuple[Cell, ...] = ()
    if math.prod(map(len, values.values())) <= MOST_SWEPT_CELLS:
        base = document.data if settled is None else to_plain(settled)
        with pause_garbage_collection():
            cells, found = cells_of(document, base, spanned, known=set(problems))
        problems += found
    if settled is not None and judges:
        problems += [
            located(fault, document.place)
            for fault in faults.study_faults(settled, [cell.scenario for cell in cells])
        ]
    if settled is None or problems:
        raise ConfigError(sorted(problems, key=line_order))
    return settled, cells


@contextlib.contextmanager
def pause_garbage_collection() -> Iterator[None]:
    """Have Python look for no garbage while many objects are made that all stay."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def line_order(problem: Problem) -> tuple[int, ...]:
    """Orders problems as they stand in the file, the command line's last."""
    match = re.search(r":([0-9]+):([0-9]+)$", problem.place)
    return (int(match[1]), int(match[2])) if match else (2**62,)


def idle_overrides(document: Document, swept: Sequence[str]) -> Iterator[Problem]:
    """Overrides that the sweep would silently replace."""
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
    """A fault with the place of the first of its keys that was written."""
    return Problem(place(*map(split_key, fault.keys)), fault.keys[0], fault.message)


def name_kinds(document: Document) -> None:
    """Write out what a kind's bare name, or a mapping without one, stands for."""
    for field in KINDS:
        if field in document.data:
            document.data[field] = with_kind(field, document.data[field])
            place = document.place((field, "kind"), (field,))
            document.places.setdefault((field, "kind"), place)


def with_kind(field: str, value: Any) -> Any:
    """The mapping that a value of a kind's field means."""
    if isinstance(value, str):
        return {"kind": value}
    if isinstance(value, dict) and "kind" not in value:
        return {"kind": Scenario.model_fields[field].default.reference(), **value}
    return value


def complete_kinds(document: Document) -> None:
    """Have kinds add what they read from files, in the sweep too."""
    sweep = document.data.get("sweep")
    for field in KINDS:
        if field in document.data:
            complete(document, field, document.data, (field,))
        listed = sweep.get(field) if isinstance(sweep, dict) else None
        for number in range(len(listed) if isinstance(listed, list) else 0):
            complete(document, field, listed, ("sweep", field, number))


def complete(document: Document, field: str, holder: Any, at: Keys) -> None:
    """Have the kind at a place of a config, in a mapping or list, add what it reads from a file."""
    if model := model_of(field, holder[at[-1]]):
        try:
            holder[at[-1]] = model.completed(holder[at[-1]], document.folder)
        except KindError as error:
            key = (*at, "path")
            document.problems.append(Problem(document.place(key, at), dotted_key(key), str(error)))


def validate(model: type[Any], data: Mapping[Any, Any], place: Locate) -> tuple[Any, list[Problem]]:
    """The model, or what is wrong with each key."""
    try:
        return model.model_validate(dict(data)), []
    except ValidationError as error:
        problems = []
        for one in error.errors(include_url=False):
            keys = keys_of(one)
            problems.append(Problem(place(keys), dotted_key(keys), wording.explain(one, data)))
        return None, problems


def keys_of(error: Any) -> Keys:
    """Keys of an error's place as the user writes them: the marks of unions taken out."""
    keys = tuple(part for part in error["loc"] if not str(part).startswith((MARK, "[key]")))
    if error["type"] == "missing" and isinstance(keys[-1], int):
        return keys[:-1]
    in_mapping = error["type"] in ("kind", "kind_name") and isinstance(error["input"], dict)
    return (*keys, "kind") if in_mapping else keys


def swept_values(given: Any) -> list[Any]:
    """Values of one swept key; a spacing of whole numbers gives whole numbers."""
    if isinstance(given, list):
        return given
    if isinstance(given, Linspace):
        spaced = spacings.linspace(*given.linspace)
    else:
        spaced = spacings.geomspace(*given.geomspace)
    return [int(value) for value in spaced] if all(map(float.is_integer, spaced)) else spaced


def refuse_sweep(
    settled: Config | None, values: Mapping[str, list[Any]], known: "KnownKeys"
) -> Iterator[tuple[str, str]]:
    """What is wrong with a sweep before its cells are looked at: key and message."""
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
            yield key, f"unknown key{known.hint(root, key.split('.')[1])}"
        if any(other.startswith(f"{key}.") for other in list(values)[:number]):
            yield key, "must stand before the dotted keys that set into it"
        if saves and key in ("vehicles", "vehicle", "horizon", "output_step"):
            yield key, "cannot be swept while save stores errors or trajectories"
        twice = [name for name, times in Counter(value_labels(key, listed)).items() if times > 1]
        if twice:
            remedy = "; give each a label" if key in KINDS else ""
            remedy += ", a networkx graph a name" if key == "topology" else ""
            yield key, f"two values are named {twice[0]}{remedy}"


class KnownKeys:
    """Dotted keys that some cell of a study has: those of the kinds that it names, or sweeps."""

    def __init__(self, data: Mapping[Any, Any], values: Mapping[str, list[Any]]):
        self.given = {
            root: [with_kind(root, value) for value in (data.get(root, {}), *values.get(root, []))]
            for root in KINDS
        }

    def has(self, key: str) -> bool:
        """Whether there is such a key."""
        root, *inside = key.split(".")
        open_ended = any(
            model.model_config.get("extra") == "allow"
            for value in self.given.get(root, [])
            if (model := model_of(root, value))
        )
        return root in Scenario.model_fields and (open_ended or not inside or inside[0] in self.inside(root))

    def hint(self, root: str, word: str) -> str:
        """The key inside a key that was probably meant by a word, or all that can be swept."""
        found = self.inside(root)
        if root in KINDS or root == "initial":
            return wording.suggestion(word, found)
        return f" (known here: {', '.join(found or [root])})"

    def inside(self, root: str) -> list[str]:
        """Keys besides `kind` inside a key, of a list its entries; none inside a plain value."""
        if root == "initial":
            return list(Initial.model_fields)
        if root == "gain":
            return list(map(str, range(len(Scenario.model_fields[root].default))))
        models = [model_of(root, value) for value in self.given.get(root, [])]
        return list(dict.fromkeys(key for model in models if model for key in model.model_fields))


def model_of(field: str, value: Any) -> type[Kind] | None:
    """The class that a value of a kind's field names, if there is one."""
    if not isinstance(value, dict) or not isinstance(value.get("kind"), str):
        return None
    with contextlib.suppress(KindError):
        return registry.find(field, value["kind"])


def value_labels(key: str, listed: list[Any]) -> list[Any]:
    """What tables call the values of one swept key: all by a number, or all by text.

    A kind is called by its label, or by its name with whatever tells it apart from others of the kind.
    """
    if key not in KINDS:
        if all(isinstance(value, int | float) for value in listed):
            fits = all(isinstance(value, float) or -(2**63) <= value < 2**63 for value in listed)
            return listed if fits else list(map(float, listed))  # a column of tables holds 64 bits
        return [value if isinstance(value, str) else wording.value_text(value) for value in listed]
    kinds = [full_kind(key, with_kind(key, value)) for value in listed]
    telling = telling_keys(kinds)
    return [kind_label(kind, telling) for kind in kinds]


def telling_keys(kinds: list[Any]) -> dict[str, list[Any]]:
    """By name of a kind, the keys by which swept kinds of this name differ."""
    found: dict[str, list[Any]] = {}
    first: dict[str, dict[Any, Any]] = {}
    for kind in filter(lambda each: isinstance(each, dict), kinds):
        name = wording.value_text(kind["kind"])
        other, keys = first.setdefault(name, kind), found.setdefault(name, [])
        differing = (key for key in {**other, **kind} if other.get(key) != kind.get(key))
        keys += [key for key in differing if key not in (*UNLABELLED_KEYS, *keys)]
    return found


def full_kind(field: str, value: Any) -> Any:
    """The mapping of a kind with its defaults written out."""
    model = model_of(field, value)
    if model is None:
        return value
    fields = model.model_fields
    defaults = {key: each.default for key, each in fields.items() if not each.is_required()}
    return {key: without_empty_labels(each) for key, each in (defaults | value).items()}


def kind_label(kind: Any, telling: Mapping[str, list[Any]]) -> str:
    """Name of one swept kind, with the keys that tell it apart from others of its name."""
    if not isinstance(kind, dict):
        return wording.shorten_value(kind)
    if isinstance(kind.get("label"), str):
        return kind["label"]
    keys = telling[wording.value_text(kind["kind"])]
    words = [f"{key}={wording.shorten_value(value)}" for key, value in kind.items() if key in keys]
    name = str(kind["kind"]).rpartition(":")[2]
    return name + (f"({', '.join(words)})" if words else "")


class CellParts:
    """What the cells of a study are made of. A value of a key is validated once, for all cells that have it.

    The values are set into the study, with its defaults written out if nothing is wrong with it, as it is
    stored: so that the stored study has the same cells.
    """

    def __init__(self, document: Document, study: Mapping[Any, Any], values: Mapping[str, list[Any]]):
        given = {key: value for key, value in study.items() if key in Scenario.model_fields}
        kinds = {key: full_kind(key, value) for key, value in given.items() if key in KINDS}
        self.document, self.values = document, values
        self.base: dict[str, Any] = to_plain(DEFAULT_SCENARIO) | given | kinds
        self.swept: dict[str, list[str]] = {}
        for key in values:
            self.swept.setdefault(key.split(".")[0], []).append(key)
        self.found: dict[Any, tuple[Any, list[Problem]]] = {}
        fixed = {root: self.made(root, {}) for root in self.base if root not in self.swept}
        self.problems = [problem for _, wrong in fixed.values() for problem in wrong]
        self.wrong = {root for root, (_, wrong) in fixed.items() if wrong}
        right = {root: value for root, (value, wrong) in fixed.items() if not wrong}
        self.shared = DEFAULT_SCENARIO.model_copy(update=right)

    def scenario(self, chosen: Mapping[str, int]) -> tuple[Scenario | None, list[Problem]]:
        """A cell's scenario by the indices of its swept values, or all that is wrong with it.

        Where single keys are wrong, what several must fulfil together is still asked of the others.
        """
        problems, wrong, right = list(self.problems), set(self.wrong), {}
        for root, keys in self.swept.items():
            right[root], found = self.part(root, {key: chosen[key] for key in keys})
            problems += found
            if found:
                wrong.add(root)
                del right[root]
        made = self.shared.model_copy(update=right)
        place = functools.partial(place_in_cell, self.document, chosen)
        if registry.scope().judges:
            problems += [
                located(fault, place)
                for fault in faults.scenario_faults(made)
                if not wrong & {key.split(".")[0] for key in fault.keys}
            ]
        return None if wrong else made, problems

    def part(self, root: str, chosen: Mapping[str, int]) -> tuple[Any, list[Problem]]:
        """The value of a key by the indices of the swept values in it, or what is wrong with it."""
        mine = root, *chosen.values()
        if mine not in self.found:
            self.found[mine] = self.made(root, chosen)
        return self.found[mine]

    def made(self, root: str, chosen: Mapping[str, int]) -> tuple[Any, list[Problem]]:
        """The same, validated."""
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
    document: Document, study: Mapping[Any, Any], values: Mapping[str, list[Any]], known: set[Problem]
) -> tuple[tuple[Cell, ...], list[Problem]]:
    """The cells, first key slowest, and what is wrong with them but was not known, each fault once."""
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


def cell_name(number: int, labels: Mapping[str, Any]) -> str:
    """How messages name a cell."""
    swept = ", ".join(f"{key}={value}" for key, value in labels.items())
    return f"cell {number}" + (f" ({swept})" if swept else "")


def set_swept(data: dict[str, Any], key: str, value: Any) -> None:
    """Set one swept key into a cell's data: a kind replaces the whole mapping, a dotted key sets into it.

    Raises LookupError where there is nothing to set into.
    """
    root = key.split(".")[0]
    set_value(data, split_key(key), value)
    if root in KINDS:
        data[root] = with_kind(root, data[root])


def place_in_cell(document: Document, chosen: Mapping[str, int], *candidates: Keys) -> str:
    """Where a cell's fault stands: at the swept value that set the key, else where the key is written."""
    for keys in candidates:
        for key in sorted(chosen, key=lambda key: -key.count(".")):
            swept, here = split_key(key), ("sweep", key, chosen[key])
            if swept[: len(keys)] == keys[: len(swept)]:
                inside = (*here, *keys[len(swept) :])
                return document.place(inside, here)
    return document.place(*candidates)


def to_plain(model: BaseModel) -> dict[str, Any]:
    """A model as plain data, for YAML and JSON."""
    return without_empty_labels(model.model_dump(mode="python"))


def without_empty_labels(value: Any) -> Any:
    """Plain data of models, mappings and lists, without labels that nobody gave."""
    if isinstance(value, BaseModel):
        return to_plain(value)
    if isinstance(value, dict):
        return {
            key: without_empty_labels(each)
            for key, each in value.items()
            if not (key == "label" and each is None)
        }
    return [without_empty_labels(each) for each in value] if isinstance(value, list | tuple) else value
