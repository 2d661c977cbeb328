"""A random number belongs to (seed, name, sample, vehicle, component), and to nothing else."""

import jax
import numpy as np
import pytest
from scipy import stats

from jaxnet.kinds import fields
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.uniforms import Keyed, slot
from tests import systems


def draw(number, seed, name, samples, vehicles, components=1):
    """Values of a number for each sample, vehicle and component."""
    places = [(vehicle, component) for vehicle in vehicles for component in range(components)]
    values = Draw(Keyed(seed), samples, 0).placed([number] * len(places), name, places)
    return values.reshape(len(samples), len(vehicles), components)


def test_a_draw_does_not_depend_on_who_is_drawn_beside_it():
    """Not on the number of samples, nor on which vehicles or components are drawn."""
    uniform = fields.Uniform(uniform=[-1.0, 1.0])
    whole = draw(uniform, 7, "initial.position", range(600), range(1, 13), 2)
    part = draw(uniform, 7, "initial.position", [599, 3], [12, 2], 1)
    np.testing.assert_array_equal(part[:, :, 0], whole[[599, 3]][:, [11, 1], 0])


def test_seed_name_sample_vehicle_and_component_each_matter():
    """All draws of several keys are different numbers."""
    uniform = fields.Uniform(uniform=[0.0, 1.0])
    drawn = [
        draw(uniform, seed, name, range(50), range(1, 13), 2)
        for seed in (0, 1, 2**40)
        for name in ("initial.position", "initial.speed")
    ]
    assert len(np.unique(drawn)) == np.size(drawn)


@pytest.mark.parametrize(
    ("number", "distribution"),
    [
        (fields.Uniform(uniform=[2.0, 5.0]), stats.uniform(2, 3)),
        (fields.Normal(normal=[1.0, 2.0]), stats.norm(1, 2)),
    ],
)
def test_draws_follow_their_distribution(number, distribution):
    """Kolmogorov and Smirnov, 20,000 draws; each is the inverse of the same uniform number."""
    values, uniform = (
        draw(each, 0, "attack.magnitude", range(20_000), [0])[:, 0, 0]
        for each in (number, fields.Uniform(uniform=[0.0, 1.0]))
    )
    assert stats.kstest(values, distribution.cdf).pvalue > 1e-3
    np.testing.assert_allclose(distribution.cdf(values), uniform, atol=1e-12)
    three = draw(fields.DiscreteChoice(choice=[1.0, 5.0, 9.0]), 0, "x", range(20_000), [0])
    listed, counts = np.unique(three, return_counts=True)
    assert listed.tolist() == [1.0, 5.0, 9.0]
    assert stats.chisquare(counts).pvalue > 1e-3


def test_cells_share_their_draws():
    """Sample s starts alike and is attacked in the same phase whatever is swept."""
    sweep = {"attack.magnitude": [1, 9], "gain": [[1, 3, 3], [6, 11, 6]]}
    cells = [one.inputs.lane for one in systems.lanes(systems.study(sweep=sweep), 3).jobs]
    initial = [lane.initial for lane in cells]
    phases = [np.arctan2(*lane.vectors[:, ::-1, :, 0].swapaxes(0, 1)) for lane in cells]
    for cell in range(1, 4):
        np.testing.assert_array_equal(initial[cell], initial[0])
        np.testing.assert_allclose(phases[cell], phases[0], atol=1e-14)
    for drawn in (initial[0], phases[0]):
        assert not np.array_equal(drawn[0], drawn[1])


def test_initial_states_are_in_their_ranges():
    """model.md: positions, headings, speeds, and ω = F = 0."""
    initial = systems.lanes(systems.study(), 200).inputs.lane.initial
    for column, (low, high) in enumerate([(-200, 200), (-200, 200), (-np.pi, np.pi), (0.2, 0.4)]):
        assert low <= initial[:, column].min() < low + 0.02 * (high - low)
        assert high - 0.02 * (high - low) < initial[:, column].max() <= high
    assert not initial[:, 4:].any()


RECORDED = {  # samples 0 and 599, seed 2⁴⁰
    ("initial.position", 12, 1): ("0x1.b6420d40d631ep-1", "0x1.c60ef9dd69196p-1"),
    ("attack.phase", 9999, 0): ("0x1.9129638b7ab32p-1", "0x1.09379be81f5fep-1"),
    ("attack.magnitude", 0, 0): ("0x1.68e8d4f528ff8p-5", "0x1.b8e0319691938p-5"),
}


@pytest.mark.parametrize(("place", "recorded"), RECORDED.items(), ids=lambda each: str(each[0]))
def test_draws_are_what_they_were(place, recorded):
    """To the last bit, or a folder that is extended would mix two studies."""
    name, vehicle, component = place
    drawn = Keyed(2**40).uniforms(name, [0, 599], [(vehicle, component)])
    assert [value.hex() for value in drawn[:, 0].tolist()] == list(recorded)


