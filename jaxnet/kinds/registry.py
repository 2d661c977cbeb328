"""Finding a kind by its name: ours by its file, an installed one by its entry point, anybody's by
`module:Class`.

A class counts only if it is of the family that was asked for, which is seen before anything of it is called.
What a class is made of (its module's source, its distribution's version) is told by `provenance`, for rows
depend on it.
"""

import contextlib
import functools
import hashlib
import importlib
import importlib.util
import inspect
import json
import os
import pkgutil
import sys
import types
from collections.abc import Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from jaxnet.kinds.kind import REFERENCES, Kind, KindError


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


PLAIN = (bool, int, float, complex, str)


class Provenance(NamedTuple):
    """What a class from outside is made of."""

    file: str
    sha256: str  # of the file when it was imported
    version: str | None  # of the distribution that it came with


def names(family: str) -> list[str]:
    """Names of a family's kinds that need no module: ours, then those of installed packages."""
    package = importlib.import_module(FAMILIES[family].package)
    ours = [module.name for module in pkgutil.iter_modules(package.__path__)]
    return [*ours, *(point.name for point in entry_points(family) if point.name not in ours)]


def find(family: str, name: str) -> Any:
    """The class (of `metrics` the metric) that a name means in a family; raises KindError."""
    if (family, name) in RENAMED:
        raise KindError(f"{name} was renamed to {RENAMED[family, name]}")
    found = HANDED.get(name)
    if found is None:
        found = builtin(family, name)
    if found is None:
        found = installed(family, name)
    if found is None and ":" in name:
        found = imported(name, name)
    if found is None:
        raise unknown(family, name)
    base = base_of(family)
    if not (isinstance(found, type) and issubclass(found, base)) and not isinstance(found, base):
        shown = found.__name__ if isinstance(found, type) else repr(found)[:60]
        raise KindError(f"{name} is not of the family {base.__name__} ({shown})")
    if isinstance(found, type) and issubclass(found, Kind):
        REFERENCES[found] = name
    if not home_of(found).startswith("jaxnet."):
        OUTSIDE[name] = found
    return found


def unknown(family: str, given: Any) -> KindError:
    """What is said of a name that means no kind, or of something that is no name."""
    known, shown = ", ".join(names(family)), json.dumps(given, default=repr)
    return KindError(f"must be one of {known}, or module:Class (got {shown})")


HANDED: dict[str, Any] = {}  # objects that a script has handed over, by their references
OUTSIDE: dict[str, Any] = {}  # what was found and is not ours, by name


def home_of(found: Any) -> str:
    """The module that a class, or a metric's function, is written in."""
    return found.__module__ if isinstance(found, type) else found.of.__module__


def adopt(given: Any) -> str:
    """The reference by which a class or metric that a script hands over is found from now on."""
    module = home_of(given)
    if isinstance(given, type):
        reference = given.reference()  # pyright: ignore[reportAttributeAccessIssue]
    else:
        held = vars(sys.modules[module]).items()
        known = next((name for name, each in held if each is given), given.name)
        reference = given.name if module.startswith("jaxnet.") else f"{module}:{known}"
    if not module.startswith("jaxnet."):
        HANDED[reference] = given
        SOURCES.setdefault(module, source_of(module))
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


def installed(family: str, name: str) -> Any:
    """A class by its entry point, None if there is none of this name; raises KindError."""
    for point in entry_points(family):
        if point.name == name:
            return imported(point.value, name)
    return None


def imported(reference: str, name: str) -> Any:
    """What stands at `module:attribute`; the module's source is remembered as it was imported."""
    module, _, attribute = reference.partition(":")
    before = module in sys.modules
    try:
        found: Any = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    except ImportError as error:
        missing = getattr(error, "name", None) == module
        where = "; modules beside the config can be imported" if missing else ""
        raise KindError(f"{name} cannot be imported: {error}{where}") from error
    except AttributeError as error:
        raise KindError(f"{name}: {error}") from error
    except Exception as error:  # of a stranger's module anything may come
        raise KindError(f"{name} cannot be imported: {with_place(error)}") from error
    if not before or module not in SOURCES:
        SOURCES[module] = source_of(module)
    refuse_changed(module, name)
    return found


SOURCES: dict[str, Provenance] = {}  # of modules that kinds came from, as they were imported


def source_of(module: str) -> Provenance:
    """What a module's file holds now; what is typed into a notebook or a shell has none."""
    file = getattr(sys.modules[module], "__file__", None) or ""
    if not Path(file).is_file():  # a shell may say "<stdin>"
        return Provenance("", "", None)
    return Provenance(file, hashlib.sha256(Path(file).read_bytes()).hexdigest(), version_of(module))


