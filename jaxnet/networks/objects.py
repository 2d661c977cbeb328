"""Networks as objects of Python: graphs of networkx, which is not imported, and arrays."""

import math
import numbers
import operator
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from jaxnet.networks import GREATEST_EDGE_WEIGHT, NamedNetwork
from jaxnet.networks.matrices import matrix_network
from jaxnet.outside.modules import KindError

if TYPE_CHECKING:
    import networkx


def object_network(value: object, first: int = 0) -> NamedNetwork | None:
    """Return the network of networkx's graph or a matrix, None for others; raises KindError."""
    if any(each.__module__.startswith("networkx.") for each in type(value).__mro__):
        return networkx_network(value)  # pyright: ignore[reportArgumentType]
    if sparse.issparse(value):
        value = sparse.coo_array(value)  # pyright: ignore[reportArgumentType]
    return (
        matrix_network(value, first) if isinstance(value, np.ndarray | sparse.coo_array) else None
    )


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
