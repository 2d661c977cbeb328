"""YAML 1.2 text as plain data, remembering where every key stands.

PyYAML parses YAML 1.1, where `1e-3` is text, `on` is true and a key given twice silently wins; the core
schema of YAML 1.2 is put in its place here, and a repeated key is an error.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

Keys = tuple[Any, ...]  # where a value stands: keys and list indices from the top


class Problem(NamedTuple):
    """One thing that is wrong, and where: `place` is FILE:LINE:COL or the command line's word."""

    place: str
    key: str
    message: str

    def __str__(self) -> str:
        """The line a user sees."""
        return ": ".join(part for part in self if part)


class ConfigError(ValueError):
    """A config that cannot be run, with everything that is wrong with it."""

    def __init__(self, problems: list[Problem]):
        self.problems = problems
        super().__init__("\n".join(map(str, problems)))


class Loader(yaml.SafeLoader):
    """PyYAML's parser with the scalars of YAML 1.2's core schema."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 (PyYAML's own protocol)


INT = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
FLOAT = re.compile(
    r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
)
for name, pattern, first in [
    ("null", re.compile(r"~|null|Null|NULL|"), ["~", "n", "N", ""]),
    ("bool", re.compile(r"true|True|TRUE|false|False|FALSE"), list("tTfF")),
    ("int", INT, list("-+0123456789")),
    ("float", FLOAT, list("-+.0123456789")),
]:
    Loader.add_implicit_resolver(f"tag:yaml.org,2002:{name}", re.compile(f"^(?:{pattern.pattern})$"), first)


class Reader:
    """Turns one YAML text into plain data; `places` is filled on the way."""

    def __init__(self, source: str):
        self.source = source
        self.places: dict[Keys, str] = {}

    def read(self, text: str) -> Any:
        """The value that the text holds, None if it holds nothing."""
        node = self.compose(text)
        return None if node is None else self.build(node, (), [])

    def compose(self, text: str) -> yaml.Node | None:
        """The node tree of a YAML text."""
        try:
            return yaml.compose(text, Loader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            place = f"{self.source}:{mark.line + 1}:{mark.column + 1}" if mark else self.source
            raise ConfigError([Problem(place, "", f"not YAML: {error.problem}")]) from error
        except yaml.YAMLError as error:
            raise ConfigError([Problem(f"{self.source}:1:1", "", f"not YAML: {error}")]) from error

    def build(self, node: yaml.Node, keys: Keys, above: list[yaml.Node]) -> Any:
        """Plain data of a node, noting places; `above` guards against an alias inside its own anchor."""
        self.places.setdefault(keys, self.at(node))
        if node in above:
            self.refuse(node, dotted(keys), "an alias inside its own anchor")
        if isinstance(node, yaml.SequenceNode):
            return [self.build(item, (*keys, n), [*above, node]) for n, item in enumerate(node.value)]
        if isinstance(node, yaml.MappingNode):
            return dict(self.items(node, keys, [*above, node]))
        return self.scalar(node, keys)

    def items(
        self, node: yaml.MappingNode, keys: Keys, above: list[yaml.Node]
    ) -> Iterator[tuple[Any, Any]]:
        """Keys and values of a mapping, each key once."""
        seen = set()
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                self.refuse(key_node, dotted(keys), "a key must be text or a number")
            key = self.scalar(key_node, keys)
            if key in seen:
                self.refuse(key_node, dotted((*keys, key)), "given twice")
            seen.add(key)
            self.places[(*keys, key)] = self.at(key_node)
            yield key, self.build(value_node, (*keys, key), above)

    def scalar(self, node: yaml.Node, keys: Keys) -> Any:
        """A null, bool, int, float or text by YAML 1.2."""
        kind, text = node.tag.removeprefix("tag:yaml.org,2002:"), str(node.value)
        if kind == "str":
            return text
        if kind == "null":
            return None
        if kind == "bool":
            return text.lower() == "true"
        if kind == "int" and INT.fullmatch(text):
            return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))
        if kind == "float" and FLOAT.fullmatch(text):
            return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
        return self.refuse(node, dotted(keys), f"the tag {node.tag} has no meaning here")

    def at(self, node: yaml.Node) -> str:
        """FILE:LINE:COL of a node."""
        return f"{self.source}:{node.start_mark.line + 1}:{node.start_mark.column + 1}"

    def refuse(self, node: yaml.Node, key: str, message: str) -> None:
        """Raise the error at a node."""
        raise ConfigError([Problem(self.at(node), key, message)])


class Document:
    """A config as it was written: `data`, and the place of everything in it."""

    def __init__(self, text: str, source: str):
        reader = Reader(source)
        data = reader.read(text)
        if not isinstance(data, dict | None):
            problem = Problem(f"{source}:1:1", "", "a config is a mapping of keys to values")
            raise ConfigError([problem])
        self.source, self.places = source, reader.places
        self.overridden: list[str] = []  # dotted keys set from the command line
        self.data: dict[str, Any] = data or {}

    @classmethod
    def read(cls, path: str | Path) -> "Document":
        """The document in a file."""
        try:
            return cls(Path(path).read_text(encoding="utf-8"), str(path))
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
            raise ConfigError([Problem(str(path), "", f"cannot be read: {reason}")]) from error

    def place(self, *candidates: Keys) -> str:
        """Where the first of these stands that was written; else the nearest thing around the first."""
        for keys in candidates:
            if keys in self.places:
                return self.places[keys]
        around = candidates[0]
        while around and around not in self.places:
            around = around[:-1]
        return self.places.get(around, f"{self.source}:1:1")

    def override(self, word: str) -> None:
        """Set a value from `KEY=VALUE`, the value in YAML."""
        source = f"command line '{word}'"
        key, equals, text = word.partition("=")
        if not equals or not key:
            raise ConfigError([Problem(source, "", "an override is KEY=VALUE")])
        reader, keys = Reader(source), split(key)
        put(self.data, keys, reader.read(text))
        self.overridden.append(key)
        kept = {known: at for known, at in self.places.items() if known[: len(keys)] != keys}
        self.places = kept | {(*keys, *inner): source for inner in [(), *reader.places]}


def split(key: str) -> Keys:
    """Keys of a dotted name; what follows `sweep.` is one key, for swept keys are dotted themselves."""
    if key.startswith("sweep."):
        return ("sweep", key.removeprefix("sweep."))
    return tuple(key.split("."))


def dotted(keys: Keys) -> str:
    """The dotted name of a place."""
    return ".".join(map(str, keys))


def put(data: dict[str, Any], keys: Keys, value: Any) -> None:
    """Set a value deep in nested mappings, making the ones on the way; a kind's bare name becomes one."""
    for key in keys[:-1]:
        inner = data.get(key)
        if not isinstance(inner, dict):
            inner = {"kind": inner} if isinstance(inner, str) else {}
        data[key] = inner = dict(inner)
        data = inner
    data[keys[-1]] = value
