"""Find a kind by its name: a kind of jaxnet by its file, an installed kind by its entry point, any
other kind by `module:Class`.

`find` refuses a class of another family before it calls anything of the class. A `Scope` holds what
the names of one study mean, because another study may use the same names for other classes.
"""

import contextlib
import functools
import importlib
import importlib.util
import json
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError, core_schema

from jaxnet.kinds.fields import Record
from jaxnet.kinds.kind import REFERENCES, Kind, KindError
from jaxnet.outside import modules, provenance
from jaxnet.outside.families import (
    FAMILIES,
    base_of,
    entry_points,
    family_of,
    import_reference,
    is_member,
)
from jaxnet.outside.provenance import KindOrMetric, home_of, name_in

RENAMED = {("engine", "flat"): "exact", ("engine", "chassis"): "nonlinear"}

FamilyName = tuple[str, str]  # a family, and the name of a kind in it
Origins = Mapping[FamilyName, tuple[modules.Origin, str]]


class Scope:
    """Classes and metrics from outside by their names in one study, whose config is in `folder`."""

    judges = True  # whether the study is new: kinds then read their files and report faults

    def __init__(
        self, folder: Path | None = None, known: Mapping[FamilyName, KindOrMetric] | None = None
    ):
        self.folder, self.known = folder, dict(known or {})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scope) and self.known == other.known

    def __reduce__(self) -> tuple[Callable[..., "Scope"], tuple[object, ...]]:
        """Pickle modules and names of the classes, from which another process loads the classes."""
        known = self.known.items()
        origins = {key: (provenance.origin_of(each), name_in(each)) for key, each in known}
        return scope_of, (self.folder, origins)

    @contextlib.contextmanager
    def __call__(self) -> Iterator["Scope"]:
        """Make this the scope in which `find` looks up names."""
        token = CURRENT_SCOPE.set(self)
        try:
            yield self
        finally:
            CURRENT_SCOPE.reset(token)

    def outside(self, family: str, name: str) -> KindOrMetric | None:
        """The kind of an entry point or of `module:attribute`, None if the name is neither."""
        point = next((each for each in entry_points(family) if each.name == name), None)
        if point is not None:
            return import_reference(point.value, name, None)
        return import_reference(name, name, self.folder) if ":" in name else None

    def named_in(self, data: object) -> list[KindOrMetric]:
        """The classes and metrics from outside that plain data names."""
        named = set(text_in(data))
        return [found for (_, name), found in self.known.items() if name in named]


CURRENT_SCOPE: ContextVar[Scope | None] = ContextVar("scope", default=None)
# Everything from outside that this process has found, latest last
LOADED: dict[FamilyName, list[Any]] = {}
METRIC_REFERENCES: dict[Any, str] = {}  # names by which metrics from outside were found


def scope() -> Scope:
    """The current scope, or an empty one outside a study."""
    return CURRENT_SCOPE.get() or Scope()


def scope_of(folder: Path | None, origins: Origins) -> Scope:
    """A scope that another process has sent; raise KindError if a module differs here."""
    found = Scope(folder)
    for key, (origin, name) in origins.items():
        found.known[key] = modules.attribute(modules.load_origin(origin), name)
        record_found(*key, found.known[key])
    return found


def kind_names(family: str) -> list[str]:
    """The names of a family's kinds that need no module: jaxnet's, then those of entry points."""
    package = importlib.import_module(FAMILIES[family].package)
    ours = [module.name for module in pkgutil.iter_modules(package.__path__)]
    return [*ours, *(point.name for point in entry_points(family) if point.name not in ours)]


def models(family: str) -> dict[str, type[Record]]:
    """The models of keys, by name, of a family's kinds that have keys and need no module."""
    found = {name: find(family, name) for name in kind_names(family)}
    models = {
        name: each if isinstance(each, type) else type(each.of) for name, each in found.items()
    }
    return {name: model for name, model in models.items() if issubclass(model, Record)}


def find(family: str, name: str) -> Any:
    """The class of a kind by its name in a family, or the metric; raise KindError."""
    if (family, name) in RENAMED:
        raise KindError(f"{name} was renamed to {RENAMED[family, name]}")
    here = scope()
    found = here.known.get((family, name)) or builtin_kind(family, name)
    found = found or here.outside(family, name)
    if found is None:
        raise unknown_kind(family, name)
    if not is_member(found, family):
        shown = found.__name__ if isinstance(found, type) else repr(found)[:60]
        raise KindError(f"{name} is not of the family {base_of(family).__name__} ({shown})")
    if home_of(found).startswith("jaxnet."):
        refer(found, name)
    else:
        keep(family, name, found)
    return found


