"""What is said of a value that does not fit: pydantic's errors in a user's words."""

import difflib
import json
from typing import Any

from jaxnet.config.keys import (
    KINDS,
    MARK,
    Config,
    Criterion,
    Geomspace,
    Initial,
    Linspace,
    Record,
    Recovery,
    Samples,
    Save,
    Sequential,
    Worst,
    kind_name,
    names_distribution,
)

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
    "value_error": "{error}",
    "literal_error": "must be {expected}",
}


def explain(error: Any) -> str:
    """What is wrong, in a user's words, from one of pydantic's errors."""
    kind, context, given = error["type"], error.get("ctx", {}), error["input"]
    if kind == "missing":
        return "an entry is missing" if isinstance(error["loc"][-1], int) else "required"
    if kind in ("extra_forbidden", "invalid_key"):
        return "unknown key" + suggestion(str(error["loc"][-1]), known_keys(error["loc"]))
    if kind in ("kind", "union_tag_invalid"):
        allowed = [kind_name(each) for each in KINDS[error["loc"][0]]]
        if not isinstance(given, dict):
            return f"must be a mapping, or one of {', '.join(allowed)} (got {shown(given)})"
        hint = suggestion(str(given["kind"]), allowed, fallback=False)
        return f"must be one of {', '.join(allowed)} (got {shown(given['kind'])}){hint}"
    if kind in ("too_short", "too_long"):
        word, number = (
            ("least", context["min_length"]) if kind == "too_short" else ("most", context["max_length"])
        )
        entries = "1 entry" if number == 1 else f"{number} entries"
        return f"must have at {word} {entries} (got {shown(given)})"
    message = WORDS[kind].format(**context) if kind in WORDS else error["msg"]
    if kind in ("float_type", "int_type") and names_distribution(given):
        message += ", not a distribution"
    return f"{message} (got {shown(given)})"


def shown(value: Any) -> str:
    """A value as a user may have written it, cut short if it is long."""
    text = in_full(value)
    return text if len(text) <= 60 else text[:57] + "..."


def in_full(value: Any) -> str:
    """A value in full, as a user may have written it."""
    return json.dumps(value, default=lambda record: record.model_dump(), ensure_ascii=False)


def suggestion(word: str, known: list[str], fallback: bool = True) -> str:
    """The known word that was probably meant, or all that are known."""
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if near:
        return f" (did you mean '{near[0]}'?)"
    return f" (known here: {', '.join(known)})" if fallback else ""


def known_keys(location: tuple[Any, ...]) -> list[str]:
    """Keys allowed in the mapping in which pydantic met an unknown one."""
    inside = [part.removeprefix(MARK) for part in location[:-1] if isinstance(part, str)]
    if not inside:
        return list(Config.model_fields)
    models: dict[str, type[Record]] = {
        "initial": Initial,
        "save": Save,
        "recovery": Recovery,
        "sequential": Sequential,
        "until": Criterion,
        "samples": Samples,
        "worst": Worst,
        "linspace": Linspace,
        "geomspace": Geomspace,
    }
    models |= {field: kinds[0] for field, kinds in KINDS.items()}
    models |= {kind_name(kind): kind for kind in KINDS.get(inside[0], ())}
    return list(models[inside[-1]].model_fields)
