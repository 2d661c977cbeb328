"""Kinds of results that are read without running code from the results folder.

A kind from outside is available if this process has loaded its very files, or if it is installed.
Any other kind gets a stand-in with the kind's keys and the manifest's description. Methods of a
stand-in raise MissingKindError.
"""

import contextlib
import copy
import importlib
import importlib.util
import inspect
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NoReturn, TypeVar, get_origin

from pydantic import BaseModel, ConfigDict, create_model

from jaxnet.kinds.kind import Kind, KindError
from jaxnet.kinds.metrics import Metric, MetricKeys
from jaxnet.kinds.registry import LOADED, METRIC_REFERENCES, Scope, metric_name
from jaxnet.outside import modules
from jaxnet.outside import provenance as source
from jaxnet.outside.families import FAMILIES, base_of, entry_points, import_reference

# What is known of a metric besides its code.
METRIC = ("name", "unit", "over", "time", "vehicles", "words")
# Methods that need the types of keys.
ASKS = {"drawn", "drawn_keys", "apart", "chosen", "signal", "told", "faults"}
Found = type[Kind] | Metric  # a kind from outside
Description = dict[str, object]  # of a kind from outside, in JSON


class MissingKindError(KindError):
    """A request for the code of kinds that is not available; the message says how to give it."""

    def __init__(self, names: str):
        super().__init__(
            f"the code of {names} is needed, and none is run because a results folder names it:"
            " give the study's config, beside which it is (--config FILE), or trust the folder's"
            " word (--trust)"
        )


Fallback = TypeVar("Fallback")


def known_or(otherwise: Fallback, ask: Callable[[], Fallback]) -> Fallback:
    """What `ask` finds, or `otherwise` if it needs the code of a missing kind."""
    try:
        return ask()
    except MissingKindError:
        return otherwise


class Looking(Scope):
    """Names of kinds in the results of an earlier run.

    `manifest` belongs to the results, and no module inside the folder `results` is imported.
    `places` are folders whose modules the user permits.
    """

    judges = False

    def __init__(
        self, results: Path | None, manifest: Mapping[str, Any], places: Iterable[Path] = ()
    ):
        super().__init__()
        self.results, self.manifest, self.places = results, manifest, list(places)
        self.stand_ins: dict[tuple[str, str], Found] = {}

    @property
    def missing(self) -> list[str]:
        return sorted({name for _, name in self.stand_ins})

    def outside(self, family: str, name: str) -> Found | None:
        """The kind or a stand-in; raise KindError if a permitted module fails."""
        made = self.manifest.get("modules", {})
        for found in reversed(LOADED.get((family, name), [])):  # from files equal to the results'
            parts = source.provenance([found]).items()
            if all(made.get(each, {}).get("sha256") == one.sha256 for each, one in parts):
                return found
        for place in self.places if ":" in name else ():
            if modules.file_of(place, name.partition(":")[0]) is not None:
                return import_reference(name, name, place)
        offered = {point.name: point.value for point in entry_points(family)}
        reference = offered.get(name, name if ":" in name else "")
        module = reference.partition(":")[0]
        known = name in offered or modules.is_installed(module)
        if reference and known and "__main__" not in module and self.is_outside(module):
            # A kind of another version of the package is shown as a name.
            with contextlib.suppress(KindError):
                return import_reference(reference, name, None)
        if (family, name) not in self.stand_ins:
            told = self.manifest.get("kinds", {}).get(name, {})
            told = told if told.get("family") == family else {}
            make = metric_like if family == "metrics" else class_like
            self.stand_ins[family, name] = make(family, name, told)
        return self.stand_ins[family, name]

    def is_outside(self, module: str) -> bool:
        """Whether an import of a module finds a file, and none inside the results."""
        top = module.partition(".")[0]
        try:
            spec = importlib.util.find_spec(top) if top.isidentifier() else None
        except ValueError:  # of a module without a spec
            return False
        if spec is None or self.results is None:
            return spec is not None
        places = [*(spec.submodule_search_locations or ()), *filter(None, [spec.origin])]
        return all(self.results.resolve() not in Path(place).resolve().parents for place in places)


def describe_outside(
    known: Mapping[tuple[str, str], source.KindOrMetric],
    named: Iterable[source.KindOrMetric],
    metrics: Sequence[Metric] = (),
) -> dict[str, Description]:
    """The manifest's description of kinds from outside, for readers without their code.

    `metrics` are those of the study, with its keys.
    """
    wanted, told = list(named), dict[str, Description]()
    for (family, name), found in known.items():
        if any(each is found for each in wanted):
            used = [each for each in metrics if metric_name(each) == name] or [found]
            own = {key: getattr(used[0], key, None) for key in METRIC}
            own["name"] = getattr(found, "base", None)
            if len({getattr(each, "words", "") for each in used}) > 1:
                own["words"] = ""  # one text cannot tell all
            told[name] = {"family": family, **(of_class(found) if isinstance(found, type) else own)}
    return told


