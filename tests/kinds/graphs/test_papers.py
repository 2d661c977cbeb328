"""The paper's graphs, written out."""

import numpy as np
import pytest

from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.figure1 import Figure1
from jaxnet.kinds.graphs.path import Path
from jaxnet.kinds.graphs.star import Star
from jaxnet.model.graph import dense
from tests.matrices import matrix_of

FLEET = range(1, 13)
RING = {i: {0: 0.1, (i - 1) or 12: 0.45, i + 1 if i < 12 else 1: 0.45} for i in FLEET}
FIGURE_1 = {1: {0: 1.0}, 2: {1: 1.0}, 3: {2: 1.0}, 4: {0: 0.5, 5: 0.5}, 5: {0: 0.5, 4: 0.5}}


@pytest.mark.parametrize(
    ("graph", "rows"),
    [
        (Star(), {i: {0: 1.0} for i in FLEET}),
        (Cyclic(navigator_weight=0.1), RING),
        (Path(), {i: {i - 1: 1.0} for i in FLEET}),
        (Figure1(), FIGURE_1),
    ],
    ids=lambda each: getattr(each, "kind", ""),
)
def test_the_papers_graphs_have_the_papers_weights(graph, rows):
    expected = np.zeros((len(rows), len(rows) + 1))
    for listener, row in rows.items():
        for source, weight in row.items():
            expected[listener - 1, source] = weight
    np.testing.assert_array_equal(matrix_of(graph, len(rows)), expected)
    np.testing.assert_allclose(dense(graph.normalised_rows(len(rows))), expected, rtol=1e-15)
