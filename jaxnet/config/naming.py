"""Names of swept keys and their values in figures, tables and pages."""

import functools
import re
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from jaxnet.config.keys import KINDS, Scenario
from jaxnet.outside.families import base_of

MAGNITUDE = "attack.magnitude"
NO_BREAK = "\N{NO-BREAK SPACE}"


def labels_title(labels: Mapping[str, object]) -> str:
    """Return the title of a panel or row: its swept values, with keys where a value alone is unclear."""
    return ", ".join(value_name(key, value) for key, value in labels.items())


def value_name(key: str, value: object) -> str:
    """Return the name of one swept value with its unit. Non-breaking spaces join number and unit."""
    if value == "none":
        return f"no{NO_BREAK}{key}"
    if key in KINDS:
        return str(value)
    name = f"ā{NO_BREAK}=" if key == MAGNITUDE else f"{key} ="
    return NO_BREAK.join(filter(None, [name, format_value(value), unit(key)]))


def format_value(value: object) -> str:
    """Return a number with four digits; text stays as it is."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def value_alone(key: str, value: object) -> str:
    """Return a swept value without its key and unit."""
    return value_name(key, value) if key in KINDS else format_value(value)


def quantity(key: str) -> str:
    """Return the label of the axis of a swept key."""
    name = "attack magnitude ā" if key == MAGNITUDE else key
    return f"{name} [{unit(key)}]" if unit(key) else name


@functools.cache
def unit(key: str) -> str:
    """Return the unit in brackets in a key's description, "" if there is none.

    An entry of a list has the unit of the list.
    """
    key = re.sub(r"(\.[0-9]+)+$", "", key)
    root, name = key.partition(".")[0], key.rpartition(".")[2]
    base: Any = Scenario
    if name != key:
        base = base_of(root) if root in KINDS else Scenario.model_fields[root].annotation
    models = [model for model in family(base) if name in model.model_fields]
    described = (model.model_fields[name].description or "" for model in models)
    found = (re.match(r"\[([^],]+)", words) for words in described)
    return next((match[1] for match in found if match), "")


def family(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """Yield a model and all its subclasses."""
    yield model
    for each in model.__subclasses__():
        yield from family(each)
