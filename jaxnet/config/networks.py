"""A topology from a network that a script holds."""

from collections.abc import Sequence

from jaxnet.config.document import ConfigError, Problem
from jaxnet.kinds.graphs.edges import Edges, edges_of_network, network_label
from jaxnet.kinds.kind import KindError
from jaxnet.networks import Direction, number_nodes
from jaxnet.networks.objects import label_of, object_network


def network(
    given: object,
    *,
    direction: Direction = "hears",
    first: int = 0,
    leader: object = None,
    names: Sequence[str] = (),
    label: str | None = None,
    leads: bool = True,
) -> Edges:
    """Make a topology of a matrix, or of a networkx graph with any labels.

    A networkx graph, a NumPy array or a SciPy sparse array is a topology as it is, by the defaults
    of this function, and with `leads` False where the study has `navigator: none`.

    Parameters
    ----------
    given
        A networkx graph, in which an edge (a, b) means "a hears b"; or a matrix, a NumPy array or a
        SciPy sparse array: (n, n), whose entry (i, j) is the weight with which node i hears node j,
        a Laplacian (n, n), or [a0 | A], (m, m + 1), whose column 0 is the navigator.
    direction
        "hears", or "tells": an edge (a, b) means "a tells b".
    first
        Number of the first node, 0 or 1, where nodes have numbers.
    leader
        Node of the navigator. Default: the first number, or the node called 0, navigator or leader.
    names
        Names of the m vehicles. Default: the labels of the nodes, where they are no numbers.
    label
        Name of the topology in a sweep. Default: the name of the networkx graph.
    leads
        Whether one node is the navigator. False: every node is a vehicle, for `navigator: none`.

    Returns
    -------
        A topology for `load`; vehicles are numbered 1 … m in the order of the nodes.

    Raises
    ------
    ConfigError
        If the object means no network; the message says why.

    Examples
    --------
    >>> import jaxnet, numpy as np
    >>> adjacency = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0]])  # node 2 hears nodes 0 and 1
    >>> jaxnet.network(adjacency, names=["ann", "bob"]).edges
    [(1, 0, 1.0), (2, 0, 1.0), (2, 1, 2.0)]
    >>> jaxnet.network(np.eye(3, k=1) + np.eye(3, k=-2), leads=False).edges  # a ring
    [(1, 2, 1.0), (2, 3, 1.0), (3, 1, 1.0)]
    """
    try:
        found = object_network(given, first)
        if found is None:
            raise KindError(
                f"a network is a matrix or a networkx graph (got {type(given).__name__})"
            )
        chosen = None if leader is None else label_of(leader)
        numbered = number_nodes(found, direction, first, chosen, names, leads)
        return edges_of_network(numbered, label or network_label(given), leads)
    except KindError as error:
        raise ConfigError([Problem("", "topology", str(error))]) from error
