"""Who hears whom, with what weight (paper, section 2), in NumPy: a graph is settled before anything runs.

A graph of m vehicles lists for each listener whom it hears, so that it takes memory as it has links, not m².
The paper's matrix `[a0 | A]`, (m, m + 1) with the navigator's column first, is made by `dense` where one is
wanted: of small fleets, by what inverts it.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

BLOCK = 2**17  # numbers of dense rows that are added at once

Weights = Float[np.ndarray, "m sources"]  # of a dense matrix
Links = Bool[np.ndarray, "m slots"]  # some of a graph's, slot by slot
Row = Int[np.ndarray, " links"]


class Digraph(NamedTuple):
    """A weighted digraph: row i - 1 holds what vehicle i hears, slot by slot, by the numbers of the sources.

    There are as many slots as the busiest listener has sources; one left over holds the listener itself. A
    slot in which nobody is heard has weight 0. Weights of a row sum to 1, or to 0 where nobody is.
    """

    sources: Int[np.ndarray, "m slots"]  # 0 the navigator
    weights: Float[np.ndarray, "m slots"]

    @property
    def vehicles(self) -> int:
        """How many there are."""
        return len(self.sources)

    @property
    def heard(self) -> Links:
        """Slots that hold somebody who is heard."""
        return self.weights > 0

    @property
    def none(self) -> Links:
        """No link."""
        return np.zeros(self.weights.shape, bool)

    def only(self, links: Links) -> "Digraph":
        """The same with weight 0 elsewhere."""
        return self._replace(weights=np.where(links, self.weights, 0.0))

    def edges(self) -> tuple[Row, Row]:
        """Listeners, from 0, and slots of all links, listener by listener."""
        listeners, slots = np.nonzero(self.heard)
        return listeners, slots

    def pairs(self) -> dict[tuple[int, int], float]:
        """Weights by listener, from 0, and source."""
        rows, slots = self.edges()
        ends = zip(rows.tolist(), self.sources[rows, slots].tolist(), strict=True)
        return dict(zip(ends, self.weights[rows, slots].tolist(), strict=True))


def of_links(vehicles: int, listeners: Any, sources: Any, weights: Any = 1.0) -> Digraph:
    """Graph in which listeners, from 0, hear sources with these weights; no link is given twice."""
    listeners, sources = (np.asarray(each).astype(int) for each in (listeners, sources))
    order = np.argsort(listeners * (vehicles + 1) + sources, kind="stable")
    listeners, sources = listeners[order], sources[order]
    rows, slots, table = slotted(vehicles, listeners, sources)
    found = np.zeros(table.shape)
    found[rows, slots] = np.broadcast_to(np.asarray(weights, float), order.shape)[order]
    return Digraph(table, found)


def slotted(vehicles: int, listeners: Row, sources: Row) -> tuple[Row, Row, Int[np.ndarray, "m slots"]]:
    """Sources slot by slot, with the row and the slot of each; they are given listener by listener."""
    number = np.bincount(listeners, minlength=vehicles)
    slots = np.arange(len(listeners)) - (np.cumsum(number) - number)[listeners]
    table = np.tile(np.arange(1, vehicles + 1)[:, None], (1, max(1, int(number.max()))))
    table[listeners, slots] = sources
    return listeners, slots, table


def of_matrix(given: Any) -> Digraph:
    """Graph of an array (m, m + 1) of weights, or of links, NumPy's or a sparse one of SciPy's."""
    return of_links(given.shape[0], *entries(given))


def entries(given: Any) -> tuple[Row, Row, Any]:
    """Rows and columns of what is not 0 in an array, NumPy's or a sparse one of SciPy's, and what it is."""
    if isinstance(given, np.ndarray):
        rows, columns = np.nonzero(given)
        return rows, columns, given[rows, columns]
    links = sparse.coo_array(given)
    links.sum_duplicates()
    links.eliminate_zeros()
    return links.row, links.col, links.data


def weighted(vehicles: int, edges: Iterable[tuple[int, int, float]]) -> Digraph:
    """Graph of the edges (i, j, w), "i hears j with weight w", each row normalised to sum 1."""
    listeners, sources, weights = np.array([*edges], float).reshape(-1, 3).T
    return normalised(of_links(vehicles, listeners - 1, sources, weights))


def normalised(graph: Digraph) -> Digraph:
    """The graph with rows that sum to 1, or to 0 where a vehicle hears nobody."""
    weights = graph.weights
    total = totals(graph.sources, weights, graph.vehicles + 1)[:, None]
    return graph._replace(weights=np.divide(weights, total, out=np.zeros_like(weights), where=total > 0))


def totals(
    columns: Int[np.ndarray, "m slots"], values: Float[np.ndarray, "m slots"], width: int
) -> Float[np.ndarray, " m"]:
    """Sums of rows to the last bit as NumPy adds them in dense ones of this width, by pairs.

    So that a graph has the same weights however it is given. Of two numbers there is one sum; where there are
    more a few rows are made dense at a time.
    """
    found = values.sum(axis=1)
    several, at_once = np.flatnonzero((values != 0).sum(axis=1) > 2), max(1, BLOCK // width)
    for first in range(0, len(several), at_once):
        rows = several[first : first + at_once]
        row, slot = np.nonzero(values[rows])
        some = np.zeros((len(rows), width))
        some[row, columns[rows][row, slot]] = values[rows][row, slot]
        found[rows] = some.sum(axis=1)
    return found


def dense(graph: Digraph) -> Weights:
    """`[a0 | A]`, of small fleets."""
    matrix = np.zeros((graph.vehicles, graph.vehicles + 1))
    np.add.at(matrix, (np.arange(graph.vehicles)[:, None], graph.sources), graph.weights)
    return matrix


def laplacian(weights: Weights) -> Float[np.ndarray, "m m"]:
    """`L = I - A` of `[a0 | A]`; where everybody hears somebody, nonsingular just if the navigator reaches
    everybody.
    """
    return np.eye(len(weights)) - weights[:, 1:]


def solver(graph: Digraph) -> Callable[[np.ndarray], np.ndarray]:
    """What makes `L⁻¹ b` of b (m, …), L = I - A sparse and nonsingular."""
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
    """Links on the shortest way from the navigator to each vehicle, inf where there is none."""
    listeners, _, ends = by_source(graph)
    told, found, waiting = (listeners + 1).tolist(), [0.0, *[np.inf] * graph.vehicles], [0]
    for source in waiting:
        for listener in told[ends[source] : ends[source + 1]]:
            if found[listener] == np.inf:
                found[listener] = found[source] + 1
                waiting.append(listener)
    return np.array(found[1:])


def by_source(graph: Digraph) -> tuple[Row, Row, list[int]]:
    """Listeners, from 0, and slots of all links, source by source, and where those of each begin, and end."""
    listeners, slots = graph.edges()
    sources = graph.sources[listeners, slots]
    order = sources.argsort(kind="stable")
    ends = np.bincount(sources, minlength=graph.vehicles + 1).cumsum().tolist()
    return listeners[order], slots[order], [0, *ends]


def unreachable(graph: Digraph) -> list[int]:
    """Vehicles that nothing the navigator says can reach."""
    return [int(i) for i in np.flatnonzero(np.isinf(hops(graph))) + 1]


def hears_vehicles(graph: Digraph) -> bool:
    """Whether any vehicle hears another one."""
    return bool((graph.heard & (graph.sources > 0)).any())


def trusted_links(graph: Digraph, trusted: Mapping[int, Iterable[int]]) -> Links:
    """Links whose source the listener trusts: the navigator wherever it is heard, and the listed ones."""
    links = graph.sources == 0
    for listener, sources in trusted.items():
        links[listener - 1] |= np.isin(graph.sources[listener - 1], list(sources))
    return links & graph.heard


def least(heard: Links, values: Float[np.ndarray, "m slots"], count: Any) -> Links:
    """The `count` sources that each listener hears of the least values, of equal ones the first."""
    ranks = np.where(heard, values, np.inf).argsort(axis=1, kind="stable").argsort(axis=1)
    return heard & (ranks < np.reshape(count, (-1, 1)))


def metropolis(graph: Digraph) -> Float[np.ndarray, "m slots"]:
    """`1 / (1 + max(d_i, d_j))` where i hears vehicle j, d_i the number of vehicles that i hears.

    Symmetric where links are mutual; what is left of 1 in a row is the vehicle's own. Source: Xiao, Boyd and
    Lall, A scheme for robust distributed sensor fusion based on average consensus, 2005.
    """
    heard = graph.heard & (graph.sources > 0)
    degrees = heard.sum(axis=1)
    return heard / (1.0 + np.maximum(degrees[:, None], degrees[graph.sources - 1]))
