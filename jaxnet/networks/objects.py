"""Networks as objects of Python: graphs of networkx, which is not imported, and matrices.

A matrix is an adjacency matrix, a Laplacian, or the paper's [a0 | A].
"""

import math
import numbers
import operator
from typing import TYPE_CHECKING

import numpy as np

from jaxnet.lazy import sparse
from jaxnet.model import graph
from jaxnet.networks import GREATEST_EDGE_WEIGHT, NamedNetwork
from jaxnet.outside.modules import KindError

if TYPE_CHECKING:
    import networkx

LAPLACIAN_ROUNDING = 1e-9  # of the greatest entry: how far from 0 a row of a Laplacian may sum


def object_network(value: object, first: int = 0) -> NamedNetwork | None:
    """Return the network of networkx's graph or a matrix, None for others; raises KindError."""
    if any(each.__module__.startswith("networkx.") for each in type(value).__mro__):
        return networkx_network(value)  # pyright: ignore[reportArgumentType]
    if sparse.issparse(value):
        return matrix_network(sparse.coo_array(value), first)  # pyright: ignore[reportArgumentType]
    return matrix_network(value, first) if isinstance(value, np.ndarray) else None


def matrix_network(given: "np.ndarray | sparse.coo_array", first: int = 0) -> NamedNetwork:
    """Return the network of a matrix; entry (i, j) is the weight with which node i hears node j.

    A matrix is (n, n), and one of its nodes, numbered from `first`, may be the navigator; or it is
    [a0 | A], (m, m + 1), whose column 0 is the navigator. A square matrix with a negative entry is
    a Laplacian: its weights are −l_ij, j ≠ i. Raises KindError for another shape or entry, and for
    a node without an edge.
    """
    shape: tuple[int, ...] = given.shape or ()
    if len(shape) != 2 or shape[1] - shape[0] not in (0, 1):
        got = " × ".join(map(str, shape))
        allowed = "n × n, or m × (m + 1) with the navigator in column 0"
        raise KindError(f"a matrix is {allowed} (got {got})")
    try:
        rows, columns, values = graph.entries(given)
        values = values.astype(float, casting="safe")
    except TypeError as error:
        raise KindError(f"a matrix has real numbers (got {given.dtype})") from error
    square = shape[0] == shape[1]
    if square and (values < 0).any():
        sums = np.bincount(rows, values)
        row = int(np.abs(sums).argmax())
        if np.abs(sums[row]) > LAPLACIAN_ROUNDING * np.abs(values).max():
            told = "a matrix with negative entries is a Laplacian, whose rows sum to 0"
            raise KindError(f"{told} (row {row + 1} sums to {sums[row]:g})")
        off = rows != columns
        rows, columns, values = rows[off], columns[off], -values[off]
    right = (values > 0) & (values <= GREATEST_EDGE_WEIGHT)
    if not right.all():
        wrong = int(np.argmin(right))
        place = f"in row {rows[wrong] + 1}, column {columns[wrong] + 1}"
        allowed = f"weights are 0 to {GREATEST_EDGE_WEIGHT:g}"
        raise KindError(f"{allowed} (got {values[wrong]:g} {place})")
    shift = first if square else 1
    ends = (rows + shift).tolist(), (columns + shift - (not square)).tolist()
    alone = sorted(set(range(shift, shift + shape[0])).difference(*ends))
    if alone and len(values):
        raise KindError(f"node {alone[0]} has no edge")
    links = zip(map(str, ends[0]), map(str, ends[1]), values.tolist(), strict=True)
    return NamedNetwork((), list(links), None if square else "0")


def networkx_network(
    network: "networkx.Graph", unread: tuple[str, ...] = (), weight: object = 1.0
) -> NamedNetwork:
    """Return the network of a networkx graph; an undirected edge is a link in both directions.

    Nodes are numbers, or their labels are names. An edge without a weight has `weight`; attributes
    of edges that are `unread` count for nothing. Raises KindError for another attribute of an edge,
    a node without an edge, and two nodes with one name.
    """
    labels = {node: label_of(node) for node in network.nodes}
    if len({*labels.values()}) < len(labels):
        raise KindError("two nodes have one name")
    for node, label in labels.items():
        if not network.degree[node]:
            raise KindError(f"node {label} has no edge")
    links = []
    for one, other, data in network.edges(data=True):
        ends = labels[one], labels[other]
        if odd := [name for name in data if name not in ("weight", *unread)]:
            raise KindError(
                f"edge ({', '.join(ends)}) has the attribute {odd[0]!r}; only 'weight' is read"
            )
        links.append((*ends, weight_of(data.get("weight", weight), ends)))
    back = [] if network.is_directed() else [(j, i, w) for i, j, w in links if i != j]
    numbered = all(map(is_whole, network.nodes))
    return NamedNetwork(() if numbered else tuple(labels.values()), [*links, *back])


def is_whole(node: object) -> bool:
    return hasattr(node, "__index__") and not isinstance(node, bool | np.bool_)


def label_of(node: object) -> str:
    """Return a node's label; raise KindError for a negative number, and for True and False."""
    label = str(operator.index(node)) if is_whole(node) else str(node)  # pyright: ignore[reportArgumentType]
    if isinstance(node, bool | np.bool_) or (is_whole(node) and label.startswith("-")):
        raise KindError(f"nodes are numbers from 0, or names (got {node!r})")
    return label


def weight_of(given: object, ends: tuple[str, str]) -> float:
    number = given if isinstance(given, numbers.Real) and not isinstance(given, bool) else math.nan
    if not number <= GREATEST_EDGE_WEIGHT or not float(number) > 0:
        allowed = f"a weight is a number > 0, at most {GREATEST_EDGE_WEIGHT:g}"
        raise KindError(f"edge ({', '.join(ends)}): {allowed} (got {given!r})")
    return float(number)
