"""The law by exchanges with neighbours: both engines against a plain program, and growth against theory."""

import numpy as np
import pytest

from jaxnet.engine.status import Status
from jaxnet.model import graph
from jaxnet.theory import rounds as theory
from tests import reference, systems
from tests.engine.test_exactness import attack_on_links, navigator_at

TICK, TICKS = 0.05, 120
KEYS = {"horizon": TICK * TICKS, "tail": 1.0, "output_step": TICK, "tick": TICK}
ENGINES = [("exact", 1e-9), ("nonlinear", 1e-5)]
SMALL = {"topology": "figure1", "vehicles": 5}
CASES = {
    "trimmed": {"attack": {"kind": "rotating", "magnitude": 5.0}},
    "replaced": {
        "attack": {"kind": "rotating", "threat": "replaces"},
        "defence": "none",
        "gain": [2.0, 4.0, 2.5],
    },
    "position alone": {
        "attack": {"kind": "sinusoid", "orders": [0], "vehicles": [1, 4]},
        "defence": "none",
        **SMALL,
    },
}


def plain(one, number, weights, rounds, carried):
    """Positions at each tick, (ticks + 1, m, 2), with these weights (ticks + 1, m, m + 1) in force.

    Vehicle by vehicle and link by link: what a vehicle demands, then what it hears of its neighbours' jerks.
    """
    lane, navigator, attack = (
        systems.lane(one, number),
        navigator_at(one, number),
        attack_on_links(one, number),
    )
    k = np.append(lane.gain, 1.0)
    y, velocity, acceleration = reference.flat_jets(lane.initial.T)
    m, q, path = len(y), np.zeros_like(y), []
    for n in range(TICKS + 1):
        path.append(y)
        there, added = navigator(n * TICK), attack(n * TICK)
        fed_back = k[0] * y + k[1] * velocity + k[2] * acceleration
        demand = -fed_back
        for i in range(m):
            for j in np.flatnonzero(weights[n, i]):
                word = k @ there if j == 0 or not carried[i, j] else fed_back[j - 1]
                demand[i] = demand[i] + weights[n, i, j] * (word + np.tensordot(k, added[:, i, j], 1))
        for _ in range(rounds):
            told = np.concatenate([np.zeros((1, 2)), q])
            q = demand + (weights[n] * carried) @ told
        y = y + TICK * velocity + TICK**2 / 2 * acceleration + TICK**3 / 6 * q
        velocity = velocity + TICK * acceleration + TICK**2 / 2 * q
        acceleration = acceleration + TICK * q
    return np.stack(path)


@pytest.mark.parametrize(("engine", "accuracy"), ENGINES)
@pytest.mark.parametrize("case", CASES)
def test_vehicles_move_as_the_plain_program(case, engine, accuracy):
    """Two rounds and three; trimmed, replaced, and with derivatives that do not belong together."""
    sweep = {"law.rounds": [2, 3]}
    study = systems.study(engine=engine, law="rounds", sweep=sweep, **KEYS, **CASES[case])
    one = systems.lanes(study, 2)
    outcome = systems.simulate(one)
    assert (outcome.status == Status.ok).all()
    for number in range(4):
        lane, kept = systems.lane(one, number), outcome.series["kept"][number]
        carried = ~lane.links if case == "replaced" else np.ones_like(lane.links)
        known = plain(one, number, kept, 2 + number // 2, carried)
        assert np.abs(outcome.series["state"][number, :, :, :2] - known).max() <= accuracy
    assert (outcome.switches > 0).all() == (case == "trimmed")
