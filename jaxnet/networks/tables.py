"""Networks as text: a list of edges, or a matrix."""

import ast
import csv
import re
from collections.abc import Callable, Sequence
from textwrap import shorten

import numpy as np

from jaxnet.networks import (
    DECIMAL_NUMBER,
    NODE_NUMBER,
    LinkList,
    NamedNetwork,
    parse_number,
    parse_weight,
)
from jaxnet.networks.matrices import matrix_network
from jaxnet.outside.modules import KindError

COMMENTS = ("#", "%")
ATTRIBUTES = re.compile(r"(\S+)\s+(\S+)\s+(\{.*\})\s*")  # a row that networkx wrote
HEADER_WORDS = {
    *("source", "target", "from", "to", "listener", "speaker", "sender", "receiver", "head"),
    *("tail", "i", "j", "u", "v", "s", "t", "src", "dst", "node1", "node2", "weight", "w"),
}
READ = (
    "a row is i, j or i, j, w, numbers or names and a weight > 0; or all are a matrix n × n or"
    " m × (m + 1)"
)
EXPORTS = "also read: networkx's edge list, GraphML (.graphml), arrays (.npy, .mtx)"

TableRow = tuple[int, list[str], str]  # line, fields, text


def read_text_table(content: bytes, name: str, first: int = 0) -> NamedNetwork:
    """Return the network in text of edges or of a matrix; raise KindError.

    Empty rows, rows that begin with # or %, and a header do not count.
    """
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise KindError(f"{name} is not UTF-8 text") from error
    places = [(place, line) for place, line in enumerate(lines, 1) if line.strip()]
    places = [(place, line) for place, line in places if not line.lstrip().startswith(COMMENTS)]
    if not places:
        raise KindError(f"{name} has no edge")
    split = row_splitter(places[0][1])
    rows = [(place, split(line), line) for place, line in places]
    if is_header(rows):
        rows = rows[1:]
    matrix = matrix_of_rows(rows)
    if matrix is not None:
        return matrix_network(matrix, first)
    if not rows:
        raise KindError(f"{name} has no edge")
    return NamedNetwork((), edge_links(rows, name))


def row_splitter(first: str) -> Callable[[str], list[str]]:
    """Split rows by the separator in the first; beside semicolons, a comma is a decimal point."""
    if ATTRIBUTES.fullmatch(first):
        return split_attributes
    for separator in (";", ",", "\t"):
        if separator in first:
            return lambda line: split_fields(line, separator)
    return split_attributes


def split_fields(line: str, separator: str) -> list[str]:
    fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    point = re.compile(r"(?<=[0-9]),(?=[0-9])")
    return [
        point.sub(".", field.strip()) if separator == ";" else field.strip() for field in fields
    ]


def split_attributes(line: str) -> list[str]:
    """Split a row at blanks; the attributes of networkx, {'weight': w}, are its last field."""
    found = ATTRIBUTES.fullmatch(line)
    return list(found.groups()) if found else line.split()


def row_weight(text: str) -> float:
    if not text.startswith("{"):
        return parse_weight(text)
    try:
        attributes = ast.literal_eval(text)
    except (SyntaxError, MemoryError, RecursionError) as error:
        raise ValueError("no attributes") from error
    if not isinstance(attributes, dict) or set(attributes) - {"weight"}:
        raise ValueError("attributes other than weight")
    return parse_weight(str(attributes.get("weight", 1.0)))


def is_header(rows: Sequence[TableRow]) -> bool:
    words = [field.casefold() for field in rows[0][1]]
    known = [word in HEADER_WORDS for word in words]
    return not any(map(DECIMAL_NUMBER.fullmatch, words)) and all(known)


def matrix_of_rows(rows: Sequence[TableRow]) -> np.ndarray | None:
    """Return the rows as a matrix, None if they are a list of edges.

    Three columns are edges unless the third, their weights, has a 0 and the diagonal only zeros.
    """
    width, height = len(rows[0][1]) if rows else 0, len(rows)
    if width - height not in (0, 1) or any(len(fields) != width for _, fields, _ in rows):
        return None
    try:
        numbers = np.array([[parse_number(field) for field in fields] for _, fields, _ in rows])
    except ValueError:
        return None
    laplacian = width == height and (numbers < 0).any()
    without_loops = (
        width == 3 and not numbers[:, 2].all() and not np.diag(numbers, width - height).any()
    )
    return numbers if width > 3 or laplacian or without_loops else None


def edge_links(rows: Sequence[TableRow], name: str) -> LinkList:
    """Return the links in rows of a table; raise KindError with the line that is none."""
    links: LinkList = []
    for place, fields, line in rows:
        try:
            one, other, *weight = fields
            links.append(
                (node_label(one), node_label(other), row_weight(*weight) if weight else 1.0)
            )
        except (TypeError, ValueError) as error:
            got = shorten(line, 60, placeholder=" …")
            raise KindError(f"{name}:{place}: {READ} (got {got}); {EXPORTS}") from error
    refuse_mixed(links, rows, name)
    return links


def node_label(text: str) -> str:
    """Return the label of a node: a name, or a whole number without point; raise ValueError."""
    if not text:
        raise ValueError("no name")
    if not DECIMAL_NUMBER.fullmatch(text):
        return text
    number = float(text)
    if number < 0 or not number.is_integer():
        raise ValueError("a number of a node is whole")
    return str(int(number))


def refuse_mixed(links: LinkList, rows: Sequence[TableRow], name: str) -> None:
    """Raise KindError if some nodes are numbers and some names; 0 may lead named nodes."""
    ends = [
        (end, row)
        for (*both, _), row in zip(links, rows, strict=True)
        for end in both
        if end != "0"
    ]
    for end, (place, _, line) in ends:
        if bool(NODE_NUMBER.fullmatch(end)) != bool(NODE_NUMBER.fullmatch(ends[0][0])):
            got = shorten(line, 60, placeholder=" …")
            told = f"{name}:{place}: nodes are numbers or names, not both:"
            raise KindError(f"{told} {ends[0][0]}, {end} (got {got})")
