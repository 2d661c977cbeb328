"""Vehicles that decisions cut off from the navigator: their lane fails, or they coast. Who, since when."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import jaxnet
from jaxnet.engine.status import Status
from jaxnet.kinds.defences import Defence
from jaxnet.kinds.fields import NotNegative
from jaxnet.store import rows
from jaxnet.view.text import tables
from tests import reference, systems
from tests.engine.test_channel import ONE_STEP, Striped, is_lost
from tests.engine.test_exactness import attack_on_links, navigator_at

TICK, TICKS = 0.1, 30
KEYS = {"horizon": TICK * TICKS, "tail": 1.0, "output_step": TICK, "tick": TICK}
NEAR = {"initial": {"position": {"uniform": [-20.0, 20.0]}}}
TIMES = np.arange(TICKS + 1) * TICK


class LastDrops(Defence):
    """From a time on, vehicle 3 drops its only source; from another time on it believes the source again."""

    kind = "last_drops"

    since: NotNegative = 0.0
    until: NotNegative = 100.0

    def decide(self, own, received, last, memory, around):
        """By the time alone."""
        on = (around.time > self.since - 1e-9) & (around.time < self.until - 1e-9)
        third = (around.sources == 2)[:, :, None]
        return ~(third & on[None, None]), memory


def companion(gain):
    """The matrix of `s^r + … + k1 s + k0` on y with its derivatives below r."""
    matrix = np.diag(np.ones(len(gain) - 1), 1)
    matrix[-1] = -np.asarray(gain)
    return matrix


def test_a_vehicle_cut_off_goes_to_rest_where_its_last_drive_leads():
    """On the path the last vehicle keeps z, so its y solves `y^(r) + … + k0 y = z`; others are nominal."""
    defence = {"kind": f"{__name__}:LastDrops", "isolated": "coast"}
    keys = (
        KEYS | NEAR | {"topology": "path", "vehicles": 3, "gain": [2.0, 4.0, 2.5], "attack": "none"}
    )
    begins = [0.0, 0.7]
    given = systems.study(engine="exact", defence=defence, sweep={"defence.since": begins}, **keys)
    one = systems.lanes(given, 1)
    outcome = systems.simulate(one)
    assert (outcome.status == Status.ok).all()
    for number, since in enumerate(begins):
        known = coasting(one, number, since)
        apart = np.abs(outcome.series["state"][number, :, :, :2] - known).max()
        assert apart <= 1e-9
    counted, ticks = outcome.cut_off, TICKS + 1 - np.round(np.array(begins) / TICK)
    assert counted["cut_off"].tolist() == [3, 3]
    np.testing.assert_allclose(counted["cut_off_at"], begins, atol=1e-12)
    assert counted["cut_off_vehicles"].tolist() == [1, 1]
    assert outcome.unheard.tolist() == ticks.tolist()
    np.testing.assert_allclose(counted["cut_off_share"], ticks / (3 * (TICKS + 1)))


def coasting(one, number, since):
    """Positions (ticks + 1, m, 2): nominal, but the last vehicle keeps z from `since` on.

    Until then z is R(y_0); before the first tick, it is the drive of a vehicle without jerk.
    """
    navigator, lane = navigator_at(one, number), systems.lane(one, number)
    gain, initial = lane.gain, lane.initial
    r = len(gain)
    start = reference.flat_jets(initial.T)
    flow, error = companion(gain), start - navigator(0.0)[:r, None]

    def ahead(jets, time):
        return np.einsum("kl,lmx->kmx", expm(flow * time), jets)

    known = np.array([navigator(t)[0] + ahead(error, t)[0] for t in TIMES])
    z = (
        np.append(gain, 1.0) @ navigator(since)[: r + 1]
        if since
        else np.tensordot(gain, start, 1)[2]
    )
    rest = np.concatenate([z[None] / gain[0], np.zeros((r - 1, 2))])[:, None]
    away = ahead(error, since)[:, 2:] + navigator(since)[:r, None] - rest
    for n, t in enumerate(TIMES):
        if t > since - 1e-9:
            known[n, 2] = (rest + ahead(away, t - since))[0, 0]
    return known


class Plain:
    """One lane under W-MSR with F = 1, solved vehicle by vehicle and axis by axis, integrated by SciPy.

    `lossy` loses the messages of `Striped`; `rounds` are those of the law, 0 for the law itself.
    """

    def __init__(self, one, number, lossy=False, rounds=0):
        self.lane, self.navigator = systems.lane(one, number), navigator_at(one, number)
        self.attack, self.lossy, self.rounds = attack_on_links(one, number), lossy, rounds
        self.k = np.append(self.lane.gain, 1.0)
        self.m = len(self.lane.weights)

    def believed(self, n, jets, arrived, before):
        """Whom each vehicle retains by axis, (2, m, m + 1); of a lost message, what was decided before."""
        words = self.attack(n * TICK)[0]
        kept = np.where(arrived[None], True, before)
        for axis, i in np.ndindex(2, self.m):
            own = jets[0, i, axis]
            told = {
                j: jets[0, j - 1, axis] + words[i, j, axis] - own
                for j in range(1, self.m + 1)
                if arrived[i, j]
            }
            for side in (1, -1):
                beyond = [j for j, value in told.items() if side * value > 0]
                if beyond:
                    kept[axis, i, max(beyond, key=lambda j: side * told[j])] = False
        return kept & (self.lane.weights > 0)[None]

    def lost_from(self, heard, sources):
        """Vehicles that no path over the links `heard` (m, m + 1) reaches from the navigator or `sources`."""
        reached, grew = set(sources), True
        while grew:
            new = {
                i
                for i in set(range(self.m)) - reached
                if any(heard[i, j] and (j == 0 or j - 1 in reached) for j in range(self.m + 1))
            }
            reached, grew = reached | new, bool(new)
        return set(range(self.m)) - reached

    def run(self):
        """Positions (ticks + 1, m, 2), and the vehicles cut off and coasting at each tick."""
        jets, m = reference.flat_jets(self.lane.initial.T), self.m
        jerk, kept, believed = np.zeros((m, 2)), {}, np.ones((2, m, m + 1), bool)
        path, off, coasting = [], [], []
        for n in range(TICKS + 1):
            path.append(jets[0])
            arrived = self.lane.weights > 0
            if self.lossy:
                arrived = arrived & ~is_lost(n, np.arange(m)[:, None], np.arange(m + 1)[None])
            believed = self.believed(n, jets, arrived, believed)
            off.append(set.union(*(self.lost_from(believed[axis], []) for axis in (0, 1))))
            keeping = set(off[-1])
            for axis in (0, 1):
                heard = believed[axis] & arrived
                alone = off[-1] | {i for i in range(m) if not heard[i].any()}
                keeping |= alone | self.lost_from(heard, alone)
            coasting.append(keeping)
            last = jerk + np.tensordot(self.k[:3], jets, 1)
            kept = {i: kept.get(i, last[i]) for i in keeping}
            weights = np.where(believed & arrived[None], self.lane.weights[None], 0.0)
            for i in range(m):
                weights[:, i] = (
                    0.0 if i in keeping else weights[:, i] / weights[:, i].sum(1, keepdims=True)
                )
            jets, jerk = self.moved(n * TICK, jets, weights, kept, jerk)
        return np.stack(path), off, coasting

    def asked(self, t, weights, axis):
        """`a0 R(y_0) + W R(a)` on an axis, (m,)."""
        words = self.attack(t)[..., axis]
        words[:, :, 0] += self.navigator(t)[:, None, axis]
        return (weights[axis] * np.tensordot(self.k, words, 1)).sum(axis=1)

    def moved(self, t, jets, weights, kept, jerk):
        """A tick with these weights and kept drives, and the jerk at its end."""
        found = [
            self.on_axis(axis, t, jets[..., axis], weights, kept, jerk[:, axis]) for axis in (0, 1)
        ]
        return np.stack([one[0] for one in found], axis=-1), np.stack(
            [one[1] for one in found], axis=-1
        )

    def on_axis(self, axis, t, jets, weights, kept, jerk):
        """A tick on one axis: (3, m) jets and (m,) jerk. Under rounds a coasting vehicle holds its jerk."""
        heard, own = weights[axis][:, 1:], np.tensordot(self.k[:3], jets, 1)
        if self.rounds:
            demand = self.asked(t, weights, axis) + heard @ own - own
            demand[list(kept)] = jerk[list(kept)]
            for _ in range(self.rounds):
                jerk = demand + heard @ jerk
            y, v, a = jets
            h = TICK
            return np.stack(
                [
                    y + h * v + h**2 / 2 * a + h**3 / 6 * jerk,
                    v + h * a + h**2 / 2 * jerk,
                    a + h * jerk,
                ]
            ), jerk
        inverse, constant = np.linalg.inv(np.eye(self.m) - heard), np.zeros(self.m)
        for i, z in kept.items():
            constant[i] = z[axis]

        def third(s, jets):
            drive = inverse @ (self.asked(s, weights, axis) + constant)
            return drive - np.tensordot(self.k[:3], jets, 1)

        def field(s, flat):
            jets = flat.reshape(3, -1)
            return np.concatenate([jets[1], jets[2], third(t + s, jets)])

        end = solve_ivp(field, (0.0, TICK), jets.ravel(), **ONE_STEP).y[:, -1]
        return end.reshape(3, -1), third(t + TICK, end.reshape(3, -1))


TWO_ROUNDS = {"kind": "rounds", "rounds": 2}
LINKS = [
    [1, 0],
    [2, 0],
    [1, 3],
    [2, 4],
    [3, 1],
    [3, 2],
    [4, 2],
    [4, 3],
    [4, 5],
    [5, 3],
    [5, 4],
    [5, 1],
]
ATTACKED = {
    "topology": {"kind": "edges", "edges": [[*link, 1.0] for link in LINKS]},
    "vehicles": 5,
    "gain": [2.0, 4.0, 2.5],
    "attack": {"kind": "rotating", "vehicles": [2, 4], "magnitude": 8.0, "frequency": 2.0},
}


def attacked(engine, isolated, **keys):
    """Two lanes in which the attack makes vehicles drop so many that paths from the navigator come and go."""
    defence = {"kind": "w_msr", "isolated": isolated}
    return systems.lanes(
        systems.study(engine=engine, defence=defence, seed=6, **keys, **ATTACKED, **KEYS, **NEAR), 2
    )


@pytest.mark.parametrize(("law", "lossy"), [("exact", True), (TWO_ROUNDS, False)])
def test_vehicles_coast_as_the_plain_program(law, lossy):
    """Positions, and who is cut off, since when, how many and how often.

    Other engines: tests/engine/test_drawn.py and tests/engine/test_channel.py.
    """
    keys = {"channel": {"loss": Striped()}} if lossy else {}
    one = attacked("exact", "coast", law=law, **keys)
    outcome = systems.simulate(one)
    assert (outcome.status == Status.ok).all()
    for number in range(2):
        known, off, coasting = Plain(one, number, lossy, 0 if law == "exact" else 2).run()
        apart = np.abs(outcome.series["state"][number, :, :, :2] - known).max()
        assert apart <= 1e-8
        first = next(n for n in range(TICKS + 1) if off[n])
        assert outcome.cut_off["cut_off"][number] == min(off[first]) + 1
        assert outcome.cut_off["cut_off_at"][number] == pytest.approx(first * TICK)
        assert outcome.cut_off["cut_off_vehicles"][number] == len(set.union(*off))
        share = sum(map(len, off)) / (5 * (TICKS + 1))
        assert outcome.cut_off["cut_off_share"][number] == pytest.approx(share)
        assert outcome.unheard[number] == sum(map(len, coasting))
        assert sum(bool(a) != bool(b) for a, b in zip(off[1:], off, strict=False)) >= (
            1 if lossy else 2
        )


@pytest.fixture(scope="module")
def results():
    """Lanes without decisions, lanes that fail, and lanes whose vehicles coast, two of each."""
    coasts = {"kind": "w_msr", "isolated": "coast", "label": "coasts"}
    defences = [{"kind": "none"}, {"kind": "w_msr"}, coasts]
    keys = {"engine": "exact", "seed": 6, "samples": 2, "sweep": {"defence": defences}}
    keys["save"] = {"trajectories": "all"}
    return jaxnet.simulate({**keys, **ATTACKED, **KEYS, **NEAR}, progress=False)


def test_a_failed_lane_tells_who_was_cut_off_first_and_when(results):
    """The lane has numbers until then, of everybody. In the nonlinear engine: tests/engine/test_batch.py."""
    one, failed = attacked("exact", "fail"), results.lanes[2:4].reset_index()
    assert failed["status"].tolist() == ["disconnected"] * 2
    for number in range(2):
        known, off, _ = Plain(one, number).run()
        first = next(n for n in range(TICKS + 1) if off[n])
        assert failed["cut_off"][number] == min(off[first]) + 1
        assert failed["cut_off_at"][number] == pytest.approx(first * TICK)
        states = results.trajectories["states"].sel(cell=1, sample=number).values[..., :2]
        np.testing.assert_allclose(states[:first], known[:first], atol=1e-8, rtol=0)
        assert np.isnan(states[first:]).all()


def test_rows_tell_who_since_when_and_how_long(results):
    """All rows of a study have the same columns; `show` names the vehicle of a failed lane."""
    counted = results.lanes[["cut_off", "cut_off_at", "cut_off_vehicles", "cut_off_share"]]
    assert counted["cut_off"].tolist() == [0, 0, 3, 4, 3, 4]
    np.testing.assert_array_equal(counted["cut_off_at"], [np.nan, np.nan, 0.0, 1.2, 0.0, 1.2])
    assert counted["cut_off_vehicles"][4:].tolist() == [3, 2]
    np.testing.assert_allclose(counted["cut_off_share"][4:], [44 / 155, 20 / 155])
    count, failed = results.failed(9)
    assert count == 2
    assert failed["cut_off"].tolist() == [3, 4]
    assert "disconnected, vehicle 4 since 1.2 s" in tables.failures_text(results)
    alone = rows.isolation_columns(jaxnet.load({"defence": "w_msr", "law": "local"}).cells)
    assert alone == []
    assert rows.isolation_columns(jaxnet.load({"defence": "w_msr"}).cells) == [
        "cut_off",
        "cut_off_at",
    ]
    assert rows.isolation_columns(jaxnet.load({"defence": "none"}).cells) == []
