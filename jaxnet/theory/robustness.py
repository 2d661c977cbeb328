"""Robustness of digraphs by enumeration and percolation: what rules without trusted sources need.

Sources: LeBlanc, Zhang, Koutsoukos and Sundaram, Resilient asymptotic consensus in robust networks,
2013, for (r, s)-robustness; Usevitch and Panagou, Resilient leader-follower consensus to arbitrary
reference values in time-varying graphs, 2020, for strong r-robustness with respect to leaders.
`integer` treats larger graphs.
"""

from collections.abc import Iterable
from numbers import Integral

import numpy as np
from jaxtyping import Bool

from jaxnet.model.graph import Digraph, Links, of_links
from jaxnet.model.safety import Nodes, percolate

MOST_NODES = 16  # in a graph whose subsets are all enumerated


def pairs(hears: Iterable[object], nodes: int) -> list[int]:
    """For r = 1, 2, …, the greatest s for which a digraph is (r, s)-robust, while s > 0.

    A node of a set is r-reachable if it hears at least r nodes outside the set. The digraph is
    (r, s)-robust if of any two disjoint nonempty sets of nodes one has only r-reachable nodes, or
    both together have at least s of them (LeBlanc et al., 2013). r-robust means (r, 1)-robust. The
    result is exact, by enumeration of all sets.

    Parameters
    ----------
    hears, nodes
        The links and the number of nodes, at most 16, as `heard_matrix` takes them.

    Returns
    -------
    list of int
        The greatest s, at place r - 1. Its length is the greatest r of r-robustness.

    Raises
    ------
    ValueError
        If `nodes` is not from 1 to 16, or if a pair is not of two different nodes.

    Examples
    --------
    >>> from jaxnet.theory.robustness import pairs
    >>> pairs([[1, 2], [2, 3], [3, 1]], nodes=3)  # a directed ring
    [3]
    >>> complete = [[i, j] for i in range(1, 6) for j in range(1, 6) if i != j]
    >>> pairs(complete, nodes=5)
    [5, 5, 5]
    """
    heard = heard_matrix(hears, nodes)
    if nodes > MOST_NODES:
        raise ValueError(
            f"nodes: must be at most {MOST_NODES} (got {nodes}); larger: robustness_bracket"
        )
    return robustness(heard)