def keep(family: str, name: str, found: KindOrMetric) -> None:
    """Let a name mean a class or metric from outside in this scope.

    Raises KindError if its file has changed, or if the name means another one.
    """
    provenance.refuse_changed(found, name)
    held = scope().known.setdefault((family, name), found)
    if held is not found and (isinstance(held, type) or not held.is_alike(found)):
        raise KindError(f"two classes are called {name}: rename one of them")
    provenance.made_of(found)  # records the file as it is now
    record_found(family, name, found)


def record_found(family: str, name: str, found: KindOrMetric) -> None:
    held = LOADED.setdefault((family, name), [])
    if found not in held:
        held.append(found)
    refer(found, name)


def refer(found: KindOrMetric, name: str) -> None:
    if not isinstance(found, type):
        METRIC_REFERENCES[found] = name
    elif issubclass(found, Kind):
        REFERENCES[found] = name


def metric_name(metric: KindOrMetric) -> str:
    return str(METRIC_REFERENCES.get(metric, metric.base))


def unknown_kind(family: str, given: object) -> KindError:
    """The error for a name that no kind has, or for a value that is no name."""
    known, shown = ", ".join(kind_names(family)), json.dumps(given, default=repr)
    return KindError(f"must be one of {known}, or module:Class (got {shown})")


def adopt(given: KindOrMetric) -> str:
    """Reference of a class or metric that a script passes; `find` knows the reference from now on.

    Raises KindError if the class's file has changed, or if two classes have one reference.
    """
    module = home_of(given)
    ours = module.startswith("jaxnet.")
    if isinstance(given, type):
        reference: str = given.reference()  # pyright: ignore[reportAttributeAccessIssue]
    else:
        reference = given.base if ours else f"{modules.public_name(module)}:{name_in(given)}"
    if not ours:
        keep(family_of(given), reference, given)
    return reference


@functools.cache
def builtin_kind(family: str, name: str) -> KindOrMetric | None:
    """The kind in the file of this name in the family's folder, None if there is no such file."""
    module, base = f"{FAMILIES[family].package}.{name}", base_of(family)
    if not name.isidentifier() or importlib.util.find_spec(module) is None:
        return None
    for found in vars(importlib.import_module(module)).values():
        if isinstance(found, base) and getattr(found, "name", None) == name:
            return found
        member = isinstance(found, type) and issubclass(found, base)
        if member and found.__dict__.get("kind") == name:
            return found
    return None


def text_in(data: object) -> Iterator[str]:
    """All text in plain data except the keys of mappings."""
    if isinstance(data, str):
        yield data
    values = data.values() if isinstance(data, dict) else data if isinstance(data, list) else ()
    for inner in values:
        yield from text_in(inner)


class KindOf:
    """A kind of a family: an object, a mapping with `kind` and its keys, or the name alone.

    A mapping without `kind` means the kind `default`, if there is one.
    """

    def __init__(self, family: str, default: str | None = None):
        self.family, self.default = family, default

    def validate(self, value: object) -> Any:
        if isinstance(value, str):
            value = {"kind": value}
        if isinstance(value, base_of(self.family)):
            return value
        if not isinstance(value, dict):
            context = {"known": ", ".join(kind_names(self.family)), "family": self.family}
            raise PydanticCustomError("kind", "must be a mapping, or one of {known}", context)
        if self.default is not None:
            value = {"kind": self.default, **value}
        try:
            if not isinstance(value.get("kind"), str):
                raise unknown_kind(self.family, value.get("kind"))
            found = find(self.family, value["kind"])
        except KindError as error:
            context = {"error": str(error), "family": self.family}
            raise PydanticCustomError("kind_name", "{error}", context) from error
        return self.made(found, {str(key): each for key, each in value.items() if key != "kind"})

    @staticmethod
    def made(found: Any, keys: dict[str, object]) -> Any:
        return found.model_validate(keys)

    @staticmethod
    def plain(kind: Any) -> object:
        """The form of a config."""
        return kind.model_dump()

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        dumped = core_schema.plain_serializer_function_ser_schema(self.plain)
        return core_schema.no_info_plain_validator_function(self.validate, serialization=dumped)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """A placeholder, which `config.schema` replaces by a reference."""
        return {"family": self.family}


class MetricOf(KindOf):
    """A metric: an object, a mapping with `kind` and its keys, or the name alone."""

    @staticmethod
    def made(found, keys):
        made = found.with_keys(**{"name": found.base, **keys})
        refer(made, metric_name(found))
        return made

    @staticmethod
    def plain(kind):
        return plain_metric(kind)


def plain_metric(metric: Any) -> str | dict[str, object]:
    """A metric as a config has it: its name, or a mapping with its keys."""
    return {"kind": metric_name(metric), **metric.keys} if metric.keys else metric_name(metric)
