"""YAML 1.2 text as plain data with the place of every key. A repeated key is an error.

libyaml parses, through PyYAML: 100,000 values take a second of a CPU, in ruamel.yaml three to five,
and both need the scalars of YAML 1.2's core schema from here (`1_000` and a date are text).
"""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import yaml
from upath import UPath

Keys = tuple[Any, ...]  # place of a value: keys and list indices from the top
Plain = Any  # null, bool, int, float, text, or a list or mapping of plain data
PlainMapping = Mapping[Any, Any]
Spot = tuple[str, ...]  # keys as text, because pydantic reports a key 1.5 as text

MOST_CHARACTERS = 50_000_000  # characters of a text
MOST_DEPTH = 32  # mappings and lists inside each other
MOST_REPEATED = 100_000  # values that aliases repeat
LONGEST_INT = 300  # digits; a longer one is a float that is not finite
LONGEST_PART = 2000  # characters of each part of a problem's line
TOO_DEEP = f"more than {MOST_DEPTH} mappings and lists inside each other"
TOO_MANY = f"aliases repeat more than {MOST_REPEATED:,} values"

# also of direction
CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
NO_CHARACTERS = re.compile("[\x00\ud800-\udfff]")  # in no file name and in no UTF-8 text

FLOAT = r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
SCALARS = {
    "null": re.compile(r"~|null|Null|NULL|"),
    "bool": re.compile(r"true|True|TRUE|false|False|FALSE"),
    "int": re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+"),
    "float": re.compile(FLOAT),
}
FIRST_CHARACTERS = {"null": ["~", "n", "N", ""], "bool": list("tTfF"), "int": list("-+0123456789")}
FIRST_CHARACTERS["float"] = [*FIRST_CHARACTERS["int"], "."]
TAG = "tag:yaml.org,2002:"


Parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # PyYAML may lack libyaml


class Yaml12Loader(Parser):
    """The parser, with the scalars of YAML 1.2."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 (PyYAML's own protocol)


for kind, pattern in SCALARS.items():
    whole = re.compile(f"^(?:{pattern.pattern})$")
    Yaml12Loader.add_implicit_resolver(TAG + kind, whole, FIRST_CHARACTERS[kind])


class Yaml12Dumper(yaml.SafeDumper):
    """PyYAML's writer that quotes text which YAML 1.2 would read as another type."""

    yaml_implicit_resolvers = Yaml12Loader.yaml_implicit_resolvers


def escape_controls(text: str, but: str = "") -> str:
    return CONTROLS.sub(
        lambda found: found[0] if found[0] in but else found[0].encode("unicode_escape").decode(),
        text,
    )


class Problem(NamedTuple):
    """An error and its place: FILE:LINE:COL, a command line's word, or "" for a script's value."""

    place: str
    key: str
    message: str

    def __str__(self) -> str:
        parts = (part for part in self if part)
        cut = (part if len(part) <= LONGEST_PART else part[:LONGEST_PART] + "…" for part in parts)
        return escape_controls(": ".join(cut))


