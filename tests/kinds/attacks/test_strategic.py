"""Attackers that choose at every tick: how far they come untrimmed, and what trimming sees."""

import numpy as np
import pytest

from tests import systems

CLOCK = {"tick": 0.1, "horizon": 30.0, "tail": 0.0}


@pytest.mark.parametrize(("kind", "gain"), [("greedy", {"cyclic": 3.1034482758620690})])
def test_a_greedy_attacker_finds_the_worst_constant(kind, gain):
    """Where nobody trims that is all in one direction, which attains the static gain."""
    keys = {**CLOCK, "horizon": 60.0, "engine": "exact", "defence": "none"}
    study = systems.study(
        attack={"kind": kind, "magnitude": 2.0}, sweep={"topology": list(gain)}, **keys
    )
    outcome = systems.simulate(systems.lanes(study, 2, ()))
    known = 2.0 * np.repeat(list(gain.values()), 2)
    np.testing.assert_allclose(outcome.metrics["tail_max"], known, rtol=0, atol=1e-5)


def test_one_mimic_alone_is_believed_whenever_it_lies_and_could_not_lie_more():
    """What it says passes; a part more of ā, at that tick, would be dropped by a listener."""
    attack = {"kind": "mimic", "magnitude": 8.0, "vehicles": [5], "direction": 0.5}
    study = systems.study(attack=attack, engine="exact", **{**CLOCK, "output_step": 0.1})
    outcome = systems.simulate(systems.lanes(study, 3))
    unit = np.array([np.cos(0.5), np.sin(0.5)])
    lied = 0
    for states, said, kept in zip(
        *(outcome.series[each] for each in ("state", "attack", "kept")), strict=True
    ):
        lane = systems.lane(systems.lanes(study, 1), 0)
        for n in range(len(states)):
            path = np.asarray(lane.navigator.jets(np.asarray(n * 0.1)))[0]
            error = states[n, :, :2] - path
            part = said[n, 4] @ unit / 8.0
            assert abs(16 * part - round(16 * part)) < 1e-9
            others = {
                3: np.linalg.norm(error[2]),
                5: np.linalg.norm(error[6]),
            }  # of listeners 4 and 6
            if part > 0:
                lied += 1
                assert (kept[n, [3, 5], 5] > 0).all()
            farther = [
                np.linalg.norm(error[4] + 8.0 * p * unit)
                for p in np.arange(round(16 * part) + 1, 17) / 16
            ]
            assert all(any(score > other - 1e-6 for other in others.values()) for score in farther)
    assert lied > 20
