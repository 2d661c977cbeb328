"""Messages about the wrong keys and values of a config."""

import typing

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from jaxnet.config.document import Plain, dotted_key
from jaxnet.config.keys import Config
from jaxnet.kinds import registry
from jaxnet.kinds.fields import MARK
from jaxnet.kinds.kind import KindError
from jaxnet.kinds.refusals import shorten_value as shorten_value
from jaxnet.kinds.refusals import suggestion as suggestion
from jaxnet.kinds.refusals import value_message
from jaxnet.kinds.refusals import value_text as value_text
from jaxnet.kinds.registry import KindOf

RENAMED_KEYS = {"attack.channel": "links"}


def explain(error: ErrorDetails, data: Plain) -> str:
    """Return the message of one of pydantic's errors on some data."""
    kind, given = error["type"], error["input"]
    if kind in ("extra_forbidden", "invalid_key"):
        if renamed := renamed_key(error["loc"]):
            return renamed
        return value_message(error) + suggestion(
            str(error["loc"][-1]), known_keys(error["loc"], data)
        )
    if kind == "kind_name":
        name = given.get("kind") if isinstance(given, dict) else given
        known = registry.kind_names(error.get("ctx", {})["family"])
        return value_message(error) + suggestion(str(name), known, fallback=False)
    return value_message(error) + (
        attacked_hint(error["loc"], given) if kind == "list_type" else ""
    )


def attacked_hint(location: tuple[int | str, ...], given: object) -> str:
    """Return a hint for a number in place of the list of attacked vehicles; "" for another mistake."""
    places = [part for part in location if not str(part).startswith(MARK)]
    if type(given) is not int or (places[0], places[-1]) != ("attack", "vehicles"):
        return ""
    return f": {{random: {given}}} draws {given} in each lane, [{given}] is vehicle {given}"


def renamed_key(location: tuple[int | str, ...]) -> str:
    """Return that a key was renamed; "" if it was not."""
    name = RENAMED_KEYS.get(dotted_key(location), "")
    return name and f"{location[-1]} was renamed to {name}"


def known_keys(location: tuple[int | str, ...], data: Plain) -> list[str]:
    """Return the keys allowed in the mapping in which pydantic found an unknown key."""
    model: object = Config
    for part in location[:-1]:
        if isinstance(part, str) and part.startswith(MARK):
            model = record_of(part.removeprefix(MARK), model)
            continue
        field = getattr(model, "model_fields", {}).get(part)
        data = data.get(part) if isinstance(data, dict) else None
        model = field if field is None else model_in(field, data)
    return list(getattr(model, "model_fields", {}))


def model_in(field: FieldInfo, value: Plain) -> object:
    """Return the model or union of models of a key. If the key takes a kind, this is the class that its value
    names.
    """
    family = next((mark.family for mark in field.metadata if isinstance(mark, KindOf)), None)
    if family is None:
        models = records(field.annotation)
        return models[0] if len(models) == 1 else field.annotation
    try:
        name = value.get("kind") if isinstance(value, dict) else value
        return registry.find(family, name) if isinstance(name, str) else None
    except KindError:
        return None


def record_of(member: str, union: object) -> type[BaseModel] | None:
    """Return the member of a union of records with this tag, None if there is none."""
    found = [
        each
        for each in records(union)
        if each.__name__.lower().startswith(member) or member in each.model_fields
    ]
    return found[0] if found else None


def records(annotation: object) -> list[type[BaseModel]]:
    """Return all models inside a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for part in typing.get_args(annotation) for found in records(part)]
