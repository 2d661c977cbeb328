"""Names of swept keys and of their values, as figures, tables and pages show them.

A key's name comes from the config (`labels`), else from the key's field (`title`), else from its words:
`attack.frequency` is "attack frequency". A key's unit stands in the brackets of its description.
"""

import functools
import re
from collections.abc import Iterator, Mapping
from typing import Any

import yaml
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from jaxnet.config import wording
from jaxnet.config.keys import INNER_KINDS, KINDS, Scenario
from jaxnet.kinds import registry
from jaxnet.kinds.kind import KindError
from jaxnet.kinds.registry import KindOf
from jaxnet.model.wording import orders_in_words, sets_in_words
from jaxnet.outside.families import base_of

MAGNITUDE = "attack.magnitude"
ATTACKED, ATTACKED_NUMBER = "attack.vehicles", "attack.vehicles.random"
NO_BREAK = "\N{NO-BREAK SPACE}"


class Key(str):
    """A dotted key with the name that its study's config gives it, None without one."""

    name: str | None

    def __new__(cls, key: str, name: str | None = None) -> "Key":
        """Return the key with its name."""
        made = super().__new__(cls, key)
        made.name = name
        return made


def labels_title(labels: Mapping[str, object]) -> str:
    """Return the title of a panel or row: its swept values, with keys where a value alone is unclear."""
    return ", ".join(value_name(key, value) for key, value in labels.items())


def value_name(key: str, value: object) -> str:
    """Return the name of one swept value with its unit. Non-breaking spaces join number and unit."""
    if value == "none":
        return f"no{NO_BREAK}{key_name(key)}"
    if is_kind(key):
        return words_of_kind(key, str(value))
    if own_name(key) is None and (number := attacked_number(key, value)):
        noun = "attacked vehicle" if number == 1 else "attacked vehicles"
        return f"{number}{NO_BREAK}{noun} drawn at random"
    shown = magnitudes_with_units(key, value)
    name = f"ā{NO_BREAK}=" if key == MAGNITUDE and own_name(key) is None else f"{key_name(key)} ="
    return NO_BREAK.join(
        filter(None, [name, shown or format_value(value), "" if shown else unit(key)])
    )


def magnitudes_with_units(key: str, value: object) -> str:
    """Return a swept list of magnitudes with the unit of each order, "" for another value."""
    if key != MAGNITUDE or not str(value).startswith("["):
        return ""
    sizes = [float(size) for size in yaml.safe_load(str(value))]
    return f"({orders_in_words(sizes)})".replace(" m", f"{NO_BREAK}m")


def attacked_number(key: str, value: object) -> int:
    """Return how many attacked vehicles a swept value draws at random, 0 if it names them."""
    if key == ATTACKED_NUMBER and isinstance(value, int):
        return value
    given = yaml.safe_load(value) if key == ATTACKED and isinstance(value, str) else None
    return given.get("random", 0) if isinstance(given, dict) else 0


def value_alone(key: str, value: object) -> str:
    """Return a swept value without its key and unit."""
    if is_kind(key):
        return value_name(key, value)
    return magnitudes_with_units(key, value) or format_value(value)


def quantity(key: str) -> str:
    """Return the label of the axis of a swept key."""
    symbol = " ā" if key == MAGNITUDE and own_name(key) is None else ""
    name = key_name(key) + symbol
    return f"{name} [{unit(key)}]" if unit(key) else name


def is_kind(key: str) -> bool:
    """Return whether the values of a key are kinds."""
    return key in KINDS or key in INNER_KINDS


def own_name(key: str) -> str | None:
    """Return the name that the config gives a key, None without one."""
    return key.name if isinstance(key, Key) else None


def key_name(key: str) -> str:
    """Return the name of a key in words."""
    return own_name(key) or words_of(str(key))


@functools.cache
def words_of(key: str) -> str:
    """Return the name of a key by its field's title, else by its own words."""
    titles = (field.title for field in fields_of(key))
    if title := next(filter(None, titles), None):
        return title
    root, *inside = key.split(".")
    words = [*([] if root == "channel" else [root]), *inside]
    if root == "gain" and inside:
        words[-1] = f"k{words[-1]}"
    return " ".join(words).replace("_", " ")


def format_value(value: object) -> str:
    """Return a number with four digits, a list or mapping in words, and other text as it is."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return str(value)
    if not isinstance(value, str):
        return f"{value:.4g}" if isinstance(value, float) else str(value)
    if value.startswith(("[", "{")):
        return plain_words(yaml.safe_load(value))
    return value


def words_of_kind(key: str, label: str) -> str:
    """Return the label of a kind in words: the name of its class, and the keys that tell it apart."""
    name, bracket, inside = label.partition("(")
    try:
        name = registry.find(INNER_KINDS.get(key, key), name).words or name.replace("_", " ")
    except KindError:
        return label  # a label that the config gives
    told = re.sub(r"(\w+)=", r"\1 ", inside).replace('"', "").replace("_", " ")
    return f"{name} ({told}" if bracket else name


def plain_words(value: object) -> str:
    """Return a list or mapping of a config in words."""
    if isinstance(value, dict):
        if set(value) == {
            "random"
        }:  # attacked vehicles: the number must not read as that of a vehicle
            return f"{value['random']} drawn"
        if set(value) == {"at", "sets"}:  # attacked vehicles, which change
            return sets_in_words(value["at"], value["sets"])
        return ", ".join(
            f"{str(key).replace('_', ' ')} {plain_words(inner)}" for key, inner in value.items()
        )
    if isinstance(value, list):
        inner = ", ".join(map(plain_words, value))
        return f"({inner})" if any(isinstance(each, list) for each in value) else inner
    return format_value(value)


@functools.cache
def unit(key: str) -> str:
    """Return the unit in brackets in a key's description, "" if there is none.

    An entry of a list has the unit of the list.
    """
    described = (field.description or "" for field in fields_of(re.sub(r"(\.[0-9]+)+$", "", key)))
    found = (re.match(r"\[([^],]+)", words) for words in described)
    return next((match[1] for match in found if match), "")


def fields_of(key: str) -> list[FieldInfo]:
    """Return the fields that a dotted key has in the models of its root, the first kind first."""
    root, *inside = key.split(".")
    if not inside:
        return [Scenario.model_fields[root]]
    found = [Scenario.model_fields[root]]
    for name in inside:
        models = (model for field in found for model in models_in(field))
        found = [model.model_fields[name] for model in models if name in model.model_fields]
    return found


def models_in(field: FieldInfo) -> Iterator[type[BaseModel]]:
    """Yield the models that a key's value can be, each with all its subclasses."""
    kinds = (base_of(mark.family) for mark in field.metadata if isinstance(mark, KindOf))
    for model in (*kinds, *wording.records(field.annotation)):
        yield from family(model)


def family(model: Any) -> Iterator[type[BaseModel]]:
    """Yield a model and all its subclasses."""
    yield model
    for each in model.__subclasses__():
        yield from family(each)
