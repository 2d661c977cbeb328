"""YAML 1.2 text as plain data with the place of every key. A repeated key is an error."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from upath import UPath

from jaxnet.config.yaml12 import (
    MOST_CHARACTERS,
    MOST_DEPTH,
    SCALARS,
    TOO_DEEP,
    ExcessError,
    Yaml12Loader,
    parse_scalar,
)

Keys = tuple[Any, ...]  # place of a value: keys and list indices from the top
Plain = Any  # null, bool, int, float, text, or a list or mapping of plain data
PlainMapping = Mapping[Any, Any]
Spot = tuple[str, ...]  # keys as text, because pydantic reports a key 1.5 as text

LONGEST_PART = 2000  # characters of each part of a problem's line
CONTROLS = re.compile(
    "[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]"
)  # also of direction
NO_CHARACTERS = re.compile(
    "[\x00\ud800-\udfff]"
)  # characters that no file name and no UTF-8 text contains


def escape_controls(text: str, but: str = "") -> str:
    """Return text whose control characters, but for some, are escape sequences that a reader sees."""
    return CONTROLS.sub(
        lambda found: found[0] if found[0] in but else found[0].encode("unicode_escape").decode(),
        text,
    )


class Problem(NamedTuple):
    """An error and its place: FILE:LINE:COL, the word on the command line, or "" for a script's value."""

    place: str
    key: str
    message: str

    def __str__(self) -> str:
        """Return the line for the user, with control characters escaped."""
        line = ": ".join(
            part if len(part) <= LONGEST_PART else part[:LONGEST_PART] + "…"
            for part in self
            if part
        )
        return escape_controls(line)


class ConfigError(ValueError):
    """A config that cannot be run, with all its problems.

    Examples
    --------
    >>> import jaxnet
    >>> try:
    ...     jaxnet.load({"horizn": 3})
    ... except jaxnet.ConfigError as error:
    ...     print(error)
    horizn: unknown key (did you mean 'horizon'?)
    """

    def __init__(self, problems: list[Problem]):
        self.problems = problems
        super().__init__("\n".join(map(str, problems)))


class Reader:
    """Converts one YAML text to plain data, and fills `places` and `problems`.

    A text from the command line has no lines; `within` is then the key whose value the text is. The text of a
    script's mapping has no `source`, and its places are "".
    """

    def __init__(self, source: str, within: Keys = ()):
        self.source, self.within = source, within
        self.places: dict[Spot, str] = {}
        self.problems: list[Problem] = []

    def read(self, text: str) -> Plain:
        """Return the value of the text, None if it is empty; raise ConfigError if it is not YAML."""
        if len(text) > MOST_CHARACTERS:
            reason = f"more than {MOST_CHARACTERS:,} characters"
            raise ConfigError([Problem(self.at(0, 0), dotted_key(self.within), reason)])
        try:
            node = yaml.compose(text, Yaml12Loader)
            return None if node is None else self.build(node, (), [])
        except ExcessError as error:
            raise ConfigError(
                [Problem(self.at(*error.place), dotted_key(self.within), error.excess)]
            ) from error
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            place = self.at(mark.line, mark.column) if mark else self.source
            reason = error.problem or "not understood"
            if "'\\t'" in reason:
                reason = "a tab here; blanks indent and separate"
        except yaml.reader.ReaderError as error:
            before = text[: error.position]
            place = self.at(before.count("\n"), len(before) - before.rfind("\n") - 1)
            reason = f"the character {error.character!r} is not allowed"
        raise ConfigError([Problem(place, dotted_key(self.within), f"not YAML: {reason}")])

    def build(self, node: yaml.Node, keys: Keys, above: list[yaml.Node]) -> Plain:
        """Return a node's plain data and record places; `above` detects an alias inside its own anchor."""
        self.places.setdefault(spot(keys), self.at_node(node))
        if node in above:
            raise ConfigError([self.problem(node, keys, "an alias inside its own anchor")])
        if isinstance(node, yaml.ScalarNode):
            return self.scalar(node, keys)
        if len(self.within) + len(keys) >= MOST_DEPTH:
            raise ConfigError([self.problem(node, keys, TOO_DEEP)])
        kind = node.tag.removeprefix("tag:yaml.org,2002:")
        if isinstance(node, yaml.SequenceNode) and kind == "seq":
            return [
                self.build(item, (*keys, n), [*above, node]) for n, item in enumerate(node.value)
            ]
        if isinstance(node, yaml.MappingNode) and kind == "map":
            return dict(self.items(node, keys, [*above, node]))
        raise ConfigError([self.problem(node, keys, f"the tag {node.tag} has no meaning here")])

    def items(
        self, node: yaml.MappingNode, keys: Keys, above: list[yaml.Node]
    ) -> Iterator[tuple[Plain, Plain]]:
        """Yield the keys and values of a mapping, each key once."""
        seen = set()
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise ConfigError([self.problem(key_node, keys, "a key must be text or a number")])
            key = self.scalar(key_node, keys)
            if key in seen:
                self.problems.append(self.problem(key_node, (*keys, key), "given twice"))
                continue
            seen.add(key)
            self.places[spot((*keys, key))] = self.at_node(key_node)
            yield key, self.build(value_node, (*keys, key), above)

    def scalar(self, node: yaml.ScalarNode, keys: Keys) -> Plain:
        """Return a null, bool, int, float or text by YAML 1.2."""
        kind, text = node.tag.removeprefix("tag:yaml.org,2002:"), node.value
        if found := NO_CHARACTERS.search(text):
            raise ConfigError(
                [self.problem(node, keys, f"the character {found[0]!r} is not allowed")]
            )
        if kind == "str":
            return text
        if kind in SCALARS and SCALARS[kind].fullmatch(text):
            return parse_scalar(kind, text)
        message = f"the tag {node.tag} has no meaning here"
        raise ConfigError([self.problem(node, keys, message)])

    def at(self, line: int, column: int) -> str:
        """Return FILE:LINE:COL; lines and columns count from 1."""
        return (
            f"{self.source}:{line + 1}:{column + 1}"
            if self.source and not self.within
            else self.source
        )

    def at_node(self, node: yaml.Node) -> str:
        """Return the place where a node starts."""
        return self.at(node.start_mark.line, node.start_mark.column)

    def problem(self, node: yaml.Node, keys: Keys, message: str) -> Problem:
        """Return a problem at a node."""
        return Problem(self.at_node(node), dotted_key((*self.within, *keys)), message)