def of_class(cls: type) -> Description:
    base = next(each for each in cls.__mro__ if is_ours(each))
    fields = cls.model_fields.items()
    keys = {key: None if field.is_required() else field.get_default() for key, field in fields}
    facts = {key: getattr(cls, key, None) for key in facts_of(base)}
    return {
        "base": base.__name__,
        "kind": cls.kind,
        "keys": {key: json_value(each) for key, each in keys.items()},
        "facts": {key: each for key, each in facts.items() if json_value(each) is not None},
        "own": [
            name
            for name in methods_of(base)
            if inspect.getattr_static(cls, name) is not inspect.getattr_static(base, name)
        ],
    }


def is_ours(cls: type) -> bool:
    return cls.__module__ in {family.package for family in FAMILIES.values()}


def facts_of(base: type) -> list[str]:
    told = (vars(each).get("__annotations__", {}) for each in base.__mro__ if is_ours(each))
    names = (name for each in told for name, kind in each.items() if get_origin(kind) is ClassVar)
    return [name for name in dict.fromkeys(names) if name != "untraced"]


def methods_of(base: type) -> list[str]:
    """Public methods of a family's base class, without those of every kind."""
    own = {name for each in base.__mro__ if is_ours(each) for name in vars(each)}
    return sorted(name for name in own if name[0] != "_" and callable(getattr(base, name)))


def json_value(value: object) -> object:
    """A value as JSON data; None if JSON cannot represent it."""
    value = value.model_dump() if isinstance(value, BaseModel) else value
    try:
        return json.loads(json.dumps(value))
    except (TypeError, ValueError):
        return None


def metric_like(family: str, name: str, told: Description) -> Metric:
    texts = {"name": name.rpartition(":")[2], "unit": ""}
    texts |= {key: told[key] for key in METRIC if isinstance(told.get(key), str)}
    own = {"__call__": missing_method(name), "model_config": ConfigDict(extra="allow")}
    measure: Any = type("StandIn", (MetricKeys,), {"__module__": __name__, **own})
    found = Metric(**texts, of=measure())  # pyright: ignore[reportArgumentType]
    METRIC_REFERENCES[found] = name
    return found


def class_like(family: str, name: str, told: Description) -> type[Kind]:
    package = importlib.import_module(FAMILIES[family].package)
    base = getattr(package, str(told.get("base")), None)
    if not (isinstance(base, type) and issubclass(base, base_of(family)) and is_ours(base)):
        base, told = base_of(family), {}
    listed = told.get("own")
    own = [key for key in methods_of(base) if not isinstance(listed, list) or key in listed]
    asks = [key for key in (*own, *ASKS) if hasattr(base, key)]
    namespace = dict.fromkeys(asks, missing_method(name)) | facts_like(name, base, told)
    namespace |= {
        "__module__": __name__,
        "reference": classmethod(lambda cls: name),
        "model_config": ConfigDict(extra="allow"),
    }
    bare: Any = type("StandIn", (base,), namespace)
    found: Any = create_model(
        "StandIn", __base__=bare, __module__=__name__, **keys_like(base, told)
    )
    called = told.get("kind")
    found.kind = called if isinstance(called, str) else name.rpartition(":")[2]
    return found


def facts_like(name: str, base: type, told: Description) -> dict[str, Any]:
    """Described facts of a class that have the right type; any other fact raises."""
    facts, found = told.get("facts"), {}
    for key in facts_of(base):
        value, known = facts.get(key) if isinstance(facts, dict) else None, getattr(base, key, ())
        value = tuple(map(str, value)) if isinstance(value, list) else value
        found[key] = value if type(value) is type(known) else property(missing_method(name))
    return found


def keys_like(base: type[Kind], told: Description) -> dict[str, Any]:
    """Described keys of a class. Keys of its base keep their types, others accept anything."""
    keys, found = told.get("keys"), dict[str, Any]()
    for key, default in keys.items() if isinstance(keys, dict) else ():
        field = base.model_fields.get(key)
        if field is None and key.isidentifier() and key[0] != "_" and not hasattr(base, key):
            found[key] = (Any, default)
        elif field is not None and json_value(field.get_default()) != default:
            field = copy.copy(field)
            field.default = default
            found[key] = (field.annotation, field)
    return found


def missing_method(name: str) -> Callable[..., NoReturn]:
    def ask(*given: object, **more: object) -> NoReturn:
        raise MissingKindError(name)

    return ask