def test_every_place_has_a_slot_of_its_own():
    """Of 10,000 vehicles and as many sources, each below 2³²; all vehicles by a few components."""
    components = [*range(9), 4999, *range(9990, 10_001)]
    slots = {slot(vehicle, component) for vehicle in range(10_001) for component in components}
    assert len(slots) == 10_001 * len(components)
    assert min(slots) >= 0
    assert max(slots) < 2**32


EDGES = [[1, 0, 1], [2, 0, 1], [2, 1, 2], [2, 3, 3], [3, 1, 4], [3, 2, 5], [3, 0, 6]]
SMALL = {"vehicles": 3, "attack": {"vehicles": [2]}}


def everything(of):
    """Studies with all numbers of a lane made by `of`: a ring, and a digraph solved exactly."""
    both = {"gain": [of(1.0), of(3.0), of(3.0)], "defence": {"tolerance": of(1e-6)}}
    ring = {
        "topology": {"navigator_weight": of(0.1)},
        "engine": {"rtol": of(1e-6), "atol": of(1e-8)},
    }
    edges = [[i, j, of(float(weight))] for i, j, weight in EDGES]
    exact = {**SMALL, "topology": {"kind": "edges", "edges": edges}, "engine": "exact"}
    return systems.study(**both, **ring), systems.study(**both, **exact)


def test_a_distribution_of_one_value_is_that_number():
    """Of each quantity that may be one, so each reaches its place; to rounding."""
    for drawn, given in zip(everything(lambda x: {"choice": [x]}), everything(float), strict=True):
        ours, theirs = systems.lanes(drawn, 3), systems.lanes(given, 3)
        assert ours.plan == theirs.plan
        for one, other in zip(jax.tree.leaves(ours[:2]), jax.tree.leaves(theirs[:2]), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-15)


def test_lanes_are_the_same_however_many_there_are():
    """To the last bit, and they differ from each other in every number that is drawn."""
    for study in everything(lambda x: {"uniform": [x, 1.1 * x]}):
        few, many = (systems.lanes(study, samples).inputs for samples in (3, 300))
        for one, other in zip(jax.tree.leaves(few), jax.tree.leaves(many), strict=True):
            np.testing.assert_array_equal(one, other[:3])
        lane = many.lane
        for drawn in (
            *lane.gain.T,
            lane.weights,
            lane.defence.tolerance,
            *(many.numbers or ())[:2],
        ):
            assert len(np.unique(drawn, axis=0)) == 300


def test_k0_k1_and_k2_are_drawn_apart():
    """Independent of each other, and each like the first component of its own."""
    gain = systems.lanes(systems.study(gain=[{"uniform": [k, k + 1]} for k in (1, 3, 4)]), 2000)
    u = gain.inputs.lane.gain - [1, 3, 4]
    assert (u > 0).all()
    assert (u < 1).all()
    assert np.abs(np.corrcoef(u.T) - np.eye(3)).max() < 0.08
    middle = systems.lanes(systems.study(gain=[1, {"uniform": [3, 4]}, 4]), 2000).inputs.lane.gain
    np.testing.assert_array_equal(
        middle, np.stack([np.full(2000, 1.0), 3 + u[:, 1], np.full(2000, 4.0)], 1)
    )


def test_an_edge_s_number_belongs_to_the_edge():
    """Not to its place in the list, nor to what other listeners hear; each is another number."""

    def ratios(edges):
        """Weights of 3 over that of the navigator, which is not drawn."""
        drawn = [[*link, {"uniform": [1, 2]} if link[1] else 1] for link in edges]
        graph = {"kind": "edges", "edges": drawn}
        given = systems.study(vehicles=3, attack="none", topology=graph)
        navigator, *others = systems.lanes(given, 20).inputs.lane.weights[:, :3, 2].T
        return np.array(others) / navigator

    listed = [[1, 0], [2, 0], [3, 0], [3, 1], [3, 2]]
    drawn = ratios(listed)
    np.testing.assert_allclose(ratios(listed[::-1]), drawn, rtol=1e-15)
    np.testing.assert_allclose(ratios([[1, 2], *listed, [2, 1]]), drawn, rtol=1e-15)
    assert len(np.unique(drawn[(drawn >= 1) & (drawn <= 2)])) == 40


# --- positions that a config lists ----------------------------------------------------------------

PLACED = {"vehicles": 3, "engine": "exact", "attack": "none", "defence": "none"}


def test_each_vehicle_starts_at_its_place():
    """A pair is a place, a number a place on the line y = 0; others are drawn."""
    listed = [7.0, [2, -3], [{"uniform": [0, 1]}, 5.0]]
    sweep = {"initial.position": [listed, {"uniform": [10.0, 11.0]}]}
    jobs = systems.lanes(systems.study(**PLACED, sweep=sweep), 2).jobs
    found, drawn = (job.inputs.lane.initial[:, :2].transpose(0, 2, 1) for job in jobs)
    np.testing.assert_array_equal(found[:, :2], [[[7.0, 0.0], [2.0, -3.0]]] * 2)
    np.testing.assert_array_equal(found[:, 2, 1], 5.0)
    assert ((found[:, 2, 0] > 0) & (found[:, 2, 0] < 1)).all()
    assert np.ptp(found[:, 2, 0]) > 0
    assert (drawn >= 10.0).all()
