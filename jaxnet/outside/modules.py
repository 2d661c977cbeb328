"""Modules of kinds from outside, loaded from their files.

Two folders may each have a `kinds.py`, and a notebook may edit a file: a name does not identify a
module. A file is therefore imported under a private name, `jaxnet_kinds_…`, which stands for its
folder and its content. The folder is not put on `sys.path`, so a library that looks for an optional
module does not find a file of the folder.
"""

import ast
import builtins
import functools
import hashlib
import importlib
import importlib.util
import operator
import os
import re
import sys
import types
from collections.abc import Iterator, Mapping, Sequence
from importlib import metadata
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from pathlib import Path
from typing import Any, NamedTuple

PREFIX = "jaxnet_kinds_"
PACKAGE = "__init__.py"
PRIVATE = re.compile(rf"{PREFIX}\w+?\.")


class KindError(ValueError):
    """A kind from outside that cannot be loaded, or that failed. The message says which, and where.

    Examples
    --------
    >>> import jaxnet
    >>> from jaxnet.kinds.attacks.rotating import Rotating
    >>> try:
    ...     Rotating(magnitude=-1)
    ... except jaxnet.KindError as error:
    ...     print(error)
    Rotating: magnitude: must be at least 0 (got -1)
    """


class Origin(NamedTuple):
    """Where another process finds a module: its folder, its name there, hashes of its files."""

    folder: str  # empty: the module is imported by its name
    module: str
    # SHA-256 of the module and of its neighbours that it imports
    hashes: tuple[tuple[str, str], ...] = ()


