"""r-robustness and its variants: requirements on the graph in the literature's rules without trusted sources.

Sources: LeBlanc, Zhang, Koutsoukos and Sundaram, Resilient asymptotic consensus in robust networks, 2013, for
(r, s)-robustness; Usevitch and Panagou, Resilient leader-follower consensus to arbitrary reference values in
time-varying graphs, 2020, for strong r-robustness with respect to leaders. `integer` treats larger graphs.
"""

from collections.abc import Iterable
from numbers import Integral

import numpy as np
from jaxtyping import Bool

from jaxnet.model.graph import Digraph, Links
from jaxnet.model.safety import Nodes, Vehicles, percolate

MOST_NODES = 16  # in a graph whose subsets are all enumerated


def pairs(hears: Iterable[object], nodes: int) -> list[int]:
    """Return, for r = 1, 2, …, the greatest s for which a digraph is (r, s)-robust, while s > 0.

    Consider any two disjoint nonempty sets of nodes. A node of a set is r-reachable if it hears at least r
    nodes outside its set. The digraph is (r, s)-robust if at least one of three conditions holds for the two
    sets (LeBlanc et al., 2013):

    - Every node of the first set is r-reachable.
    - Every node of the second set is r-reachable.
    - The two sets together contain at least s r-reachable nodes.

    The digraph is r-robust if it is (r, 1)-robust. The result is exact, by enumeration of all sets.

    Parameters
    ----------
    hears : list of [int, int]
        The links: [i, j] means "node i hears node j". Nodes have numbers from 1.
    nodes : int
        The number of nodes, from 1 to 16.

    Returns
    -------
    list of int
        The greatest s, at place r - 1. Its length is the greatest r for which the digraph is r-robust.

    Raises
    ------
    ValueError
        If `nodes` is not from 1 to 16, or if a pair is not of two different nodes.

    Examples
    --------
    >>> from jaxnet.theory.robustness import pairs
    >>> pairs([[1, 2], [2, 3], [3, 1]], nodes=3)  # a directed ring
    [3]
    >>> pairs([[i, j] for i in range(1, 6) for j in range(1, 6) if i != j], nodes=5)  # a complete graph
    [5, 5, 5]
    """
    heard = heard_matrix(hears, nodes)
    if nodes > MOST_NODES:
        raise ValueError(f"nodes: must be at most {MOST_NODES} (got {nodes}); larger: robustness_bracket")
    return robustness(heard)


def heard_matrix(hears: Iterable[object], nodes: int) -> Bool[np.ndarray, "n n"]:
    """Return the matrix of a digraph: entry (i - 1, j - 1) tells whether node i hears node j.

    Parameters
    ----------
    hears : list of [int, int]
        The links: [i, j] means "node i hears node j". Nodes have numbers from 1.
    nodes : int
        The number of nodes.

    Returns
    -------
    array of bool, shape (nodes, nodes)
        A row lists the sources of a node.

    Raises
    ------
    ValueError
        If `nodes` is less than 1, or if a pair is not of two different nodes.

    Examples
    --------
    >>> from jaxnet.theory.robustness import heard_matrix
    >>> heard_matrix([[1, 2], [2, 3]], nodes=3).astype(int).tolist()
    [[0, 1, 0], [0, 0, 1], [0, 0, 0]]
    """
    if nodes < 1:
        raise ValueError(f"nodes: must be at least 1 (got {nodes})")
    heard = np.zeros((nodes, nodes), bool)
    for place, pair in enumerate(hears):
        i, j = checked_pair(pair, nodes, f"hears[{place}]")
        heard[i - 1, j - 1] = True
    return heard


def checked_pair(pair: object, nodes: int, where: str) -> tuple[int, int]:
    """Return listener and source of a pair, or raise ValueError with the pair and its place."""
    ends = tuple(pair) if isinstance(pair, Iterable) else ()
    if len(ends) != 2 or not all(is_node(end, nodes) for end in ends):
        raise ValueError(f"{where}: must be [listener, source], two nodes from 1 to {nodes} (got {pair!r})")
    if ends[0] == ends[1]:
        raise ValueError(f"{where}: node {ends[0]} hears itself")
    return int(ends[0]), int(ends[1])


def is_node(value: object, nodes: int) -> bool:
    """Return whether a value is a whole number, of Python or NumPy, from 1 to the number of nodes."""
    return isinstance(value, Integral) and not isinstance(value, bool) and 1 <= int(value) <= nodes


def robustness(heard: Bool[np.ndarray, "n n"]) -> list[int]:
    """Return, for r = 1, 2, …, the greatest s for which a graph is (r, s)-robust, while s > 0.

    For every two disjoint sets of nodes: every node of one set has r sources outside its set, or at least s
    nodes of both sets together do. The graph is r-robust if it is (r, 1)-robust. Exact, for at most 16 nodes.
    """
    n = len(heard)
    sets, bits = np.arange(2**n, dtype=np.uint32), np.uint32(1) << np.arange(n, dtype=np.uint32)
    rows = (heard * bits).sum(axis=1, dtype=np.uint32)
    outside = np.where(sets & bits[:, None], np.bitwise_count(rows[:, None] & ~sets), 0)
    size, found = np.bitwise_count(sets), []
    for r in range(1, (n + 1) // 2 + 1):
        reach = (outside >= r).sum(axis=0)
        fewest = np.where(reach < size, reach, n)
        inside = fewest.copy()
        for bit in range(n):
            halves = inside.reshape(-1, 2, 2**bit)
            np.minimum(halves[:, 1], halves[:, 0], out=halves[:, 1])
        found.append(min(n, int((fewest + inside[::-1]).min())))
        if not found[-1]:
            return found[:-1]
    return found


def leader_robustness(graph: Digraph, leaders: Nodes) -> int:
    """Return the greatest r for which a graph of any size is strongly r-robust with respect to leaders.

    Every set of other nodes must contain a node with r sources outside the set. Equivalently, percolation
    with threshold r reaches every node.
    """
    r, votes, needed = 0, np.ones(graph.sources.shape, int), np.ones(graph.vehicles, int)
    while r < graph.vehicles and percolate(graph, votes, (r + 1) * needed, leaders).all():
        r += 1
    return r


def percolated_vehicles(graph: Digraph, trusted: Links, leaders: Nodes) -> Vehicles:
    """Return the leaders and the vehicles that percolation from them reaches despite one liar, F = 1.

    A vehicle is reached if it hears 2F + 1 reached vehicles or trusts F + 1 of them.
    """
    return percolate(graph, np.where(trusted, 3, 2), np.full(graph.vehicles, 6), leaders)[1:]
