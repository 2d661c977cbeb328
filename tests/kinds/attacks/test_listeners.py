"""Lies that differ by listener, attackers drawn for each lane, and sybils: exact answers."""

import numpy as np
import pytest

import jaxnet
from jaxnet.config.document import ConfigError
from jaxnet.statistics import limits
from tests import reference, systems
from tests.kinds.attacks.test_threat import rows_of
from tests.matrices import slots_of
from tests.reference import march, navigator_at

ATTACKED = [2, 5, 8, 11]


def test_each_listener_is_told_its_own():
    """As the plain program that adds to every link what that link carries; no two are told the same."""
    attack = {"kind": "rotating", "magnitude": 3.0, "listeners": "each"}
    study = systems.study(engine="exact", attack=attack, defence="none", horizon=12.0, tail=1.0)
    one = systems.lanes(study, 2)
    outcome = systems.simulate(one)
    times = np.arange(121) * 0.1
    for number in range(2):
        lane, navigator = systems.lane(one, number), navigator_at(one, number)
        links = [(i, j) for i, j in np.argwhere(lane.weights > 0) if j in ATTACKED]
        slots = slots_of(lane.weights)
        told = {
            (i, j): lane.vectors[:, i * len(slots) + int(np.flatnonzero(slots[:, i] == j)[0])]
            for i, j in links
        }
        assert len({tuple(np.round(each.ravel(), 9)) for each in told.values()}) == len(links) == 8

        def added(t, lane=lane, told=told):
            found, basis = (
                np.zeros((3, 12, 13, 2)),
                np.asarray(lane.signal.basis(np.asarray(t)))[:3],
            )
            for (i, j), vectors in told.items():
                found[:, i, j] = basis @ vectors.T
            return found

        start = reference.flat_jets(lane.initial.T) - navigator(0.0)[:3, None]
        held = np.stack([lane.weights] * 2), added
        known = march(
            lambda *_, held=held: held, np.ones((12, 13), bool), lane.gain, start, 0.1, 120
        )
        path = np.stack([navigator(t)[0] for t in times])
        ours = outcome.series["state"][number, :, :, :2] - path[:, None]
        assert np.abs(ours - known[:, 0]).max() <= 1e-8
        first = {j: min(i for i, k in links if k == j) for j in ATTACKED}  # whose lie is shown
        for j in ATTACKED:
            shown = outcome.series["attack"][number, 30, j - 1]
            np.testing.assert_allclose(shown, added(3.0)[0, first[j], j], rtol=0, atol=1e-9)
    assert limits.violations_table(systems.results_of(study, rows_of(study, outcome, 2))).empty


def test_attackers_are_drawn_for_each_lane_and_for_all_cells_alike():
    """Four of twelve in each of 200 lanes, everybody about as often; the same in cells that differ in ā."""
    attack = {"kind": "bias", "vehicles": {"random": 4}, "magnitude": 5.0}
    keys = {"defence": "none", "engine": "exact", "horizon": 2.0, "tail": 1.0}
    study = systems.study(attack=attack, sweep={"attack.magnitude": [5.0, 2.0]}, **keys)
    one = systems.lanes(study, 200)
    sets = [np.abs(job.inputs.lane.vectors).max(axis=(1, 3)) > 0 for job in one.jobs]
    assert (sets[0].sum(axis=1) == 4).all()
    np.testing.assert_array_equal(*sets)
    share = sets[0].mean(axis=0)
    assert np.abs(share - 1 / 3).max() < 4 * np.sqrt(2 / 9 / 200)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    attacked = np.abs(outcome.series["attack"][:200, 5]).max(axis=2) > 0
    np.testing.assert_array_equal(attacked, sets[0])


