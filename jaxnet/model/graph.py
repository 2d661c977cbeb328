"""Directed graphs with weights (paper, section 2), in NumPy: the graph is complete before a
simulation starts.

A graph of m vehicles lists the sources of each listener. Its memory grows with the number of links,
not with m². For small fleets, `dense` returns the matrix `[a0 | A]` of the paper: (m, m + 1), with
the navigator in the first column.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from jaxnet.lazy import sparse

Weights = Float[np.ndarray, "m sources"]  # dense matrix
Links = Bool[np.ndarray, "m slots"]  # a subset of the links of a graph, slot by slot
Row = Int[np.ndarray, " links"]
Numbered = Sequence[int] | np.ndarray
Matrices: TypeAlias = "np.ndarray | sparse.sparray | sparse.spmatrix"  # (m, m + 1)


class Digraph(NamedTuple):
    """A weighted digraph: row i - 1 lists the sources of vehicle i, slot by slot.

    The number of slots is the greatest number of sources of any listener. An unused slot has weight
    0 and contains the number of the listener itself. The weights of a row sum to 1, or to 0 if the
    vehicle hears no source.
    """

    sources: Int[np.ndarray, "m slots"]  # 0 is the navigator
    weights: Float[np.ndarray, "m slots"]

    @property
    def vehicles(self) -> int:
        return len(self.sources)

    @property
    def heard(self) -> Links:
        """The slots that contain a link: the slots with positive weight."""
        return self.weights > 0

    @property
    def none(self) -> Links:
        return np.zeros(self.weights.shape, bool)

    def only(self, links: Links) -> "Digraph":
        """The graph with weight 0 outside the given links."""
        return self._replace(weights=np.where(links, self.weights, 0.0))

    def edges(self) -> tuple[Row, Row]:
        """Listeners, from 0, and slots of all links, sorted by listener."""
        listeners, slots = np.nonzero(self.heard)
        return listeners, slots

    def pairs(self) -> dict[tuple[int, int], float]:
        """The weights by listener, from 0, and source."""
        rows, slots = self.edges()
        ends = zip(rows.tolist(), self.sources[rows, slots].tolist(), strict=True)
        return dict(zip(ends, self.weights[rows, slots].tolist(), strict=True))


def of_links(
    vehicles: int,
    listeners: Numbered,
    sources: Numbered,
    weights: Shaped[np.ndarray, " links"] | float = 1.0,
) -> Digraph:
    """The graph of listeners (from 0), sources and weights, not normalised; no link twice."""
    listeners, sources = (np.asarray(each).astype(int) for each in (listeners, sources))
    order = np.argsort(listeners * (vehicles + 1) + sources, kind="stable")
    listeners, sources = listeners[order], sources[order]
    rows, slots, table = slotted(vehicles, listeners, sources)
    found = np.zeros(table.shape)
    found[rows, slots] = np.broadcast_to(np.asarray(weights, float), order.shape)[order]
    return Digraph(table, found)


def slotted(
    vehicles: int, listeners: Row, sources: Row
) -> tuple[Row, Row, Int[np.ndarray, "m slots"]]:
    """Row and slot of each link, sorted by listener, and the table of sources by slot."""
    number = np.bincount(listeners, minlength=vehicles)
    slots = np.arange(len(listeners)) - (np.cumsum(number) - number)[listeners]
    table = np.tile(np.arange(1, vehicles + 1)[:, None], (1, max(1, int(number.max()))))
    table[listeners, slots] = sources
    return listeners, slots, table


def of_matrix(given: Matrices) -> Digraph:
    """Graph of a matrix (m, m + 1) of weights or links, a NumPy array or a SciPy sparse array."""
    return of_links(given.shape[0], *entries(given))  # pyright: ignore[reportAttributeAccessIssue]


def entries(given: Matrices) -> tuple[Row, Row, Shaped[np.ndarray, " links"]]:
    """Rows, columns and values of the entries other than 0, of a NumPy or SciPy sparse array."""
    links = sparse.coo_array(given)
    links.sum_duplicates()
    links.eliminate_zeros()
    return links.row, links.col, links.data


def weighted(vehicles: int, edges: Iterable[tuple[int, int, float]]) -> Digraph:
    """The graph of edges (i, j, w), "i hears j with weight w", with rows normalised to sum 1."""
    listeners, sources, weights = np.array([*edges], float).reshape(-1, 3).T
    return normalised(of_links(vehicles, listeners - 1, sources, weights))


def normalised(graph: Digraph) -> Digraph:
    """The graph with rows that sum to 1, or to 0 if a vehicle hears no source."""
    weights = graph.weights
    total = weights.sum(axis=1, keepdims=True)
    return graph._replace(
        weights=np.divide(weights, total, out=np.zeros_like(weights), where=total > 0)
    )


def row_sums(
    graph: Digraph, navigator: bool
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """The weight of each vehicle on itself, and the sum of its other weights.

    `navigator` says whether the navigator counts among the others.
    """
    loop = graph.sources == np.arange(1, graph.vehicles + 1)[:, None]
    others = ~loop if navigator else ~loop & (graph.sources != 0)
    return graph.only(loop).weights.sum(axis=1), graph.only(others).weights.sum(axis=1)


def dense(graph: Digraph) -> Weights:
    """The dense matrix `[a0 | A]`, for small fleets."""
    matrix = np.zeros((graph.vehicles, graph.vehicles + 1))
    np.add.at(matrix, (np.arange(graph.vehicles)[:, None], graph.sources), graph.weights)
    return matrix


def laplacian(weights: Weights) -> Float[np.ndarray, "m m"]:
    """`L = I - A` of the matrix `[a0 | A]`.

    If every vehicle hears a source, L is nonsingular iff the navigator reaches every vehicle.
    """
    return np.eye(len(weights)) - weights[:, 1:]


def solver(graph: Digraph) -> Callable[[np.ndarray], np.ndarray]:
    """A function that computes `L⁻¹ b` for b (m, …), with `L = I - A` sparse and nonsingular."""
    from scipy.sparse.linalg import splu

    listeners, slots = graph.edges()
    sources, weights = graph.sources[listeners, slots], graph.weights[listeners, slots]
    shape = graph.vehicles, graph.vehicles + 1
    heard = sparse.csc_array((weights, (listeners, sources)), shape=shape)[:, 1:]
    return splu(sparse.csc_array(sparse.eye_array(graph.vehicles) - heard)).solve


def inverse_norm(graph: Digraph) -> float:
    """`‖L⁻¹‖₂` of a nonsingular L."""
    return float(np.linalg.norm(solver(graph)(np.eye(graph.vehicles)), 2))


def hops(graph: Digraph) -> Float[np.ndarray, " m"]:
    """The links on the shortest path from the navigator to each vehicle, inf without a path."""
    listeners, slots = graph.edges()
    sources, found = graph.sources[listeners, slots], np.full(graph.vehicles + 1, np.inf)
    order = np.argsort(sources, kind="stable")
    firsts = np.searchsorted(sources[order], np.arange(1, graph.vehicles + 1))
    hearers = np.split(listeners[order] + 1, firsts)  # of each node
    reached, links = np.array([0]), 0
    while len(reached):
        found[reached] = links
        ends = np.concatenate([hearers[node] for node in reached])
        reached, links = np.unique(ends[np.isinf(found[ends])]), links + 1
    return found[1:]


def unreachable(graph: Digraph) -> list[int]:
    return [int(i) for i in np.flatnonzero(np.isinf(hops(graph))) + 1]


def hears_vehicles(graph: Digraph) -> bool:
    return bool((graph.heard & (graph.sources > 0)).any())


def trusted_links(graph: Digraph, trusted: Mapping[int, Iterable[int]]) -> Links:
    """The links from sources that the listener trusts.

    Every listener trusts the navigator. `trusted` maps a listener to its further trusted sources.
    """
    links = graph.sources == 0
    for listener, sources in trusted.items():
        links[listener - 1] |= np.isin(graph.sources[listener - 1], list(sources))
    return links & graph.heard


def least(heard: Links, values: Float[np.ndarray, "m slots"], count: int | np.ndarray) -> Links:
    """Return each listener's `count` links of least value; the lowest slot wins ties."""
    ranks = np.where(heard, values, np.inf).argsort(axis=1, kind="stable").argsort(axis=1)
    return heard & (ranks < np.reshape(count, (-1, 1)))


def metropolis(graph: Digraph) -> Float[np.ndarray, "m slots"]:
    """`1 / (1 + max(d_i, d_j))` for each link of i from vehicle j.

    Here d_i is the number of vehicles that i hears. The weights are symmetric if links are mutual.
    The rest of each row, up to 1, is the weight of the vehicle itself. Source: Xiao, Boyd and Lall,
    A scheme for robust distributed sensor fusion based on average consensus, 2005.
    """
    heard = graph.heard & (graph.sources > 0)
    degrees = heard.sum(axis=1)
    return heard / (1.0 + np.maximum(degrees[:, None], degrees[graph.sources - 1]))
