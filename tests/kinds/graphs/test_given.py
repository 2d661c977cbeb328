"""However a graph of one's own is given, it is the same graph."""

import numpy as np
import pytest
from scipy import sparse

from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.figure1 import Figure1
from jaxnet.kinds.graphs.path import Path
from jaxnet.kinds.graphs.star import Star
from jaxnet.kinds.kind import KindError
from jaxnet.model import graph
from tests import systems
from tests.matrices import links_of, matrix_of

WEIGHTS = np.array([[1.0, 0, 0, 0], [0.3, 0.6, 0, 0], [0.2, 0, 5.0, 0]])
GIVEN = {
    "dense": WEIGHTS,
    "list": WEIGHTS.tolist(),
    "csr": sparse.csr_array(WEIGHTS),
    "coo, not in order and in parts": sparse.coo_array(
        ([5.0, 0.2, 0.6, 0.3, 0.5, 0.5, 0.0], ([2, 2, 1, 1, 0, 0, 0], [2, 0, 1, 0, 0, 0, 3])),
        shape=(3, 4),
    ),
    "digraph": graph.of_matrix(WEIGHTS),
}


class Mine(Graph):
    kind = "mine"
    way: str = "dense"

    def weights(self, vehicles):
        return GIVEN[self.way]


@pytest.mark.parametrize("way", GIVEN)
def test_arrays_dense_and_sparse_are_one_graph(way):
    expected = WEIGHTS / WEIGHTS.sum(axis=1, keepdims=True)
    np.testing.assert_array_equal(graph.dense(Mine(way=way).normalised_rows(3)), expected)
    np.testing.assert_array_equal(links_of(Mine(way=way), 3), WEIGHTS > 0)
    keys = {"vehicles": 3, "attack": "none", "engine": "exact", "defence": "none"}
    given = systems.study(topology=Mine(way=way), **keys)
    np.testing.assert_array_equal(systems.lane(systems.lanes(given, 2), 1).weights, expected)


@pytest.mark.parametrize("way", GIVEN)
def test_one_of_another_size_is_refused(way):
    with pytest.raises(KindError, match=r"mine: weights must be \(4, 5\) numbers, none of them"):
        Mine(way=way).normalised_rows(4)


FLEET = range(1, 13)
RING = {i: {0: 0.1, (i - 1) or 12: 0.45, i + 1 if i < 12 else 1: 0.45} for i in FLEET}
FIGURE_1 = {1: {0: 1.0}, 2: {1: 1.0}, 3: {2: 1.0}, 4: {0: 0.5, 5: 0.5}, 5: {0: 0.5, 4: 0.5}}


@pytest.mark.parametrize(
    ("given", "rows"),
    [
        (Star(), {i: {0: 1.0} for i in FLEET}),
        (Cyclic(navigator_weight=0.1), RING),
        (Path(), {i: {i - 1: 1.0} for i in FLEET}),
        (Figure1(), FIGURE_1),
    ],
    ids=lambda each: getattr(each, "kind", ""),
)
def test_the_papers_graphs_have_the_papers_weights(given, rows):
    expected = np.zeros((len(rows), len(rows) + 1))
    for listener, row in rows.items():
        for source, weight in row.items():
            expected[listener - 1, source] = weight
    np.testing.assert_array_equal(matrix_of(given, len(rows)), expected)
    np.testing.assert_allclose(graph.dense(given.normalised_rows(len(rows))), expected, rtol=1e-15)