def heard_matrix(hears: Iterable[object], nodes: int) -> Bool[np.ndarray, "n n"]:
    """Matrix of a digraph: entry (i - 1, j - 1) tells whether node i hears node j.

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
        ends = tuple(pair) if isinstance(pair, Iterable) else ()
        if len(ends) != 2 or not all(is_node(end, nodes) for end in ends):
            allowed = f"[listener, source], two nodes from 1 to {nodes}"
            raise ValueError(f"hears[{place}]: must be {allowed} (got {pair!r})")
        if ends[0] == ends[1]:
            raise ValueError(f"hears[{place}]: node {ends[0]} hears itself")
        heard[ends[0] - 1, ends[1] - 1] = True
    return heard


def is_node(value: object, nodes: int) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool) and 1 <= int(value) <= nodes


def robustness(heard: Bool[np.ndarray, "n n"]) -> list[int]:
    """`pairs` of a matrix with at most 16 nodes; sets are bits of a number."""
    n = len(heard)
    sets, bits = np.arange(2**n, dtype=np.uint32), np.uint32(1) << np.arange(n, dtype=np.uint32)
    rows = (heard * bits).sum(axis=1, dtype=np.uint32)
    outside = np.where(sets & bits[:, None], np.bitwise_count(rows[:, None] & ~sets), 0)
    size, found = np.bitwise_count(sets), []
    for r in range(1, (n + 1) // 2 + 1):
        reach = (outside >= r).sum(axis=0)
        fewest = np.where(reach < size, reach, n)
        inside = fewest.copy()  # the least of all subsets, one bit after the other
        for bit in range(n):
            halves = inside.reshape(-1, 2, 2**bit)
            np.minimum(halves[:, 1], halves[:, 0], out=halves[:, 1])
        found.append(min(n, int((fewest + inside[::-1]).min())))
        if not found[-1]:
            return found[:-1]
    return found


def most_local(r: int) -> int:
    """Greatest F for which r-robustness is enough for W-MSR with F-local attackers, -1 for none.

    The digraph must be (2F + 1)-robust, which is sufficient. Each vehicle hears at most F
    attackers, and they tell all their listeners alike.
    """
    return (r - 1) // 2


def most_total(found: list[int]) -> int:
    """Greatest F for which W-MSR tolerates F-total attackers, -1 for none.

    `found` has the greatest s for each r. The digraph must be (F + 1, F + 1)-robust, which is
    necessary and sufficient. There are at most F attackers, and they tell all their listeners
    alike.
    """
    return max((r for r, s in enumerate(found, 1) if s >= r), default=0) - 1


def leader_robustness(graph: Digraph, leaders: Nodes) -> int:
    """Greatest r for which a graph of any size is strongly r-robust with respect to leaders.

    Every set of other nodes must contain a node with r sources outside the set. Equivalently,
    percolation with threshold r reaches every node.
    """
    r, votes, needed = 0, np.ones(graph.sources.shape, int), np.ones(graph.vehicles, int)
    while r < graph.vehicles and percolate(graph, votes, (r + 1) * needed, leaders).all():
        r += 1
    return r


def percolated(graph: Digraph, trusted: Links, leaders: Nodes, F: int = 1) -> Nodes:
    """Leaders and the nodes that percolation from them reaches despite F-local attackers.

    Percolation reaches a node that hears 2F + 1 reached sources or trusts F + 1 of them. A link
    counts 1 / (2F + 1), and a trusted link 1 / (F + 1). Leaders whom nobody trusts may be
    attackers.
    """
    votes = np.where(trusted, 2 * F + 1, F + 1)
    needed = np.full(graph.vehicles, (2 * F + 1) * (F + 1))
    return percolate(graph, votes, needed, leaders)


def strong_robustness(hears: Iterable[object], nodes: int, leaders: Iterable[object]) -> int:
    """Greatest r for which a digraph is strongly r-robust with respect to leaders.

    Every nonempty set of nodes without leaders must contain a node that hears at least r nodes
    outside the set (Usevitch and Panagou, 2020).

    Parameters
    ----------
    hears, nodes
        The links and the number of nodes, as `heard_matrix` takes them.
    leaders : list of int
        The leaders. At least one node must be no leader.

    Returns
    -------
    int
        The greatest r. Followers with W-MSR follow the leaders despite F-local attackers, leaders
        among them, if r ≥ 2F + 1.

    Raises
    ------
    ValueError
        If a pair is not of two different nodes, a leader is no node, or every node is a leader.

    Examples
    --------
    >>> from jaxnet.theory.robustness import strong_robustness
    >>> hears = [[4, 1], [4, 2], [4, 3], [5, 2], [5, 3], [5, 4]]
    >>> strong_robustness(hears, nodes=5, leaders=[1, 2, 3])
    3
    """
    network, seeds = led_digraph(heard_matrix(hears, nodes), leaders)
    if seeds.all():
        raise ValueError("leaders: at least one node must be no leader")
    return leader_robustness(network, seeds)


def percolated_nodes(
    hears: Iterable[object],
    nodes: int,
    leaders: Iterable[object],
    F: int,
    trusted: Iterable[object] = (),
) -> list[int]:
    """Nodes that bootstrap percolation from leaders reaches, with no leader trusted by default.

    A node is reached if it hears 2F + 1 reached nodes: at most F of them are F-local attackers.
    Percolation without trust reaches every node if and only if the digraph is strongly
    (2F + 1)-robust with respect to the leaders (Usevitch and Panagou, 2020).

    Parameters
    ----------
    hears, nodes
        The links and the number of nodes, as `heard_matrix` takes them.
    leaders : list of int
        The nodes from which percolation starts.
    F : int
        The greatest number of attackers that a node hears.
    trusted : list of [int, int], optional
        The links whose listener trusts the source. F + 1 reached trusted sources reach a node, too:
        a link counts 1 / (2F + 1), a trusted link 1 / (F + 1).

    Returns
    -------
    list of int
        The reached nodes, with the leaders.

    Raises
    ------
    ValueError
        If a pair is not of two different nodes, a leader is no node, F is negative, or a trusted
        pair is no link.

    Examples
    --------
    >>> from jaxnet.theory.robustness import percolated_nodes
    >>> hears = [[4, 1], [4, 2], [4, 3], [5, 2], [5, 3], [5, 4], [6, 4], [6, 5]]
    >>> percolated_nodes(hears, nodes=6, leaders=[1, 2, 3], F=1)
    [1, 2, 3, 4, 5]
    >>> percolated_nodes(hears, nodes=6, leaders=[1, 2, 3], F=1, trusted=[[6, 4], [6, 5]])
    [1, 2, 3, 4, 5, 6]
    """
    if F < 0:
        raise ValueError(f"F: must be at least 0 (got {F})")
    heard = heard_matrix(hears, nodes)
    network, seeds = led_digraph(heard, leaders)
    marks = heard_matrix(trusted, nodes)
    for i, j in np.argwhere(marks & ~heard).tolist():
        raise ValueError(f"trusted: node {i + 1} does not hear node {j + 1}")
    slots = marks[np.arange(nodes)[:, None], network.sources - 1]
    reached = percolated(network, slots & network.heard, seeds, F)
    return np.flatnonzero(reached)[1:].tolist()


def led_digraph(heard: Bool[np.ndarray, "n n"], leaders: Iterable[object]) -> tuple[Digraph, Nodes]:
    """Graph of a matrix and the flags of its leaders; nobody hears the navigator, a leader too."""
    nodes = len(heard)
    seeds = np.arange(nodes + 1) == 0
    for leader in leaders:
        if not is_node(leader, nodes):
            raise ValueError(f"leaders: must be nodes from 1 to {nodes} (got {leader!r})")
        seeds[leader] = True
    listeners, sources = np.nonzero(heard)
    return of_links(nodes, listeners, sources + 1), seeds
