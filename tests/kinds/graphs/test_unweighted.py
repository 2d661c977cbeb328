"""Graphs of a pattern: links against networkx, spectra, hearers of the navigator, weight rules."""

import networkx as nx
import numpy as np
import pytest

import jaxnet
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


@pytest.mark.parametrize(
    ("topology", "vehicles", "says"),
    [
        ("{kind: lattice, neighbours: 3}", 12, "neighbours: must be a multiple of 2 (got 3)"),
        ("{kind: lattice, neighbours: 6}", 6, "must be less than the 6 vehicles (got 6)"),
        ("{kind: small_world, neighbours: 8}", 6, "neighbours: must be less than the 6 vehicles"),
        ("{kind: small_world, rewired: 2}", 6, "topology.rewired: must be at most 1 (got 2)"),
        ("{kind: circulant, offsets: [1, 6]}", 6, "topology.offsets: must lead to other vehicles"),
        ("{kind: circulant, offsets: [1, -5]}", 6, "around 6 (got [1, -5])"),
        ("{kind: circulant, offsets: []}", 6, "offsets: must have at least 1 entry (got [])"),
        ("{kind: grid, rows: 3, columns: 4}", 10, "must be the 10 vehicles (got 3 × 4)"),
        ("{kind: erdos_renyi, probability: 0}", 6, "must be greater than 0 (got 0)"),
        ("{kind: random_regular, degree: 5}", 5, "less than the 5 vehicles"),
        ("{kind: random_regular, degree: 3}", 5, "must be even"),
        ("{kind: complete, navigator: [7]}", 6, "navigator: vehicles are 1 to 6 (got 7)"),
        ("{kind: complete, navigator: []}", 6, "the navigator does not reach 1, 2, 3"),
        ("{kind: circulant, offsets: [2, -2], navigator: [1]}", 6, "does not reach 2, 4, 6"),
        ("{kind: complete, navigator: some}", 6, "must be all, a list of vehicles or {share: s}"),
        ("{kind: complete, navigator: 3}", 6, "a list of vehicles or {share: s} (got 3)"),
        ("{kind: complete, navigator: {share: 0}}", 6, "share: must be greater than 0 (got 0)"),
        ("{kind: complete, navigator: {share: 0.01}}", 6, "in none of 1000 draws"),
        ("{kind: complete, weighting: equal}", 6, "must be 'uniform' or 'metropolis'"),
    ],
)
def test_what_cannot_be_is_said(topology, vehicles, says, tmp_path):
    file = tmp_path / "bad.yaml"
    file.write_text(f"name: bad\nvehicles: {vehicles}\nattack: none\ntopology: {topology}\n")
    with pytest.raises(jaxnet.ConfigError) as raised:
        jaxnet.load(file)
    (problem,) = raised.value.problems
    assert says in str(problem)
    assert problem.place.startswith(f"{file}:")


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
