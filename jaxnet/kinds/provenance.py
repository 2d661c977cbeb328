"""What a class from outside is made of: its module's files, or its code if it was typed into a notebook."""

import hashlib
import inspect
import sys
import types
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from jaxnet.kinds import modules
from jaxnet.kinds.modules import KindError, ModuleFolder

PLAIN_TYPES = (bool, int, float, complex, str)


class Provenance(NamedTuple):
    """What a class from outside is made of."""

    file: str
    sha256: str  # of the file as it was loaded
    version: str | None  # of the distribution that it came with


IMPORTED_SOURCES: dict[str, Provenance] = {}  # of modules that are imported by their names, as they were then
FOLDERS: WeakKeyDictionary[Any, ModuleFolder] = (
    WeakKeyDictionary()
)  # what a script's classes and metrics are from


def home_of(found: Any) -> str:
    """The module that a class, or a metric's function, is written in."""
    return found.__module__ if isinstance(found, type) else found.of.__module__


def name_in(found: Any) -> str:
    """The dotted name of a class or metric in its module."""
    if isinstance(found, type):
        return found.__qualname__
    held = vars(sys.modules[home_of(found)]).items()
    return next((name for name, each in held if each is found), found.name)


def neighbours_of(found: Any) -> ModuleFolder | None:
    """The files that a class or metric is from; None where its module is installed, or is in no file."""
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


def origin_of(found: Any) -> modules.Origin:
    """Where another process finds the module of a class or metric."""
    held, name = neighbours_of(found), modules.public_name(home_of(found))
    if held is None:
        return modules.Origin("", name)
    return modules.Origin(str(held.folder), name, tuple(held.hashes(name).items()))


def provenance(found: Iterable[Any]) -> dict[str, Provenance]:
    """What classes and metrics from outside are made of: their modules and what these import, by name.

    Raises KindError where two modules have the same name.
    """
    told: dict[str, Provenance] = {}
    without: dict[str, list[Any]] = {}
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


def made_of(found: Any) -> dict[str, Provenance]:
    """What one class or metric is made of, by module; of what is in no file the module alone."""
    held, name = neighbours_of(found), modules.public_name(home_of(found))
    if held is None:
        return {name: IMPORTED_SOURCES.setdefault(name, read_source(name))}
    hashes = held.hashes(name)
    return {
        each: Provenance(str(file), hashes[each], None) for each, file in modules.closure(held, name).items()
    }


def read_source(module: str) -> Provenance:
    """What a module's file holds now; what is typed into a notebook or a shell has none."""
    file = getattr(sys.modules[module], "__file__", None) or ""
    if not Path(file).is_file():  # a shell may say "<stdin>"
        return Provenance("", "", None)
    return Provenance(file, hashlib.sha256(Path(file).read_bytes()).hexdigest(), modules.version_of(module))


def refuse_changed(found: Any, name: str) -> None:
    """Raise KindError if the file of what was imported by its name is no longer what it was."""
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


def hash_typed_code(module: str, kinds: list[Any]) -> Provenance:
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
    if isinstance(value, PLAIN_TYPES):
        return repr(value)
    if isinstance(value, dict):
        return as_words([*value.items()])
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(as_words, value))}]"
    if isinstance(value, set | frozenset):
        return as_words(sorted(map(as_words, value)))
    return as_words(value.tolist()) if hasattr(value, "dtype") and hasattr(value, "tolist") else ""
