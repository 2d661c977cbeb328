"""A weighted digraph from a file."""

import importlib
import io
import re
import warnings
from collections.abc import Callable, Iterator
from textwrap import shorten
from typing import Annotated, ClassVar
from xml.parsers import expat

from pydantic import AfterValidator, Field
from upath import UPath

from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.graphs.edges import GREATEST_EDGE_WEIGHT, edge_faults, edges_of, size_faults
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.kinds.protocols import ScenarioView
from jaxnet.model import graph
from jaxnet.model.graph import Digraph

EdgeIterator = Iterator[tuple[int, int, float]]
LARGEST_FILE = 50_000_000  # bytes
DECIMAL_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?", re.ASCII)
NODE_ID = re.compile(r"n?([0-9]{1,9})", re.ASCII)  # igraph, and the GraphML primer, write n0, n1, …
CALLED = ("name", "label", "id")  # attributes of a node that may give it another number
NOT_GRAPHML = (SyntaxError, ValueError, LookupError, TypeError, AttributeError, UserWarning, expat.ExpatError)
AN_EDGE = "i, j or i, j, w: whole numbers, 0 the navigator, and a weight > 0"
READ = "no header; commas, semicolons or blanks between them"


def parse_edges(content: str) -> list[tuple[int, int, float]]:
    """Return the edges in text of items i,j,w between blanks; raise ValueError."""
    return [parse_edge(*row.split(",")) for row in content.split()]


def check_edges(content: str) -> str:
    """Return a file's content in the form that a study stores; raise ValueError if it holds no edges."""
    try:
        edges = parse_edges(content)
    except (TypeError, ValueError):
        edges = []
    if not edges:
        raise ValueError("must be edges i,j,w between blanks")
    return content


class File(Graph):
    """Any weighted digraph from a file: a table with rows i, j or i, j, w, or GraphML, which networkx reads.

    Vehicle i hears source j with weight w, or 1 if there is no weight; source 0 is the navigator. The weights
    of each listener are normalised to sum 1. The content of the file becomes part of the study, so results
    need no file and belong to one version of it.
    """

    kind = "file"
    linked_by: ClassVar[str] = "topology.path"

    path: str = Field(description="of the file, from the config's folder; GraphML if it ends with .graphml")
    content: dict[str, Annotated[str, AfterValidator(check_edges)]] = Field(
        default={}, description="edges i,j,w of the file at a path, as read by jaxnet"
    )

    @classmethod
    def completed(cls, given: dict[object, object], folder: UPath) -> dict[object, object]:
        """Return the mapping with the file's edges, unless it has them already."""
        path, content = given.get("path"), given.get("content")
        if not isinstance(path, str) or (isinstance(content, dict) and path in content):
            return given
        edges = (",".join(map(str, edge)) for edge in read_edges(UPath(folder) / path, path))
        return given | {"content": {path: " ".join(edges)}}

    def edges(self) -> list[tuple[int, int, float]]:
        """Return the edges of the file at the time when the study was loaded; raise KindError if it was not
        read.
        """
        if self.path not in self.content:
            raise KindError(f"{self.path} was not read: a study reads it where topology names it")
        return parse_edges(self.content[self.path])

    def weights(self, vehicles: int) -> Digraph:
        """Return the weights of the file's edges."""
        return graph.weighted(vehicles, self.edges())

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield the faults of the edges. A file that cannot be read is a fault of loading, reported there."""
        if self.path not in self.content:
            if self.content:
                yield Fault(
                    ("topology.path",), f"{self.path} was not read: sweep topology, each with its path"
                )
            return
        edges = self.edges()
        found = list(edge_faults(edges, scenario.vehicles))
        yield from (Fault(("topology.path", "vehicles"), f"{self.path}: {fault.message}") for fault in found)
        if not found:
            yield from size_faults(edges, scenario.vehicles) or super().faults(scenario)


def read_edges(file: UPath, name: str) -> list[tuple[int, int, float]]:
    """Return the edges (i, j, w) of a file; raise KindError."""
    try:
        with file.open("rb") as stream:
            content = stream.read(LARGEST_FILE + 1)
    except (OSError, ValueError, ImportError) as error:
        reason = getattr(error, "strerror", None) or error
        raise KindError(f"{name} cannot be read: {reason}") from error
    if len(content) > LARGEST_FILE:
        raise KindError(f"{name} has more than {LARGEST_FILE:,} bytes")
    edges = list(read_graphml(content, name) if name.endswith(".graphml") else read_edge_table(content, name))
    if not edges:
        raise KindError(f"{name} has no edge")
    return edges


def read_edge_table(content: bytes, name: str) -> EdgeIterator:
    """Yield the edges in the rows of a table. Empty rows and rows that begin with # do not count."""
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise KindError(f"{name} is not UTF-8 text") from error
    rows = [
        (number, line) for number, line in enumerate(lines, 1) if line.strip() and line.lstrip()[0] != "#"
    ]
    fields = row_splitter(next((line for _, line in rows), ""))
    for place, line in rows:
        try:
            yield parse_edge(*fields(line))
        except (TypeError, ValueError) as error:
            got = shorten(line, 60, placeholder=" …")
            raise KindError(f"{name}:{place}: must be {AN_EDGE}; {READ} (got {got})") from error


