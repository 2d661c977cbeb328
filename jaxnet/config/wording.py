"""Messages about wrong values: pydantic's errors in a user's words."""

import difflib
import json
import typing

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from jaxnet.config.document import Plain, dotted_key
from jaxnet.config.keys import Config
from jaxnet.kinds import registry
from jaxnet.kinds.family import KindOf
from jaxnet.kinds.fields import MARK, names_distribution
from jaxnet.kinds.kind import KindError

WORDS = {
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be text",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "dict_type": "must be a mapping",
    "model_type": "must be a mapping",
    "model_attributes_type": "must be a mapping",
    "finite_number": "must be finite",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "multiple_of": "must be a multiple of {multiple_of:g}",
    "value_error": "{error}",
    "literal_error": "must be {expected}",
}
RENAMED_KEYS = {"attack.channel": "links"}


def explain(error: ErrorDetails, data: Plain) -> str:
    """Return the message of one of pydantic's errors on some data."""
    kind, context, given = error["type"], error.get("ctx", {}), error["input"]
    if kind == "missing":
        return "an entry is missing" if isinstance(error["loc"][-1], int) else "required"
    if kind in ("extra_forbidden", "invalid_key"):
        if renamed := renamed_key(error["loc"]):
            return renamed
        return "unknown key" + suggestion(str(error["loc"][-1]), known_keys(error["loc"], data))
    if kind == "kind":
        return f"must be a mapping, or one of {context['known']} (got {shorten_value(given)})"
    if kind == "metric":
        return context["error"]
    if kind == "kind_name":
        name = given.get("kind") if isinstance(given, dict) else given
        return context["error"] + suggestion(
            str(name), registry.kind_names(context["family"]), fallback=False
        )
    if kind in ("too_short", "too_long"):
        word, number = (
            ("least", context["min_length"]) if kind == "too_short" else ("most", context["max_length"])
        )
        entries = "1 entry" if number == 1 else f"{number} entries"
        return f"must have at {word} {entries} (got {shorten_value(given)})"
    message = WORDS[kind].format(**context) if kind in WORDS else error["msg"]
    if kind in ("float_type", "int_type") and names_distribution(given):
        message += ", not a distribution"
    return f"{message} (got {shorten_value(given)})"


def renamed_key(location: tuple[int | str, ...]) -> str:
    """Return that a key was renamed; "" if it was not."""
    name = RENAMED_KEYS.get(dotted_key(location), "")
    return name and f"{location[-1]} was renamed to {name}"


def shorten_value(value: object) -> str:
    """Return a value as a user may have written it, cut to 60 characters."""
    text = value_text(value)
    return text if len(text) <= 60 else text[:57] + "..."


def value_text(value: object) -> str:
    """Return a value in full, as a user may have written it."""
    return json.dumps(value, default=lambda record: record.model_dump(), ensure_ascii=False)


def suggestion(word: str, known: list[str], fallback: bool = True) -> str:
    """Return the known word that was probably meant, or a list of the known words."""
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if near:
        return f" (did you mean '{near[0]}'?)"
    return f" (known here: {', '.join(known)})" if fallback else ""


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
    found = [each for each in records(union) if member in (each.__name__.lower(), *each.model_fields)]
    return found[0] if found else None


def records(annotation: object) -> list[type[BaseModel]]:
    """Return all models inside a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for part in typing.get_args(annotation) for found in records(part)]
