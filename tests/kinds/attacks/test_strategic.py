"""Attackers that choose at every tick; what frozen and freeform messages are."""

import numpy as np

from tests import systems

CLOCK = {"tick": 0.1, "horizon": 30.0, "tail": 0.0}


def test_one_mimic_alone_is_believed_whenever_it_lies_and_could_not_lie_more():
    """What it says passes; a part more of ā, at that tick, would be dropped by a listener."""
    attack = {"kind": "mimic", "magnitude": 8.0, "vehicles": [5], "direction": 0.5}
    study = systems.study(attack=attack, engine="exact", **{**CLOCK, "output_step": 0.1})
    outcome = systems.simulate(systems.lanes(study, 3))
    unit = np.array([np.cos(0.5), np.sin(0.5)])
    lied = 0
    series = (outcome.series[each] for each in ("state", "attack", "kept"))
    lane = systems.lane(systems.lanes(study, 1), 0)
    for states, said, kept in zip(*series, strict=True):
        for n in range(len(states)):
            path = np.asarray(lane.navigator.jets(np.asarray(n * 0.1)))[0]
            error = states[n, :, :2] - path
            part = said[n, 4] @ unit / 8.0
            assert abs(16 * part - round(16 * part)) < 1e-9
            others = np.linalg.norm(error[[2, 6]], axis=1)  # of listeners 4 and 6
            if part > 1e-9:  # a mimic that sends 0 stays attacked
                lied += 1
                assert (kept[n, [3, 5], 5] > 0).all()
            more = np.arange(round(16 * part) + 1, 17)[:, None] / 16
            farther = np.linalg.norm(error[4] + 8.0 * more * unit, axis=1)
            assert (farther > others.min() - 1e-6).all()
    assert lied > 20


def test_a_sleeper_strikes_and_stays():
    """Nothing before its start, ā for a while, then a share of it; from the next tick on."""
    attack = {"kind": "sleeper", "magnitude": 4.0, "vehicles": [2], "direction": np.pi / 2}
    attack |= {"start": 0.35, "burst": 0.2, "share": 0.25}
    keys = {"engine": "exact", "tick": 0.1, "output_step": 0.1, "horizon": 1.0, "tail": 0.0}
    said = systems.simulate(systems.lanes(systems.study(attack=attack, **keys), 1)).series["attack"]
    sent = [0.0] * 4 + [4.0] * 2 + [1.0] * 5
    np.testing.assert_allclose(said[0, :, 1, 1], sent, rtol=1e-15, atol=1e-299)
    np.testing.assert_allclose(said[0, :, 1, 0], 0.0, atol=1e-15)


ATTACKED = [2, 5, 8, 11]


def test_a_frozen_message_is_the_first_one():
    """It carries the output of its source at t = 0, for `look_ahead` not the axle's place."""
    vehicle = {"kind": "look_ahead", "ahead": 0.5}
    one = systems.lanes(systems.study(attack="freeze", vehicle=vehicle), 2)
    for number in range(2):
        lane = systems.lane(one, number)
        navigator = lane.navigator.jets(np.zeros(1))[0]
        carried = (lane.vectors @ lane.signal.basis(np.zeros(1))[0])[..., 0] + navigator
        ahead = 0.5 * np.array([np.cos(lane.initial[2]), np.sin(lane.initial[2])])
        of, known = np.array(ATTACKED) - 1, lane.initial[:2] + ahead
        np.testing.assert_allclose(carried[:, of], known[:, of], rtol=1e-12)


def test_the_freeform_attack_is_what_its_coefficients_say():
    """A circle is the rotating attack of any size; a multisine is one with its coefficients."""
    keys = {"magnitude": 3.0, "vehicles": [2, 5]}
    circle = {"kind": "freeform", "frequency": 0.6, "harmonics": 1}
    circle |= {"coefficients": [[9, 0, 0, 9], [0, 1, -1, 0]]}
    turning = {"kind": "rotating", "frequency": 0.6, "phase": [0.0, np.pi / 2]}
    phases, directions = [[0.1, 2.0], [3.0, 4.0]], [[0.5, 1.0], [2.5, 6.0]]
    sine = {"kind": "multisine", "frequency": 0.4, "harmonics": 2}
    sine |= {"phase": phases, "direction": directions}
    turns = np.stack([np.cos(phases), -np.sin(phases)], axis=-1)
    along = np.stack([np.cos(directions), np.sin(directions)], axis=-1)
    given = (turns[..., None] * along[..., None, :]).reshape(2, -1).tolist()
    free = {"kind": "freeform", "frequency": 0.4, "harmonics": 2, "coefficients": given}
    for one, other, size in ((circle, turning, np.cos(np.pi / 32)), (free, sine, 1.0)):
        signals = []
        for attack in (one, other):
            study = systems.study(attack={**keys, **attack}, engine="exact")
            lane = systems.lane(systems.lanes(study, 1), 0)
            basis = np.asarray(lane.signal.basis(np.linspace(0.0, 30.0, 301)))
            signals.append(np.einsum("xjb,kbt->kxjt", lane.vectors, basis))
        np.testing.assert_allclose(signals[0], size * signals[1], rtol=0, atol=1e-12)
