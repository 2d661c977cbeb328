"""What links carry under each attack, on either channel: trajectories against a plain program."""

import numpy as np
import pytest

from tests import reference, systems
from tests.reference import march, navigator_at

ATTACKED, SIZE, DELAY, TICK, TICKS = [2, 5, 8, 11], 3.0, 5.0, 0.1, 60
NAVIGATOR = {"kind": "lissajous", "phase": [1.0, 0.5]}  # begins at (84, 24)
CLOCK = {"tick": TICK, "output_step": TICK, "horizon": TICK * TICKS, "tail": 1.0}
CONSTANT = {"magnitude": SIZE, "vehicles": ATTACKED}
ADDING = {
    "bias": CONSTANT,
    "spoof": CONSTANT,
    "mimic": {**CONSTANT, "direction": 0.0},
    "greedy": {**CONSTANT, "directions": 8},
}
REPLACING = {"replay": {"delay": DELAY}, "freeze": {}}
LIARS, EARS = ("neighbour", "cyclic", 1), ("navigator", "cyclic", 0)  # channel, topology, sybils
CASES = [(kind, threat, *EARS) for kind in ADDING for threat in ("adds", "replaces")]
CASES += [("replay", "replaces", *EARS), ("freeze", "replaces", "navigator", "star", 0)]
CASES += [("bias", "replaces", *LIARS)]


def attacked_links(channel, weights):
    """By listener and source (12, 13)."""
    links = np.zeros((12, 13), bool)
    if channel == "neighbour":
        links[:, ATTACKED] = True
    else:
        links[np.array(ATTACKED) - 1, 0] = True
    return links & (weights > 0)


def lie(kind, source, lane, navigator, t):
    """The jets (3, 2) that an attacked link of a source adds, or has beside the navigator's own."""
    if kind == "replay":
        return navigator(t - DELAY)[:3] - navigator(t)[:3]
    if kind == "freeze":
        first = navigator(0.0)[0] if source == 0 else lane.initial[:2, source - 1]
        return np.stack([first, np.zeros(2), np.zeros(2)]) - navigator(t)[:3]
    # A constant in all four orders does what a greater one does that is a path's position
    # (theorems.md O10).
    factor = (1.0 + lane.gain.sum()) / lane.gain[0] if kind == "spoof" else 1.0
    return np.array([[factor * SIZE, 0.0], [0.0, 0.0], [0.0, 0.0]])


def plain(kind, lane, links, navigator):
    """`choose` of `march`: the weights, and what links carry; greedy attackers choose at ticks."""
    angles = 2 * np.pi * np.arange(8) / 8
    directions = SIZE * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    share = np.where(links, lane.weights, 0.0).sum(axis=1)

    def choose(n, error):
        pulled = error[0] + share[None, :, None] * directions[:, None]
        worst = directions[np.linalg.norm(pulled, axis=2).sum(axis=1).argmax()]

        def added(t):
            found = np.zeros((3, 12, 13, 2))
            for i, j in np.argwhere(links):
                found[:, i, j] = lie(kind, j, lane, navigator, t)
            if kind == "greedy":
                found[0][links] = worst
            return found

        return np.stack([lane.weights] * 2), added

    return choose


# One of each: a constant that adds, a choice at ticks, a path of before, a message in the place of
# another. The formulas of the other kinds: test_signals, test_strategic.
LONG = [(kind, "replaces", *EARS) for kind in ("spoof", "mimic", "greedy")]
LONG += [("spoof", "adds", *EARS), ("mimic", "adds", *EARS)]
LONG += [("freeze", "replaces", "navigator", "star", 0)]


@pytest.mark.parametrize(
    ("kind", "threat", "channel", "topology", "sybils"),
    [pytest.param(*each, marks=[pytest.mark.long] * (each in LONG)) for each in CASES],
)
def test_a_lane_moves_as_its_links_say(kind, threat, channel, topology, sybils):
    """Vehicle by vehicle for 6 s, to 1e-8 m."""
    keys = {"kind": kind, "links": channel, "threat": threat, "sybils": sybils}
    attack = keys | (ADDING | REPLACING)[kind]
    fleet = {"defence": "none", "navigator": NAVIGATOR, "topology": topology}
    one = systems.lanes(systems.study(engine="exact", attack=attack, **fleet, **CLOCK), 1)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    lane, navigator = systems.lane(one, 0), navigator_at(one, 0)
    links = attacked_links(channel, lane.weights)
    carried = ~links if threat == "replaces" else np.ones_like(links)
    start = reference.flat_jets(lane.initial.T) - navigator(0.0)[:3, None]
    known = march(plain(kind, lane, links, navigator), carried, lane.gain, start, TICK, TICKS)
    path = np.stack([navigator(n * TICK)[0] for n in range(TICKS + 1)])
    assert np.abs(outcome.series["state"][0, :, :, :2] - path[:, None] - known[:, 0]).max() <= 1e-8
