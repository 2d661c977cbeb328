"""The exact engine against the independent tick-by-tick program, and against the nonlinear engine."""

import numpy as np

from tests import systems
from tests.engine.test_exactness import RANDOM_GRAPH, UNTRIMMED, exact


def test_attacked_without_trimming_is_exact():
    """O2 at every output time, to rounding; four graphs, two gains and three attacks."""
    for keys in UNTRIMMED:
        one = systems.lanes(systems.study(engine="exact", defence="none", **keys), 1)
        outcome = systems.simulate(one)
        assert (outcome.status == 0).all()
        for number, states in enumerate(outcome.series["state"]):
            known = exact(one, number, 0.1, 300)["positions"]
            assert np.abs(states[:, :, :2] - known).max() <= 1e-9


def test_trimming_at_ticks_decides_and_moves_as_the_reference():
    """The same decisions until one falls on a knife's edge, and positions to 1e-9 m until then."""
    given = systems.study(engine="exact", attack={"magnitude": 5.0}, output_step=0.05)
    one = systems.lanes(given, 4)
    outcome = systems.simulate(one)
    defence = {"trusted": [{0}] * 12, "theta": [1] * 12}
    for number in range(4):
        known = exact(one, number, 0.05, 600, **defence)
        kept = outcome.series["kept"][number]
        alike = (np.abs(kept - known["kept"]) < 1e-12).all(axis=(1, 2))
        first = len(alike) if alike.all() else int(np.argmin(alike))
        assert first == len(alike) or known["margin"][first] < 1e-9
        assert first > 200
        error = np.abs(outcome.series["state"][number, :first, :, :2] - known["positions"][:first])
        assert error.max() <= 1e-9
        changed = (kept[1:] > 0) != (kept[:-1] > 0)
        assert outcome.switches[number] == changed.any(axis=2).sum()


def test_both_engines_measure_the_same():
    """Every contract metric, untrimmed; speeds and turn rates are recovered from flat outputs (O4)."""
    ours, theirs = (
        systems.simulate(systems.lanes(systems.study(engine=engine, defence="none"), 20, ())).metrics
        for engine in ("exact", "nonlinear")
    )
    for name in ("tail_mean", "tail_max", "tail_disagreement", "peak_error"):
        np.testing.assert_allclose(ours[name], theirs[name], atol=1e-5, rtol=0)
    np.testing.assert_allclose(ours["min_speed"], theirs["min_speed"], atol=1e-3)
    np.testing.assert_allclose(ours["peak_turn_rate"], theirs["peak_turn_rate"], rtol=1e-2)


GAIN = [{"uniform": [0.5, 1.5]}, {"uniform": [2.5, 3.5]}, {"choice": [2.5, 3, 3.5]}]


def test_drawn_gains_and_edges_are_each_lane_s_own():
    """O2 with gains and a weighted digraph drawn lane by lane, to 1e-9 m."""
    edges = [[i, j, {"uniform": [weight / 4, 4 * weight]}] for i, j, weight in RANDOM_GRAPH["edges"]]
    topology = {"kind": "edges", "edges": edges}
    one = systems.lanes(systems.study(engine="exact", defence="none", topology=topology, gain=GAIN), 6)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    assert len({systems.lane(one, number).weights.tobytes() for number in range(6)}) == 6
    for number, states in enumerate(outcome.series["state"]):
        known = exact(one, number, 0.1, 300)["positions"]
        assert np.abs(states[:, :, :2] - known).max() <= 1e-9


def test_trimming_with_drawn_gains_and_weights():
    """The same decisions and positions as the reference that has the lane's numbers, tolerance included."""
    topology = {"navigator_weight": {"uniform": [0.05, 0.5]}}
    defence = {"tolerance": {"uniform": [0.1, 1]}}
    given = systems.study(engine="exact", topology=topology, defence=defence, gain=GAIN, output_step=0.05)
    one = systems.lanes(given, 3)
    outcome = systems.simulate(one)
    for number in range(3):
        tolerance = systems.lane(one, number).defence.tolerance
        rule = {"trusted": [{0}] * 12, "theta": [1] * 12, "tolerance": tolerance}
        known = exact(one, number, 0.05, 600, **rule)
        assert known["margin"].min() > 1e-9, "no decision on a knife's edge"
        np.testing.assert_allclose(outcome.series["kept"][number], known["kept"], atol=1e-12)
        error = np.abs(outcome.series["state"][number, :, :, :2] - known["positions"])
        assert error.max() <= 1e-9
