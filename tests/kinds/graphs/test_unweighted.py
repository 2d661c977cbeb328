"""Graphs of a pattern: links against networkx, spectra, hearers of the navigator, weight rules."""

import networkx as nx
import numpy as np
import pytest

from jaxnet.kinds.graphs.circulant import Circulant
from jaxnet.kinds.graphs.complete import Complete
from jaxnet.kinds.graphs.erdos_renyi import ErdosRenyi
from jaxnet.kinds.graphs.grid import Grid
from jaxnet.kinds.graphs.lattice import Lattice
from jaxnet.kinds.graphs.small_world import SmallWorld
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from tests import systems
from tests.matrices import matrix_of

SIDES = ((3, 4), (4, 3), (1, 5), (5, 5))


def heard(graph, vehicles):
    return matrix_of(graph, vehicles)[:, 1:] > 0


@pytest.mark.parametrize(
    ("ours", "network"),
    [
        (Complete(), nx.complete_graph(7)),
        (Lattice(neighbours=2), nx.cycle_graph(9)),
        (Lattice(), nx.circulant_graph(9, [1, 2])),
        (Lattice(neighbours=8), nx.complete_graph(9)),
        (Circulant(offsets=[2, -2, 5, -5]), nx.circulant_graph(13, [2, 5])),
        (SmallWorld(neighbours=6, rewired=0.0), nx.watts_strogatz_graph(11, 6, 0.0)),
        (ErdosRenyi(probability=1.0), nx.gnp_random_graph(6, 1.0, directed=True)),
        *((Grid(rows=a, columns=b), nx.grid_2d_graph(a, b)) for a, b in SIDES),
        *((Grid(rows=a, columns=b, torus=True), nx.grid_2d_graph(a, b, True)) for a, b in SIDES),
    ],
    ids=lambda each: getattr(each, "kind", ""),
)
def test_links_are_those_of_networkx(ours, network):
    theirs = nx.to_numpy_array(network, nodelist=sorted(network)) > 0
    np.testing.assert_array_equal(heard(ours, len(network)), theirs)
    assert (matrix_of(ours, len(network))[:, 0] == 0.1).all()


def test_offsets_need_not_be_mutual():
    """Vehicle 1 of 5 hears 2 and 4."""
    found = np.argwhere(heard(Circulant(offsets=[1, 3]), 5))[:4]
    assert found.tolist() == [[0, 1], [0, 3], [1, 2], [1, 4]]


def test_a_share_is_drawn_by_the_seed_whatever_the_pattern():
    """Half of twelve are six; more of the same where the share is greater."""

    def informed(seed, share, kind=Complete):
        return set(np.flatnonzero(matrix_of(kind(navigator={"share": share}, seed=seed), 12)[:, 0]))

    assert [len(informed(seed, 0.5)) for seed in range(20)] == [6] * 20
    assert len({frozenset(informed(seed, 0.5)) for seed in range(20)}) > 15
    assert informed(3, 0.25) < informed(3, 0.5) < informed(3, 1.0) == set(range(12))
    assert informed(3, 0.5) == informed(3, 0.5, Lattice)


def test_who_hears_no_vehicle_hears_the_navigator_alone():
    """On a grid of one place, and a vehicle that no link was drawn for."""
    np.testing.assert_array_equal(matrix_of(Grid(rows=1, columns=1), 1), [[1.0, 0.0]])
    weights = matrix_of(ErdosRenyi(probability=0.2, seed=1), 8)
    alone = ~(weights[:, 1:] > 0).any(axis=1)
    assert alone.any()
    assert not alone.all()
    np.testing.assert_array_equal(weights[:, 0], np.where(alone, 1.0, 0.1))


def test_metropolis_weights_by_hand():
    """On a 2 × 3 grid 2 and 5 have three neighbours, so `1/(1 + 3)`; 1 and 4 two, `1/(1 + 2)`."""
    weights = matrix_of(Grid(rows=2, columns=3, weighting="metropolis"), 6)
    np.testing.assert_allclose(weights[0], [0.1, 0, 0.9 * 3 / 7, 0, 0.9 * 4 / 7, 0, 0], rtol=1e-15)
    np.testing.assert_allclose(weights[1], [0.1, 0.3, 0, 0.3, 0, 0.3, 0], rtol=1e-15)


@pytest.mark.parametrize("weighting", ["uniform", "metropolis"])
def test_a_drawn_weight_of_the_navigator_is_each_lane_s_own(weighting):
    """The lane's graph has this weight; a vehicle that does not hear the navigator stays."""
    keys = {"rows": 2, "columns": 3, "navigator": [1, 6], "weighting": weighting}
    drawn = {"kind": "grid", **keys, "navigator_weight": {"uniform": [0.2, 0.8]}}
    given = systems.study(topology=drawn, vehicles=6, engine="exact", attack="none")
    one = job(given.cells[0].scenario, Keyed(0), range(5))
    seen = np.stack([systems.lane(one, number).weights for number in range(5)])
    assert len(set(seen[:, 0, 0])) == 5
    assert ((seen[:, 0, 0] >= 0.2) & (seen[:, 0, 0] <= 0.8)).all()
    for weights in seen:
        expected = Grid(**keys, navigator_weight=float(weights[0, 0]))
        np.testing.assert_allclose(weights, matrix_of(expected, 6), rtol=1e-14)


def test_cells_share_a_graph_that_nobody_can_change():
    """One object for the same topology and fleet; each array refuses to be written into."""
    one = Lattice()
    for graph in (one.linked(9), one.normalised_rows(9)):
        for array in graph:
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1
    assert one.linked(9) is one.linked(9)
    assert one.linked(8).vehicles == 8
    assert Lattice().linked(9) is not one.linked(9)
