"""The nonlinear engine against the closed loop's exact solutions (theorems.md O1 to O3)."""

import numpy as np
import pytest

from tests import reference, systems

TOPOLOGIES = ["star", "cyclic", "path"]
RANDOM_GRAPH = {
    "kind": "edges",
    "edges": [
        [i, j, 1.0 + (5 * i + 3 * j) % 7] for i in range(1, 13) for j in {0, i % 12 + 1, (5 * i) % 13} - {i}
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
        "sweep": {"topology": ["cyclic", RANDOM_GRAPH], "gain": [[1, 3, 3], [6, 11, 6]]},
    },
]
INSTANTS = np.arange(301) * 0.1


def navigator_at(one, number):
    path = systems.lane(one, number).navigator
    return lambda t: np.asarray(path.jets(np.asarray(t)))


def attack_on_links(one, number):
    """`a_ij` jets of a lane by link, written out."""
    lane = systems.lane(one, number)
    m = len(lane.links)

    def at(t):
        basis = np.asarray(lane.signal.basis(np.asarray(t)))
        received = np.zeros((4, m, m + 1, 2))
        for i, j in np.argwhere(lane.links):
            received[:, i, j] = basis @ lane.vectors[:, i if j == 0 else j - 1].T
        return received

    return at


def exact(one, number, interval, intervals, **trimming):
    lane = systems.lane(one, number)
    return reference.propagate(
        lane.weights,
        navigator_at(one, number),
        attack_on_links(one, number),
        lane.gain,
        reference.flat_jets(lane.initial.T),
        interval,
        intervals,
        **trimming,
    )


def test_nominal_tracking_is_exact_and_the_same_in_every_topology():
    """O1: 20 random lanes in each of three topologies, to 5e-6 m over 30 s."""
    given = systems.study(attack="none", defence="none", sweep={"topology": TOPOLOGIES})
    one = systems.lanes(given, 20)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    for number, states in enumerate(outcome.series["state"]):
        lane = systems.lane(one, number)
        known = reference.nominal(
            navigator_at(one, number), lane.gain, reference.flat_jets(lane.initial.T), INSTANTS
        )
        assert np.abs(states[:, :, :2] - known).max() <= 5e-6
    star, cyclic, path = outcome.series["tracking"].reshape(3, 20, 301)
    np.testing.assert_allclose(cyclic, star, atol=5e-6, rtol=0)
    np.testing.assert_allclose(path, star, atol=5e-6, rtol=0)


@pytest.mark.parametrize("keys", UNTRIMMED)
def test_attacked_without_trimming(keys):
    """O2: star, path, cyclic and a weighted digraph, two gains, to 1e-5 m at every output time."""
    one = systems.lanes(systems.study(defence="none", **keys), 1)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    for number, states in enumerate(outcome.series["state"]):
        known = exact(one, number, 0.1, 300)["positions"]
        assert np.abs(states[:, :, :2] - known).max() <= 1e-5


@pytest.fixture(scope="module")
def trimmed():
    """Trimmed cyclic lanes with an output time at each tick, and the tick-by-tick reference of each."""
    given = systems.study(attack={"kind": "rotating", "magnitude": 5.0}, output_step=0.05)
    one = systems.lanes(given, 4)
    outcome = systems.simulate(one)
    count = one.size
    defence = {"trusted": [{0}] * 12, "theta": [1] * 12}
    return one, outcome, [exact(one, number, 0.05, 600, **defence) for number in range(count)]


def test_trimming_at_ticks_decides_and_moves_as_the_reference(trimmed):
    """The same decisions, and positions to 1e-4 m over 30 s for as long as they are the same."""
    _, outcome, known = trimmed
    assert (outcome.status == 0).all()
    for number, lane in enumerate(known):
        kept = outcome.series["kept"][number]
        alike = (np.abs(kept - lane["kept"]) < 1e-12).all(axis=(1, 2))
        # A decision may differ only where two scores were nearly tied.
        first = len(alike) if alike.all() else int(np.argmin(alike))
        assert first == len(alike) or lane["margin"][first] < 1e-6
        assert first > 200, "the comparison must reach beyond the transient"
        error = np.abs(outcome.series["state"][number, :first, :, :2] - lane["positions"][:first])
        assert error.max() <= 1e-4


