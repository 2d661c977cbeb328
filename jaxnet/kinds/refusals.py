"""Messages about wrong values: pydantic's errors in a user's words."""

import difflib
import json

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from jaxnet.kinds.fields import MARK, names_distribution

LEAST_LETTERS = 3  # letters of a name that tell which was meant
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


def refusal_of(name: str, known: list[str], error: ValidationError) -> str:
    """What is wrong with the arguments of a class, a line for each; `known` are its keys."""
    lines = []
    for one in error.errors(include_url=False):
        keys = [str(part) for part in one["loc"] if not str(part).startswith((MARK, "[key]"))]
        message = value_message(one)
        if one["type"] == "extra_forbidden" and len(keys) == 1:
            message += suggestion(keys[0], known)
        lines.append(": ".join([name, *filter(None, [".".join(keys)]), message]))
    return "\n".join(lines)


def value_message(error: ErrorDetails) -> str:
    """The message of one of pydantic's errors, without its place."""
    kind, context, given = error["type"], error.get("ctx", {}), error["input"]
    if kind == "missing":
        return "an entry is missing" if isinstance(error["loc"][-1], int) else "required"
    if kind in ("extra_forbidden", "invalid_key"):
        return "unknown key"
    if kind == "kind":
        return f"must be a mapping, or one of {context['known']} (got {shorten_value(given)})"
    if kind == "kind_name":
        return str(context["error"])
    if kind in ("too_short", "too_long"):
        limit, name = ("least", "min_length") if kind == "too_short" else ("most", "max_length")
        entries = "1 entry" if context[name] == 1 else f"{context[name]} entries"
        return f"must have at {limit} {entries} (got {shorten_value(given)})"
    message = WORDS[kind].format(**context) if kind in WORDS else error["msg"]
    if kind in ("float_type", "int_type") and names_distribution(given):
        message += ", not a distribution"
    return f"{message} (got {shorten_value(given)})"


def shorten_value(value: object) -> str:
    """A value as a user may have written it, cut to 60 characters."""
    text = value_text(value)
    return text if len(text) <= 60 else text[:57] + "..."


def value_text(value: object) -> str:
    """A value in full, as a user may have written it."""
    return json.dumps(value, default=lambda record: record.model_dump(), ensure_ascii=False)


def suggestion(word: str, known: list[str] | dict[str, str], fallback: bool = True) -> str:
    """The known words that were probably meant, or a list of the known words if there are any.

    The nearest word was meant, else those that contain the given one. The keys of a mapping are
    compared, and its values told.
    """
    told = known if isinstance(known, dict) else dict(zip(known, known, strict=True))
    near = difflib.get_close_matches(word, told, n=1, cutoff=0.6)
    near = near or [each for each in told if each.lower() == word.lower()]
    if not near and len(word) >= LEAST_LETTERS:
        near = [each for each in told if word.lower() in each.lower()]
    if meant := dict.fromkeys(f"'{told[each]}'" for each in near):
        return f" (did you mean {' or '.join(meant)}?)"
    return f" (known here: {', '.join(known)})" if fallback and known else ""
