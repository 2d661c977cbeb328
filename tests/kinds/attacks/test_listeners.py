"""Which links an attack holds; lies that differ by listener, drawn attackers, sybils."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.kinds.attacks.bias import Bias
from tests import reference, systems
from tests.matrices import slots_of
from tests.model.test_graph import digraphs, links, marked, weights_of
from tests.reference import march, navigator_at

ATTACKED = [2, 5, 8, 11]


def test_each_listener_is_told_its_own():
    """As the plain program that adds to every link what it carries; no two hear the same."""
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
            found = np.zeros((3, 12, 13, 2))
            basis = np.asarray(lane.signal.basis(np.asarray(t)))[:3]
            for (i, j), vectors in told.items():
                found[:, i, j] = basis @ vectors.T
            return found

        start = reference.flat_jets(lane.initial.T) - navigator(0.0)[:3, None]
        held, everywhere = (np.stack([lane.weights] * 2), added), np.ones((12, 13), bool)
        known = march(lambda *_, held=held: held, everywhere, lane.gain, start, 0.1, 120)
        path = np.stack([navigator(t)[0] for t in times])
        ours = outcome.series["state"][number, :, :, :2] - path[:, None]
        assert np.abs(ours - known[:, 0]).max() <= 1e-8
        first = {j: min(i for i, k in links if k == j) for j in ATTACKED}  # whose lie is shown
        for j in ATTACKED:
            shown = outcome.series["attack"][number, 30, j - 1]
            np.testing.assert_allclose(shown, added(3.0)[0, first[j], j], rtol=0, atol=1e-9)


def test_attackers_are_drawn_for_each_lane_and_for_all_cells_alike():
    """Four of twelve in each of 200 lanes, all about as often; equal in cells that differ in ā."""
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
            # Of honest ones, all on the navigator, either is dropped
            weights[i - 1, (i - 2) % 12 + 1] = 0.0
        weights[i - 1, 0] = 0.1
    total = weights.sum(axis=1, keepdims=True)
    known = 2.0 * np.linalg.solve(np.eye(12) - (weights / total)[:, 1:], added / total[:, 0])
    np.testing.assert_allclose(outcome.metrics["tail_max"], known.max(), rtol=0, atol=1e-5)


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