def test_switches_count_changed_kept_sets(trimmed):
    """`switches` counts (vehicle, tick) pairs whose kept set differs from the tick before."""
    _, outcome, _ = trimmed
    kept = outcome.series["kept"] > 0
    changed = (kept[:, 1:] != kept[:, :-1]).any(axis=3).sum(axis=(1, 2))
    assert outcome.switches.tolist() == changed.tolist()
    assert changed.sum() > 0


def test_received_error_obeys_the_nominal_dynamics_between_switches(trimmed):
    """What a vehicle takes for its error knows nothing of the attack (model.md)."""
    one, outcome, _ = trimmed
    flow = reference.expm(np.array([[0, 1, 0], [0, 0, 1], [-1, -3, -3]]) * 0.05)
    for number in range(len(outcome.status)):
        links, path = attack_on_links(one, number), navigator_at(one, number)
        received = []
        for n, state in enumerate(outcome.series["state"][number]):
            jets, t = reference.flat_jets(state), n * 0.05
            sources = np.concatenate([path(t)[:3, None], jets], axis=1)
            received.append((jets, sources[:, None] + links(t)[:3]))
        kept = outcome.series["kept"][number]

        def error(n, weights, received=received):
            jets, heard = received[n]
            return jets - np.einsum("is,kisx->kix", weights, heard)

        # ε̈ holds F and ω, whose relative accuracy is the integrator's: hence the scale.
        for n in range(0, 600, 3):
            start, end = error(n, kept[n]), error(n + 1, kept[n])
            expected = np.einsum("kl,lix->kix", flow, start)
            assert np.abs(end[:2] - expected[:2]).max() <= 1e-5 * max(1.0, np.abs(start).max())


def test_constant_in_phase_attack_has_the_static_gains():
    """O3: tail mean over ā, untrimmed and with the defence, which protects nobody in star and path."""
    signal = {"kind": "bias", "magnitude": 2.0}
    clock = {"tick": 0.1, "horizon": 60.0}
    known = {"star": (1 / 3, 1 / 3), "path": (1.8333, 1 / 3), "cyclic": (3.0, 0.3)}
    for defence in ("none", "trusted_trim"):
        given = systems.study(attack=signal, defence=defence, **clock, sweep={"topology": list(known)})
        metrics = systems.simulate(systems.lanes(given, 2)).metrics
        for number, (name, (error, disagreement)) in enumerate(known.items()):
            ours = slice(2 * number, 2 * number + 2)
            if defence == "trusted_trim" and name == "cyclic":
                assert (metrics["tail_mean"][ours] / 2.0 < 1e-6).all()
            else:
                assert np.abs(metrics["tail_mean"][ours] / 2.0 - error).max() < 1e-4
                assert np.abs(metrics["tail_disagreement"][ours] / 2.0 - disagreement).max() < 1e-4
                if name == "cyclic":
                    assert np.abs(metrics["tail_max"][ours] / 2.0 - 3.1034).max() < 1e-4


def test_trimming_in_the_vector_field_is_the_limit_of_trimming_at_ticks():
    """On a lane that recovers: the finer the ticks, the nearer to `tick: 0`."""
    ended = {}
    for tick in (0.1, 0.025, 0):
        given = systems.study(tick=tick, horizon=10.0, tail=1.0, attack={"magnitude": 5.0, "vehicles": [2]})
        outcome = systems.simulate(systems.lanes(given, 1))
        assert (outcome.status == 0).all()
        ended[tick] = outcome.series["state"][0, :, :, :2]
    coarse, fine = (np.abs(ended[tick] - ended[0]).max() for tick in (0.1, 0.025))
    assert 0 < fine < coarse / 2
