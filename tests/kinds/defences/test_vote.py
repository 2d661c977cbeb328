"""The vote of theorem 7 (docs/guarantees.md): plain programs, its bound, and where it fails."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from jaxnet.config.scenario import safe_in, situation_of
from jaxnet.kinds.defences import Defence, Neighbourhood
from jaxnet.kinds.defences.vote import Vote
from jaxnet.model.graph import Digraph
from jaxnet.view.text.facts import facts
from tests import systems
from tests.reference import attack_on_links, companion, earlier, navigator_at, voted

TICKS, TICK = 120, 0.05
VEHICLES = {1: "single_integrator", 2: "double_integrator", 3: "two_wheeled"}
GROWTH = 3 + 2 * np.sqrt(2)


def network(rng, more):
    """Edges and ϑ: three trust the navigator, others hear 2ϑ + 1 or more of those before them.

    Of the last vehicles some hear later ones too, which they never believe.
    """
    edges, theta = [[i, 0, 1.0] for i in (1, 2, 3)], {}
    for i in range(4, 10):
        theta[i] = int(rng.integers(1, (i - 2) // 2 + 1))
        number = min(i - 1, 2 * theta[i] + 1 + int(rng.integers(0, 2)))
        sources = rng.choice(np.arange(1, i), number, replace=False).tolist()
        sources += [j for j in range(i + 1, 10) if more and rng.random() < 0.3]
        edges += [[i, int(j), round(float(rng.uniform(0.5, 2.0)), 3)] for j in sources]
    return edges, theta


def liars(edges, theta, rng):
    """Vehicles of whom nobody hears more than ϑ, in an order drawn."""
    found = []
    for j in rng.permutation(np.arange(1, 10)).tolist():
        counts = {i: sum(s in [*found, j] for a, s, _ in edges if a == i) for i in theta}
        if all(count <= theta[i] for i, count in counts.items()):
            found.append(j)
    return found


def study(edges, theta, **keys):
    order = keys.pop("order", 3)
    if order < 3:
        keys |= {"vehicle": VEHICLES[order], "gain": [[1.1], [1.0, 2.0]][order - 1]}
    given = {"engine": "exact", "tick": TICK, "output_step": TICK, "horizon": TICKS * TICK}
    given |= {"vehicles": 9, "topology": {"kind": "edges", "edges": edges}, "tail": 0.5}
    return systems.study(**given | {"defence": {"kind": "vote", "theta": theta}} | keys)


def marched(one, theta, attack):
    """Positions at the ticks (ticks + 1, m, 2), R(E) before and after each, and depths.

    Between ticks `E = G + e^(A t) (E - G)`, with `G = (I - W)⁻¹ d` of the believed links.
    """
    lane, path, added = systems.lane(one, 0), navigator_at(one, 0), attack_on_links(one, 0)
    r, m = len(lane.gain), len(lane.weights)
    gain, flow = np.append(lane.gain, 1.0), expm(companion(lane.gain) * TICK)
    heard = [set(np.flatnonzero(row > 0).tolist()) for row in lane.weights]
    given = [{0}] * m, [theta.get(i + 1, 0) for i in range(m)]
    before, believed = earlier(heard, *given), np.zeros((m, m + 1))
    start = np.stack(lane.vehicle.output_jets(lane.initial[..., None]))[..., 0].swapaxes(1, 2)
    errors = start - path(0.0)[:r, None]
    drive = np.einsum("k,kix->ix", lane.gain, errors) - path(0.0)[r]
    found, drives = [errors[0] + path(0.0)[0]], []
    carried = ~lane.links if attack.get("threat") == "replaces" else np.ones((m, m + 1), bool)

    def carrying(time):
        """Jets that attacks add; a constant in some orders alone acts as R of it over k0."""
        jets = added(time)[: r + 1]
        if attack["kind"] == "spoof":
            jets[0], jets[1:] = np.einsum("k,kijx->ijx", gain, jets) / gain[0], 0.0
        return jets

    for n in range(TICKS):
        now, then = carrying(n * TICK), carrying((n + 1) * TICK)
        told = np.vstack([np.zeros((1, 2)), drive]) * carried[..., None]
        told = told + np.einsum("k,kijx->ijx", gain, now)
        for i, sources in enumerate(heard):
            mine = voted({j: told[i, j] for j in sources}, before[i], given[0][i], given[1][i])
            believed[i] = 0.0
            believed[i, mine] = lane.weights[i, mine] / lane.weights[i, mine].sum()
        own = np.eye(m) - (believed * carried)[:, 1:]
        ends = [np.einsum("ij,kijx->kix", believed, jets) for jets in (now, then)]
        ends = [np.linalg.solve(own, jets) for jets in ends]
        errors = ends[1][:r] + np.einsum("kl,lix->kix", flow, errors - ends[0][:r])
        drives += [np.einsum("k,kix->ix", gain, jets) for jets in ends]
        drive = drives[-1]
        found.append(errors[0] + path((n + 1) * TICK)[0])
    return np.stack(found), np.stack(drives), depths(heard, before)


def depths(heard, before):
    """Votes between the navigator and each vehicle, at most."""
    far = dict.fromkeys(range(len(heard) + 1), 0)
    for _ in heard:
        for i, sources in enumerate(heard, 1):
            votes = 0 not in sources
            far[i] = votes + max(far[j] for j in sources & before[i - 1])
    return np.array([far[i] for i in range(1, len(heard) + 1)])


ATTACKS = [
    {"kind": "rotating", "frequency": 0.9},
    {"kind": "sinusoid", "frequency": 2.3, "direction": 0.4},
    {"kind": "bias", "direction": 1.0},
    {"kind": "spoof", "orders": [0, 2]},
    {"kind": "rotating", "frequency": 1.3, "threat": "replaces"},
    {"kind": "multisine"},
]
CASES = [(1, 2), (2, 1), (3, 3), (4, 3), (5, 3), (6, 1), (7, 2), (8, 3)]


def rate(one, order):
    """Greatest rate of R of any attack [m/s⁴], by differences."""
    gain, attack = np.append(systems.lane(one, 0).gain, 1.0), attack_on_links(one, 0)
    times = np.linspace(0, TICKS * TICK, 40 * TICKS)
    values = [np.einsum("k,kijx->ijx", gain, attack(t)[: order + 1]) for t in times]
    return np.linalg.norm(np.diff(values, axis=0), axis=-1).max() / (times[1] - times[0])


@pytest.mark.parametrize(
    ("seed", "order"), [(0, 3), *(pytest.param(*each, marks=pytest.mark.long) for each in CASES)]
)
def test_a_fleet_moves_as_a_plain_program_and_stays_within_theorem_7(seed, order):
    """Positions to 1e-12 of their size; `‖R(E)‖ ≤ κ_d (Λ h + 1e-9)` from the d-th tick on."""
    rng, attack = np.random.default_rng(seed), dict(ATTACKS[seed % len(ATTACKS)])
    edges, theta = network(rng, more=seed % 2)
    attack |= {"vehicles": sorted(liars(edges, theta, rng)), "magnitude": 8.0}
    one = systems.lanes(study(edges, theta, order=order, attack=attack), 1)
    outcome = systems.simulate(one)
    assert outcome.status.tolist() == [0]
    found, drives, depth = marched(one, theta, attack)
    ours = outcome.series["state"][0][..., :2]
    assert np.abs(ours - found).max() <= 1e-12 * np.abs(found).max()
    allowed = (GROWTH**depth - 1) / (GROWTH - 1) * (1.01 * rate(one, order) * TICK + 1e-9)
    size = np.linalg.norm(drives, axis=-1).reshape(TICKS, 2, -1).max(axis=1)
    for i, d in enumerate(depth):
        assert (size[d:, i] <= allowed[i] + 1e-12).all()


LED = [[1, 0], [2, 0], [3, 0], [4, 1], [4, 2], [4, 3], [5, 2], [5, 3], [5, 4]]
LED = [[*each, 1.0] for each in [*LED, [6, 1], [6, 2], [6, 3], [6, 4], [6, 5]]]
THETA = {4: 1, 5: 1, 6: 2}
LASTING = {"vehicles": 6, "horizon": 45.0, "tail": 2.0, "output_step": 0.5}
CONSTANT = [{"kind": "bias"}, {"kind": "spoof", "orders": [1, 2, 3]}, {"kind": "greedy"}]


def lasting(liars, **attack):
    return study(LED, THETA, attack={"vehicles": liars, "magnitude": 10.0, **attack}, **LASTING)


def safe(given, why):
    one = given.cells[0].scenario
    known = situation_of(one)
    reasons = safe_in(one, known.graph, known.attacked)
    return np.any([each.vehicles for each in reasons if each.why.startswith(why)], axis=0).tolist()


@pytest.mark.parametrize(
    "attack",
    [pytest.param(each, marks=[pytest.mark.long] * (each != CONSTANT[-1])) for each in CONSTANT],
    ids=str,
)
def test_a_lie_whose_r_stays_within_a_tick_leaves_nothing(attack):
    """Λ = 0. A greedy liar jumps at ticks, where its word is judged. 6 bears two liars."""
    given = lasting([2, 5], **attack)
    assert safe(given, "by vote") == [True] * 6
    outcome = systems.simulate(systems.lanes(given, 8, ()))
    assert outcome.status.tolist() == [0] * 8
    assert outcome.metrics["tail_max"].max() < 1e-9


def test_the_vote_fails_where_one_liar_more_is_heard():
    """2 and 3 say the same, of the three whom 4 hears."""
    given = lasting([2, 3], kind="bias", direction=0.0)
    assert safe(given, "by vote") == [True] * 3 + [False] * 3
    outcome = systems.simulate(systems.lanes(given, 8, ()))
    assert outcome.metrics["tail_max"].min() > 9.0


def test_what_liars_announce_is_not_asked():
    given = lasting([2], kind="rotating", announces="zero")
    assert safe(given, "by vote, ‖R(E)‖ ≤ 40.8 Λ h") == [True] * 6
    assert facts(given.cells[0].scenario)["vote"] == (
        "believes whom it trusts: 1-3; votes on earlier ones: 4-6"
    )


def test_each_lane_has_the_order_of_its_own_network():
    """Of 300 networks; a vehicle without a place has all sources before it."""
    rng, m, theta = np.random.default_rng(3), 7, [0, 1, 1, 1, 2, 1, 1]
    sources = np.tile(np.arange(m + 1)[:, None], (1, m))
    linked = (rng.random((m + 1, m, 300)) < 0.6) & (sources != np.arange(1, m + 1))[:, :, None]
    linked[0] &= rng.random((m, 300)) < 0.3
    trusted = (sources == 0) | (rng.random(sources.shape) < 0.05)
    vote = Vote.filled({"theta": dict(enumerate(theta, 1))})
    shared = vote.shared(Digraph(sources.T, linked[..., 0].T), trusted.T, sources)
    around = Neighbourhood(
        sources, jnp.asarray(linked / 1.0), jnp.asarray(trusted), None, None, shared
    )
    found, places = np.asarray(vote.start(around)), []
    for lane in range(300):
        heard = [set(np.flatnonzero(linked[:, i, lane]).tolist()) for i in range(m)]
        known = earlier(heard, [set(np.flatnonzero(trusted[:, i])) for i in range(m)], theta)
        graph = Digraph(sources.T, linked[..., lane].T / 1.0)
        order = vote.order(graph, trusted.T & graph.heard)
        for i in range(m):
            assert set(np.flatnonzero(found[:, i, lane]).tolist()) == known[i]
            assert set(np.flatnonzero(order.earlier[i]).tolist()) == known[i]
        places.append(order.reached.mean())
    assert min(places) < 0.2
    assert max(places) == 1.0


@pytest.mark.long
def test_noise_in_what_is_judged_has_liars_believed():
    """The law has no such error: a liar whom the noise hides leaves one."""
    keys = {"attack": {"kind": "bias", "vehicles": [2], "magnitude": 10.0, "direction": 0.0}}
    given = study(LED, THETA, **keys, **LASTING, sweep={"defence.noise": [0.0, 0.01, 20.0]})
    worst = systems.simulate(systems.lanes(given, 4, ())).metrics["tail_max"].reshape(3, 4)
    assert worst[:2].max() < 1e-9
    assert worst[2].min() > 0.1


@pytest.mark.long
def test_what_is_proved_under_loss_holds():
    """Corollary 3: all messages are jammed 10 ticks in a row. ‖H‖₁ = 1 at gain (1, 3, 3)."""
    jammed = {"channel": {"loss": {"kind": "jamming", "period": 2.0, "length": 0.5}}}
    attack = {"kind": "bias", "vehicles": [2], "magnitude": 10.0}
    given = study(LED, THETA, **LASTING | {"horizon": 60.0, "tail": 30.0}, **jammed, attack=attack)
    times = np.linspace(0, 60.0, 60_001)
    one = systems.lanes(given, 4)
    path = np.stack([navigator_at(one, 0)(t) for t in times])
    driven = np.einsum("k,tkx->tx", [1.0, 3.0, 3.0, 1.0], path)
    changed = np.linalg.norm(np.diff(driven, axis=0), axis=1).max() / 1e-3 * 10 * TICK
    allowed = [changed]
    while len(allowed) < 4:
        allowed.append(GROWTH * allowed[-1] + changed)
    outcome = systems.simulate(one)
    assert outcome.status.tolist() == [0] * 4
    errors = (
        outcome.series["state"][..., :2]
        - navigator_at(one, 0)(np.arange(121) / 2)[0].T[None, :, None]
    )
    worst = np.linalg.norm(errors[:, 60:], axis=-1).max(axis=(0, 1))
    assert (worst <= np.array(allowed)[[0, 0, 0, 1, 2, 3]]).all()
    assert worst.min() > 0.05 * allowed[0]


class Quiet(Defence):
    """Believe trusted sources, and those whose R is the navigator's to 1 m/s³."""

    def hears_messages(self):
        return True

    def decide(self, own, received, last, memory, around):
        """The length of R of each message."""
        return around.trusted[:, :, None] | (jnp.hypot(*around.messages) < 1.0), memory


def test_a_rule_from_outside_hears_messages():
    """R of a constant lie of 10 m is 10 m/s³ at k0 = 1; without the lie it is 0."""
    keys = LASTING | {"vehicles": 4, "horizon": 30.0, "engine": "exact"}
    attack = {"kind": "bias", "vehicles": [2], "magnitude": 10.0}
    outcome = systems.outcome(2, defence=Quiet(), attack=attack, **keys)
    heard = outcome.series["kept"][:, 1:]
    assert (heard[:, :, [0, 2], 2] == 0.0).all()
    assert (heard[:, :, [0, 2], 4] > 0.0).all()
