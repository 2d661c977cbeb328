"""r-robustness and its variants: requirements on the graph in the literature's rules without trusted sources.

Sources: LeBlanc, Zhang, Koutsoukos and Sundaram, Resilient asymptotic consensus in robust networks, 2013, for
(r, s)-robustness; Usevitch and Panagou, Resilient leader-follower consensus to arbitrary reference values in
time-varying graphs, 2020, for strong r-robustness with respect to leaders.
"""

import numpy as np
from jaxtyping import Bool

from jaxnet.model.graph import Digraph, Links
from jaxnet.model.safety import Nodes, Vehicles, percolate

MOST_NODES = 16  # in a graph whose subsets are all enumerated


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
