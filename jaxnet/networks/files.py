"""Networks from files: text, .npy, .mtx and .graphml, told apart by the ending."""

import importlib
import io
import warnings
from xml.parsers import expat

import numpy as np
from scipy.io import mmread
from upath import UPath

from jaxnet.lazy import sparse
from jaxnet.networks import NODE_NUMBER, NamedNetwork
from jaxnet.networks.objects import matrix_network, networkx_network
from jaxnet.networks.text import read_text_table
from jaxnet.outside.modules import KindError

LARGEST_FILE = 50_000_000  # bytes
CALLED = ("name", "label", "id")  # attributes of a GraphML node that may name it
FAULTS = (
    SyntaxError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    UserWarning,
    expat.ExpatError,
)


def read_network(file: UPath, name: str, first: int = 0) -> NamedNetwork:
    """Return the network in a file; raise KindError. `first` numbers the first node of a matrix."""
    content = read_bytes(file, name)
    ending = name.rpartition(".")[2].casefold()
    if ending == "graphml":
        network = read_graphml(content, name)
    elif ending in ("npy", "mtx"):
        network = read_matrix(content, name, ending, first)
    else:
        network = read_text_table(content, name, first)
    if not network.links:
        raise KindError(f"{name} has no edge")
    return network


def read_bytes(file: UPath, name: str) -> bytes:
    try:
        with file.open("rb") as stream:
            content = stream.read(LARGEST_FILE + 1)
    except (OSError, ValueError, ImportError) as error:
        reason = getattr(error, "strerror", None) or error
        raise KindError(f"{name} cannot be read: {reason}") from error
    if len(content) > LARGEST_FILE:
        raise KindError(f"{name} has more than {LARGEST_FILE:,} bytes")
    return content


def read_matrix(content: bytes, name: str, ending: str, first: int) -> NamedNetwork:
    """Return the network of the matrix in a .npy or .mtx (Matrix Market) file; raise KindError."""
    told = "an array of NumPy" if ending == "npy" else "a matrix of Matrix Market"
    stream = io.BytesIO(content)
    try:
        found = np.load(stream, allow_pickle=False) if ending == "npy" else mmread(stream)
    except (ValueError, OverflowError, EOFError, OSError) as error:
        raise KindError(f"{name} is not {told}: {error}") from error
    matrix = sparse.coo_array(found) if sparse.issparse(found) else np.asarray(found)
    try:
        return matrix_network(matrix, first)
    except KindError as error:
        raise KindError(f"{name}: {error}") from error


def read_graphml(content: bytes, name: str) -> NamedNetwork:
    """Return the network in GraphML; an undirected edge is a link in both directions."""
    try:
        networkx = importlib.import_module("networkx")
    except ImportError as error:
        raise KindError(
            f"{name}: GraphML needs networkx: pip install 'jaxnet-sim[graphs]'"
        ) from error
    try:
        refuse_unread(content)
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # networkx warns of content that it ignores
            network = networkx.read_graphml(io.BytesIO(content))
        called = node_names(dict(network.nodes(data=True)))
        weight = network.graph.get("edge_default", {}).get("weight", 1.0)
        return networkx_network(
            networkx.relabel_nodes(network, called), unread=("id",), weight=weight
        )
    except KindError as error:
        raise KindError(f"{name}: {error}") from error
    except (networkx.NetworkXException, *FAULTS) as error:
        reason = str(error) or type(error).__name__
        raise KindError(
            f"{name}: must be GraphML with nodes and weighted edges ({reason})"
        ) from error


def node_names(nodes: dict[str, dict[str, object]]) -> dict[str, str]:
    """Return the name of each node: an attribute that names it, or else its id; raise ValueError.

    If all names are numbers, possibly behind an n as igraph writes them, the name is the number.
    """
    found = {
        node: str(next((data[key] for key in CALLED if key in data), node))
        for node, data in nodes.items()
    }
    bare = {node: name.removeprefix("n") for node, name in found.items()}
    if all(map(NODE_NUMBER.fullmatch, bare.values())):
        found = {node: str(int(name)) for node, name in bare.items()}
    if len({*found.values()}) < len(found):
        raise ValueError("two nodes have one name")
    return found


def refuse_unread(content: bytes) -> None:
    """Raise ValueError for GraphML with content that no network is read from.

    Entities may stand for gigabytes or other files. networkx reads the first of several graphs,
    takes a graph without `edgedefault` for an undirected one, and data named `id` for the id of the
    edge.
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
