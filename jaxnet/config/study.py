"""A study: what a YAML file, a mapping or a script asks jaxnet to simulate."""

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path, PurePath
from textwrap import shorten
from types import NoneType
from typing import Any, Protocol, runtime_checkable

import numpy as np
from upath import UPath

from jaxnet.config import cells
from jaxnet.config.cells import Cell
from jaxnet.config.document import (
    LONGEST_INT,
    MOST_DEPTH,
    NO_CHARACTERS,
    TOO_DEEP,
    ConfigError,
    Document,
    Keys,
    Override,
    Plain,
    Problem,
    dotted_key,
    read_override,
    set_value,
)
from jaxnet.config.keys import Config
from jaxnet.config.known import model_of
from jaxnet.config.naming import without_empty_labels
from jaxnet.kinds import registry
from jaxnet.kinds.graphs.edges import adopt_network
from jaxnet.kinds.kind import Kind, KindError
from jaxnet.kinds.metrics import Metric

TOO_GREAT = 10**LONGEST_INT
SCALAR_TYPES = (bool, int, float, str, NoneType)
MOST_VALUES = 1_000_000  # values in a script's mapping


@dataclass(frozen=True, repr=False)
class Study:
    """A validated config and the cells that its sweep spans.

    Attributes
    ----------
    config
        All keys of the study, with the defaults of keys that were left out.
    cells
        One cell for each combination of swept values, in the order of the sweep.

    Examples
    --------
    >>> import jaxnet
    >>> study = jaxnet.load({"samples": 3, "sweep": {"attack.magnitude": [1, 5]}})
    >>> study
    Study('study', cells=2, lanes=6)
    >>> study.config.horizon, study.cells[1].labels
    (30.0, {'attack.magnitude': 5})
    """

    config: Config
    cells: tuple[Cell, ...]

    @property
    def lanes(self) -> int:
        """Return the greatest possible number of lanes."""
        return len(self.cells) * self.config.most_samples

    def __repr__(self) -> str:
        return f"Study({self.config.name!r}, cells={len(self.cells)}, lanes={self.lanes})"

    def _repr_html_(self) -> str:
        """Return a notebook's table: the study's size, and each swept key with its values."""
        rows = {"cells": str(len(self.cells)), "lanes": str(self.lanes)}
        for key in self.cells[0].labels:
            values = dict.fromkeys(str(cell.labels[key]) for cell in self.cells)
            rows[key] = shorten(", ".join(values), 100, placeholder=" …")
        body = "".join(
            f"<tr><th>{escape(key)}</th><td>{escape(row)}</td></tr>" for key, row in rows.items()
        )
        return f"<table><caption>{escape(self.config.name)}</caption>{body}</table>"


StudySource = Study | str | Path | UPath | Mapping[str, Any]
Overrides = Mapping[str, object] | Iterable[str]


def load(source: StudySource, overrides: Overrides = ()) -> Study:
    """Read a study from a YAML file, or from a mapping with the same keys.

    A kind may be defined in a module beside the file. In a mapping, a kind may be an object, and a
    topology a graph of networkx or a matrix, as `network` reads it. Values of NumPy and pandas
    count as Python's, tuples as lists. Without a `name` a mapping's study is called "study".

    Parameters
    ----------
    source
        Path of a YAML file, a mapping, or a Study. A Study without overrides is returned as it is.
    overrides
        A mapping by dotted key, or words KEY=VALUE with the value in YAML.

    Returns
    -------
        The validated study and its cells.

    Raises
    ------
    ConfigError
        With everything that is wrong. An error in a file names the line, an error in a mapping the
        key.

    Examples
    --------
    >>> import jaxnet
    >>> study = jaxnet.load({"samples": 3, "sweep": {"attack.magnitude": [1, 5]}})
    >>> len(study.cells), study.lanes
    (2, 6)
    """
    if isinstance(overrides, Mapping):
        given = [Override(key, value) for key, value in overrides.items()]
    else:
        given = [read_override(str(word)) for word in overrides]
    if isinstance(source, Study):
        if not given:
            return source
        with source.config.scope():
            return read_mapping(cells.to_plain(source.config), given, settled=True)
    if isinstance(source, Mapping):
        return read_mapping({"name": "study", **source}, given)
    document = Document.read(source)
    with registry.Scope(Path(str(source)).resolve().parent)() as scope:
        return read_study(document, as_plain(given, document.data), scope)


def read_mapping(
    source: Mapping[str, Any], overrides: Sequence[Override], settled: bool = False
) -> Study:
    """Return the study of a script's mapping; raise ConfigError.

    `settled`: the mapping is a study's config, in which `vehicles` follows from the network.
    """
    with registry.Scope(known=registry.scope().known)() as scope:
        data = native(source, leads=has_navigator(source, overrides))
        return read_study(Document.of(data, settled), as_plain(overrides, source), scope)


def read_study(document: Document, overrides: Iterable[Override], scope: registry.Scope) -> Study:
    for override in overrides:
        document.override(override)
    with scope():
        config, found = cells.read_document(document)
    return Study(config.within(scope), found)


