"""Networks as text: a list of edges, or a matrix."""

import ast
import csv
import re
from collections.abc import Sequence
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
from jaxnet.networks.objects import matrix_network
from jaxnet.outside.modules import KindError

COMMENTS = ("#", "%")
ATTRIBUTES = re.compile(r"(\S+)\s+(\S+)\s+(\{.*\})\s*")  # a row that networkx wrote
HEADER_WORDS = {
    *("source", "target", "from", "to", "listener", "speaker", "sender", "receiver", "head"),
    *("tail", "i", "j", "u", "v", "s", "t", "src", "dst", "node1", "node2", "weight", "w"),
}
COMMA = re.compile(r"(?<=[0-9]),(?=[0-9])")
READ = (
    "a row is i, j or i, j, w, numbers or names and a weight > 0; or all are a matrix n × n or"
    " m × (m + 1)"
)
EXPORTS = "also read: networkx's edge list, GraphML (.graphml), arrays (.npy, .mtx)"

TableRow = tuple[int, list[str], str]  # line, fields, text


def read_text_table(content: bytes, name: str, first: int = 0) -> NamedNetwork:
    """Return the network in text of edges or of a matrix; raise KindError.

    Empty rows, rows that begin with # or %, and a header do not count. The first row tells by what
    rows are separated.
    """
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise KindError(f"{name} is not UTF-8 text") from error
    places = [(place, line) for place, line in enumerate(lines, 1) if line.strip()]
    places = [(place, line) for place, line in places if not line.lstrip().startswith(COMMENTS)]
    top = places[0][1] if places else ""
    marks = "" if ATTRIBUTES.fullmatch(top) else ";,\t"
    separator = next((mark for mark in marks if mark in top), "")
    rows = [(place, split_row(line, separator), line) for place, line in places]
    if rows and all(field.casefold() in HEADER_WORDS for field in rows[0][1]):
        rows = rows[1:]
    if not rows:
        raise KindError(f"{name} has no edge")
    matrix = matrix_of_rows(rows)
    if matrix is not None:
        return matrix_network(matrix, first)
    return NamedNetwork((), edge_links(rows, name))


def split_row(line: str, separator: str) -> list[str]:
    """Split a row; the attributes of networkx, {'weight': w}, are its last field.

    Beside semicolons, a comma is a decimal point.
    """
    if not separator:
        found = ATTRIBUTES.fullmatch(line)
        return list(found.groups()) if found else line.split()
    fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    fields = [field.strip() for field in fields]
    return [COMMA.sub(".", field) for field in fields] if separator == ";" else fields


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


def matrix_of_rows(rows: Sequence[TableRow]) -> np.ndarray | None:
    """Return the rows as a matrix, None if they are a list of edges.

    Three columns are edges unless the third, their weights, has a 0 and the diagonal only zeros.
    """
    width, height = len(rows[0][1]), len(rows)
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
    """Return the links in rows; raise KindError with the line of a row that is none.

    Nodes are numbers or names, not both; 0 may lead named nodes.
    """
    links: LinkList = []
    node = ""  # the first but 0
    for place, fields, line in rows:
        got = f"(got {shorten(line, 60, placeholder=' …')})"
        try:
            one, other, *weight = fields
            ends = node_label(one), node_label(other)
            links.append((*ends, row_weight(*weight) if weight else 1.0))
        except (TypeError, ValueError) as error:
            raise KindError(f"{name}:{place}: {READ} {got}; {EXPORTS}") from error
        for end in ends:
            node = node or ("" if end == "0" else end)
            if end != "0" and bool(NODE_NUMBER.fullmatch(end)) != bool(NODE_NUMBER.fullmatch(node)):
                told = f"nodes are numbers or names, not both: {node}, {end}"
                raise KindError(f"{name}:{place}: {told} {got}")
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