def typed(module: str, kinds: list[Any]) -> Provenance:
    """What kinds without a file are made of now: their functions, and what of their module these use."""
    held = vars(sys.modules[module])
    told: dict[str, Any] = {}
    ahead = [(each.__name__ if isinstance(each, type) else each.name, each) for each in kinds]
    while ahead:
        name, thing = ahead.pop()
        held_by = [vars(base).items() for base in bases_in(module, thing)]
        parts = [thing, *(each for held_in in held_by for key, each in held_in if not key.startswith("__"))]
        codes = [code for part in parts for code in codes_of(part)]
        told[name] = [(code.co_code, code.co_names, as_words(code.co_consts)) for code in codes]
        told[name] += [as_words(part) + as_words(defaults_of(part)) for part in parts]
        used = {name for code in codes for name in code.co_names}
        ahead += [(name, held[name]) for name in used & set(held) - set(told)]
    return Provenance("", hashlib.sha256(repr(sorted(told.items())).encode()).hexdigest(), None)


def bases_in(module: str, thing: Any) -> list[type]:
    """A class and its bases, as far as they are written in this module."""
    return [each for each in getattr(thing, "__mro__", ()) if each.__module__ == module]


def function_of(thing: Any) -> Any:
    """What a function, method, property or metric does."""
    thing = getattr(thing, "fget", getattr(thing, "of", thing))
    return inspect.unwrap(thing) if callable(thing) else thing


def codes_of(thing: Any) -> Iterator[types.CodeType]:
    """Its code, and that of the functions written inside it."""
    code = getattr(function_of(thing), "__code__", None)
    ahead = [code] if code else []
    while ahead:
        yield (code := ahead.pop())
        ahead += [each for each in code.co_consts if isinstance(each, types.CodeType)]


def defaults_of(thing: Any) -> Any:
    """Values of a function's arguments that are left out."""
    function = function_of(thing)
    return getattr(function, "__defaults__", None), getattr(function, "__kwdefaults__", None)


def as_words(value: Any) -> str:
    """Numbers and text, also in containers and arrays, in full; nothing of what else there is."""
    if isinstance(value, PLAIN):
        return repr(value)
    if isinstance(value, dict):
        return as_words([*value.items()])
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(as_words, value))}]"
    if isinstance(value, set | frozenset):
        return as_words(sorted(map(as_words, value)))
    return as_words(value.tolist()) if hasattr(value, "dtype") and hasattr(value, "tolist") else ""


@functools.cache
def version_of(module: str) -> str | None:
    """Version of the distribution that a module came with, None if it came with none."""
    top = module.partition(".")[0]
    return next((each.version for each in metadata.distributions() if installs(each, top)), None)


def installs(distribution: Any, top: str) -> bool:
    """Whether a package or module of this name came with it: by what it declares, or by its list of files."""
    if declared := (distribution.read_text("top_level.txt") or "").split():
        return top in declared
    files = (distribution.read_text("RECORD") or "").splitlines()
    return any(file.startswith((f"{top}/", f"{top}.")) for file in files)


def refuse_changed(module: str, name: str) -> None:
    """Raise KindError if a module's file is no longer what was imported."""
    if source_of(module).sha256 != SOURCES[module].sha256:
        file = SOURCES[module].file
        raise KindError(f"{name} was changed since it was imported ({file}): start Python anew")


def search_folder(folder: str | Path) -> None:
    """Have modules of this folder found, after all others."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))


def search_home(module: str, file: str) -> None:
    """Have a module in this file found; what a notebook holds has none."""
    if file:
        search_folder(Path(file).parents[module.count(".") + (Path(file).name == "__init__.py")])


def provenance(data: Any) -> dict[str, Provenance]:
    """What those kinds are made of that plain data names and that are not ours, by module."""
    named = set(words(data))
    found = [kind for name, kind in OUTSIDE.items() if name in named]
    modules = {module: [kind for kind in found if home_of(kind) == module] for module in map(home_of, found)}
    sources = {module: SOURCES.setdefault(module, source_of(module)) for module in sorted(modules)}
    return {
        module: source if source.file else typed(module, modules[module])
        for module, source in sources.items()
    }


def confirm(modules: Mapping[str, Provenance]) -> None:
    """Raise KindError if modules that another process names are not the same here."""
    for name, made_of in modules.items():
        search_home(name, made_of.file)
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise KindError(f"{name} cannot be imported by process {os.getpid()}: {error}") from error
        SOURCES.setdefault(name, source_of(name))
        if SOURCES[name].sha256 != made_of.sha256:
            raise KindError(f"{name} is another one in process {os.getpid()} ({SOURCES[name].file})")


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
    return {source.file for source in SOURCES.values() if source.file}


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