def as_plain(overrides: Sequence[Override], known: Mapping[str, Any]) -> list[Override]:
    """Make plain data of the values of overrides; raise ConfigError."""
    leads = has_navigator(known, overrides)
    return [each._replace(value=native(each.value, each.key, leads=leads)) for each in overrides]


def has_navigator(known: Mapping[str, Any], overrides: Sequence[Override]) -> bool | None:
    """Whether the cells of a study have a navigator, None if some have.

    A script's network is numbered by that before the study is read.
    """
    data: dict[str, Plain] = {key: known[key] for key in ("navigator", "sweep") if known.get(key)}
    for override in overrides:
        if override.key.split(".")[0] in ("navigator", "sweep"):
            with contextlib.suppress(LookupError, AttributeError):  # told where the study is read
                set_value(data, override.keys, override.value)
    swept = data.get("sweep")
    listed = swept.get("navigator") if isinstance(swept, Mapping) else None
    each = listed if isinstance(listed, list) and listed else [data.get("navigator")]
    kinds = [one if isinstance(one, Kind) else model_of("navigator", one) for one in each]
    leads = {getattr(kind, "present", True) for kind in kinds}
    return leads.pop() if len(leads) == 1 else None


def native(value: object, *keys: str | int, leads: bool | None = True) -> Plain:
    """Return plain data of a script's value: arrays and tuples become lists, paths become text.

    `leads`: whether a node of a network is the navigator, None if in some cells only. Raises
    ConfigError for a value that YAML cannot express, and beyond the limits of `document`.
    """
    return Native(leads).plain(value, keys)


@runtime_checkable
class Listable(Protocol):
    """An array or number of NumPy, pandas or JAX."""

    def tolist(self) -> object: ...


class Native:
    """Converts a script's values to plain data, and counts them."""

    def __init__(self, leads: bool | None):
        self.count, self.leads = 0, leads

    def plain(self, value: object, keys: Keys) -> Plain:
        self.count += 1
        if self.count > MOST_VALUES:
            raise refusal(keys, f"more than {MOST_VALUES:,} values")
        if type(value) in SCALAR_TYPES:
            return plain_scalar(value, keys)
        value = config_form(value, keys, self.leads)
        value = value.tolist() if isinstance(value, Listable) else value
        if isinstance(value, Mapping | list | tuple | range) and len(keys) >= MOST_DEPTH:
            raise refusal(keys, TOO_DEEP)
        if isinstance(value, Mapping):
            inner = {plain_scalar(key, keys): each for key, each in value.items()}
            return {key: self.plain(each, (*keys, key)) for key, each in inner.items()}
        if isinstance(value, list | tuple | range):
            return [self.plain(inner, (*keys, number)) for number, inner in enumerate(value)]
        return plain_scalar(value, keys)


def config_form(value: object, keys: Keys, leads: bool | None) -> object:
    """Return a kind, a kind's class, a metric or a network in the form of a config.

    A network is a graph of networkx, or where a topology stands also a matrix of NumPy or SciPy.
    Other values are returned as they are. Raises ConfigError for a network that is no topology.
    """
    if isinstance(value, Kind) and getattr(value, "led", False) and leads is False:
        told = "a node leads this network, and navigator is none: jaxnet.network(…, leads=False)"
        raise refusal(keys, told)
    if isinstance(value, Kind):
        return {"kind": registry.adopt(type(value)), **without_empty_labels(dict(value))}
    if isinstance(value, Metric) or (isinstance(value, type) and issubclass(value, Kind)):
        return registry.adopt(value)
    if isinstance(value, np.ndarray) and not is_topology(keys):
        return value
    try:
        graph = adopt_network(value, leads)
    except KindError as error:
        raise refusal(keys, str(error)) from error
    return value if graph is None else config_form(graph, keys, leads)


def is_topology(keys: Keys) -> bool:
    """Whether a topology stands at these keys, as it is or swept."""
    return keys == ("topology",) or (keys[:2] == ("sweep", "topology") and len(keys) == 3)


def plain_scalar(value: object, keys: Keys) -> bool | int | float | str | None:
    value = value.tolist() if isinstance(value, Listable) else value
    value = str(value) if isinstance(value, PurePath | UPath) else value
    if type(value) not in SCALAR_TYPES:
        allowed = "must be a number, text, true, false, null, a list or a mapping"
        raise refusal(keys, f"{allowed} (got {value!r})")
    if isinstance(value, int) and abs(value) >= TOO_GREAT:
        raise refusal(keys, f"a whole number has at most {LONGEST_INT} digits")
    if isinstance(value, str) and (found := NO_CHARACTERS.search(value)):
        raise refusal(keys, f"the character {found[0]!r} is not allowed")
    return value  # pyright: ignore[reportReturnType]


def refusal(keys: Keys, message: str) -> ConfigError:
    return ConfigError([Problem("", dotted_key(keys), message)])
