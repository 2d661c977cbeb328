import functools
from typing import Annotated, ClassVar

from pydantic import AfterValidator
from upath import UPath

from jaxnet.kinds.fields import setting
from jaxnet.kinds.graphs import EdgeGraph
from jaxnet.kinds.kind import Fault, KindError
from jaxnet.networks import Direction, NumberedNetwork, number_nodes, parse_network, write_network
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


class File(EdgeGraph):
    """Any weighted digraph from a file: a list of edges, a matrix, or GraphML.

    A link a, b with weight w, or 1 if there is no weight, means that a hears b. The navigator is
    node 0; with `navigator: none` every node is a vehicle. The weights of each listener are
    normalised to sum 1. The content of the file becomes part of the study, so results need no file
    and belong to one version of it.
    """

    linked_by = "topology.path"
    leads: ClassVar[bool] = True  # whether a node is the navigator

    path: str = setting(
        ..., "of the file, from the config's folder: .graphml, .npy, .mtx (Matrix Market), or text"
    )
    direction: Direction = setting(
        "hears", "what a link a, b means: hears, a hears b; tells, a tells b"
    )
    first: int = setting(0, "number of the first node, where nodes have numbers", ge=0, le=1)
    leader: str | None = setting(
        None, "the navigator's node; null: the first number, or that called 0, navigator or leader"
    )
    names: list[str] = setting([], "of the vehicles, in place of those in the file")
    content: dict[str, Annotated[str, AfterValidator(check_content)]] = setting(
        {}, "links a,b,w of the file at a path, as read by jaxnet"
    )

    @classmethod
    def completed(cls, given, folder):
        keys: dict[object, object] = {**given}
        if type(leader := keys.get("leader")) is int:
            keys["leader"] = str(leader)
        path, content, first = keys.get("path"), keys.get("content"), keys.get("first", 0)
        if isinstance(path, str) and not (isinstance(content, dict) and path in content):
            network = read_network(UPath(folder) / path, path, 1 if first == 1 else 0)
            keys["content"] = {path: write_network(network)}
        return keys

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

    def listed(self):
        return self.network().edges

    def size(self):
        try:
            return super().size()
        except KindError:
            return None

    def vehicle_names(self):
        return self.network().names

    def faults(self, scenario):
        """Faults of the edges. A file that cannot be read is a fault of loading, reported there."""
        if self.path not in self.content:
            if self.content:
                message = f"{self.path} was not read: sweep topology, each with its path"
                yield Fault(("topology.path",), message)
            return
        try:
            messages = [fault.message for fault in self.edge_faults(scenario)]
        except KindError as error:
            yield Fault(("topology.path",), f"{self.path}: {error}")
            return
        found = [Fault(("topology.path", "vehicles"), f"{self.path}: {each}") for each in messages]
        yield from found or super().faults(scenario)


@functools.lru_cache(maxsize=16)  # the cells of a sweep have one file
def numbered_content(
    content: str,
    direction: Direction,
    first: int,
    leader: str | None,
    names: tuple[str, ...],
    leads: bool,
) -> NumberedNetwork:
    return number_nodes(parse_network(content), direction, first, leader, names, leads)
