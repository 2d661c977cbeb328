"""YAML 1.2 text as plain data with the place of every key. A repeated key is an error.

libyaml parses, through PyYAML: 100,000 values take a second of a CPU, in ruamel.yaml three to five,
and both need the scalars of YAML 1.2's core schema from here (`1_000` and a date are text).
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

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
TAG = "tag:yaml.org,2002:"
COLLECTIONS = {yaml.SequenceStartEvent: "seq", yaml.MappingStartEvent: "map"}


class Yaml12Dumper(yaml.SafeDumper):
    """PyYAML's writer that quotes text which YAML 1.2 would read as another type."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 (PyYAML's own protocol)


for kind, pattern in SCALARS.items():
    whole = re.compile(f"^(?:{pattern.pattern})$")
    Yaml12Dumper.add_implicit_resolver(TAG + kind, whole, [None])


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


class Reader:
    """Converts one YAML text to plain data, and fills `places` and `problems`.

    A text from the command line has no lines; `within` is the key whose value the text is.
    """

    def __init__(self, source: str, within: Keys = ()):
        self.source, self.within = source, within
        self.places: dict[Spot, str] = {}
        self.problems: list[Problem] = []
        self.events: Iterator[Any] = iter(())  # of PyYAML
        self.mark: Any = None  # of the last event
        self.anchors: dict[str, tuple[Plain, int]] = {}  # values, and how many are in each
        self.count = self.repeated = 0  # values so far, and those that aliases repeat

    def read(self, text: str) -> Plain:
        """Return the value of the text, None if it is empty; raise ConfigError."""
        if len(text) > MOST_CHARACTERS:
            raise self.error((), f"more than {MOST_CHARACTERS:,} characters")
        self.events = yaml.parse(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        try:
            if isinstance([self.next(), self.next()][1], yaml.StreamEndEvent):
                return None
            data = self.value(self.next(), ())
            last = [self.next(), self.next()][1]
        except yaml.MarkedYAMLError as error:
            self.mark = error.problem_mark or error.context_mark
            raise self.error((), f"not YAML: {reason_of(error, text)}") from error
        except yaml.reader.ReaderError as error:
            before = text[: error.position]
            line, column = before.count("\n"), len(before) - before.rfind("\n") - 1
            self.mark = yaml.Mark(self.source, 0, line, column, "", 0)
            told = f"not YAML: the character {chr(int(error.character))!r} is not allowed"
            raise self.error((), told) from error
        if isinstance(last, yaml.DocumentStartEvent):
            raise self.error((), "not YAML: another document begins here")
        return data

    def next(self) -> Any:
        event = next(self.events)
        self.mark = event.start_mark
        return event

    def value(self, event: Any, keys: Keys) -> Plain:
        """Return the plain data that begins with an event, and record places."""
        self.places.setdefault(spot(keys), self.at())
        if isinstance(event, yaml.AliasEvent):
            return self.repeat(event.anchor, keys)
        if event.anchor:
            self.anchors[event.anchor] = None, 0
        before = self.count
        self.count += 1
        if isinstance(event, yaml.ScalarEvent):
            data = self.scalar(event, keys)
        elif event.tag not in (None, "!", TAG + COLLECTIONS[type(event)]):
            raise self.error(keys, f"the tag {event.tag} has no meaning here")
        elif len(self.within) + len(keys) >= MOST_DEPTH:
            raise self.error((), TOO_DEEP)
        elif isinstance(event, yaml.SequenceStartEvent):
            data = [self.value(each, (*keys, n)) for n, each in enumerate(self.inside())]
        else:
            data = dict(self.items(keys))
        if event.anchor:
            self.anchors[event.anchor] = data, self.count - before
        return data

    def inside(self) -> Iterator[Any]:
        """Yield the events with which the values of a collection begin."""
        while not isinstance(event := self.next(), yaml.CollectionEndEvent):
            yield event

    def items(self, keys: Keys) -> Iterator[tuple[Plain, Plain]]:
        seen = set()
        for event in self.inside():
            if not isinstance(event, yaml.ScalarEvent):
                raise self.error(keys, "a key must be text or a number")
            key = self.scalar(event, keys)
            if key in seen:
                self.problems += self.error((*keys, key), "given twice").problems
            seen.add(key)
            self.places.setdefault(spot((*keys, key)), self.at())
            yield key, self.value(self.next(), (*keys, key))

    def repeat(self, anchor: str, keys: Keys) -> Plain:
        if anchor not in self.anchors:
            raise self.error((), f"not YAML: found undefined alias (got *{anchor})")
        data, size = self.anchors[anchor]
        if not size:
            raise self.error(keys, "an alias inside its own anchor")
        self.count += size
        self.repeated += size
        if self.repeated > MOST_REPEATED:
            raise self.error((), f"aliases repeat more than {MOST_REPEATED:,} values")
        if len(self.within) + len(keys) + depth_of(data) > MOST_DEPTH:
            raise self.error((), TOO_DEEP)
        return data

    def scalar(self, event: yaml.ScalarEvent, keys: Keys) -> Plain:
        text = event.value
        if found := NO_CHARACTERS.search(text):
            raise self.error(keys, f"the character {found[0]!r} is not allowed")
        fits = [kind for kind, pattern in SCALARS.items() if pattern.fullmatch(text)]
        if event.tag is None:
            kind = fits[0] if fits and event.implicit[0] else "str"
        else:
            kind = event.tag.removeprefix(TAG)
        if kind != "str" and kind not in fits:
            raise self.error(keys, f"the tag {event.tag} has no meaning here")
        return parse_scalar(kind, text)

    def at(self) -> str:
        """Name the place of the last event, FILE:LINE:COL; lines and columns count from 1."""
        if not self.source or self.within:
            return self.source
        line, column = (self.mark.line, self.mark.column) if self.mark else (0, 0)
        return f"{self.source}:{line + 1}:{column + 1}"

    def error(self, keys: Keys, message: str) -> ConfigError:
        return ConfigError([Problem(self.at(), dotted_key((*self.within, *keys)), message)])


def depth_of(data: Plain) -> int:
    inside = data.values() if isinstance(data, dict) else data if isinstance(data, list) else None
    return 0 if inside is None else 1 + max(map(depth_of, inside), default=0)


def reason_of(error: yaml.MarkedYAMLError, text: str) -> str:
    mark, reason = error.problem_mark, str(error.problem or "not understood")
    lines = text.split("\n")
    here = lines[mark.line][mark.column :] if mark and mark.line < len(lines) else ""
    if here.startswith("\t"):
        return "a tab here; blanks indent and separate"
    return f"{reason} (got {here.split()[0]})" if here.strip() else reason


def parse_scalar(kind: str, text: str) -> str | bool | int | float | None:
    """Return the value of a scalar whose text fits the pattern of its type."""
    if kind in ("null", "str", "bool"):
        return {"null": None, "str": text, "bool": text.lower() == "true"}[kind]
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
    def of(cls, data: Mapping[Any, Any], settled: bool = False) -> "Document":
        """Make a document of a script's plain data, which has no places."""
        made = cls("", "")
        made.data, made.settled = dict(data), settled
        return made

    @classmethod
    def read(cls, path: str | Path | UPath) -> "Document":
        try:
            with UPath(path).open(encoding="utf-8") as file:
                text = file.read(MOST_CHARACTERS + 1)
        except (OSError, ValueError, TypeError, ImportError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            reason = "not UTF-8 text" if isinstance(error, UnicodeDecodeError) else reason
            is_folder = isinstance(error, IsADirectoryError)
            reason += f"; of results, give {path}/study.yaml" * is_folder
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

    def override(
        self, key: str, value: Plain, source: str = "", inside: Iterable[Spot] = ()
    ) -> None:
        """Set a value by its dotted key; `inside` are the keys in it. A fault is a problem."""
        keys = split_key(key)
        try:
            set_value(self.data, keys, value)
        except LookupError as error:
            self.problems.append(Problem(source, key, str(error.args[0])))
            return
        self.overridden.append(key)
        here = spot(keys)
        kept = {known: at for known, at in self.places.items() if known[: len(here)] != here}
        self.places = kept | {(*here, *inner): source for inner in ((), *inside)}

    def override_by(self, word: str) -> None:
        """Set the value of `KEY=VALUE`, which is YAML."""
        source = f"command line '{word}'"
        key, equals, text = word.partition("=")
        if not equals or "" in split_key(key):
            told = "an override is KEY=VALUE, KEY a dotted name"
            told += f": {key} has no value" * (bool(key) and not equals)
            self.problems.append(Problem(source, key, told))
            return
        reader = Reader(source, split_key(key))
        try:
            self.override(key, reader.read(text), source, reader.places)
        except ConfigError as error:
            self.problems += error.problems
        self.problems += reader.problems


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
