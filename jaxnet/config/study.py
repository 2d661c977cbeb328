"""A study: what a YAML file, a mapping or a script asks to be simulated."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from upath import UPath

from jaxnet.config import cells
from jaxnet.config.cells import Cell
from jaxnet.config.document import Document
from jaxnet.config.keys import Config


@dataclass(frozen=True)
class Study:
    """A validated config and the cells that its sweep spans."""

    config: Config
    cells: tuple[Cell, ...]

    @property
    def lanes(self) -> int:
        """How many lanes it has, at most."""
        return len(self.cells) * self.config.most_samples


def load(
    source: str | Path | UPath | Mapping[str, Any], overrides: Mapping[str, Any] | Iterable[str] = ()
) -> Study:
    """Read a study from a YAML file, or from a mapping like one (its `name` is "study" if it has none).

    Overrides are a mapping by dotted key, or KEY=VALUE words. Raises ConfigError with everything that is
    wrong; of a mapping it names the places in its YAML.
    """
    if isinstance(source, Mapping):
        document = Document(yaml.safe_dump({"name": "study", **source}, sort_keys=False), "study")
    else:
        document = Document.read(source)
    if isinstance(overrides, Mapping):
        overrides = [f"{key}={as_yaml(value)}" for key, value in overrides.items()]
    for word in overrides:
        document.override(word)
    return Study(*cells.read(document))


def as_yaml(value: Any) -> str:
    """A plain value as YAML (JSON is YAML)."""
    return json.dumps(value)
