"""Both engines against the closed loop's exact solutions (theorems.md O1 to O3)."""

import numpy as np
import pytest

from experiments.exactness import deviations, lanes_at_ticks
from tests import reference, systems
from tests.reference import navigator_at

RANDOM_GRAPH = {
    "kind": "edges",
    "edges": [
        [i, j, 1.0 + (5 * i + 3 * j) % 7]
        for i in range(1, 13)
        for j in {0, i % 12 + 1, (5 * i) % 13} - {i}
    ],
}
DRAWN = {
    "kind": "edges",
    "edges": [[i, j, {"uniform": [w / 4, 4 * w]}] for i, j, w in RANDOM_GRAPH["edges"]],
}
GAIN = [{"uniform": [0.5, 1.5]}, {"uniform": [2.5, 3.5]}, {"choice": [2.5, 3, 3.5]}]
CONSTANT = {"kind": "bias", "magnitude": 4.0, "direction": {"uniform": [0, 6.28]}}
ROTATING = {"kind": "rotating", "magnitude": 4.0}
UNTRIMMED = {"defence": "none", "tick": 0.1, "attack": ROTATING}
CASES = {  # samples, and keys of a study
    "known": (1, UNTRIMMED | {"attack": CONSTANT, "sweep": {"topology": ["star", "path"]}}),
    "given": (1, UNTRIMMED | {"topology": RANDOM_GRAPH, "gain": [6, 11, 6]}),
    "drawn": (6, UNTRIMMED | {"topology": DRAWN, "gain": GAIN}),
    "trimmed": (2, {"defence": "trusted_trim", "tick": 0.05, "attack": ROTATING}),
}
INSTANTS = np.arange(301) * 0.1


def test_nominal_tracking_is_exact_and_the_same_in_every_topology():
    """O1: eight random lanes in each of three topologies, to 5e-6 m over 30 s."""
    topologies = ["star", "cyclic", "path"]
    given = systems.study(attack="none", defence="none", sweep={"topology": topologies})
    one = systems.lanes(given, 8)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    for number, states in enumerate(outcome.series["state"]):
        lane = systems.lane(one, number)
        known = reference.nominal(
            navigator_at(one, number), lane.gain, reference.flat_jets(lane.initial.T), INSTANTS
        )
        assert np.abs(states[:, :, :2] - known).max() <= 5e-6
    star, cyclic, path = outcome.series["tracking"].reshape(3, 8, 301)
    np.testing.assert_allclose(cyclic, star, atol=5e-6, rtol=0)
    np.testing.assert_allclose(path, star, atol=5e-6, rtol=0)


@pytest.mark.parametrize(
    ("engine", "accuracy"),
    [("exact", 1e-10), pytest.param("nonlinear", 1e-5, marks=pytest.mark.long)],
)
@pytest.mark.parametrize("name", CASES)
def test_attacked_lanes_move_as_the_exact_solution(name, engine, accuracy):
    """O2 at every tick, with gains and weights of each lane, for what it retained."""
    samples, keys = CASES[name]
    for cell in systems.study(engine=engine, horizon=10.0, tail=1.0, **keys).cells:
        lanes = lanes_at_ticks(cell.scenario, 0, range(samples))
        assert deviations(lanes).max() <= accuracy


def test_switches_are_counted_by_vehicle_and_tick():
    """As the weights in force change, on the ring."""
    attack = {"kind": "rotating", "magnitude": 5.0}
    outcome = systems.outcome(2, engine="exact", attack=attack, output_step=0.05)
    changed = np.diff(outcome.series["kept"] > 0, axis=1).any(axis=3)
    assert outcome.switches.tolist() == changed.sum(axis=(1, 2)).tolist()
    assert outcome.switches.min() > 0


def test_constant_in_phase_attack_has_the_static_gains():
    """O3: tail mean over ā, untrimmed; on the ring the defence leaves nothing of it."""
    attack = {"kind": "bias", "magnitude": 2.0}
    keys = {"engine": "exact", "attack": attack, "tick": 0.1, "horizon": 60.0}
    known = {"star": (1 / 3, 1 / 3), "path": (1.8333, 1 / 3), "cyclic": (3.0, 0.3)}
    given = systems.study(defence="none", sweep={"topology": list(known)}, **keys)
    metrics = systems.simulate(systems.lanes(given, 2)).metrics
    for column, name in enumerate(("tail_mean", "tail_disagreement")):
        expected = np.repeat([each[column] for each in known.values()], 2)
        np.testing.assert_allclose(metrics[name] / 2.0, expected, rtol=0, atol=1e-4)
    assert np.abs(metrics["tail_max"][-2:] / 2.0 - 3.1034).max() < 1e-4
    trimmed = systems.outcome(2, topology="cyclic", **keys).metrics
    assert (trimmed["tail_mean"] / 2.0 < 1e-6).all()


@pytest.mark.long
def test_trimming_in_the_vector_field_is_the_limit_of_trimming_at_ticks():
    """On a lane that recovers: the finer the ticks, the nearer to `tick: 0`."""
    ended = {}
    for tick in (0.1, 0.025, 0):
        given = systems.study(
            tick=tick, horizon=10.0, tail=1.0, attack={"magnitude": 5.0, "vehicles": [2]}
        )
        outcome = systems.simulate(systems.lanes(given, 1))
        assert (outcome.status == 0).all()
        ended[tick] = outcome.series["state"][0, :, :, :2]
    coarse, fine = (np.abs(ended[tick] - ended[0]).max() for tick in (0.1, 0.025))
    assert 0 < fine < coarse / 2


def test_both_engines_measure_the_same():
    """Every contract metric, untrimmed; speeds and turn rates come from flat outputs (O4)."""
    ours, theirs = (
        systems.outcome(20, engine=engine, defence="none").metrics
        for engine in ("exact", "nonlinear")
    )
    for name in ("tail_mean", "tail_max", "tail_disagreement", "peak_error"):
        np.testing.assert_allclose(ours[name], theirs[name], atol=1e-5, rtol=0)
    np.testing.assert_allclose(ours["min_speed"], theirs["min_speed"], atol=1e-3)
    np.testing.assert_allclose(ours["peak_turn_rate"], theirs["peak_turn_rate"], rtol=1e-2)
