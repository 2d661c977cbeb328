"""What a network promises: known norms, the paper's scenarios, and what breaks whom."""

import numpy as np
import pytest

from jaxnet.kinds.attacks.bias import Bias
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.path import Path
from jaxnet.kinds.graphs.star import Star
from jaxnet.model import graph
from jaxnet.theory.certificate import certify, joint_reach, margin
from jaxnet.view.text.check import check_text
from tests import reference, systems
from tests.reference import navigator_at

ATTACKED = [2, 5, 8, 11]
STAR, CYCLIC, PATH = (
    Star().weights(12),
    Cyclic(navigator_weight=0.1).weights(12),
    Path().weights(12),
)


def certificate(weights, attacked=()):
    """Certificate of a graph where these vehicles are attacked."""
    return certify(weights, Bias(vehicles=list(attacked)).attacked_links(weights))


@pytest.mark.parametrize(
    ("weights", "norm", "links", "all_attacked", "cut_off"),
    [
        (STAR, 1.0, 4, ATTACKED, ATTACKED),
        # a triangle of ones: 1 / (2 sin(π / (4m + 2)))
        (PATH, 1 / (2 * np.sin(np.pi / 50)), 4, [3, 6, 9, 12], [*range(3, 13)]),
        (CYCLIC, 10.0, 8, [], []),  # symmetric, and L 1 = 0.1 · 1 is its least eigenvalue
    ],
)
def test_the_papers_networks(weights, norm, links, all_attacked, cut_off):
    found = certificate(weights, ATTACKED)
    assert found.inverse_norm == pytest.approx(norm, rel=1e-12)
    assert (len(found.attacked_links), found.unreachable) == (links, [])
    assert (found.all_attacked, found.cut_off) == (all_attacked, cut_off)


def test_of_large_fleets_no_inverse_is_made():
    assert certificate(Path().weights(1001)).inverse_norm is None


@pytest.mark.parametrize(
    "edges",
    [
        [(1, 0, 1.0), (2, 1, 1.0), (3, 4, 1.0), (4, 3, 1.0)],  # L singular
        [(1, 0, 1.0), (2, 1, 1.0), (4, 3, 1.0)],  # 3 hears nobody, and L is regular
    ],
)
def test_vehicles_that_nothing_reaches_make_the_norm_infinite(edges):
    found = certificate(graph.weighted(4, edges))
    assert found.unreachable == [3, 4]
    assert found.inverse_norm == np.inf


def test_what_breaks_whom():
    """1 bears one liar of {2, 3, 4}, 5 none of {4}; what 6 believes nobody can touch."""

    def safe(attacked):
        return np.array(
            [len({2, 3, 4} & {*attacked}) < 2, True, True, True, 4 not in attacked, True]
        )

    found = margin(safe, [2, 4, 6], 6)
    assert found.sets == [[(2, 4)], [], [], [], [(4,)], []]
    assert found.further.tolist() == [0, 4, 4, 4, 0, 4]
    assert margin(safe, [2], 6).further.tolist() == [1, 4, 4, 4, 1, 4]
    assert margin(safe, [6], 6).further.tolist() == [2, 4, 4, 4, 1, 4]


TURNS = [
    [[i, 0, 1] for i in range(1, 7)],
    [[1, 0, 1], [2, 1, 1], [3, 2, 1], [4, 5, 1], [5, 4, 1], [6, 3, 1], [6, 4, 1]],
]


def test_joint_reach_is_that_of_powers_of_matrices():
    """Random networks in turn: reach by powers; by brute force the greatest set hearing itself."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        heard = rng.uniform(size=(2, 5, 6)) < 0.3
        heard[:, np.arange(5), np.arange(1, 6)] = False
        networks = [graph.of_links(5, *np.nonzero(each)) for each in heard]
        steps = [
            np.vstack([np.eye(6)[:1], each + np.eye(5, 6, 1)])
            for each in (*heard, heard.any(axis=0))
        ]
        first, second, union = (np.linalg.matrix_power(each, 6)[1:, 0] > 0 for each in steps)
        always = first & second
        sets = [np.array([number >> i & 1 for i in range(5)], bool) for number in range(32)]
        inside = [
            s for s in sets if (s <= always).all() and not heard[:, s][:, :, 1:][:, :, ~s].any()
        ]
        nominal = max(inside, key=lambda s: s.sum())
        known = [(np.flatnonzero(each) + 1).tolist() for each in (union, always, nominal)]
        assert list(joint_reach(networks)) == known


def test_certain_vehicles_move_as_on_a_star_and_others_do_not():
    """Vehicle 6 is reached in each network, and hears 4, which keeps its last drive in one."""
    topology = {
        "kind": "switching",
        "every": 2.0,
        "networks": [{"kind": "edges", "edges": e} for e in TURNS],
    }
    keys = {"vehicles": 6, "engine": "exact", "attack": "none", "defence": "none", "horizon": 4.0}
    keys |= {"tail": 1.0}
    one = systems.lanes(systems.study(**keys, topology=topology), 1)
    lane, path = systems.lane(one, 0), navigator_at(one, 0)
    known = reference.nominal(path, lane.gain, reference.flat_jets(lane.initial.T), [4.0])[0]
    apart = np.abs(systems.simulate(one).series["state"][0, -1, :, :2] - known).max(axis=1)
    assert apart[:3].max() < 1e-9
    assert apart[3:].min() > 0.01
    told = " ".join(check_text(systems.study(**keys, topology=topology)).split())
    assert "reaches every vehicle in the union and 1-3, 6 in each of them" in told
    assert "O1 holds of 1-3, of others nothing is known" in told
