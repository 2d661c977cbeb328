"""Networks as matrices: an adjacency matrix, a Laplacian, or the paper's [a0 | A]."""

import numpy as np
from scipy import sparse

from jaxnet.model import graph
from jaxnet.networks import GREATEST_EDGE_WEIGHT, NamedNetwork
from jaxnet.outside.modules import KindError

GivenMatrix = np.ndarray | sparse.coo_array

LAPLACIAN_ROUNDING = 1e-9  # of the greatest entry: how far from 0 a row of a Laplacian may sum


def matrix_network(given: GivenMatrix, first: int = 0) -> NamedNetwork:
    """Return the network of a matrix; entry (i, j) is the weight with which node i hears node j.

    A matrix is (n, n), and one of its nodes, numbered from `first`, may be the navigator; or it is
    [a0 | A], (m, m + 1), whose column 0 is the navigator. A square matrix with a negative entry is
    a Laplacian: its weights are −l_ij, j ≠ i. Raises KindError for another shape or entry, and for
    a node without an edge.
    """
    shape: tuple[int, ...] = given.shape or ()
    if len(shape) != 2 or shape[1] - shape[0] not in (0, 1):
        got = " × ".join(map(str, shape))
        raise KindError(
            f"a matrix is n × n, or m × (m + 1) with the navigator in column 0 (got {got})"
        )
    try:
        rows, columns, values = graph.entries(given)
        values = values.astype(float, casting="safe")
    except TypeError as error:
        raise KindError(f"a matrix has real numbers (got {given.dtype})") from error
    square = shape[0] == shape[1]
    if square and (values < 0).any():
        rows, columns, values = laplacian_links(rows, columns, values)
    if not (values > 0).all() or not (values <= GREATEST_EDGE_WEIGHT).all():
        wrong = int(np.flatnonzero(~((values > 0) & (values <= GREATEST_EDGE_WEIGHT)))[0])
        raise KindError(
            f"weights are 0 to {GREATEST_EDGE_WEIGHT:g}"
            f" (got {values[wrong]:g} in row {rows[wrong] + 1}, column {columns[wrong] + 1})"
        )
    shift = first if square else 1
    ends = (rows + shift).tolist(), (columns + shift - (not square)).tolist()
    alone = sorted(set(range(shift, shift + shape[0])).difference(*ends))
    if alone and len(values):
        raise KindError(f"node {alone[0]} has no edge")
    links = zip(map(str, ends[0]), map(str, ends[1]), values.tolist(), strict=True)
    return NamedNetwork((), list(links), None if square else "0")


def laplacian_links(
    rows: graph.Row, columns: graph.Row, values: np.ndarray
) -> tuple[np.ndarray, ...]:
    sums = np.bincount(rows, values)
    if np.abs(sums).max() > LAPLACIAN_ROUNDING * np.abs(values).max():
        row = int(np.abs(sums).argmax())
        raise KindError(
            f"a matrix with negative entries is a Laplacian, whose rows sum to 0"
            f" (row {row + 1} sums to {sums[row]:g})"
        )
    off = rows != columns
    return rows[off], columns[off], -values[off]
