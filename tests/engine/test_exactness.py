"""Both engines against the closed loop's exact solutions (theorems.md O1 to O3)."""

import numpy as np
import pytest

from tests import reference, systems
from tests.reference import exact, navigator_at

RANDOM_GRAPH = {
    "kind": "edges",
    "edges": [
        [i, j, 1.0 + (5 * i + 3 * j) % 7]
        for i in range(1, 13)
        for j in {0, i % 12 + 1, (5 * i) % 13} - {i}
    ],
}
DIRECTION = {"uniform": [0, 6.28]}
UNTRIMMED = [
    {
        "attack": {"kind": "bias", "magnitude": 4.0, "direction": DIRECTION},
        "gain": [6, 11, 6],
        "sweep": {"topology": ["star", "cyclic"]},
    },
    {
        "attack": {"kind": "sinusoid", "magnitude": 4.0, "direction": DIRECTION},
        "gain": [1, 3, 3],
        "sweep": {"topology": ["path", RANDOM_GRAPH]},
    },
    {
        "attack": {"kind": "rotating", "magnitude": 4.0},
        "sweep": {"topology": [RANDOM_GRAPH], "gain": [[1, 3, 3], [6, 11, 6]]},
    },
]
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
    "keys",
    [UNTRIMMED[-1], *[pytest.param(keys, marks=pytest.mark.long) for keys in UNTRIMMED[:-1]]],
)
def test_attacked_without_trimming(keys):
    """O2: star, path, cyclic and a weighted digraph, two gains, at every output time.

    To 1e-5 m in the nonlinear engine, to rounding in the exact one.
    """
    accuracies = {"nonlinear": 1e-5, "exact": 1e-9}
    of_engine = [
        systems.lanes(systems.study(engine=each, defence="none", **keys), 1) for each in accuracies
    ]
    outcomes = [systems.simulate(one) for one in of_engine]
    for number in range(of_engine[0].size):
        known = exact(of_engine[0], number, 0.1, 300)["positions"]
        for outcome, accuracy in zip(outcomes, accuracies.values(), strict=True):
            assert outcome.status[number] == 0
            assert np.abs(outcome.series["state"][number, :, :, :2] - known).max() <= accuracy


TRIMMED = {"attack": {"kind": "rotating", "magnitude": 5.0}, "output_step": 0.05}


@pytest.mark.parametrize(
    ("engine", "accuracy", "knife_edge"),
    [pytest.param("nonlinear", 1e-4, 1e-6, marks=pytest.mark.long), ("exact", 1e-9, 1e-9)],
)
def test_trimming_at_ticks_decides_and_moves_as_the_reference(engine, accuracy, knife_edge):
    """The same decisions, and positions over 30 s for as long as they are the same.

    The ring, with an output at each tick.
    """
    one = systems.lanes(systems.study(engine=engine, **TRIMMED), 2)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    defence = {"trusted": [{0}] * 12, "theta": [1] * 12}
    for number in range(one.size):
        lane = exact(one, number, 0.05, 600, **defence)
        kept = outcome.series["kept"][number]
        alike = (np.abs(kept - lane["kept"]) < 1e-12).all(axis=(1, 2))
        # A decision may differ only where two scores were nearly tied.
        first = len(alike) if alike.all() else int(np.argmin(alike))
        assert first == len(alike) or lane["margin"][first] < knife_edge
        assert first > 200, "the comparison must reach beyond the transient"
        error = np.abs(outcome.series["state"][number, :first, :, :2] - lane["positions"][:first])
        assert error.max() <= accuracy
        changed = (kept[1:] > 0) != (kept[:-1] > 0)
        assert outcome.switches[number] == changed.any(axis=2).sum() > 0


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


GAIN = [{"uniform": [0.5, 1.5]}, {"uniform": [2.5, 3.5]}, {"choice": [2.5, 3, 3.5]}]


def test_drawn_gains_and_edges_are_each_lane_s_own():
    """O2 with gains and a weighted digraph drawn lane by lane, to 1e-9 m."""
    edges = [
        [i, j, {"uniform": [weight / 4, 4 * weight]}] for i, j, weight in RANDOM_GRAPH["edges"]
    ]
    topology = {"kind": "edges", "edges": edges}
    one = systems.lanes(
        systems.study(engine="exact", defence="none", topology=topology, gain=GAIN), 6
    )
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    assert len({systems.lane(one, number).weights.tobytes() for number in range(6)}) == 6
    for number, states in enumerate(outcome.series["state"]):
        known = exact(one, number, 0.1, 300)["positions"]
        assert np.abs(states[:, :, :2] - known).max() <= 1e-9
