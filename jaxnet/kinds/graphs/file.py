"""A weighted digraph from a file."""

import csv
import importlib
from collections.abc import Iterator
from typing import Any, ClassVar

from pydantic import Field
from upath import UPath

from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.graphs.edges import GREATEST, edge_faults, edges_of
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.model import graph
from jaxnet.model.graph import Digraph

Edges = Iterator[tuple[Any, Any, Any]]
AN_EDGE = "i, j or i, j, w: whole numbers, 0 the navigator, and a weight > 0"


class File(Graph):
    """Any weighted digraph from a file: lines i, j or i, j, w of a CSV, or GraphML, which networkx reads.

    Vehicle i hears j, 0 the navigator, with weight w, 1 if there is none; the weights of each listener are
    normalised to sum 1. What the file holds becomes part of the study, so that its results need no file and
    are of one version of it.
    """

    kind = "file"
    linked_by: ClassVar[str] = "topology.path"

    path: str = Field(description="of the file, from the config's folder; GraphML if it ends with .graphml")
    content: dict[str, str] = Field(
        default={}, description="edges i,j,w of the file at a path, as read by jaxnet"
    )

    @classmethod
    def completed(cls, given: dict[str, Any], folder: Any) -> dict[str, Any]:
        """With the file's edges, unless they are there already."""
        path, content = given.get("path"), given.get("content")
        if not isinstance(path, str) or (isinstance(content, dict) and path in content):
            return given
        edges = (",".join(map(str, edge)) for edge in read(UPath(folder) / path, path))
        return given | {"content": {path: " ".join(edges)}}

    def edges(self) -> list[tuple[int, int, float]]:
        """What the file held when the study was loaded; raises KindError if that is not known."""
        if self.path not in self.content:
            raise KindError(f"{self.path} was not read: a study reads it where topology names it")
        rows = (edge.split(",") for edge in self.content[self.path].split())
        return [(int(i), int(j), float(weight)) for i, j, weight in rows]

    def weights(self, vehicles: int) -> Digraph:
        """The edges' weights."""
        return graph.weighted(vehicles, self.edges())

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """As of edges that a config lists; of a file that cannot be read, loading the study has said so."""
        if self.path not in self.content:
            if self.content:
                yield Fault(
                    ("topology.path",), f"{self.path} was not read: sweep topology, each with its path"
                )
            return
        found = list(edge_faults(self.edges(), scenario.vehicles))
        yield from (Fault(("topology.path", "vehicles"), f"{self.path}: {fault.message}") for fault in found)
        if not found:
            yield from super().faults(scenario)


def read(file: UPath, name: str) -> Edges:
    """The edges (i, j, w) that a file holds; raises KindError."""
    try:
        yield from graphml(file, name) if name.endswith(".graphml") else table(file, name)
    except OSError as error:
        raise KindError(f"{name} cannot be read: {error.strerror or error}") from error


def table(file: UPath, name: str) -> Edges:
    """The lines of a CSV, empty ones left out."""
    with file.open(encoding="utf-8", newline="") as lines:
        reader = csv.reader(lines)
        for row in filter(None, reader):
            try:
                yield edge(*row)
            except (TypeError, ValueError) as error:
                got = ",".join(row)
                raise KindError(f"{name}:{reader.line_num}: must be {AN_EDGE} (got {got})") from error


def edge(listener: Any, source: Any, weight: Any = 1.0) -> tuple[int, int, float]:
    """An edge of numbers; raises ValueError."""
    if not 0 < float(weight) <= GREATEST:
        raise ValueError("a weight is positive")
    return int(listener), int(source), float(weight)


def graphml(file: UPath, name: str) -> Edges:
    """The edges of a GraphML file, those of an undirected graph both ways."""
    try:
        networkx = importlib.import_module("networkx")
    except ImportError as error:
        raise KindError(f"{name}: GraphML needs networkx: pip install 'jaxnet-sim[graphs]'") from error
    try:
        with file.open("rb") as stream:
            yield from (edge(*each) for each in edges_of(networkx.read_graphml(stream, node_type=int)))
    except (networkx.NetworkXException, SyntaxError, ValueError) as error:
        raise KindError(f"{name}: must be GraphML with edges {AN_EDGE} ({error})") from error
