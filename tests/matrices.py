"""Graphs and their links as matrices over (listener, source), for plain programs."""

import numpy as np

from jaxnet.model import graph


def matrix_of(kind, vehicles):
    """The weights of a kind of graph."""
    return graph.dense(kind.weights(vehicles))


def links_of(kind, vehicles):
    """The links that some lane of a kind of graph may have."""
    return graph.dense(kind.linked(vehicles)) > 0


def whole(network, links):
    """Some links of a graph."""
    rows, slots = np.nonzero(links)
    found = np.zeros((network.vehicles, network.vehicles + 1), bool)
    found[rows, network.sources[rows, slots]] = True
    return found


def slotwise(network, matrix):
    """What a matrix has of a graph's links, as the graph has its own."""
    return np.take_along_axis(matrix, network.sources, axis=1)


def slots_of(matrix):
    """Sources of the listeners of a matrix: (slots, m)."""
    return graph.of_matrix(matrix).sources.T


def by_slot(matrix, sources):
    """What a matrix (m, n, …) has of links: (slots, m, …)."""
    return matrix[np.arange(sources.shape[1])[None], sources]
