"""Provenance of a class from outside: the files of its module, or its bytecode without a file."""

import hashlib
import inspect
import sys
import types
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from jaxnet.outside import modules
from jaxnet.outside.modules import KindError, ModuleFolder

KindOrMetric = Any  # a class, or a metric, which has `base`, `of` and `is_alike`
ARGUMENT_DEFAULTS = ("__defaults__", "__kwdefaults__")  # of a function's arguments
PLAIN_TYPES = (bool, int, float, complex, str)


class Provenance(NamedTuple):
    file: str
    sha256: str  # of the file at the time of loading
    version: str | None  # of the module's distribution


# Of modules imported by their names, at the time of import.
IMPORTED_SOURCES: dict[str, Provenance] = {}
# Folders of a script's classes and metrics.
FOLDERS: WeakKeyDictionary[Any, ModuleFolder] = WeakKeyDictionary()


def home_of(found: KindOrMetric) -> str:
    return found.__module__ if isinstance(found, type) else found.of.__module__


def name_in(found: KindOrMetric) -> str:
    if isinstance(found, type):
        return found.__qualname__
    held = vars(sys.modules[home_of(found)])
    # A metric with other keys than that of the module has its name.
    alike = (n for n, each in held.items() if type(each) is type(found) and each.base == found.base)
    return next((name for name, each in held.items() if each is found), next(alike, found.base))


def neighbours_of(found: KindOrMetric) -> ModuleFolder | None:
    """Folder of a class's module; None if the module is installed or has no file."""
    module = home_of(found)
    if (held := modules.STATES.get(module.partition(".")[0])) is not None:
        return held
    if found in FOLDERS:
        return FOLDERS[found]
    file = Path(getattr(sys.modules[module], "__file__", None) or "")
    by_name = module == "__main__" or module.startswith("jaxnet.") or modules.is_installed(module)
    if by_name or not file.is_file():  # a shell may say "<stdin>"
        return None
    folder = file.resolve().parents[module.count(".") + (file.name == modules.PACKAGE)]
    if modules.file_of(folder, module) is None:
        return None
    return FOLDERS.setdefault(found, modules.module_folder(folder))


def origin_of(found: KindOrMetric) -> modules.Origin:
    """Where another process finds the module of a class or metric."""
    held, name = neighbours_of(found), modules.public_name(home_of(found))
    if held is None:
        return modules.Origin("", name)
    return modules.Origin(str(held.folder), name, tuple(held.hashes(name).items()))


def provenance(found: Iterable[KindOrMetric]) -> dict[str, Provenance]:
    """Provenance of classes and metrics by module, with the neighbours that the modules import.

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
    """Provenance of one class or metric by module, empty for a module without a file."""
    held, name = neighbours_of(found), modules.public_name(home_of(found))
    if held is None:
        return {name: IMPORTED_SOURCES.setdefault(name, read_source(name))}
    files = held.closure(name)
    return {
        each: Provenance(str(files[each]), content, None)
        for each, content in held.hashes(name).items()
    }


def read_source(module: str) -> Provenance:
    """Provenance of a module from its present file; a notebook or shell has no file."""
    file = getattr(sys.modules[module], "__file__", None) or ""
    if not Path(file).is_file():  # a shell may say "<stdin>"
        return Provenance("", "", None)
    content = hashlib.sha256(Path(file).read_bytes()).hexdigest()
    return Provenance(file, content, modules.version_of(module))


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
    """Provenance of kinds without a file: hash of their bytecode and of the names they use."""
    held = vars(sys.modules[module])
    told: dict[str, Any] = {}
    ahead = [(each.__name__ if isinstance(each, type) else each.base, each) for each in kinds]
    while ahead:
        name, thing = ahead.pop()
        bases = [each for each in getattr(thing, "__mro__", ()) if each.__module__ == module]
        own = [pair for base in bases for pair in vars(base).items()]
        parts = [thing, *(each for key, each in own if not key.startswith("__"))]
        functions = [function_of(part) for part in parts]
        codes = [code for function in functions for code in codes_of(function)]
        told[name] = [(code.co_code, code.co_names, as_words(code.co_consts)) for code in codes]
        for part, function in zip(parts, functions, strict=True):
            defaults = [getattr(function, each, None) for each in ARGUMENT_DEFAULTS]
            told[name].append(as_words(part) + as_words(defaults))
        used = {name for code in codes for name in code.co_names}
        ahead += [(name, held[name]) for name in used & set(held) - set(told)]
    return Provenance("", hashlib.sha256(repr(sorted(told.items())).encode()).hexdigest(), None)


def function_of(thing: object) -> object:
    """The function behind a function, method, property or metric; any other object itself."""
    thing = getattr(thing, "fget", getattr(thing, "of", thing))
    return inspect.unwrap(thing) if callable(thing) else thing


def codes_of(function: object) -> Iterator[types.CodeType]:
    """Yield the code of a function and of all functions inside it."""
    ahead = [getattr(function, "__code__", None)]
    while ahead:
        if (code := ahead.pop()) is not None:
            yield code
            ahead += [each for each in code.co_consts if isinstance(each, types.CodeType)]


def as_words(value: object) -> str:
    """Numbers and text as text, also inside containers and arrays; "" for any other value."""
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
