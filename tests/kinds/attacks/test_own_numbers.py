"""Numbers that attacked vehicles have each for itself, listed or drawn: exact answers, the bound of each."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from jaxnet.config.document import ConfigError
from jaxnet.kinds.fields import FULL_TURN, Uniform
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import hearing, signal
from tests import reference, systems
from tests.reference import navigator_at

ATTACKED = [2, 5, 8, 11]
OWN = [0.7, 1.4, 0.3, 2.0]
KEYS = {"defence": "none", "horizon": 12.0, "tail": 1.0}


def states(attack, samples=2):
    """States of lanes over time."""
    outcome = systems.simulate(
        systems.lanes(systems.study(attack=attack, engine="exact", **KEYS), samples)
    )
    assert (outcome.status == 0).all()
    return outcome.series["state"][..., :2]


def test_attackers_superpose():
    """What four of own frequencies do is the sum of what each does alone (theorems.md O2)."""
    attack = {"kind": "sinusoid", "magnitude": 3.0, "direction": {"uniform": [0, 3]}}
    silent = states(attack | {"magnitude": 0.0, "frequency": 1.0})
    alone = [
        states(attack | {"vehicles": [j], "frequency": w}) - silent
        for j, w in zip(ATTACKED, OWN, strict=True)
    ]
    together = states(attack | {"frequency": OWN})
    assert np.abs(together - silent - np.sum(alone, axis=0)).max() <= 1e-9
    assert np.abs(alone).max() > 1


def of_vehicle(name, distribution, j, component=0, count=2):
    """The numbers that a vehicle has in the first lanes, drawn by themselves."""
    return Draw(Keyed(0), range(count), 12).placed([distribution], name, [(j, component)])[:, 0]


def jets_by_hand(w, phase, magnitude, times):
    """A rotating signal of any frequency with two derivatives, within ā: (3, times, 2)."""
    z = magnitude / max(1.0, abs(w) ** 3) * np.exp(1j * (w * times + phase))
    derivatives = np.stack([z, 1j * w * z, -(w**2) * z])
    return np.stack([derivatives.real, derivatives.imag], axis=-1)


def test_lanes_are_exact_with_frequencies_drawn_for_each():
    """As the plain program, whose attackers turn by numbers that belong to them."""
    frequency = Uniform(uniform=[-2.0, 2.0])
    attack = {"kind": "rotating", "magnitude": 3.0, "frequency": {"each": {"uniform": [-2, 2]}}}
    one = systems.lanes(systems.study(attack=attack, engine="exact", **KEYS), 2)
    outcome, times = systems.simulate(one), np.arange(121) * 0.1
    for number in range(2):
        lane = systems.lane(one, number)
        turning = {
            j: jets_by_hand(
                of_vehicle("attack.frequency", frequency, j)[number],
                of_vehicle("attack.phase", FULL_TURN, j)[number],
                3.0,
                times,
            )
            for j in ATTACKED
        }

        def added(t, lane=lane, turning=turning):
            found = np.zeros((4, 12, 13, 2))
            for j in ATTACKED:
                found[:3, lane.weights[:, j] > 0, j] = turning[j][:, None, round(t / 0.1)]
            return found

        start = reference.flat_jets(lane.initial.T)
        navigator = navigator_at(one, number)
        known = reference.propagate(lane.weights, navigator, added, lane.gain, start, 0.1, 120)
        ours = outcome.series["state"][number, :, :, :2]
        assert np.abs(ours - known["positions"]).max() <= 1e-9


KINDS = {
    "sinusoid": {"frequency": {"each": {"uniform": [0.3, 3.0]}}},
    "rotating": {"frequency": [0.3, -1.2, 2.0, 0.9]},
    "chirp": {
        "frequency": {"each": {"uniform": [-1, 1]}},
        "rate": [0.1, 0.0, -0.2, {"uniform": [0, 0.3]}],
    },
    "multisine": {"frequency": {"each": {"uniform": [0.2, 0.8]}}, "harmonics": 3},
    "envelope": {
        "of": {
            "kind": "sinusoid",
            "frequency": [0.2, 1.5, 0.4, 2.0],
            "phase": {"shared": {"uniform": [0, 6]}},
        },
        "start": [0.0, 2.0, 4.0, 6.0],
        "stop": [12.0, 7.0, 20.0, 11.0],
        "rise": {"each": {"uniform": [3.0, 4.0]}},
    },
}


@pytest.mark.parametrize("kind", KINDS)
def test_each_attacker_is_within_the_magnitude_by_its_own_numbers_and_near_it(kind):
    """Its value or one of its derivatives comes to ā, whatever others do; and they are derivatives."""
    study = systems.study(attack={"kind": kind, "magnitude": 3.0, **KINDS[kind]}, engine="exact")
    lanes = job(study.cells[0].scenario, Keyed(0), range(3)).inputs.lane
    times = np.linspace(0.0, 30.0, 3001)
    for number in range(3):
        lane = jax.tree.map(lambda leaf, n=number: jnp.asarray(leaf[n]), lanes)
        basis = np.moveaxis(jax.vmap(lane.signal.basis)(jnp.asarray(times)), 0, -1)
        norms = []
        for j in ATTACKED:
            jets = np.einsum("xb,kbt->kxt", np.asarray(lane.vectors)[:, j - 1], basis)
            norms.append(np.linalg.norm(jets, axis=1).max())
            for k in range(3):
                slope = np.gradient(jets[k], times, axis=1, edge_order=2)
                assert np.abs(slope - jets[k + 1])[:, 2:-2].max() < 0.03
        assert max(norms) <= 3.0 * (1 + 1e-12)
        assert min(norms) >= 3.0 * (0.3 if kind == "envelope" else 0.95)
        honest = np.delete(np.asarray(lane.vectors), np.array(ATTACKED) - 1, axis=1)
        assert not honest.any()


def signals(attack, samples=40, **keys):
    """Signals of vehicles, or links, at some instants: (instants, 2, signals, lanes)."""
    study = systems.study(attack={"kind": "sinusoid", "magnitude": 2.0, **attack}, **keys)
    made = job(study.cells[0].scenario, Keyed(0), range(samples))
    lane = jax.tree.map(lambda leaf: np.moveaxis(leaf, 0, -1), made.inputs.lane)
    instants = (0.4, 2.3, 7.0)
    return np.stack(
        [signal.jets(lane.vectors, lane.signal.basis(np.full(samples, t)))[0] for t in instants]
    )


def test_ways_to_write_the_same_are_the_same():
    """A list of one distribution is one for each; a list of one number is that; to rounding."""
    band = {"uniform": [0.1, 4.0]}
    for one, other in (
        ({"frequency": [band] * 4}, {"frequency": {"each": band}}),
        ({"frequency": [0.8] * 4}, {"frequency": 0.8}),
        ({"frequency": {"shared": band}}, {"frequency": band}),
        ({"phase": {"each": band}}, {"phase": band}),
        ({"phase": [band] * 4}, {"phase": band}),
        ({"direction": [0.5, 0.5, 0.5, 0.5]}, {"direction": 0.5}),
        (
            {"vehicles": [8, 2], "frequency": [1.5, 0.2]},
            {"vehicles": [2, 8], "frequency": [0.2, 1.5]},
        ),
    ):
        np.testing.assert_allclose(signals(one), signals(other), rtol=0, atol=1e-12)


def test_a_shared_phase_is_drawn_once_for_all_vehicles_of_a_lane():
    """They swing together, each lane by its own."""
    found = signals({"phase": {"shared": {"uniform": [0, 6]}}})[:, 0][:, np.array(ATTACKED) - 1]
    assert np.abs(found - found[:, :1]).max() < 1e-12
    assert len(np.unique(np.round(found[0, 0], 9))) == 40


def test_drawn_attackers_and_listeners_have_their_own_too():
    """Of three drawn vehicles each swings by the number that it would have if it were named; so do links."""
    band, rows = {"frequency": {"each": {"uniform": [0.1, 4.0]}}}, np.arange(1, 13)
    named = signals({"vehicles": rows.tolist(), **band})
    drawn = signals({"vehicles": {"random": 3}, **band})
    chosen = np.abs(drawn).max(axis=(0, 1)) > 0
    assert (chosen.sum(axis=0) == 3).all()
    np.testing.assert_allclose(drawn, np.where(chosen, named, 0.0), rtol=0, atol=1e-12)
    by_link = signals({"listeners": "each", **band})
    sources = systems.lanes(systems.study(), 1).network.hearing.sources
    links = hearing.link_signals(sources)[np.isin(sources, ATTACKED)]
    assert len(np.unique(np.round(by_link[1, 0, links], 9))) == links.size * 40


@pytest.mark.parametrize(
    ("attack", "words"),
    [
        ({"frequency": [1.0, 2.0]}, "attack.frequency: a list has a number for each vehicle, 4"),
        ({"frequency": [1.0, "x", 2.0, 3.0]}, r"attack.frequency.1: must be a number \(got"),
        ({"frequency": {"each": "x"}}, "attack.frequency.each: must be a number"),
        ({"frequency": {"apiece": 1.0}}, "one of them in {each: ...} or {shared: ...}, or a list"),
        ({"vehicles": {"random": 2}, "phase": [0.0, 1.0]}, "got drawn ones"),
        (
            {"vehicles": {"random": 2}, "listeners": "each", "frequency": {"each": 1.0}},
            "one number for all",
        ),
        ({"kind": "multisine", "frequency": [1.0, 1.0, 0.0, 1.0]}, "must be greater than 0"),
        (
            {"kind": "envelope", "of": {"kind": "chirp", "rate": [0.1]}},
            "attack.of.rate: a list has",
        ),
        (
            {"kind": "envelope", "of": "bias", "start": [0, 1, 2, 3], "stop": [6, 6, 6, 6]},
            "before start",
        ),
        ({"magnitude": [1, 2, 3, 4]}, "attack.magnitude: must be one number"),
    ],
)
def test_what_cannot_be_is_said(attack, words):
    with pytest.raises(ConfigError, match=words):
        jaxnet.load({"name": "test", "attack": {"kind": "rotating", **attack}})