class Document:
    """A config as it was written: `data`, the place of each key, and the problems so far.

    Paths in the config are relative to `folder`.
    """

    def __init__(self, text: str, source: str, folder: UPath | None = None):
        reader = Reader(source)
        data = reader.read(text)
        if not isinstance(data, dict | None):
            place = reader.places[()]
            raise ConfigError([Problem(place, "", "a config is a mapping of keys to values")])
        self.source, self.places, self.problems = source, reader.places, reader.problems
        self.folder = folder or UPath()
        self.overridden: list[str] = []  # dotted keys set from the command line
        self.data: dict[Any, Any] = data or {}
        self.settled = False  # whether the data are the config of a study, with every key written

    @classmethod
    def read(cls, path: str | Path | UPath) -> "Document":
        """Read a document from a file; raise ConfigError."""
        try:
            with UPath(path).open(encoding="utf-8") as file:
                text = file.read(MOST_CHARACTERS + 1)
        except (OSError, ValueError, TypeError, ImportError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            reason = "not UTF-8 text" if isinstance(error, UnicodeDecodeError) else reason
            raise ConfigError([Problem(str(path), "", f"cannot be read: {reason}")]) from error
        return cls(text, str(path), UPath(path).parent)

    def place(self, *candidates: Keys) -> str:
        """Return the place of the first candidate that was written, or of a key inside or around it."""
        for keys in candidates:
            if spot(keys) in self.places:
                return self.places[spot(keys)]
        around = spot(candidates[0])
        for known, at in self.places.items():
            if around and known[: len(around)] == around:
                return at
        while around and around not in self.places:
            around = around[:-1]
        return self.places.get(around, f"{self.source}:1:1" if self.source else "")

    def override(self, word: str, written: bool = True) -> None:
        """Set a value from `KEY=VALUE` with the value in YAML; errors are added to `problems`.

        `written` says whether the user wrote the word, so that errors quote it.
        """
        source = f"command line '{word}'" if written else ""
        key, equals, text = word.partition("=")
        keys = split_key(key)
        if not equals or not key or "" in keys:
            self.problems.append(
                Problem(source, key, "an override is KEY=VALUE, KEY a dotted name")
            )
            return
        reader = Reader(source, keys)
        try:
            set_value(self.data, keys, reader.read(text))
        except ConfigError as error:
            self.problems += error.problems
            return
        except LookupError as error:
            self.problems.append(Problem(source, key, str(error.args[0])))
            return
        self.problems += reader.problems
        self.overridden.append(key)
        here = spot(keys)
        kept = {known: at for known, at in self.places.items() if known[: len(here)] != here}
        self.places = kept | {(*here, *inner): source for inner in [(), *reader.places]}


DOTTED = ("sweep", "search.over")  # keys that hold dotted names
INDEX = re.compile(r"[0-9]{1,9}")


def split_key(key: str) -> Keys:
    """Return the keys of a dotted name; digits become ints. The rest after one of DOTTED is a single key."""
    for before in DOTTED:
        if key.startswith(f"{before}."):
            return (*before.split("."), key.removeprefix(f"{before}."))
    return tuple(int(part) if INDEX.fullmatch(part) else part for part in key.split("."))


def spot(keys: Keys) -> Spot:
    """Return a tuple of keys with each key as text."""
    return tuple(map(str, keys))


def dotted_key(keys: Keys) -> str:
    """Return the dotted name of a tuple of keys."""
    return ".".join(map(str, keys))


def set_value(data: Plain, keys: Keys, value: Plain) -> None:
    """Set a value deep in nested mappings and lists, and create missing mappings.

    The bare name of a kind becomes a mapping. Raises LookupError if a parent is neither mapping nor list.
    """
    if len(keys) > MOST_DEPTH:
        raise LookupError(TOO_DEEP)
    for depth, key in enumerate(keys[:-1], start=1):
        inner = data[key] if isinstance(data, list) else data.get(key)
        if isinstance(inner, str):
            inner = {"kind": inner}
        elif inner is None:
            inner = {}
        elif not isinstance(inner, dict | list):
            raise LookupError(f"{dotted_key(keys[:depth])} is not a mapping")
        elif isinstance(inner, list) and keys[depth] not in range(len(inner)):
            raise LookupError(f"{dotted_key(keys[:depth])} has entries 0 to {len(inner) - 1}")
        data[key] = inner = inner.copy()
        data = inner
    data[keys[-1]] = value
