"""Which links an attack holds: those of each channel, against plain sets, and the paper's."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.kinds.attacks.bias import Bias
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.path import Path
from jaxnet.kinds.graphs.star import Star
from tests.model.test_graph import digraphs, links, marked, weights_of


@given(digraphs(), st.frozensets(st.integers(1, 5)))
def test_attacked_links_of_each_channel(heard, attackers):
    weights = weights_of(heard)
    transmitted = {(i, j) for i, j in links(heard) if j in attackers}
    received = {(i, j) for i, j in links(heard) if j == 0 and i in attackers}
    vehicles_talk = any(j > 0 for _, j in links(heard))

    def attacked(channel):
        return marked(
            weights, Bias(vehicles=sorted(attackers), links=channel).attacked_links(weights)
        )

    assert attacked("neighbour") == transmitted
    assert attacked("navigator") == received
    assert attacked("auto") == (transmitted if vehicles_talk else received)


@pytest.mark.parametrize(
    ("graph", "expected"),
    [
        (Star(), {(2, 0), (5, 0), (8, 0), (11, 0)}),
        (Path(), {(3, 2), (6, 5), (9, 8), (12, 11)}),
        (Cyclic(), {(1, 2), (3, 2), (4, 5), (6, 5), (7, 8), (9, 8), (10, 11), (12, 11)}),
    ],
)
def test_attacked_links_of_the_papers_scenarios(graph, expected):
    weights = graph.weights(12)
    assert marked(weights, Bias().attacked_links(weights)) == expected
