"""Random regular graphs: what they are, whom a seed belongs to, and lanes that have their own."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxnet
from jaxnet.kinds.graphs.random_regular import RandomRegular
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model.patterns import drawn_regular
from tests import systems
from tests.matrices import matrix_of

REDRAWN = {"kind": "random_regular", "degree": 3, "redraw": True, "navigator_weight": 0.2}
KEYS = {
    "vehicles": 8,
    "horizon": 4.0,
    "tail": 1.0,
    "attack": {"vehicles": [2, 5], "magnitude": 3.0},
}


@given(st.integers(1, 12), st.integers(1, 11), st.integers(0, 2**32))
def test_it_is_simple_mutual_and_regular(vehicles, degree, seed):
    """The same for the same seed; the navigator's weight beside equal ones."""
    degree = min(degree, vehicles - 1)
    if degree == 0 or degree * vehicles % 2:
        return
    graph = RandomRegular(degree=degree, seed=seed, navigator_weight=0.25)
    weights = matrix_of(graph, vehicles)
    heard = weights[:, 1:] > 0
    assert not heard.diagonal().any()
    np.testing.assert_array_equal(heard, heard.T)
    assert (heard.sum(axis=1) == degree).all()
    assert (weights[:, 0] == 0.25).all()
    np.testing.assert_allclose(weights[:, 1:][heard], 0.75 / degree, rtol=1e-15)
    np.testing.assert_array_equal(matrix_of(graph, vehicles), weights)


def test_all_graphs_appear_and_none_much_more_often():
    """There are 70 labelled cubic graphs on six vertices (OEIS A002829)."""
    random = np.random.default_rng(1)
    found = Counter(drawn_regular(6, 3, random).toarray().tobytes() for _ in range(7000))
    assert len(found) == 70
    assert max(found.values()) < 2 * min(found.values())


def weights_of(samples, seed=0, **keys):
    """Each lane's graph: (lanes, m, m + 1)."""
    scenario = systems.study(engine="exact", topology=REDRAWN, **KEYS, **keys).cells[0].scenario
    one = job(scenario, Keyed(seed), samples)
    return np.stack([systems.lane(one, number).weights for number in range(len(samples))])


def test_a_lane_s_graph_belongs_to_seed_and_sample_alone():
    """Not to how many there are, in what order, or what else the study says."""
    many = weights_of(range(20))
    assert len({each.tobytes() for each in many}) == 20
    assert ((many[:, :, 1:] > 0).sum(axis=2) == 3).all()
    np.testing.assert_array_equal(weights_of([7, 3, 11]), many[[7, 3, 11]])
    np.testing.assert_array_equal(weights_of([5], gain=[2, 4, 4], defence="none"), many[5:6])
    assert not np.array_equal(weights_of(range(3), seed=1), many[:3])


@pytest.mark.parametrize(
    ("degree", "vehicles", "word"), [(5, 5, "less than the 5 vehicles"), (3, 5, "must be even")]
)
def test_what_cannot_be_is_said(degree, vehicles, word):
    """There is no such graph, and nobody looks for it for ever."""
    keys = {"vehicles": vehicles, "attack": "none"}
    with pytest.raises(jaxnet.ConfigError, match=word):
        jaxnet.load({"topology": {"kind": "random_regular", "degree": degree}, **keys})
