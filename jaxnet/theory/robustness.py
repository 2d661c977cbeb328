"""r-robustness and its kin: what rules of the literature that know nobody's number ask of a graph.

Sources: LeBlanc, Zhang, Koutsoukos and Sundaram, Resilient asymptotic consensus in robust networks, 2013, for
(r, s)-robustness; Usevitch and Panagou, Resilient leader-follower consensus to arbitrary reference values in
time-varying graphs, 2020, for strong r-robustness with respect to leaders.
"""

import numpy as np
from jaxtyping import Bool

from jaxnet.model.graph import Digraph, Links
from jaxnet.model.safety import Nodes, Vehicles, percolate

MOST_NODES = 16  # whose sets are all looked at


def robustness(heard: Bool[np.ndarray, "n n"]) -> list[int]:
    """For r = 1, 2, … the greatest s of which a graph is (r, s)-robust, while there is one.

    Of two disjoint sets of nodes, one has r sources outside at each of its nodes, or s nodes of the two have.
    The graph is r-robust if it is (r, 1)-robust. Exact; for at most 16 nodes.
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


def led(graph: Digraph, leaders: Nodes) -> int:
    """The greatest r for which a graph is strongly r-robust with respect to leaders, of any size.

    Of every set of others somebody hears r outside the set: percolation by r reaches everybody.
    """
    r, votes, needed = 0, np.ones(graph.sources.shape, int), np.ones(graph.vehicles, int)
    while r < graph.vehicles and percolate(graph, votes, (r + 1) * needed, leaders).all():
        r += 1
    return r


def followers(graph: Digraph, trusted: Links, leaders: Nodes) -> Vehicles:
    """Leaders, and whom percolation from them reaches that bears one liar: who hear three of the reached
    (2F + 1), or trust two of them (F + 1).
    """
    return percolate(graph, np.where(trusted, 3, 2), np.full(graph.vehicles, 6), leaders)[1:]
