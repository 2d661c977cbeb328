"""What a network promises: known norms, the paper's scenarios, networks in turn, and margins."""

from itertools import combinations

import numpy as np
import pytest

from jaxnet.config.scenario import Situation
from jaxnet.model import graph
from jaxnet.theory import certificate
from jaxnet.theory.case import Case
from jaxnet.theory.safe import margin
from jaxnet.theory.solution import decay
from jaxnet.view.text.check import check_text
from tests import reference, systems
from tests.reference import navigator_at

ATTACKED = [2, 5, 8, 11]
APART = {  # of which the navigator reaches 1 and 2
    "L singular": [[1, 0, 1], [2, 1, 1], [3, 4, 1], [4, 3, 1]],
    "L regular": [[1, 0, 1], [2, 1, 1], [4, 3, 1]],  # 3 hears nobody
}


def case_of(**keys):
    """The case of a study of one cell."""
    return Case(systems.study(**keys).cells[0].scenario, 5.0)


@pytest.mark.parametrize(
    ("topology", "norm", "all_attacked", "cut_off"),
    [
        ("star", 1.0, ATTACKED, ATTACKED),
        # a triangle of ones: 1 / (2 sin(π / (4m + 2)))
        ("path", 1 / (2 * np.sin(np.pi / 50)), [3, 6, 9, 12], [*range(3, 13)]),
        ("cyclic", 10.0, [], []),  # symmetric, and L 1 = 0.1 · 1 is its least eigenvalue
    ],
)
def test_the_papers_networks(topology, norm, all_attacked, cut_off):
    case = case_of(topology=topology, attack={"kind": "bias", "vehicles": ATTACKED})
    assert certificate.inverse_norm_of(case) == pytest.approx(norm, rel=1e-12)
    assert certificate.honest_paths(case) == (cut_off, cut_off, all_attacked)


@pytest.mark.parametrize("edges", APART.values(), ids=APART)
def test_vehicles_that_nothing_reaches_make_the_norm_infinite(edges):
    case, network = case_of(vehicles=4, attack="none"), graph.weighted(4, map(tuple, edges))
    case.situation = Situation(network, network.none, network.none, None)
    assert certificate.inverse_norm_of(case) == np.inf
    assert certificate.honest_paths(case).cut_off == [3, 4]


def test_of_large_fleets_no_inverse_is_made():
    assert certificate.inverse_norm_of(case_of(topology="path", vehicles=1001)) is None


def test_what_breaks_whom():
    """1 bears one liar of {2, 3, 4}, 5 none of {4}; what 6 believes nobody can touch."""

    def safe(attacked):
        few = len({2, 3, 4} & {*attacked}) < 2
        return np.array([few, True, True, True, 4 not in attacked, True])

    found = margin(safe, [2, 4, 6], 6)
    assert found.sets == [[(2, 4)], [], [], [], [(4,)], []]
    assert found.further.tolist() == [0, 4, 4, 4, 0, 4]
    assert margin(safe, [2], 6).further.tolist() == [1, 4, 4, 4, 1, 4]
    assert margin(safe, [6], 6).further.tolist() == [2, 4, 4, 4, 1, 4]


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
        assert list(certificate.joint_reach(networks)) == known


def test_certain_vehicles_move_as_on_a_star_and_others_do_not():
    """Vehicle 6 is reached in each network, and hears 4, which keeps its last drive in one."""
    star = [[i, 0, 1] for i in range(1, 7)]
    other = [[1, 0, 1], [2, 1, 1], [3, 2, 1], [4, 5, 1], [5, 4, 1], [6, 3, 1], [6, 4, 1]]
    networks = [{"kind": "edges", "edges": edges} for edges in (star, other)]
    keys = {"vehicles": 6, "engine": "exact", "attack": "none", "defence": "none", "horizon": 4.0}
    keys |= {"tail": 1.0, "topology": {"kind": "switching", "every": 2.0, "networks": networks}}
    one = systems.lanes(systems.study(**keys), 1)
    lane, path = systems.lane(one, 0), navigator_at(one, 0)
    known = reference.nominal(path, lane.gain, reference.flat_jets(lane.initial.T), [4.0])[0]
    apart = np.abs(systems.simulate(one).series["state"][0, -1, :, :2] - known).max(axis=1)
    assert apart[:3].max() < 1e-9
    assert apart[3:].min() > 0.01
    told = " ".join(check_text(systems.study(**keys)).split())
    assert "reaches every vehicle in the union and 1-3, 6 in each of them" in told
    assert "O1 holds of 1-3, of others nothing is known" in told


