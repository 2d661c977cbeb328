"""Kinds from outside jaxnet: entry points of installed packages, and `module:attribute` references."""

import functools
import importlib
import sys
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

from jaxnet.outside import modules, provenance
from jaxnet.outside.blame import with_place
from jaxnet.outside.families import FAMILIES
from jaxnet.outside.modules import KindError


@functools.cache
def entry_points(family: str) -> list[metadata.EntryPoint]:
    """Return the entry points by which installed packages offer kinds of a family."""
    return list(metadata.entry_points(group=FAMILIES[family].group))


def import_reference(reference: str, name: str, folder: Path | None) -> Any:
    """Return the object at `module:attribute`; raise KindError, in which `name` stands for the reference.

    The module is looked for in the folder first, then among modules that Python can import.
    """
    module, _, attribute = reference.partition(":")
    try:
        loaded = import_module(module, folder)
    except (Exception, SystemExit) as error:  # the code of another author may raise anything
        if isinstance(error, ModuleNotFoundError) and error.name == module:
            message = f"{error}; modules beside the config can be imported"
        else:
            message = with_place(error)
        raise KindError(f"{name} cannot be imported: {message}") from error
    try:
        return modules.attribute(loaded, attribute)
    except AttributeError as error:
        raise KindError(f"{name}: {modules.without_private(str(error))}") from error


def import_module(module: str, folder: Path | None) -> ModuleType:
    """Import a module from its file in a folder, or else from `sys.path`, or else by its name.

    A module of `sys.path` is loaded from its file unless it is installed or part of Python.
    """
    by_name = module in sys.modules or module.partition(".")[0] in sys.stdlib_module_names
    elsewhere = [] if by_name else map(Path, filter(None, sys.path))
    for place in filter(None, (folder, *elsewhere)):
        if modules.file_of(place, module) is None or (
            place != folder and modules.is_installed(module)
        ):
            continue
        return modules.module_folder(place).load(module)
    found = importlib.import_module(module)
    provenance.IMPORTED_SOURCES.setdefault(module, provenance.read_source(module))
    return found
