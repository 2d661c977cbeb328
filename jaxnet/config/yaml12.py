"""YAML 1.2 by PyYAML: scalars of the core schema, tabs between tokens, and limits on size and depth.

PyYAML parses YAML 1.1, where `1e-3` is text, `on` is true, and a tab separates nothing.
"""

import math
import re
from typing import Any

import yaml

MOST_CHARACTERS = 50_000_000  # characters of a text
MOST_DEPTH = 32  # mappings and lists inside each other
MOST_REPEATED = 100_000  # values that aliases repeat
LONGEST_INT = 300  # digits; a longer one is a float that is not finite

TOO_DEEP = f"more than {MOST_DEPTH} mappings and lists inside each other"
TOO_MANY = f"aliases repeat more than {MOST_REPEATED:,} values"

FLOAT = r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
SCALARS = {
    "null": re.compile(r"~|null|Null|NULL|"),
    "bool": re.compile(r"true|True|TRUE|false|False|FALSE"),
    "int": re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+"),
    "float": re.compile(FLOAT),
}
FIRST_CHARACTERS = {"null": ["~", "n", "N", ""], "bool": list("tTfF"), "int": list("-+0123456789")}
FIRST_CHARACTERS["float"] = [*FIRST_CHARACTERS["int"], "."]

LINE_BREAKS = "\r\n\x85\u2028\u2029"
LINE_ENDS = "\0" + LINE_BREAKS  # characters that end a line


class ExcessError(ValueError):
    """A text beyond the limits of size or depth, with the line and column."""

    def __init__(self, excess: str, mark: yaml.Mark):
        super().__init__(excess)
        self.excess, self.place = excess, (mark.line, mark.column)


class Yaml12Loader(yaml.SafeLoader):
    """PyYAML's parser with the rules of YAML 1.2. A text beyond the limits raises ExcessError."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 (PyYAML's own protocol)

    def __init__(self, text: str):
        super().__init__(text)
        self.depth = 0
        self.sizes: dict[yaml.Node, int] = {}  # number of values of each node with its aliases expanded

    def compose_node(self, parent: yaml.Node | None, index: int | yaml.Node | None) -> yaml.Node:
        """Return the node of the next events; raise ExcessError beyond the limits."""
        self.depth += 1
        mark, alias = self.peek_event().start_mark, self.check_event(yaml.AliasEvent)
        if self.depth > MOST_DEPTH and self.check_event(yaml.CollectionStartEvent):
            raise ExcessError(TOO_DEEP, mark)
        node: Any = super().compose_node(parent, index)  # pyright: ignore[reportArgumentType]
        self.depth -= 1
        if not alias:
            self.sizes[node] = 1 + sum(self.sizes.get(inner, 0) for inner in child_nodes(node))
        if self.sizes.get(node, 0) - len(self.sizes) > MOST_REPEATED:
            raise ExcessError(TOO_MANY, mark)
        return node

    def scan_to_next_token(self) -> None:
        """Skip blanks, comments, line breaks, and tabs that do not indent.

        No block mapping or list begins after a tab on its line.
        """
        if self.index == 0 and self.peek() == "\ufeff":
            self.forward()
        while True:
            first = self.column == 0
            self.skip(" ")
            if self.peek() == "\t" and self.separates(first):
                self.skip(" \t")
                self.allow_simple_key = self.allow_simple_key and bool(self.flow_level)
            if self.peek() == "#":
                while self.peek() not in LINE_ENDS:
                    self.forward()
            if not self.scan_line_break():
                return
            self.allow_simple_key = self.allow_simple_key or not self.flow_level

    def separates(self, first: bool) -> bool:
        """Return whether a tab comes after a token, inside brackets, or before the end of an empty line."""
        length = 1
        while self.peek(length) in " \t":
            length += 1
        return bool(self.flow_level) or not first or self.peek(length) in LINE_ENDS + "#"

    def skip(self, characters: str) -> None:
        """Skip characters while they belong to a set."""
        while self.peek() in characters:
            self.forward()

    def scan_plain_spaces(self, indent: int, start_mark: yaml.Mark) -> list[str] | None:
        """Return the white space inside or after plain text; a line break and the blanks around it are one
        space.
        """
        length = 0
        while self.peek(length) in " \t":
            length += 1
        white = self.prefix(length)
        self.forward(length)
        if self.peek() not in LINE_BREAKS:
            return [white] if white else []
        first, breaks = self.scan_line_break(), []
        self.allow_simple_key = True
        while not self.ends_document():
            self.skip(" \t" if self.flow_level else " ")
            if self.peek() not in LINE_BREAKS:
                return [*([] if first == "\n" else [first]), *(breaks or [" "] * (first == "\n"))]
            breaks.append(self.scan_line_break())
        return None

    def ends_document(self) -> bool:
        """Return whether the line begins with a document's marker."""
        return self.prefix(3) in ("---", "...") and self.peek(3) in LINE_ENDS + " \t"

    def scan_block_scalar_ignored_line(self, start_mark: yaml.Mark) -> None:
        """Skip the rest of the line on which a block scalar begins."""
        self.skip(" \t")
        super().scan_block_scalar_ignored_line(start_mark)


for kind, pattern in SCALARS.items():
    whole = re.compile(f"^(?:{pattern.pattern})$")
    Yaml12Loader.add_implicit_resolver(f"tag:yaml.org,2002:{kind}", whole, FIRST_CHARACTERS[kind])


class Yaml12Dumper(yaml.SafeDumper):
    """PyYAML's writer that quotes text which YAML 1.2 would read as another type."""

    yaml_implicit_resolvers = Yaml12Loader.yaml_implicit_resolvers


def child_nodes(node: yaml.Node) -> list[yaml.Node]:
    """Return the nodes directly inside a mapping or list."""
    if isinstance(node, yaml.MappingNode):
        return [each for pair in node.value for each in pair]
    return node.value if isinstance(node, yaml.SequenceNode) else []


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
