"""What replaces a word: a path of some time ago, a last word that is held; exact answers of both engines."""

import numpy as np
import pytest

from jaxnet.config.document import ConfigError
from jaxnet.explore.box import Box, places_of
from jaxnet.kinds.attacks.freeform import Freeform
from jaxnet.lanes.uniforms import Keyed
from jaxnet.statistics import limits
from jaxnet.view.text import check
from tests import reference, systems
from tests.reference import march, navigator_at

ATTACKED = [2, 5, 8, 11]


def test_a_lane_moves_as_the_plain_program():
    """`E = (I − A_H)⁻¹ W_r (r − y₀)` and what is free of it; r is y₀ of 5 s ago, no path that goes on.

    The exact engine, and last words that are held: tests/kinds/attacks/test_channels.py.
    """
    study = systems.study(
        engine="nonlinear", attack="replay", defence="none", horizon=12.0, tail=1.0
    )
    one = systems.lanes(study, 2)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    times = np.arange(121) * 0.1
    for number in range(2):
        lane, navigator = systems.lane(one, number), navigator_at(one, number)

        def added(t, lane=lane, navigator=navigator):
            found = np.zeros((3, 12, 13, 2))
            for j in ATTACKED:
                word = navigator(t - 5.0)[:3] - navigator(t)[:3]
                found[:, lane.weights[:, j] > 0, j] = word[:, None]
            return found

        carried = np.ones((12, 13), bool)
        carried[:, ATTACKED] = False
        start = reference.flat_jets(lane.initial.T) - navigator(0.0)[:3, None]
        held = np.stack([lane.weights] * 2), added
        known = march(lambda *_, held=held: held, carried, lane.gain, start, 0.1, 120)
        path = np.stack([navigator(t)[0] for t in times])
        ours = outcome.series["state"][number, :, :, :2] - path[:, None]
        assert np.abs(ours - known[:, 0]).max() <= 1e-5


def test_a_frozen_message_is_the_first_one():
    """It carries the output of its source at t = 0, which for `look_ahead` is not the axle's place."""
    one = systems.lanes(
        systems.study(attack="freeze", vehicle={"kind": "look_ahead", "ahead": 0.5}), 2
    )
    for number in range(2):
        lane = systems.lane(one, number)
        navigator = lane.navigator.jets(np.zeros(1))[0]
        carried = (lane.vectors @ lane.signal.basis(np.zeros(1))[0])[..., 0] + navigator
        ahead = 0.5 * np.array([np.cos(lane.initial[2]), np.sin(lane.initial[2])])
        for j in ATTACKED:
            np.testing.assert_allclose(
                carried[:, j - 1], (lane.initial[:2] + ahead)[:, j - 1], rtol=1e-12
            )


@pytest.mark.parametrize("kind", ["replay", "freeze"])
def test_no_bound_is_told_of_what_the_magnitude_does_not_bound(kind):
    study = systems.study(attack=kind, defence="none")
    assert limits.slopes_table(study.cells)["slope"].isna().all()
    assert limits.unchecked_cells(study.cells) == {"ā does not bound the attack": [0]}
    assert "not bounded by ā" in check.check_text(study)


@pytest.mark.parametrize("kind", ["multisine", "freeform"])
def test_harmonics_and_their_derivatives_come_near_their_bound_and_never_exceed_it(kind):
    """On a grid far finer than the one by which they are scaled, lane by lane and vehicle by vehicle."""
    attack = {"kind": kind, "magnitude": 3.0, "frequency": {"uniform": [0.2, 0.6]}, "harmonics": 5}
    one = systems.lanes(systems.study(attack=attack, engine="exact"), 3)
    times = np.linspace(0.0, 40.0, 20_001)
    for number in range(3):
        lane = systems.lane(one, number)
        basis = np.asarray(lane.signal.basis(times))  # (4, B, t)
        for j in ATTACKED:
            jets = np.einsum("xb,kbt->kxt", lane.vectors[:, j - 1], basis)
            greatest = np.linalg.norm(jets, axis=1).max()
            assert 0.98 * 3.0 <= greatest <= 3.0
            for k in range(3):  # and they are derivatives of each other
                slope = np.gradient(jets[k], times, axis=1, edge_order=2)
                assert np.abs(slope - jets[k + 1]).max() < 1e-3
    directions = {tuple(np.round(lane.vectors[:, j - 1].ravel(), 6)) for j in ATTACKED}
    assert len(directions) == len(ATTACKED)