class ConfigError(ValueError):
    """A config that cannot be run, with all its problems.

    Parameters
    ----------
    problems
        What is wrong: place, key and message of each.

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


@runtime_checkable
class Mark(Protocol):
    """A place in a text, of the parser in C or in Python; counted from 0."""

    line: int
    column: int


class Reader:
    """Converts one YAML text to plain data, and fills `places` and `problems`.

    A text from the command line has no lines; `within` is the key whose value the text is.
    """

    def __init__(self, source: str, within: Keys = ()):
        self.source, self.within = source, within
        self.places: dict[Spot, str] = {}
        self.problems: list[Problem] = []
        self.built: set[yaml.Node] = set()
        self.repeated = 0

    def read(self, text: str) -> Plain:
        """Return the value of the text, None if it is empty; raise ConfigError."""
        if len(text) > MOST_CHARACTERS:
            raise self.error(None, (), f"more than {MOST_CHARACTERS:,} characters")
        try:
            self.refuse_depth(text)  # before libyaml's composer, which would overflow its stack
            node = yaml.compose(text, Yaml12Loader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            raise self.error(mark, (), f"not YAML: {reason_of(error, text)}") from error
        except yaml.reader.ReaderError as error:
            before = text[: error.position]
            line, column = before.count("\n"), len(before) - before.rfind("\n") - 1
            mark = yaml.Mark(self.source, 0, line, column, "", 0)
            told = f"not YAML: the character {chr(int(error.character))!r} is not allowed"
            raise self.error(mark, (), told) from error
        return None if node is None else self.build(node, (), ())

    def refuse_depth(self, text: str) -> None:
        depth = 0
        for event in yaml.parse(text, Yaml12Loader):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > MOST_DEPTH:
                raise self.error(event.start_mark, (), TOO_DEEP)

    def build(self, node: yaml.Node, keys: Keys, above: tuple[yaml.Node, ...]) -> Plain:
        """Return a node's plain data and record places; `above` are the nodes around it."""
        mark = node.start_mark
        self.places.setdefault(spot(keys), self.at(mark))
        if node in above:
            raise self.error(mark, keys, "an alias inside its own anchor")
        self.repeated += node in self.built
        self.built.add(node)
        if self.repeated > MOST_REPEATED:
            raise self.error(mark, (), TOO_MANY)
        if isinstance(node, yaml.ScalarNode):
            return self.scalar(node, keys)
        if len(self.within) + len(keys) >= MOST_DEPTH:
            raise self.error(mark, keys, TOO_DEEP)
        if isinstance(node, yaml.SequenceNode) and node.tag == f"{TAG}seq":
            inner = enumerate(node.value)
            return [self.build(item, (*keys, n), (*above, node)) for n, item in inner]
        if isinstance(node, yaml.MappingNode) and node.tag == f"{TAG}map":
            return dict(self.items(node, keys, (*above, node)))
        raise self.error(mark, keys, f"the tag {node.tag} has no meaning here")

    def items(
        self, node: yaml.MappingNode, keys: Keys, above: tuple[yaml.Node, ...]
    ) -> Iterator[tuple[Plain, Plain]]:
        seen = set()
        for key_node, value_node in node.value:
            mark = key_node.start_mark
            if not isinstance(key_node, yaml.ScalarNode):
                raise self.error(mark, keys, "a key must be text or a number")
            key = self.scalar(key_node, keys)
            if key in seen:
                self.problems += self.error(mark, (*keys, key), "given twice").problems
                continue
            seen.add(key)
            self.places[spot((*keys, key))] = self.at(mark)
            yield key, self.build(value_node, (*keys, key), above)

    def scalar(self, node: yaml.ScalarNode, keys: Keys) -> Plain:
        kind, text = node.tag.removeprefix(TAG), node.value
        if found := NO_CHARACTERS.search(text):
            told = f"the character {found[0]!r} is not allowed"
            raise self.error(node.start_mark, keys, told)
        if kind == "str":
            return text
        if kind in SCALARS and SCALARS[kind].fullmatch(text):
            return parse_scalar(kind, text)
        raise self.error(node.start_mark, keys, f"the tag {node.tag} has no meaning here")

    def at(self, mark: Mark | None) -> str:
        """Name a place, FILE:LINE:COL; lines and columns count from 1."""
        if not self.source or self.within:
            return self.source
        return f"{self.source}:{mark.line + 1}:{mark.column + 1}" if mark else f"{self.source}:1:1"

    def error(self, mark: Mark | None, keys: Keys, message: str) -> ConfigError:
        key = dotted_key((*self.within, *keys))
        return ConfigError([Problem(self.at(mark), key, message)])


def reason_of(error: yaml.MarkedYAMLError, text: str) -> str:
    mark, reason = error.problem_mark, str(error.problem or "not understood")
    lines = text.split("\n")
    here = lines[mark.line][mark.column :] if mark and mark.line < len(lines) else ""
    if here.startswith("\t"):
        return "a tab here; blanks indent and separate"
    return f"{reason} (got {here.split()[0]})" if here.strip() else reason


def parse_scalar(kind: str, text: str) -> bool | int | float | None:
    """Return the value of a scalar whose text fits the pattern of its type."""
    if kind == "null":
        return None
    if kind == "bool":
        return text.lower() == "true"
    base = {"0o": 8, "0x": 16}.get(text[:2], 10)
    if kind == "float" or (base == 10 and len(text) > LONGEST_INT):
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return math.inf if len(text) > LONGEST_INT else int(text, base)


