"""Kinds of results that are only looked at: nothing is imported for them from a results folder.

A kind from outside is here if this process has loaded its very files, or if it is installed. For any other
there is a stand-in. It has the keys of the kind and what the folder's manifest says of it; asked for what its
code alone knows, it raises MissingKindError.
"""

import contextlib
import copy
import importlib
import importlib.util
import inspect
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, TypeVar, get_origin

from pydantic import ConfigDict, create_model

from jaxnet.kinds import modules
from jaxnet.kinds import provenance as source
from jaxnet.kinds.families import FAMILIES, base_of
from jaxnet.kinds.kind import Kind, KindError
from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.outside import entry_points, import_reference
from jaxnet.kinds.registry import LOADED, METRIC_NAMES, Scope

METRIC = ("name", "unit", "over", "time", "vehicles", "words")  # what is known of a metric besides its code
ASKS = {"drawn", "drawn_keys", "apart", "chosen", "signal", "told", "faults"}  # need the types of keys


REMEDY = "give the study's config, beside which it is (--config FILE), or trust the folder's word (--trust)"


class MissingKindError(KindError):
    """What was asked needs the code of kinds that is not here, and says what brings it."""

    def __init__(self, names: str):
        super().__init__(
            f"the code of {names} is needed, and none is run because a results folder names it: {REMEDY}"
        )


Found = TypeVar("Found")


def known_or(otherwise: Found, ask: Callable[[], Found]) -> Found:
    """What is found, or something else where the code of a kind is missing."""
    try:
        return ask()
    except MissingKindError:
        return otherwise


class Looking(Scope):
    """What names mean in results that are looked at.

    `manifest` is the results' one, and no module inside `results` is imported. `places` are folders whose
    modules may be loaded, which the user has said.
    """

    judges = False

    def __init__(self, results: Path | None, manifest: Mapping[str, Any], places: Iterable[Path] = ()):
        super().__init__()
        self.results, self.manifest, self.places = results, manifest, list(places)
        self.stand_ins: dict[tuple[str, str], Any] = {}

    @property
    def missing(self) -> list[str]:
        """Names of kinds whose code is not here."""
        return sorted({name for _, name in self.stand_ins})

    def outside(self, family: str, name: str) -> Any:
        """The kind if it is here, else a stand-in; raises KindError if a module that may be loaded fails."""
        for here in (self.loaded, self.placed, self.installed, self.stand_in):
            if (found := here(family, name)) is not None:
                return found
        return None

    def loaded(self, family: str, name: str) -> Any:
        """What this process has loaded under this name from files like those of the results."""
        made = self.manifest.get("modules", {})
        for found in reversed(LOADED.get((family, name), [])):
            parts = source.provenance([found])
            if all(made.get(each, {}).get("sha256") == one.sha256 for each, one in parts.items()):
                return found
        return None

    def placed(self, family: str, name: str) -> Any:
        """What stands in a module of a place that the user has named."""
        module = name.partition(":")[0]
        held = (place for place in self.places if modules.file_of(place, module) is not None)
        place = next(held, None) if ":" in name else None
        return None if place is None else import_reference(name, name, place)

    def installed(self, family: str, name: str) -> Any:
        """What an installed package offers, or has at `module:attribute`."""
        offered = {point.name: point.value for point in entry_points(family)}
        reference = offered.get(name, name if ":" in name else "")
        module = reference.partition(":")[0]
        known = name in offered or modules.is_installed(module)
        if not reference or "__main__" in module or not known or self.is_inside(module.partition(".")[0]):
            return None
        with contextlib.suppress(KindError):  # of another version of the package: it is shown as a name
            return import_reference(reference, name, None)
        return None

    def is_inside(self, top: str) -> bool:
        """Whether an import of this name would find something inside the results, or nothing."""
        try:
            spec = importlib.util.find_spec(top) if top.isidentifier() else None
        except ValueError:  # of a module without a spec
            return True
        if spec is None or self.results is None:
            return spec is None
        places = [*(spec.submodule_search_locations or ()), *filter(None, [spec.origin])]
        return any(self.results.resolve() in Path(place).resolve().parents for place in places)

    def stand_in(self, family: str, name: str) -> Any:
        """A class or metric in place of one whose code is not here."""
        key = family, name
        if key not in self.stand_ins:
            told = self.manifest.get("kinds", {}).get(name, {})
            told = told if isinstance(told, dict) and told.get("family") == family else {}
            make = metric_like if family == "metrics" else class_like
            self.stand_ins[key] = make(family, name, told)
        return self.stand_ins[key]


def described(known: Mapping[tuple[str, str], Any], named: Iterable[Any]) -> dict[str, Any]:
    """What a manifest says of kinds from outside, for those who look at results without their code."""
    wanted = list(named)
    return {
        name: {"family": family, **(of_metric(found) if isinstance(found, Metric) else of_class(found))}
        for (family, name), found in known.items()
        if any(each is found for each in wanted)
    }