def test_drawn_attackers_that_replace_do_what_they_do_if_they_are_named():
    """Lane by lane: where vehicles are, what is told, whom they retain, and who is attacked differs."""
    attack = {"kind": "rotating", "magnitude": 3.0, "threat": "replaces"}
    keys = {"engine": "exact", "defence": "trusted_trim", "horizon": 12.0, "tail": 1.0}
    drawn = systems.study(attack=attack | {"vehicles": {"random": 3}}, **keys)
    outcome = systems.simulate(systems.lanes(drawn, 2))
    assert (outcome.status == 0).all()
    sets = [np.flatnonzero(said.any(axis=(0, 2))) + 1 for said in outcome.series["attack"]]
    assert [len(each) for each in sets] == [3, 3]
    assert set(sets[0]) != set(sets[1])
    for number, chosen in enumerate(sets):
        named = systems.study(attack=attack | {"vehicles": chosen.tolist()}, **keys)
        known = systems.simulate(systems.lanes(named, 2))
        assert known.switches[number] == outcome.switches[number]
        for each in ("state", "attack", "kept"):
            apart = np.abs(outcome.series[each][number] - known.series[each][number])
            assert apart[..., :2].max() <= 1e-9, each


def test_a_bound_holds_whoever_is_drawn_to_be_replaced():
    """The peak gain, of all sources as if all were; the static bound is not told."""
    attack = {"kind": "bias", "vehicles": {"random": 4}, "magnitude": 5.0, "threat": "replaces"}
    keys = {"defence": "none", "engine": "exact", "horizon": 40.0, "tail": 1.0}
    study = systems.study(attack=attack, **keys)
    outcome = systems.simulate(systems.lanes(study, 8, ()))
    assert limits.unchecked_cells(study.cells) == {}
    assert limits.violations_table(systems.results_of(study, rows_of(study, outcome, 8))).empty
    known = limits.bounds_of(study.cells[0].scenario)
    assert np.isnan(known["static"].vehicles).all()
    np.testing.assert_allclose(known["peak_gain"].vehicles, 8.0 * 0.9, rtol=1e-12)
    assert 0.5 * 5.0 < outcome.metrics["tail_max"].max() <= 0.9 * 5.0 + 1e-6


def test_sybils_outvote_the_trimming():
    """Two of one mind with ϑ = 1: one of them stays, and the ring ends where a plain solve says."""
    attack = {"kind": "bias", "magnitude": 2.0, "sybils": 1}
    keys = {"horizon": 60.0, "tail": 0.0, "tick": 0.1, "engine": "exact"}
    study = systems.study(attack=attack, defence="trusted_trim", **keys)
    outcome = systems.simulate(systems.lanes(study, 2, ()))
    weights, added = np.zeros((12, 13)), np.zeros(12)
    for i in range(1, 13):
        for j in ((i - 2) % 12 + 1, i % 12 + 1):
            weights[i - 1, j] = 0.45
            added[i - 1] += 0.45 * (j in ATTACKED)
        if not {(i - 2) % 12 + 1, i % 12 + 1} & set(ATTACKED):
            weights[i - 1, (i - 2) % 12 + 1] = (
                0.0  # of honest ones, all on the navigator, either is dropped
            )
        weights[i - 1, 0] = 0.1
    total = weights.sum(axis=1, keepdims=True)
    known = 2.0 * np.linalg.solve(np.eye(12) - (weights / total)[:, 1:], added / total[:, 0])
    np.testing.assert_allclose(outcome.metrics["tail_max"], known.max(), rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("attack", "words"),
    [
        ({"vehicles": {"random": 13}}, "there are 12 vehicles"),
        ({"vehicles": {"random": 2}, "sybils": 1}, "neither sybils"),
        ({"vehicles": {"random": 0}}, "must be at least 1"),
        ({"kind": "freeze", "listeners": "each"}, "tells all listeners the same"),
        ({"threat": "replaces", "orders": [0]}, "carries no true derivative"),
        ({"kind": "bias", "orders": [1, 3]}, "bias has no derivatives: give orders with 0"),
    ],
)
def test_what_cannot_be_is_refused(attack, words):
    with pytest.raises(ConfigError, match=words):
        jaxnet.load({"name": "test", "attack": {"kind": "rotating", **attack}})