class Document:
    """A config as it was written: `data`, the place of each key, and the problems so far.

    Paths in the config are relative to `folder`.
    """

    def __init__(self, text: str, source: str, folder: UPath | None = None):
        reader = Reader(source)
        data = reader.read(text)
        if not isinstance(data, dict | None):
            told = "a config is a mapping of keys to values"
            raise ConfigError([Problem(reader.places[()], "", told)])
        self.source, self.places, self.problems = source, reader.places, reader.problems
        self.folder = folder or UPath()
        self.overridden: list[str] = []  # dotted keys that replace what was written
        self.data: dict[Any, Any] = data or {}
        self.settled = False  # whether the data are the config of a study, with every key written

    @classmethod
    def of(cls, data: dict[Any, Any], settled: bool = False) -> "Document":
        """Make a document of a script's plain data, which has no places."""
        made = cls("", "")
        made.data, made.settled = data, settled
        return made

    @classmethod
    def read(cls, path: str | Path | UPath) -> "Document":
        try:
            with UPath(path).open(encoding="utf-8") as file:
                text = file.read(MOST_CHARACTERS + 1)
        except (OSError, ValueError, TypeError, ImportError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            reason = "not UTF-8 text" if isinstance(error, UnicodeDecodeError) else reason
            raise ConfigError([Problem(str(path), "", f"cannot be read: {reason}")]) from error
        return cls(text, str(path), UPath(path).parent)

    def place(self, *candidates: Keys) -> str:
        """Return the place of the first candidate that was written, or of a key in or around it."""
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

    def override(self, override: "Override") -> None:
        """Set a value; what is wrong with it is added to `problems`."""
        self.problems += override.problems
        if override.problems and not override.places:
            return
        try:
            set_value(self.data, override.keys, override.value)
        except LookupError as error:
            told = Problem(override.source, override.key, str(error.args[0]))
            self.problems.append(told)
            return
        self.overridden.append(override.key)
        here = spot(override.keys)
        kept = {known: at for known, at in self.places.items() if known[: len(here)] != here}
        self.places = kept | {(*here, *inner): override.source for inner in override.places}


class Override(NamedTuple):
    """A value for a dotted key: that of a command line's word, or a script's."""

    key: str
    value: Plain
    source: str = ""
    places: tuple[Spot, ...] = ((),)  # keys inside the value; none if there is no value
    problems: tuple[Problem, ...] = ()

    @property
    def keys(self) -> Keys:
        return split_key(self.key)


def read_override(word: str) -> Override:
    """Read `KEY=VALUE` with the value in YAML."""
    source = f"command line '{word}'"
    key, equals, text = word.partition("=")
    if not equals or "" in split_key(key):
        told = "an override is KEY=VALUE, KEY a dotted name"
        return Override(key, None, source, (), (Problem(source, key, told),))
    reader = Reader(source, split_key(key))
    try:
        value = reader.read(text)
    except ConfigError as error:
        return Override(key, None, source, (), tuple(error.problems))
    return Override(key, value, source, ((), *reader.places), tuple(reader.problems))


DOTTED = ("sweep", "search.over")  # keys that hold dotted names
INDEX = re.compile(r"[0-9]{1,9}")


def split_key(key: str) -> Keys:
    """Return the keys of a dotted name; digits become ints. What follows DOTTED is one key."""
    for before in DOTTED:
        if key.startswith(f"{before}."):
            return (*before.split("."), key.removeprefix(f"{before}."))
    return tuple(int(part) if INDEX.fullmatch(part) else part for part in key.split("."))


def spot(keys: Keys) -> Spot:
    return tuple(map(str, keys))


def dotted_key(keys: Keys) -> str:
    return ".".join(map(str, keys))


def set_value(data: Plain, keys: Keys, value: Plain) -> None:
    """Set a value deep in nested mappings and lists, and create missing mappings.

    The bare name of a kind becomes a mapping. Raises LookupError if a parent is neither.
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
