"""Attackers that choose at every tick: how far they come untrimmed, and what trimming sees."""

import numpy as np

from tests import systems

CLOCK = {"tick": 0.1, "horizon": 30.0, "tail": 0.0}


def test_a_greedy_attacker_finds_the_worst_constant():
    """Where nobody trims that is all in one direction, which attains the static gain of a ring."""
    keys = {**CLOCK, "horizon": 60.0, "engine": "exact", "defence": "none", "topology": "cyclic"}
    study = systems.study(attack={"kind": "greedy", "magnitude": 2.0}, **keys)
    worst = systems.simulate(systems.lanes(study, 2, ())).metrics["tail_max"]
    np.testing.assert_allclose(worst, 2.0 * 3.1034482758620690, rtol=0, atol=1e-5)


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
            if part > 0:
                lied += 1
                assert (kept[n, [3, 5], 5] > 0).all()
            more = np.arange(round(16 * part) + 1, 17)[:, None] / 16
            farther = np.linalg.norm(error[4] + 8.0 * more * unit, axis=1)
            assert (farther > others.min() - 1e-6).all()
    assert lied > 20
