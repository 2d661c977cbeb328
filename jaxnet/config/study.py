"""A study: what a YAML file, a mapping or a script asks jaxnet to simulate."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path, PurePath
from textwrap import shorten
from types import NoneType
from typing import Any

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
    Plain,
    Problem,
    dotted_key,
)
from jaxnet.config.keys import Config
from jaxnet.config.known import model_of
from jaxnet.config.naming import to_plain
from jaxnet.config.sweep import joint_key, values_in
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
    replaced = overrides if isinstance(overrides, Mapping) else {}
    words = [] if replaced else [*overrides]
    if isinstance(source, Study):
        if not (replaced or words):
            return source
        scope = registry.Scope(known=source.config.scope.known)
        document = Document.of(cells.to_plain(source.config), settled=True)
    elif isinstance(source, Mapping):
        scope = registry.Scope(known=registry.scope().known)
        document = Document.of({"name": "study", **source})
    else:
        document = Document.read(source)
        scope = registry.Scope(Path(str(source)).resolve().parent)
    with scope():
        leads = has_navigator(document.data, replaced)
        if isinstance(source, Mapping):
            document.data = native(document.data, leads=leads)
        for key, value in replaced.items():
            document.override(key, native(value, key, leads=leads))
    return read_study(document, words, scope)


def read_study(document: Document, words: Iterable[str], scope: registry.Scope) -> Study:
    """Return the study of a document in which words KEY=VALUE replace what is written."""
    for word in words:
        document.override_by(str(word))
    with scope():
        config, found = cells.read_document(document)
    return Study(config.within(scope), found)


def has_navigator(data: Mapping[Any, Any], overrides: Mapping[str, object]) -> bool | None:
    """Whether the cells of a study have a navigator, None if some have.

    A script's network is numbered by that before the study is read.
    """
    roots = ("navigator", "sweep")
    trial = Document.of({key: data[key] for key in roots if data.get(key)})
    for key, value in overrides.items():
        if key.split(".")[0] in roots:
            trial.override(key, value)
    swept = trial.data.get("sweep")
    listed = values_in(swept, "navigator") if isinstance(swept, Mapping) else []
    each = listed or [trial.data.get("navigator")]
    kinds = [one if isinstance(one, Kind) else model_of("navigator", one) for one in each]
    leads = {getattr(kind, "present", True) for kind in kinds}
    return leads.pop() if len(leads) == 1 else None


def native(value: object, *keys: str | int, leads: bool | None = True) -> Plain:
    """Return plain data of a script's value: arrays and tuples become lists, paths become text.

    `leads`: whether a node of a network is the navigator, None if in some cells only. Raises
    ConfigError for a value that YAML cannot express, and beyond the limits of `document`.
    """
    left = iter(range(MOST_VALUES))

    def plain(value: object, keys: Keys) -> Plain:
        if next(left, None) is None:
            raise refusal(keys, f"more than {MOST_VALUES:,} values")
        if type(value) in SCALAR_TYPES:
            return plain_scalar(value, keys)
        value = config_form(value, keys, leads)
        value = getattr(value, "tolist", lambda: value)()
        if isinstance(value, Mapping | list | tuple | range) and len(keys) >= MOST_DEPTH:
            raise refusal(keys, TOO_DEEP)
        if isinstance(value, Mapping):
            inner = {plain_scalar(key, keys): each for key, each in value.items()}
            return {key: plain(each, (*keys, key)) for key, each in inner.items()}
        if isinstance(value, list | tuple | range):
            return [plain(each, (*keys, number)) for number, each in enumerate(value)]
        return plain_scalar(value, keys)

    return plain(value, keys)


def config_form(value: object, keys: Keys, leads: bool | None) -> object:
    """Return a kind, a kind's class, a metric or a network in the form of a config.

    A network is a graph of networkx, or where a topology stands also a matrix of NumPy or SciPy.
    Tuples of swept keys become text. Other values are returned as they are. Raises ConfigError for
    a network that is no topology.
    """
    if keys == ("sweep",) and isinstance(value, Mapping):
        return {joint_key(k) if isinstance(k, tuple) else k: each for k, each in value.items()}
    if isinstance(value, Kind) and getattr(value, "led", False) and leads is False:
        told = "a node leads this network, and navigator is none: jaxnet.network(…, leads=False)"
        raise refusal(keys, told)
    if isinstance(value, Kind):
        return {"kind": registry.adopt(type(value)), **to_plain(dict(value))}
    if isinstance(value, type) and issubclass(value, Kind):
        return registry.adopt(value)
    if isinstance(value, Metric):
        registry.adopt(value)
        return registry.plain_metric(value)
    swept = keys[:2] == ("sweep", "topology") and len(keys) == 3
    if isinstance(value, np.ndarray) and not (swept or keys == ("topology",)):
        return value
    try:
        graph = adopt_network(value, leads)
    except KindError as error:
        raise refusal(keys, str(error)) from error
    return value if graph is None else config_form(graph, keys, leads)


def plain_scalar(value: object, keys: Keys) -> bool | int | float | str | None:
    value = getattr(value, "tolist", lambda: value)()  # of NumPy, pandas or JAX
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
