"""Finding a kind by its name: ours by its file, an installed one by its entry point, anybody's by
`module:Class`.

A class counts only if it is of the family that was asked for, which is seen before anything of it is called.
A `Scope` says what the names of one study mean: another study may use the same names for other classes.
"""

import contextlib
import functools
import importlib
import importlib.util
import json
import pkgutil
import sys
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from jaxnet.kinds import modules
from jaxnet.kinds import provenance as source
from jaxnet.kinds.kind import REFERENCES, Kind, KindError
from jaxnet.kinds.provenance import home_of, name_in


class Family(NamedTuple):
    """Kinds that take each other's place under one key of a config."""

    package: str  # a folder with a file for each of ours, its base class in the package itself
    base: str
    group: str  # of entry points


FAMILIES = {
    "topology": Family("jaxnet.kinds.graphs", "Graph", "jaxnet.graphs"),
    "navigator": Family("jaxnet.kinds.navigators", "Navigator", "jaxnet.navigators"),
    "vehicle": Family("jaxnet.kinds.vehicles", "Vehicle", "jaxnet.vehicles"),
    "attack": Family("jaxnet.kinds.attacks", "AnyAttack", "jaxnet.attacks"),
    "announcement": Family("jaxnet.kinds.announcements", "Announcement", "jaxnet.announcements"),
    "defence": Family("jaxnet.kinds.defences", "AnyDefence", "jaxnet.defences"),
    "law": Family("jaxnet.kinds.laws", "Law", "jaxnet.laws"),
    "metrics": Family("jaxnet.kinds.metrics", "Metric", "jaxnet.metrics"),
    "engine": Family("jaxnet.engine.methods", "Engine", "jaxnet.engines"),
}


RENAMED = {("engine", "flat"): "exact", ("engine", "chassis"): "nonlinear"}


Key = tuple[str, str]  # a family, and a name in it


class Scope:
    """What the names of kinds from outside mean in one study, whose config is in `folder`."""

    judges = True  # whether the study is new, so that files are read for it and its kinds say what is wrong

    def __init__(self, folder: Path | None = None, known: Mapping[Key, Any] | None = None):
        self.folder, self.known = folder, dict(known or {})

    def __eq__(self, other: object) -> bool:
        """Whether names mean the same."""
        return isinstance(other, Scope) and self.known == other.known

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def __reduce__(self) -> Any:
        """Another process is told in which files the classes are."""
        origins = {key: (source.origin_of(each), name_in(each)) for key, each in self.known.items()}
        return scope_of, (self.folder, origins)

    @contextlib.contextmanager
    def __call__(self) -> Iterator["Scope"]:
        """Have names mean what they do here."""
        token = HERE.set(self)
        try:
            yield self
        finally:
            HERE.reset(token)

    def outside(self, family: str, name: str) -> Any:
        """What a name means that is none of ours: an installed kind, or one at `module:attribute`."""
        point = next((each for each in entry_points(family) if each.name == name), None)
        if point is not None:
            return imported(point.value, name, None)
        return imported(name, name, self.folder) if ":" in name else None

    def named_in(self, data: Any) -> list[Any]:
        """The classes and metrics from outside that plain data names."""
        named = set(words(data))
        return [found for (_, name), found in self.known.items() if name in named]


HERE: ContextVar[Scope | None] = ContextVar("scope", default=None)
LOADED: dict[Key, list[Any]] = {}  # all that this process has found outside, the last one last


def scope() -> Scope:
    """What names mean now; outside any study only ours and importable ones mean anything."""
    return HERE.get() or Scope()


def scope_of(folder: Path | None, origins: Mapping[Key, tuple[modules.Origin, str]]) -> Scope:
    """A scope that another process has sent; raises KindError if a module is not the same here."""
    known = {key: modules.attribute(modules.loaded(origin), name) for key, (origin, name) in origins.items()}
    for key, found in known.items():
        remember(*key, found)
    return Scope(folder, known)


def names(family: str) -> list[str]:
    """Names of a family's kinds that need no module: ours, then those of installed packages."""
    package = importlib.import_module(FAMILIES[family].package)
    ours = [module.name for module in pkgutil.iter_modules(package.__path__)]
    return [*ours, *(point.name for point in entry_points(family) if point.name not in ours)]


def find(family: str, name: str) -> Any:
    """The class (of `metrics` the metric) that a name means in a family; raises KindError."""
    if (family, name) in RENAMED:
        raise KindError(f"{name} was renamed to {RENAMED[family, name]}")
    here = scope()
    found = here.known.get((family, name))
    if found is None:
        found = builtin(family, name)
    if found is None:
        found = here.outside(family, name)
    if found is None:
        raise unknown(family, name)
    base = base_of(family)
    if not (isinstance(found, type) and issubclass(found, base)) and not isinstance(found, base):
        shown = found.__name__ if isinstance(found, type) else repr(found)[:60]
        raise KindError(f"{name} is not of the family {base.__name__} ({shown})")
    if isinstance(found, type) and issubclass(found, Kind):
        REFERENCES[found] = name
    if not home_of(found).startswith("jaxnet."):
        source.refuse_changed(found, name)
        source.made_of(found)  # as its file is now
        here.known[family, name] = found
        remember(family, name, found)
    return found


def remember(family: str, name: str, found: Any) -> None:
    """Note that this process has this class or metric, by what its name means."""
    held = LOADED.setdefault((family, name), [])
    if found not in held:
        held.append(found)
    if not isinstance(found, type):
        NAMED[found] = name
    elif issubclass(found, Kind):
        REFERENCES[found] = name