def test_the_size_of_harmonics_is_the_same_whatever_is_beside_them():
    """To the last bit, and of any size of the vectors."""
    rng = np.random.default_rng(0)
    vectors, frequency = rng.normal(size=(2, 3, 10, 700)), rng.uniform(0.1, 20, 700)
    vectors[:, 1, :, 5] *= 1e200

    def size(lanes):
        made = Freeform().model_copy(update={"frequency": frequency[lanes], "harmonics": 5})
        return made.greatest(vectors[..., lanes])

    whole = size(slice(None))
    for lanes in (slice(0, 1), slice(5, 6), slice(340, 349), slice(699, 700)):
        np.testing.assert_array_equal(size(lanes), whole[..., lanes])
    assert np.isfinite(whole).all()


def test_the_freeform_attack_is_what_its_coefficients_say():
    """A circle is the rotating attack, of any size; and a multisine is one with coefficients of its own."""
    keys = {"magnitude": 3.0, "vehicles": [2, 5]}
    circle = {
        "kind": "freeform",
        "frequency": 0.6,
        "harmonics": 1,
        "coefficients": [[9, 0, 0, 9], [0, 1, -1, 0]],
    }
    turning = {"kind": "rotating", "frequency": 0.6, "phase": [0.0, np.pi / 2]}
    phases, directions = [[0.1, 2.0], [3.0, 4.0]], [[0.5, 1.0], [2.5, 6.0]]
    sine = {
        "kind": "multisine",
        "frequency": 0.4,
        "harmonics": 2,
        "phase": phases,
        "direction": directions,
    }
    given = [
        [
            number
            for phase, along in zip(*each, strict=True)
            for turn in (np.cos(phase), -np.sin(phase))
            for number in (np.cos(along) * turn, np.sin(along) * turn)
        ]
        for each in zip(phases, directions, strict=True)
    ]
    free = {"kind": "freeform", "frequency": 0.4, "harmonics": 2, "coefficients": given}
    for one, other, size in ((circle, turning, np.cos(np.pi / 32)), (free, sine, 1.0)):
        signals = []
        for attack in (one, other):
            lane = systems.lane(
                systems.lanes(systems.study(attack={**keys, **attack}, engine="exact"), 1), 0
            )
            basis = np.asarray(lane.signal.basis(np.linspace(0.0, 30.0, 301)))
            signals.append(np.einsum("xjb,kbt->kxjt", lane.vectors, basis))
        np.testing.assert_allclose(signals[0], size * signals[1], rtol=0, atol=1e-12)


def test_a_freeform_attack_of_nothing_is_none():
    """Whose coefficients are all 0, or in the middle of what they are drawn from, as a search has them."""
    tabled = {"vehicles": [2, 5], "harmonics": 1, "coefficients": [[9, 0, 0, 9], [0, 0, 0, 0]]}
    given = systems.study(attack={"kind": "freeform", **tabled}, engine="exact")
    vectors = systems.lane(systems.lanes(given, 1), 0).vectors
    assert np.linalg.norm(vectors[:, 1]) > 1
    assert not vectors[:, [j for j in range(12) if j != 1]].any()
    over = {"over": {"attack.coefficients": "each"}}
    (cell,) = systems.study(
        attack={"kind": "freeform", "vehicles": [2]}, search=over, engine="exact"
    ).cells
    box = Box(cell.scenario, Keyed(0), places_of(cell.scenario, Keyed(0)))
    assert not box.lanes(box.centre([2])[None], np.array([0])).inputs.lane.vectors.any()


@pytest.mark.parametrize(
    ("coefficients", "said"),
    [
        ([[1, 0, 0, 1]], "must be 2 lists, one for each of attack.vehicles, of 4 numbers"),
        ([], "at least 1"),
    ],
)
def test_tables_that_do_not_fit_are_refused(coefficients, said):
    """By how many lists of how many numbers there must be."""
    keys = {"kind": "freeform", "vehicles": [2, 5], "harmonics": 1, "coefficients": coefficients}
    with pytest.raises(ConfigError, match=said):
        systems.study(attack=keys)