def test_nothing_is_told_of_own_gains_where_weights_may_switch():
    """Lemma 1 holds of local errors, which jump where weights do."""
    own = [[1, 3, 3], [27, 27, 9]] * 3
    trimmed, open_to_all = (
        decay(case_of(vehicles=6, topology="cyclic", gain={"vehicles": own}, defence=defence))
        for defence in ("trusted_trim", "none")
    )
    assert trimmed is None
    assert len(open_to_all.norms) == 6


def drawn_network(random):
    """Five vehicles, each link with probability 0.4."""
    pairs = [(i, j) for i in range(1, 6) for j in range(6) if i != j and random.random() < 0.4]
    return graph.weighted(5, [(*pair, 1.0) for pair in pairs] or [(1, 0, 1.0)])


def test_the_least_wrong_cuts_are_those_of_all_subsets():
    """Of drawn networks: no fewer links part a vehicle, and some so few do."""
    random = np.random.default_rng(0)
    for _ in range(20):
        network = drawn_network(random)
        rows, slots = network.edges()
        parted = np.full(5, len(rows) + 1)
        for size in range(4):
            for some in combinations(range(len(rows)), size):
                kept = network.heard.copy()
                kept[rows[[*some]], slots[[*some]]] = False
                gone = np.isinf(graph.hops(network.only(kept)))
                parted = np.where(gone, np.minimum(parted, size), parted)
        found = certificate.least_cuts(network)
        few = np.minimum(parted, found) < 4
        np.testing.assert_array_equal(found[few], parted[few])


def test_a_cut_both_ways_takes_the_answer_too():
    random = np.random.default_rng(1)
    for _ in range(20):
        network = drawn_network(random)
        cut = network.heard & (random.random(network.heard.shape) < 0.3)
        gone = {*network.only(cut).pairs()}
        gone |= {(source - 1, listener + 1) for listener, source in gone if source}
        left = {*network.pairs()} - gone
        assert {*certificate.without_answers(network, cut).pairs()} == left


CUTTING = {
    "engine": "exact",
    "defence": "none",
    "channel": {"noise": {"position": 0.1}},
    "detector": {"kind": "chi_squared", "cuts": "link"},
}


@pytest.mark.parametrize(
    ("keys", "known"),
    [
        # 3 hears 1 alone of the vehicles on the path from the navigator: 2 is behind it
        ({"topology": "path", "vehicles": 3, "attack": {"vehicles": [2]}}, ([3], 1, [1, 2])),
        # on the ring each hears the navigator and two: three links part it, one less beside a liar
        ({"vehicles": 6, "attack": {"vehicles": [1]}}, ([], 2, [2, 6])),
        ({"vehicles": 6, "attack": "none"}, ([], 3, [1, 2, 3, 4, 5, 6])),
        ({"vehicles": 6, "attack": {"vehicles": {"random": 1}}}, ([], 2, [1, 2, 3, 4, 5, 6])),
        ({"vehicles": 24, "attack": {"vehicles": {"random": 7}}}, (None, 0, [])),
    ],
)
def test_who_is_left_where_all_attacked_links_are_cut(keys, known):
    assert certificate.isolation(case_of(**CUTTING | keys)) == known


def test_a_liar_that_is_cut_both_ways_hears_the_navigator_alone():
    detector = CUTTING["detector"] | {"cuts": "both_ways"}
    keys = CUTTING | {"detector": detector, "vehicles": 6, "attack": {"vehicles": [1]}}
    assert certificate.isolation(case_of(**keys)) == ([], 1, [1])
    assert certificate.isolation(case_of(**keys | {"detector": "chi_squared"})) is None