def of_metric(metric: Metric) -> dict[str, Any]:
    """All of a metric but its function."""
    return {key: getattr(metric, key) for key in METRIC}


def of_class(cls: type[Kind]) -> dict[str, Any]:
    """Of a class: its base among ours, keys with their defaults, plain facts, and the methods of its own."""
    base = next(each for each in cls.__mro__ if is_ours(each))
    keys = {key: field.get_default() for key, field in cls.model_fields.items() if not field.is_required()}
    return {
        "base": base.__name__,
        "kind": cls.kind,
        "keys": dict.fromkeys(cls.model_fields) | {key: plain(each) for key, each in keys.items()},
        "facts": {
            key: getattr(cls, key) for key in facts_of(base) if plain(getattr(cls, key, None)) is not None
        },
        "own": [
            name
            for name in methods_of(base)
            if inspect.getattr_static(cls, name) is not inspect.getattr_static(base, name)
        ],
    }


def is_ours(cls: type) -> bool:
    """Whether a class is the base, or one of the bases, of a family of ours."""
    return cls.__module__ in {family.package for family in FAMILIES.values()}


def facts_of(base: type) -> list[str]:
    """Names of what a class says of itself besides its keys and methods."""
    told = (vars(each).get("__annotations__", {}) for each in base.__mro__ if is_ours(each))
    names = (name for each in told for name, kind in each.items() if get_origin(kind) is ClassVar)
    return [name for name in dict.fromkeys(names) if name != "untraced"]


def methods_of(base: type) -> list[str]:
    """Public methods of a class of ours, besides those that every kind has."""
    own = {name for each in base.__mro__ if is_ours(each) for name in vars(each)}
    return sorted(name for name in own if name[0] != "_" and callable(getattr(base, name)))


def plain(value: Any) -> Any:
    """Plain data that JSON has words for; None of anything else."""
    value = value.model_dump() if hasattr(value, "model_dump") else value
    try:
        return json.loads(json.dumps(value))
    except (TypeError, ValueError):
        return None


def metric_like(family: str, name: str, told: Mapping[str, Any]) -> Metric:
    """A metric without its function."""
    texts = {key: told[key] for key in METRIC if isinstance(told.get(key), str)}
    found = Metric(**{"name": name.rpartition(":")[2], "unit": "", **texts, "of": missing(name)})
    METRIC_NAMES[found] = name
    return found


def class_like(family: str, name: str, told: Mapping[str, Any]) -> type[Kind]:
    """A class with the keys of a kind and what a manifest says of it, whose own methods are missing."""
    package = importlib.import_module(FAMILIES[family].package)
    base = getattr(package, str(told.get("base")), None)
    if not (isinstance(base, type) and issubclass(base, base_of(family)) and is_ours(base)):
        base, told = base_of(family), {}
    listed = told.get("own")
    own = [key for key in methods_of(base) if not isinstance(listed, list) or key in listed]
    namespace: dict[str, Any] = {key: missing(name) for key in {*own, *ASKS} if hasattr(base, key)}
    namespace |= facts_like(name, base, told.get("facts"))
    namespace |= {
        "__module__": __name__,
        "reference": classmethod(lambda cls: name),
        "model_config": ConfigDict(extra="allow"),
    }
    bare: Any = type("StandIn", (base,), namespace)
    found: Any = create_model(
        "StandIn", __base__=bare, __module__=__name__, **keys_like(base, told.get("keys"))
    )
    called = told.get("kind")
    found.kind = called if isinstance(called, str) else name.rpartition(":")[2]
    return found


def facts_like(name: str, base: type, told: Any) -> dict[str, Any]:
    """What a manifest says of a class, as far as it is of the type that it must be; the rest is missing."""
    found: dict[str, Any] = {}
    for key in facts_of(base):
        value, known = told.get(key) if isinstance(told, dict) else None, getattr(base, key, ())
        value = tuple(map(str, value)) if isinstance(value, list) else value
        found[key] = value if type(value) is type(known) else property(missing(name))
    return found


def keys_like(base: type[Kind], told: Any) -> dict[str, Any]:
    """Keys of a class with their defaults: those of a base keep their types, others take anything."""
    found: dict[str, Any] = {}
    for key, default in told.items() if isinstance(told, dict) else ():
        field = base.model_fields.get(key)
        if field is None and key.isidentifier() and key[0] != "_" and not hasattr(base, key):
            found[key] = (Any, default)
        elif field is not None and plain(field.get_default()) != default:
            field = copy.copy(field)
            field.default = default
            found[key] = (field.annotation, field)
    return found


def missing(name: str) -> Callable[..., Any]:
    """A method that says whose code is not here."""

    def ask(*given: Any, **more: Any) -> Any:
        raise MissingKindError(name)

    return ask