def row_splitter(first: str) -> Callable[[str], list[str]]:
    """Return the function that splits a row into fields, by the separator in the first row.

    If the separator is a semicolon, a comma is a decimal point.
    """
    if ";" in first:
        return lambda line: [field.strip(' "').replace(",", ".") for field in line.split(";")]
    if "," in first:
        return lambda line: [field.strip(' "') for field in line.split(",")]
    return str.split


def parse_edge(listener: str, source: str, weight: str = "1") -> tuple[int, int, float]:
    """Return an edge from numbers as text; raise ValueError."""
    given = [parse_number(listener), parse_number(source)]
    if not all(map(float.is_integer, given)) or not 0 < parse_number(weight) <= GREATEST_EDGE_WEIGHT:
        raise ValueError("ends are whole, and a weight is positive")
    return int(given[0]), int(given[1]), parse_number(weight)


def parse_number(text: str) -> float:
    """Return a decimal number; raise ValueError."""
    if not DECIMAL_NUMBER.fullmatch(text.strip()):
        raise ValueError("no number")
    return float(text)


def read_graphml(content: bytes, name: str) -> EdgeIterator:
    """Yield the edges of a GraphML file; an undirected edge counts in both directions."""
    try:
        networkx = importlib.import_module("networkx")
    except ImportError as error:
        raise KindError(f"{name}: GraphML needs networkx: pip install 'jaxnet-sim[graphs]'") from error
    try:
        refuse_unread(content)
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # networkx warns of content that it ignores
            network = networkx.read_graphml(io.BytesIO(content))
        numbers = {node: node_of(node, data) for node, data in network.nodes(data=True)}
        if len({*numbers.values()}) < len(numbers):
            raise ValueError("two nodes have one number")
        weight = network.graph.get("edge_default", {}).get("weight", 1.0)
        yield from edges_of(networkx.relabel_nodes(network, numbers), unread=("id",), weight=weight)
    except KindError as error:
        raise KindError(f"{name}: {error}") from error
    except (networkx.NetworkXException, *NOT_GRAPHML) as error:
        reason = str(error) or type(error).__name__
        raise KindError(f"{name}: must be GraphML with edges {AN_EDGE} ({reason})") from error


def refuse_unread(content: bytes) -> None:
    """Raise ValueError for GraphML with content that no network is read from.

    Entities may stand for gigabytes or other files. networkx reads the first of several graphs, takes a graph
    without `edgedefault` for an undirected one, and reads data named `id` as the id of the edge.
    """
    graphs = 0

    def refuse(*_: object) -> None:
        raise ValueError("entities are not read")

    def begin(element: str, attributes: dict[str, str]) -> None:
        nonlocal graphs
        tag = element.rpartition(":")[2]
        graphs += tag == "graph"
        if graphs > 1:
            raise ValueError("more than one graph")
        if tag == "graph" and "edgedefault" not in attributes:
            raise ValueError("the graph has no edgedefault")
        if tag == "key" and attributes.get("attr.name") == "id":
            raise ValueError("data called 'id' are not read")

    parser = expat.ParserCreate()
    parser.EntityDeclHandler, parser.StartElementHandler = refuse, begin
    parser.Parse(content, True)


def node_of(node: str, data: dict[str, object]) -> int:
    """Return the number of a node with an id such as 3 or n3; raise ValueError."""
    found = NODE_ID.fullmatch(node)
    if not found:
        raise ValueError(f"a node is called 3 or n3, got {node!r}")
    called = next((str(data[key]) for key in CALLED if key in data), node)
    if called not in (node, found[1]):
        raise ValueError(f"node {node!r} is also called {called!r}")
    return int(found[1])