class ModuleFolder(MetaPathFinder):
    """The modules of a folder, with the contents that their files had at the first read.

    Python's import finds them here, under the private name.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        place = hashlib.sha256(str(folder).encode()).hexdigest()[:12]
        self.name = f"{PREFIX}{place}_{len(STATES)}"
        self.sources: dict[Path, bytes] = {}
        self.named = set[str]()  # modules that a config names, or packages that they are in
        STATES[self.name] = self
        package = types.ModuleType(self.name, f"Modules in {folder}.")
        package.__path__ = []
        sys.modules[self.name] = package
        sys.meta_path.insert(0, self)

    def read(self, file: Path) -> bytes:
        if file not in self.sources:
            self.sources[file] = file.read_bytes()
        return self.sources[file]

    def hashes(self, module: str) -> dict[str, str]:
        """SHA-256 of a module's file and of the neighbours that it imports, by name."""
        files = self.closure(module)
        return {name: hashlib.sha256(self.read(file)).hexdigest() for name, file in files.items()}

    def load(self, module: str) -> types.ModuleType:
        """Import the module of this name from the folder. Any error of its code passes through."""
        self.closure(module)  # reads all neighbours now, also those that are imported later
        return importlib.import_module(f"{self.name}.{module}")

    def closure(self, module: str) -> dict[str, Path]:
        """Files of a module and of all neighbours that it imports, directly or not, by name."""
        found: dict[str, Path] = {}
        ahead = [module]
        self.named.add(module.partition(".")[0])
        while ahead:
            name = ahead.pop()
            file = None if name in found else file_of(self.folder, name)
            if file is None or (found and not self.has_neighbour(name.partition(".")[0])):
                continue
            found[name] = file
            parts = name.split(".")
            ahead += [".".join(parts[:end]) for end in range(1, len(parts))]
            package = name if file.name == PACKAGE else name.rpartition(".")[0]
            ahead += imports_in(self.read(file), package)
        return dict(sorted(found.items()))

    def has_neighbour(self, top: str) -> bool:
        """Whether an import of this name means a file of the folder.

        Modules of Python and installed packages take precedence, but not over names the config
        uses.
        """
        folder = top.isidentifier() and (self.folder / top).is_dir()
        if file_of(self.folder, top) is None and not folder:
            return False
        known = top in sys.stdlib_module_names or top == "jaxnet" or is_installed(top)
        return top in self.named or not known

    def find_spec(
        self, fullname: str, path: object = None, target: object = None
    ) -> ModuleSpec | None:
        state, _, module = fullname.partition(".")
        if state != self.name or not module:
            return None
        if (file := file_of(self.folder, module)) is not None:
            inside = [str(file.parent)] if file.name == PACKAGE else None
            loader = NeighbourLoader(fullname, str(file))
            return importlib.util.spec_from_file_location(
                fullname, file, loader=loader, submodule_search_locations=inside
            )
        place = self.folder.joinpath(*module.split("."))
        if not place.is_dir():
            return None
        spec = ModuleSpec(fullname, None, is_package=True)
        spec.submodule_search_locations = [str(place)]
        return spec

    def import_beside(
        self,
        name: str,
        globals: Mapping[str, object] | None = None,
        locals: Mapping[str, object] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> types.ModuleType:
        """Import a neighbour by its private name, any other module as `__import__` does."""
        top = name.partition(".")[0]
        if level or not self.has_neighbour(top):
            return builtins.__import__(name, globals, locals, fromlist, level)
        found = builtins.__import__(f"{self.name}.{name}", globals, locals, fromlist, 0)
        return found if fromlist else sys.modules[f"{self.name}.{top}"]


class NeighbourLoader(SourceFileLoader):
    """Loader that runs the source at its first read, without bytecode, and imports neighbours."""

    def exec_module(self, module: types.ModuleType) -> None:
        held = STATES[module.__name__.partition(".")[0]]
        vars(module)["__builtins__"] = {**vars(builtins), "__import__": held.import_beside}
        try:
            code = compile(held.read(Path(self.path)), self.path, "exec", dont_inherit=True)
        except SyntaxError as error:  # of a null byte or a wrong encoding, Python names no file
            error.filename = error.filename or self.path
            raise
        exec(code, vars(module))


STATES: dict[str, ModuleFolder] = {}  # by private name


def module_folder(folder: Path) -> ModuleFolder:
    """The modules of a folder for the present contents of its files."""
    folder = folder.resolve()
    for held in reversed(STATES.values()):
        files = held.sources.items()
        if held.folder == folder and all(
            file.is_file() and file.read_bytes() == content for file, content in files
        ):
            return held
    return ModuleFolder(folder)


def file_of(folder: Path, module: str) -> Path | None:
    *packages, name = module.split(".")
    if not all(map(str.isidentifier, (*packages, name))) or module.partition(".")[0] == "jaxnet":
        return None
    place = folder.joinpath(*packages)
    files = (place / name / PACKAGE, place / f"{name}.py")
    return next((file for file in files if file.is_file()), None)


def imports_in(source: bytes, package: str) -> Iterator[str]:
    """Yield the names that a source may import; a source that is not Python yields none."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):  # the import reports the error
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")
            above = parts[: len(parts) - node.level + 1] if node.level else []
            base = ".".join(filter(None, [*above, node.module]))
            yield from (".".join(filter(None, [base, each.name])) for each in node.names)
            yield base


def without_private(words: str) -> str:
    """A message with private module names replaced by the names in the folders."""
    return PRIVATE.sub("", words)


def public_name(module: str) -> str:
    return PRIVATE.sub("", module, count=1) if module.startswith(PREFIX) else module


def is_installed(module: str) -> bool:
    return version_of(module) is not None


distributions = functools.cache(metadata.packages_distributions)  # by their top modules


@functools.cache
def version_of(module: str) -> str | None:
    found = distributions().get(module.partition(".")[0])
    return metadata.version(found[0]) if found else None


def attribute(module: types.ModuleType, name: str) -> Any:
    return operator.attrgetter(name)(module)


@functools.cache
def load_origin(origin: Origin) -> types.ModuleType:
    """Load another process's module from a file of the same content; raise KindError if none is."""
    if not origin.folder:
        return importlib.import_module(origin.module)
    seen = None
    for folder in map(Path, (origin.folder, *filter(None, sys.path))):
        if (file := file_of(folder, origin.module)) is None:
            continue
        seen = seen or file
        states = [each for each in STATES.values() if each.folder == folder.resolve()]
        for held in (*states, module_folder(folder)):
            if tuple(held.hashes(origin.module).items()) == origin.hashes:
                return held.load(origin.module)
    process = f"process {os.getpid()}"
    where = f"is another one in {process} ({seen})"
    if not seen:
        where = f"is not found by {process}, neither in {origin.folder} nor among installed modules"
    raise KindError(f"{origin.module} {where}")
