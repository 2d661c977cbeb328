"""Families of kinds: kinds that take each other's place under one key of a config."""

import functools
import importlib
from typing import NamedTuple

from jaxnet.outside.modules import KindError


class Family(NamedTuple):
    """Where the kinds of a family are found."""

    package: (
        str  # the folder with one file for each kind of jaxnet; its __init__ defines the base class
    )
    base: str
    group: str  # the group of entry points, by which installed packages offer kinds


FAMILIES = {
    "topology": Family("jaxnet.kinds.graphs", "Graph", "jaxnet.graphs"),
    "navigator": Family("jaxnet.kinds.navigators", "Navigator", "jaxnet.navigators"),
    "vehicle": Family("jaxnet.kinds.vehicles", "Vehicle", "jaxnet.vehicles"),
    "attack": Family("jaxnet.kinds.attacks", "AnyAttack", "jaxnet.attacks"),
    "announcement": Family("jaxnet.kinds.announcements", "Announcement", "jaxnet.announcements"),
    "defence": Family("jaxnet.kinds.defences", "AnyDefence", "jaxnet.defences"),
    "law": Family("jaxnet.kinds.laws", "Law", "jaxnet.laws"),
    "sensing": Family("jaxnet.kinds.sensors", "Sensor", "jaxnet.sensors"),
    "loss": Family("jaxnet.kinds.losses", "Loss", "jaxnet.losses"),
    "noise": Family("jaxnet.kinds.noises", "ChannelNoise", "jaxnet.noises"),
    "detector": Family("jaxnet.kinds.detectors", "Detector", "jaxnet.detectors"),
    "metrics": Family("jaxnet.kinds.metrics", "Metric", "jaxnet.metrics"),
}


def add_family(name: str, base: type, group: str) -> None:
    """Add a family that another room defines, with its kinds in the package of the base class."""
    FAMILIES[name] = Family(base.__module__, base.__name__, group)


@functools.cache
def base_of(family: str) -> type:
    """Return the base class of a family."""
    return getattr(importlib.import_module(FAMILIES[family].package), FAMILIES[family].base)


def is_member(found: object, family: str) -> bool:
    """Return whether an object is a class of a family, or an instance of its base class."""
    base = base_of(family)
    return isinstance(found, base) or (isinstance(found, type) and issubclass(found, base))


def family_of(given: object) -> str:
    """Return the family of a class or metric; raise KindError if it has none."""
    for family in FAMILIES:
        if is_member(given, family):
            return family
    raise KindError(f"{getattr(given, '__name__', given)} is of no family")
