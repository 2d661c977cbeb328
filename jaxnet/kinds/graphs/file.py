"""A weighted digraph from a file."""

import functools
from typing import Annotated, ClassVar

from pydantic import AfterValidator, Field
from upath import UPath

from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.graphs.edges import NORMALISED, as_given, edge_faults, last_vehicle, size_faults
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.model import graph
from jaxnet.networks import (
    Direction,
    EdgeList,
    NumberedNetwork,
    number_nodes,
    parse_network,
    write_network,
)
from jaxnet.networks.files import read_network


def check_content(content: str) -> str:
    """A file's content in the form that a study stores; raise ValueError if it holds no edges."""
    try:
        links = parse_network(content).links
    except (TypeError, ValueError):
        links = []
    if not links:
        raise ValueError("must be edges i,j,w between blanks")
    return content


class File(Graph):
    """Any weighted digraph from a file: a list of edges, a matrix, or GraphML.

    A link a, b with weight w, or 1 if there is no weight, means that a hears b. The navigator is
    node 0; with `navigator: none` every node is a vehicle. The weights of each listener are
    normalised to sum 1. The content of the file becomes part of the study, so results need no file
    and belong to one version of it.
    """

    kind = "file"
    linked_by = "topology.path"
    leads: ClassVar[bool] = True  # whether a node is the navigator

    path: str = Field(
        description="of the file, from the config's folder; .graphml, .npy and .mtx (Matrix "
        "Market), other files are text"
    )
    direction: Direction = Field(
        default="hears", description="hears, a link a, b means a hears b; or tells"
    )
    first: int = Field(
        default=0, ge=0, le=1, description="number of the first node, where nodes have numbers"
    )
    leader: str | None = Field(
        default=None,
        description="name or number of the navigator's node, or null: the first number, or the "
        "node called 0, navigator or leader",
    )
    names: list[str] = Field(
        default=[], description="of the vehicles, in place of those in the file"
    )
    normalised: bool = Field(default=True, description=NORMALISED)
    content: dict[str, Annotated[str, AfterValidator(check_content)]] = Field(
        default={}, description="links a,b,w of the file at a path, as read by jaxnet"
    )

    @classmethod
    def completed(cls, given, folder):
        given = {
            key: str(value) if key == "leader" and type(value) is int else value
            for key, value in given.items()
        }
        path, content, first = given.get("path"), given.get("content"), given.get("first", 0)
        if not isinstance(path, str) or (isinstance(content, dict) and path in content):
            return given
        network = read_network(UPath(folder) / path, path, 1 if first == 1 else 0)
        return given | {"content": {path: write_network(network)}}

    def network(self) -> NumberedNetwork:
        """The edges and names of the file at the time when the study was loaded.

        Raises KindError if the file was not read, or if its nodes cannot be numbered.
        """
        if self.path not in self.content:
            raise KindError(f"{self.path} was not read: a study reads it where topology names it")
        options = self.direction, self.first, self.leader, tuple(self.names), self.leads
        return numbered_content(self.content[self.path], *options)

    def leaderless(self):
        return self.with_values(leads=False)

    def edges(self) -> EdgeList:
        return self.network().edges

    def weights(self, vehicles):
        return graph.weighted(vehicles, [edge for edge in self.edges() if edge[0] != edge[1]])

    def normalises(self):
        return self.normalised

    def rows_with_loops(self, vehicles):
        return as_given(vehicles, self.edges())

    def size(self):
        try:
            return last_vehicle(self.edges())
        except KindError:
            return None

    def vehicle_names(self):
        return self.network().names

    def faults(self, scenario):
        """Faults of the edges. A file that cannot be read is a fault of loading, reported there."""
        if self.path not in self.content:
            if self.content:
                yield Fault(
                    ("topology.path",),
                    f"{self.path} was not read: sweep topology, each with its path",
                )
            return
        try:
            edges = self.edges()
        except KindError as error:
            yield Fault(("topology.path",), f"{self.path}: {error}")
            return
        found = list(edge_faults(edges, scenario))
        yield from (
            Fault(("topology.path", "vehicles"), f"{self.path}: {fault.message}") for fault in found
        )
        if not found:
            yield from size_faults(edges, scenario.vehicles) or super().faults(scenario)


@functools.lru_cache(maxsize=16)
def numbered_content(
    content: str,
    direction: Direction,
    first: int,
    leader: str | None,
    names: tuple[str, ...],
    leads: bool,
) -> NumberedNetwork:
    """The edges and names of a stored network. The cache serves the cells of a sweep."""
    return number_nodes(parse_network(content), direction, first, leader, names, leads)
