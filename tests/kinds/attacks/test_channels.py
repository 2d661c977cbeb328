"""What links carry under attacks that no formula tells: trajectories against a plain program."""

import numpy as np
import pytest

from tests import reference, systems
from tests.reference import march, navigator_at

ATTACKED, SIZE, DELAY, TICK, TICKS = [2, 5, 8, 11], 3.0, 5.0, 0.1, 60
NAVIGATOR = {"kind": "lissajous", "phase": [1.0, 0.5]}  # begins at (84, 24)
CLOCK = {"tick": TICK, "output_step": TICK, "horizon": TICK * TICKS, "tail": 1.0}
ADDING = {"magnitude": SIZE, "vehicles": ATTACKED}
KEYS = {
    "mimic": {**ADDING, "direction": 0.0},
    "greedy": {**ADDING, "directions": 8},
    "replay": {"delay": DELAY},
    "freeze": {},
}


def lie(kind, navigator, t):
    """The jets (3, 2) that an attacked link adds, or has beside the navigator's own."""
    if kind == "replay":
        return navigator(t - DELAY)[:3] - navigator(t)[:3]
    if kind == "freeze":
        return np.stack([navigator(0.0)[0], np.zeros(2), np.zeros(2)]) - navigator(t)[:3]
    return np.array([[SIZE, 0.0], [0.0, 0.0], [0.0, 0.0]])


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
                found[:, i, j] = lie(kind, navigator, t)
            if kind == "greedy":
                found[0][links] = worst
            return found

        return np.stack([lane.weights] * 2), added

    return choose


@pytest.mark.parametrize(
    ("kind", "threat", "topology"),
    [
        ("greedy", "adds", "cyclic"),
        pytest.param("greedy", "replaces", "cyclic", marks=pytest.mark.long),
        pytest.param("mimic", "adds", "cyclic", marks=pytest.mark.long),
        pytest.param("mimic", "replaces", "cyclic", marks=pytest.mark.long),
        ("replay", "replaces", "cyclic"),
        pytest.param("freeze", "replaces", "star", marks=pytest.mark.long),
    ],
)
def test_a_lane_moves_as_its_links_say(kind, threat, topology):
    """Vehicle by vehicle for 6 s, to 1e-8 m, where some are told lies about the navigator."""
    attack = {"kind": kind, "links": "navigator", "threat": threat} | KEYS[kind]
    fleet = {"defence": "none", "navigator": NAVIGATOR, "topology": topology}
    one = systems.lanes(systems.study(engine="exact", attack=attack, **fleet, **CLOCK), 1)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    lane, navigator = systems.lane(one, 0), navigator_at(one, 0)
    links = np.zeros((12, 13), bool)
    links[np.array(ATTACKED) - 1, 0] = True
    links &= lane.weights > 0
    carried = ~links if threat == "replaces" else np.ones_like(links)
    start = reference.flat_jets(lane.initial.T) - navigator(0.0)[:3, None]
    known = march(plain(kind, lane, links, navigator), carried, lane.gain, start, TICK, TICKS)
    path = np.stack([navigator(n * TICK)[0] for n in range(TICKS + 1)])
    assert np.abs(outcome.series["state"][0, :, :, :2] - path[:, None] - known[:, 0]).max() <= 1e-8