NAMED: dict[Any, str] = {}  # names by which metrics from outside were found


def metric_name(metric: Any) -> str:
    """How a config names a metric."""
    return str(NAMED.get(metric, metric.name))


def unknown(family: str, given: Any) -> KindError:
    """What is said of a name that means no kind, or of something that is no name."""
    known, shown = ", ".join(names(family)), json.dumps(given, default=repr)
    return KindError(f"must be one of {known}, or module:Class (got {shown})")


def family_of(given: Any) -> str:
    """The family of a class or metric that a script hands over; raises KindError."""
    for family in FAMILIES:
        base = base_of(family)
        if isinstance(given, base) or (isinstance(given, type) and issubclass(given, base)):
            return family
    raise KindError(f"{given.__name__} is of no family")


def adopt(given: Any) -> str:
    """The reference by which a class or metric that a script hands over is found from now on."""
    module = home_of(given)
    if isinstance(given, type):
        reference: str = given.reference()  # pyright: ignore[reportAttributeAccessIssue]
    else:
        ours = module.startswith("jaxnet.")
        reference = given.name if ours else f"{modules.public(module)}:{name_in(given)}"
    if not module.startswith("jaxnet."):
        family, here = family_of(given), scope()
        source.refuse_changed(given, reference)
        if here.known.setdefault((family, reference), given) is not given:
            raise KindError(f"two classes are called {reference}: rename one of them")
        source.made_of(given)  # as its file is now
        remember(family, reference, given)
    return reference


@functools.cache
def base_of(family: str) -> type:
    """The class that all kinds of a family are of."""
    return getattr(importlib.import_module(FAMILIES[family].package), FAMILIES[family].base)


@functools.cache
def builtin(family: str, name: str) -> Any:
    """One of ours, from the file of its name; None if there is none."""
    module = f"{FAMILIES[family].package}.{name}"
    if not name.isidentifier() or importlib.util.find_spec(module) is None:
        return None
    return of_module(importlib.import_module(module), family, name)


def of_module(module: Any, family: str, name: str) -> Any:
    """What a module of ours defines of a family."""
    base = base_of(family)
    for found in vars(module).values():
        if isinstance(found, base) and getattr(found, "name", None) == name:
            return found
        if isinstance(found, type) and issubclass(found, base) and found.__dict__.get("kind") == name:
            return found
    return None


@functools.cache
def entry_points(family: str) -> list[metadata.EntryPoint]:
    """Entry points of installed packages."""
    return list(metadata.entry_points(group=FAMILIES[family].group))


def imported(reference: str, name: str, folder: Path | None) -> Any:
    """What stands at `module:attribute`, of a module in this folder or else of one that can be imported.

    Raises KindError.
    """
    module, _, attribute = reference.partition(":")
    try:
        found = modules.attribute(module_of(module, folder), attribute)
    except ImportError as error:
        missing = getattr(error, "name", None) == module
        where = "; modules beside the config can be imported" if missing else ""
        raise KindError(f"{name} cannot be imported: {error}{where}") from error
    except AttributeError as error:
        raise KindError(f"{name}: {modules.without_private(str(error))}") from error
    except Exception as error:  # of a stranger's module anything may come
        raise KindError(f"{name} cannot be imported: {with_place(error)}") from error
    return found


def module_of(module: str, folder: Path | None) -> Any:
    """A module: from its file in a folder, or in a place of `sys.path` where nothing is installed; else by
    its name.
    """
    by_name = module in sys.modules or module.partition(".")[0] in sys.stdlib_module_names
    elsewhere = [] if by_name else map(Path, filter(None, sys.path))
    for place in filter(None, (folder, *elsewhere)):
        if modules.file_of(place, module) is None or (place != folder and modules.is_installed(module)):
            continue
        return modules.neighbours(place).load(module)
    found = importlib.import_module(module)
    source.SOURCES.setdefault(module, source.source_of(module))
    return found


def words(data: Any) -> Iterator[str]:
    """All text in plain data, keys left out."""
    if isinstance(data, str):
        yield data
    for inner in data.values() if isinstance(data, dict) else data if isinstance(data, list) else ():
        yield from words(inner)


def with_place(error: BaseException) -> str:
    """An error with the file and line where it arose, as far in as code from outside the library goes."""
    frames = list(trace(error))
    place = next((f"{file}:{line}" for file, line in reversed(frames) if file in files()), None)
    words = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return f"{place or '{}:{}'.format(*frames[-1]) if frames else ''}: {words}"


def trace(error: BaseException) -> Iterator[tuple[str, int]]:
    """Files and lines that an error came through, outermost first."""
    here = error.__traceback__
    while here is not None:
        yield here.tb_frame.f_code.co_filename, here.tb_lineno
        here = here.tb_next


def files() -> set[str]:
    """Files that kinds from outside came from."""
    return modules.files() | {each.file for each in source.SOURCES.values() if each.file}


def blame(error: BaseException) -> KindError | None:
    """The error as that of a kind from outside, if it came through one's file."""
    if isinstance(error, KindError) or not any(file in files() for file, _ in trace(error)):
        return None
    return KindError(with_place(error))


@contextlib.contextmanager
def blaming() -> Iterator[None]:
    """Have what a kind from outside raises told as a KindError, with its file and line."""
    try:
        yield
    except Exception as error:
        blamed = blame(error)
        if blamed is None:
            raise
        raise blamed from error
