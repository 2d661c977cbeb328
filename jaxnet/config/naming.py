"""What figures, tables and pages call swept keys and their values."""

import functools
import re
from collections.abc import Iterator
from typing import Any

from jaxnet.config.keys import KINDS, Scenario
from jaxnet.kinds.families import base_of

MAGNITUDE = "attack.magnitude"
NO_BREAK = "\N{NO-BREAK SPACE}"


def labels_title(labels: dict[str, Any]) -> str:
    """A panel's or row's name: the values that it is about, with their keys where they do not say which."""
    return ", ".join(value_name(key, value) for key, value in labels.items())


def value_name(key: str, value: Any) -> str:
    """One swept value, with its unit if it has one; the two are never on different lines."""
    if value == "none":
        return f"no{NO_BREAK}{key}"
    if key in KINDS:
        return str(value)
    name = f"ā{NO_BREAK}=" if key == MAGNITUDE else f"{key} ="
    return NO_BREAK.join(filter(None, [name, format_value(value), unit(key)]))


def format_value(value: Any) -> str:
    """A number to four digits, words as they are."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def value_alone(key: str, value: Any) -> str:
    """A swept value where its key and unit are told already."""
    return value_name(key, value) if key in KINDS else format_value(value)


def quantity(key: str) -> str:
    """What an axis of a swept key is called."""
    name = "attack magnitude ā" if key == MAGNITUDE else key
    return f"{name} [{unit(key)}]" if unit(key) else name


@functools.cache
def unit(key: str) -> str:
    """The unit that the config's models give a dotted key in brackets; nothing where none of them does.

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


def family(model: Any) -> Iterator[Any]:
    """A model and all that are made from it."""
    yield model
    for each in model.__subclasses__():
        yield from family(each)
