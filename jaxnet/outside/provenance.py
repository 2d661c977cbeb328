"""Provenance of a class from outside: the files of its module, or its bytecode if no file holds the class."""

import hashlib
import inspect
import sys
import types
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol
from weakref import WeakKeyDictionary

from jaxnet.outside import modules
from jaxnet.outside.modules import KindError, ModuleFolder

if TYPE_CHECKING:

    class MetricLike(Protocol):
        """A metric, as this room knows it."""

        @property
        def name(self) -> str:
            """Name of the metric's column."""
            ...

        @property
        def of(self) -> Callable[..., Any]:
            """Function from the fleet at an instant to values."""
            ...

    KindOrMetric = type | MetricLike
else:
    KindOrMetric = MetricLike = Any

PLAIN_TYPES = (bool, int, float, complex, str)


class Provenance(NamedTuple):
    """The file, hash and version of a module from outside."""

    file: str
    sha256: str  # of the file at the time of loading
    version: str | None  # of the module's distribution


IMPORTED_SOURCES: dict[
    str, Provenance
] = {}  # of modules imported by their names, at the time of import
FOLDERS: WeakKeyDictionary[Any, ModuleFolder] = (
    WeakKeyDictionary()
)  # folders of a script's classes and metrics


def home_of(found: KindOrMetric) -> str:
    """Return the module that defines a class, or a metric's function."""
    return found.__module__ if isinstance(found, type) else found.of.__module__


def name_in(found: KindOrMetric) -> str:
    """Return the dotted name of a class or metric in its module."""
    if isinstance(found, type):
        return found.__qualname__
    held = vars(sys.modules[home_of(found)]).items()
    return next((name for name, each in held if each is found), found.name)


def neighbours_of(found: KindOrMetric) -> ModuleFolder | None:
    """Return the folder of a class's module; None if the module is installed or has no file."""
    module = home_of(found)
    if (held := modules.state_of(module)) is not None:
        return held
    if found in FOLDERS:
        return FOLDERS[found]
    by_name = module == "__main__" or module.startswith("jaxnet.") or modules.is_installed(module)
    folder = None if by_name else modules.folder_of(module)
    if folder is None or modules.file_of(folder, module) is None:
        return None
    return FOLDERS.setdefault(found, modules.module_folder(folder))


def origin_of(found: KindOrMetric) -> modules.Origin:
    """Return where another process finds the module of a class or metric."""
    held, name = neighbours_of(found), modules.public_name(home_of(found))
    if held is None:
        return modules.Origin("", name)
    return modules.Origin(str(held.folder), name, tuple(held.hashes(name).items()))


def provenance(found: Iterable[KindOrMetric]) -> dict[str, Provenance]:
    """Return the provenance of classes and metrics by module, with the neighbours that the modules import.

    Raises KindError if two modules have the same name.
    """
    told: dict[str, Provenance] = {}
    without: dict[str, list[KindOrMetric]] = {}
    for each in found:
        made = made_of(each)
        if not any(one.file for one in made.values()):
            without.setdefault(home_of(each), []).append(each)
        for module, one in made.items():
            if told.setdefault(module, one) != one:
                files = f"{told[module].file} and {one.file}"
                raise KindError(f"two modules are called {module}: rename one of {files}")
    told |= {module: hash_typed_code(module, kinds) for module, kinds in without.items()}
    return dict(sorted(told.items()))


def made_of(found: KindOrMetric) -> dict[str, Provenance]:
    """Return the provenance of one class or metric by module. A module without a file has an empty
    provenance.
    """
    held, name = neighbours_of(found), modules.public_name(home_of(found))
    if held is None:
        return {name: IMPORTED_SOURCES.setdefault(name, read_source(name))}
    hashes = held.hashes(name)
    return {
        each: Provenance(str(file), hashes[each], None)
        for each, file in modules.closure(held, name).items()
    }


def read_source(module: str) -> Provenance:
    """Return the provenance of a module from its present file; a notebook or shell has no file."""
    file = getattr(sys.modules[module], "__file__", None) or ""
    if not Path(file).is_file():  # a shell may say "<stdin>"
        return Provenance("", "", None)
    return Provenance(
        file, hashlib.sha256(Path(file).read_bytes()).hexdigest(), modules.version_of(module)
    )


def refuse_changed(found: KindOrMetric, name: str) -> None:
    """Raise KindError if the file of an imported class or metric has changed since the import."""
    module = home_of(found)
    if found in FOLDERS:
        held = FOLDERS[found]
        file = modules.file_of(held.folder, module)
        changed = modules.module_folder(held.folder).hashes(module) != held.hashes(module)
    else:
        file = IMPORTED_SOURCES[module].file if module in IMPORTED_SOURCES else ""
        changed = file and read_source(module).sha256 != IMPORTED_SOURCES[module].sha256
    if changed:
        raise KindError(f"{name} was changed since it was imported ({file}): import it again")


def hash_typed_code(module: str, kinds: list[KindOrMetric]) -> Provenance:
    """Return a provenance whose hash covers the bytecode of kinds without a file, and of the names that they
    use.
    """
    held = vars(sys.modules[module])
    told: dict[str, Any] = {}
    ahead = [(each.__name__ if isinstance(each, type) else each.name, each) for each in kinds]
    while ahead:
        name, thing = ahead.pop()
        held_by = [vars(base).items() for base in bases_in(module, thing)]
        parts = [
            thing,
            *(each for held_in in held_by for key, each in held_in if not key.startswith("__")),
        ]
        codes = [code for part in parts for code in codes_of(part)]
        told[name] = [(code.co_code, code.co_names, as_words(code.co_consts)) for code in codes]
        told[name] += [as_words(part) + as_words(defaults_of(part)) for part in parts]
        used = {name for code in codes for name in code.co_names}
        ahead += [(name, held[name]) for name in used & set(held) - set(told)]
    return Provenance("", hashlib.sha256(repr(sorted(told.items())).encode()).hexdigest(), None)


def bases_in(module: str, thing: object) -> list[type]:
    """Return a class and its bases, as far as this module defines them."""
    return [each for each in getattr(thing, "__mro__", ()) if each.__module__ == module]


def function_of(thing: object) -> object:
    """Return the function behind a function, method, property or metric; other objects are returned as they
    are.
    """
    thing = getattr(thing, "fget", getattr(thing, "of", thing))
    return inspect.unwrap(thing) if callable(thing) else thing


def codes_of(thing: object) -> Iterator[types.CodeType]:
    """Yield the code of a function and of all functions inside it."""
    code = getattr(function_of(thing), "__code__", None)
    ahead = [code] if code else []
    while ahead:
        yield (code := ahead.pop())
        ahead += [each for each in code.co_consts if isinstance(each, types.CodeType)]


def defaults_of(thing: object) -> tuple[object, object]:
    """Return the default values of a function's arguments."""
    function = function_of(thing)
    return getattr(function, "__defaults__", None), getattr(function, "__kwdefaults__", None)


def as_words(value: object) -> str:
    """Return numbers and text as text, also inside containers and arrays; any other value gives ""."""
    if isinstance(value, PLAIN_TYPES):
        return repr(value)
    if isinstance(value, dict):
        return as_words([*value.items()])
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(as_words, value))}]"
    if isinstance(value, set | frozenset):
        return as_words(sorted(map(as_words, value)))
    numbers = getattr(value, "tolist", None) if hasattr(value, "dtype") else None
    return as_words(numbers()) if numbers else ""
