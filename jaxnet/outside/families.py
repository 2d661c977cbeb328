"""Families of kinds, which take each other's place under one key of a config, and whence they come.

Kinds from outside are entry points of installed packages, and `module:attribute` references.
"""

import functools
import importlib
import sys
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from jaxnet.outside import modules, provenance
from jaxnet.outside.blame import with_place
from jaxnet.outside.modules import KindError


class Family(NamedTuple):
    package: str  # folder with a file for each kind of jaxnet; its __init__ defines the base class
    base: str
    group: str  # the group of entry points, by which installed packages offer kinds


FAMILIES = {
    "topology": Family("jaxnet.kinds.graphs", "Graph", "jaxnet.graphs"),
    "navigator": Family("jaxnet.kinds.navigators", "Navigator", "jaxnet.navigators"),
    "vehicle": Family("jaxnet.kinds.vehicles", "Vehicle", "jaxnet.vehicles"),
    "attack": Family("jaxnet.kinds.attacks", "AnyAttack", "jaxnet.attacks"),
    "announcement": Family("jaxnet.kinds.announcements", "Announcement", "jaxnet.announcements"),
    "defence": Family("jaxnet.kinds.defences", "AnyDefence", "jaxnet.defences"),
    "formation": Family("jaxnet.kinds.formations", "Formation", "jaxnet.formations"),
    "law": Family("jaxnet.kinds.laws", "Law", "jaxnet.laws"),
    "sensing": Family("jaxnet.kinds.sensors", "Sensor", "jaxnet.sensors"),
    "loss": Family("jaxnet.kinds.losses", "Loss", "jaxnet.losses"),
    "noise": Family("jaxnet.kinds.noises", "ChannelNoise", "jaxnet.noises"),
    "detector": Family("jaxnet.kinds.detectors", "AnyDetector", "jaxnet.detectors"),
    "observer": Family("jaxnet.kinds.observers", "Observer", "jaxnet.observers"),
    "metrics": Family("jaxnet.kinds.metrics", "Metric", "jaxnet.metrics"),
}


def add_family(name: str, base: type, group: str) -> None:
    """Add a family that another room defines, with its kinds in the package of the base class."""
    FAMILIES[name] = Family(base.__module__, base.__name__, group)


@functools.cache
def base_of(family: str) -> type:
    return getattr(importlib.import_module(FAMILIES[family].package), FAMILIES[family].base)


def is_member(found: object, family: str) -> bool:
    base = base_of(family)
    return isinstance(found, base) or (isinstance(found, type) and issubclass(found, base))


def family_of(given: object) -> str:
    for family in FAMILIES:
        if is_member(given, family):
            return family
    raise KindError(f"{getattr(given, '__name__', given)} is of no family")


@functools.cache
def entry_points(family: str) -> list[metadata.EntryPoint]:
    return list(metadata.entry_points(group=FAMILIES[family].group))


def import_reference(reference: str, name: str, folder: Path | None) -> Any:
    """Object at `module:attribute`; raise KindError, in which `name` stands for the reference.

    The module is loaded from its file in the folder, or else on `sys.path`, unless there it is
    installed or part of Python. Then, and without a file, it is imported by its name.
    """
    module, _, attribute = reference.partition(":")
    by_name = module in sys.modules or module.partition(".")[0] in sys.stdlib_module_names
    others = [] if by_name else map(Path, filter(None, sys.path))
    try:
        for place in filter(None, (folder, *others)):
            elsewhere = place != folder and modules.is_installed(module)
            if modules.file_of(place, module) is not None and not elsewhere:
                loaded = modules.module_folder(place).load(module)
                break
        else:
            loaded = importlib.import_module(module)
            provenance.IMPORTED_SOURCES.setdefault(module, provenance.read_source(module))
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
