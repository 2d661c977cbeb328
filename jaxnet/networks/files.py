"""Networks from files: text, .npy, .mtx and .graphml, told apart by the ending."""

from upath import UPath

from jaxnet.networks import NamedNetwork
from jaxnet.networks.graphml import read_graphml
from jaxnet.networks.matrices import GivenMatrix, matrix_network, read_matrix_market, read_npy
from jaxnet.networks.tables import read_text_table
from jaxnet.outside.modules import KindError

LARGEST_FILE = 50_000_000  # bytes


def read_network(file: UPath, name: str, first: int = 0) -> NamedNetwork:
    """Return the network in a file; raise KindError. `first` numbers the first node of a matrix."""
    content = read_bytes(file, name)
    ending = name.rpartition(".")[2].casefold()
    if ending == "graphml":
        network = read_graphml(content, name)
    elif ending in ("npy", "mtx"):
        matrix = (read_npy if ending == "npy" else read_matrix_market)(content, name)
        network = with_name(name, matrix, first)
    else:
        network = read_text_table(content, name, first)
    if not network.links:
        raise KindError(f"{name} has no edge")
    return network


def with_name(name: str, matrix: GivenMatrix, first: int) -> NamedNetwork:
    """Return the network of a matrix; raise KindError with the name of its file."""
    try:
        return matrix_network(matrix, first)
    except KindError as error:
        raise KindError(f"{name}: {error}") from error


def read_bytes(file: UPath, name: str) -> bytes:
    """Return the content of a file; raise KindError."""
    try:
        with file.open("rb") as stream:
            content = stream.read(LARGEST_FILE + 1)
    except (OSError, ValueError, ImportError) as error:
        reason = getattr(error, "strerror", None) or error
        raise KindError(f"{name} cannot be read: {reason}") from error
    if len(content) > LARGEST_FILE:
        raise KindError(f"{name} has more than {LARGEST_FILE:,} bytes")
    return content
