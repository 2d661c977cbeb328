"""A first config with a comment on every key, from a few answers."""

import inspect
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from textwrap import wrap

from jaxnet.config.cells import read_document, without_empty_labels
from jaxnet.config.document import ConfigError, Document, Plain, Problem
from jaxnet.config.keys import Config, Scenario
from jaxnet.config.study import yaml_of
from jaxnet.kinds import registry
from jaxnet.kinds.attacks import usual_targets
from jaxnet.kinds.kind import Kind, KindError

ASKED_FAMILIES = ("topology", "attack", "defence")
DEFAULT_ANSWERS: dict[str, Plain] = {
    **{family: Scenario.model_fields[family].default.reference() for family in ASKED_FAMILIES},
    "vehicles": Scenario.model_fields["vehicles"].default,
    "magnitudes": [0.1, 1.0, 10.0],
    "samples": 100,
}
LINE_LENGTH = 100  # characters of a line with its comment
COLUMN = 32  # column of comments, where a line leaves room


def kinds_without_keys(family: str) -> list[str]:
    """Return the kinds of a family that need no key, including those of installed packages."""
    return [name for name in registry.kind_names(family) if not required_keys(registry.find(family, name))]


def required_keys(kind: type[Kind]) -> list[str]:
    """Return the keys of a kind without a default."""
    return [key for key, field in kind.model_fields.items() if field.is_required()]


def starter_config(file: str, answers: Mapping[str, Plain]) -> str:
    """Return the config of these answers, with defaults for the others; raise ConfigError."""
    given = {**DEFAULT_ANSWERS, **answers}
    for family in ASKED_FAMILIES:
        check_kind(file, family, given[family])
    found = "\n".join(config_lines(file, given)) + "\n"
    read_document(Document(found, file))
    return found


def check_kind(file: str, family: str, name: str) -> None:
    """Raise ConfigError for a kind that does not exist, or that needs further keys."""
    try:
        lacking = required_keys(registry.find(family, name))
    except KindError as error:
        raise ConfigError([Problem(file, family, str(error))]) from error
    if lacking:
        ready = ", ".join(kinds_without_keys(family))
        message = f"{name} needs {' and '.join(lacking)} (those that need nothing: {ready})"
        raise ConfigError([Problem(file, family, message)])


def answers_alone(given: Mapping[str, Plain], name: str) -> dict[str, Plain]:
    """Return the study of the answers as a mapping."""
    kinds = {family: registry.find(family, given[family]) for family in ASKED_FAMILIES}
    study: dict[str, Plain] = {"name": name, "samples": given["samples"], "vehicles": given["vehicles"]}
    study |= {family: {"kind": given[family], **keys_of_kind(kind, given)} for family, kind in kinds.items()}
    if "magnitude" in kinds["attack"].model_fields:
        study |= {"recovery": {"tau": 0.01}, "sweep": {"attack.magnitude": given["magnitudes"]}}
    return study


def keys_of_kind(kind: type[Kind], given: Mapping[str, Plain]) -> dict[str, Plain]:
    """Return a kind's keys with their defaults. Of its default vehicles, those that exist remain."""
    keys = {
        key: without_empty_labels(field.default)
        for key, field in kind.model_fields.items()
        if key != "label" and not field.is_required()
    }
    if "vehicles" in keys:
        keys["vehicles"] = usual_targets(given["vehicles"])
    return keys


def config_lines(file: str, given: Mapping[str, Plain]) -> Iterator[str]:
    """Yield the lines of the config."""
    yield f"# jaxnet run {shlex.quote(file)}"
    yield "# Every key that is left out has its default; `jaxnet check` says what would run."
    for key, value in answers_alone(given, Path(file).stem).items():
        if key not in ASKED_FAMILIES:
            yield from with_comment("", key, value, Config.model_fields[key].description)
            continue
        kind = registry.find(key, given[key])
        meaning = (inspect.getdoc(kind) or "").partition("\n")[0]
        yield f"{key}:"
        yield from with_comment("  ", "kind", value.pop("kind"), meaning)
        for inner, each in value.items():
            yield from with_comment("  ", inner, each, kind.model_fields[inner].description)


def with_comment(indent: str, key: str, value: Plain, comment: str | None) -> Iterator[str]:
    """Yield a key with its value and description; a long description becomes comment lines above the key."""
    line = f"{indent}{yaml_of({key: value}, inline=True).removeprefix('{').removesuffix('}')}"
    words = f"# {comment}" if comment else ""
    beside = f"{line:<{COLUMN - 2}}  {words}".rstrip()
    if len(beside) <= LINE_LENGTH:
        yield beside
        return
    yield from wrap(words, LINE_LENGTH, initial_indent=indent, subsequent_indent=f"{indent}#   ")
    yield line
