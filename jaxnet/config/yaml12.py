"""YAML 1.2 by PyYAML: scalars of the core schema, and limits on size and depth.

PyYAML parses YAML 1.1, where `1e-3` is text and `on` is true.
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
        self.sizes: dict[
            yaml.Node, int
        ] = {}  # number of values of each node with its aliases expanded

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
