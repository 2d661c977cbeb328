"""Vehicles that decisions cut off stop where they come to rest; others go on, by closed form."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from jaxnet.engine.status import Status
from tests import systems
from tests.engine.test_isolated import LastDrops
from tests.reference import companion, navigator_at

TICK, TICKS = 0.1, 120
KEYS = {"vehicles": 4, "attack": "none", "horizon": TICK * TICKS, "tail": 1.0, "output_step": TICK}
KEYS |= {"tick": TICK, "initial": {"position": {"uniform": [-20.0, 20.0]}}}
LINKS = [[1, 0, 1.0], [2, 1, 1.0], [2, 3, 1.0], [3, 2, 1.0], [4, 3, 1.0]]
KEYS["topology"] = {"kind": "edges", "edges": LINKS}
# Poles beside the imaginary axis turn a vehicle round; poles at -3 let its speed die away.
GAINS = {3: ([30.0, 19.0, 5.0], [27.0, 27.0, 9.0]), 2: ([10.0, 2.0], [9.0, 6.0])}


def stopping(engine, vehicle, order=3, **keys):
    """Two lanes whose vehicles 3 and 4 are cut off at once and from 0.7 s on, with two gains."""
    defence = {"kind": f"{LastDrops.__module__}:LastDrops", "isolated": "coast", **keys}
    parts = [
        systems.study(
            engine=engine, vehicle=vehicle, gain=gain, defence=defence | {"since": since}, **KEYS
        )
        for gain, since in zip(GAINS[order], (0.0, 0.7), strict=True)
    ]
    return [systems.lanes(part, 1) for part in parts]


class Known:
    """Vehicles 2 and 3 by closed form: 3 keeps z until it stands still; 2 hears 3 and 0.

    Vehicle 2 has `R(y_2) = (R(y_0) + c) / 2`, with c = z, and `c = k0 p` from the tick after the
    stop at p.
    """

    def __init__(self, one, since):
        self.navigator, lane = navigator_at(one, 0), systems.lane(one, 0)
        self.gain, self.flow, self.r = lane.gain, companion(lane.gain), len(lane.gain)
        start = np.zeros((self.r, 4, 2))  # at rest but for the velocity
        start[0], (heading, speed) = lane.initial[:2].T, lane.initial[2:4]
        start[1] = (speed * np.stack([np.cos(heading), np.sin(heading)])).T
        error = np.einsum("kl,lmx->kmx", expm(self.flow * since), start - self.path(0.0)[:, None])
        now = self.path(since)[:, None] + error
        led = np.append(self.gain, 1.0) @ self.navigator(since)[: self.r + 1]
        z = led if since else self.gain @ start[:, 2]
        self.since, self.third, self.second, self.z = since, now[:, 2], now[:, 1], z

    def path(self, time):
        """The navigator's jets below the order."""
        return self.navigator(time)[: self.r]

    def constant(self, value):
        """Jets of rest under the constant drive `value`."""
        return np.concatenate([value[None] / self.gain[0], np.zeros((self.r - 1, 2))])

    def coasting(self, time):
        """Jets of the third vehicle, before it stops."""
        rest = self.constant(self.z)
        return rest + expm(self.flow * (time - self.since)) @ (self.third - rest)

    def stop(self):
        """Time at which the third vehicle stands still, its place and its heading."""
        first = self.coasting(self.since)[1]

        def ahead(time):
            velocity = self.coasting(time)[1]
            return (
                velocity @ first / np.hypot(*first)
                if self.since == 0
                else np.hypot(*velocity) - 1e-9
            )

        grid = np.arange(self.since, TICK * TICKS, TICK / 2)
        number = next(n for n, time in enumerate(grid) if ahead(time) < 0)
        time = brentq(ahead, grid[number - 1], grid[number], xtol=1e-15)
        jets = self.coasting(time)
        heading = first if self.since == 0 else jets[1]
        return time, jets[0], np.arctan2(heading[1], heading[0])

    def positions(self):
        """Of vehicles 2 and 3 at the ticks, (ticks + 1, 2, 2); nominal until 3 is cut off."""
        end, place, _ = self.stop()
        told = int(np.ceil(end / TICK))
        found, second = [], self.second
        for n in range(TICKS + 1):
            time = n * TICK
            if time > self.since + 1e-9:
                c = self.z if n <= told else self.gain[0] * place
                mean = [0.5 * (self.path(at) + self.constant(c)) for at in (time - TICK, time)]
                second = mean[1] + expm(self.flow * TICK) @ (second - mean[0])
            third = place if time >= end else self.coasting(time)[0]
            found.append([second[0], third])
        return np.array(found)


@pytest.mark.parametrize(
    ("engine", "vehicle", "order"),
    [
        ("exact", "two_wheeled", 3),
        pytest.param("nonlinear", "two_wheeled", 3, marks=pytest.mark.long),  # short: with limits
        pytest.param(
            {"kind": "nonlinear", "solver": "dopri5", "rtol": 1e-9},
            "car",
            3,
            marks=pytest.mark.long,
        ),
        pytest.param({"kind": "stacked", "rtol": 1e-9}, "unicycle", 2, marks=pytest.mark.long),
    ],
)
def test_a_vehicle_cut_off_stops_where_it_stands_still(engine, vehicle, order):
    """Place, heading, speed and turn rate; the vehicle that hears it; and how many stopped."""
    for since, one in zip((0.0, 0.7), stopping(engine, vehicle, order), strict=True):
        outcome, known = systems.simulate(one), Known(one, since)
        assert outcome.status.tolist() == [Status.ok]
        assert outcome.cut_off["stopped"].tolist() == [2]
        states, begin = outcome.series["state"][0], round(since / TICK)
        apart = np.abs(states[begin:, 1:3, :2] - known.positions()[begin:]).max()
        assert apart <= 1e-6
        end, _, heading = known.stop()
        last = states[int(np.ceil(end / TICK)) :, 2]
        assert len(last) >= 10
        assert (last == last[0]).all()
        assert not last[0, 3:].any()
        turned = np.angle(np.exp(1j * (last[0, 2] - heading)))
        assert abs(turned) <= (1e-4 if since else 1e-7)  # at 1e-9 m/s rounding bends a course
        assert outcome.metrics["min_speed"].tolist() == [0.0]
        assert all(np.isfinite(value).all() for value in outcome.metrics.values())


@pytest.mark.long  # short: at rest by a held input, tests/engine/test_standstill.py
@pytest.mark.parametrize("move", ["euler", "exact"])
def test_with_held_inputs_a_vehicle_cut_off_stops_on_its_way(move):
    """A plain loop along its course: `v̇ = -k1 (v - v(0)) - k0 s`, held over a tick."""
    (k0, k1), heading, speed = GAINS[2][0], 0.7, 1.5
    keys = KEYS | {
        "vehicles": 2,
        "vehicle": "unicycle",
        "gain": [k0, k1],
        "engine": {"kind": "sampled", "move": move},
        "topology": {"kind": "edges", "edges": [[1, 2, 1.0], [2, 0, 1.0]]},
        "navigator": {"kind": "driven", "speed": [1.0, 1.0], "turn_rate": [0.0, 0.0]},
        "initial": {"position": [[3.0, 4.0], [0.0, 0.0]], "heading": [heading, 0.0]},
        "defence": {"kind": f"{LastDrops.__module__}:LastDrops", "isolated": "coast"},
    }
    keys["initial"]["speed"] = [speed, 1.0]
    outcome = systems.outcome(1, **keys)
    way, now, ways, span = 0.0, speed, [0.0], TICK
    while now > 0:
        rate = -k1 * (now - speed) - k0 * way
        span = min(TICK, now / max(-rate, 1e-9))
        way += span * now + (move == "exact") * span**2 / 2 * rate
        now = now + span * rate if span == TICK else 0.0
        ways.append(way)
    ways += [way] * (TICKS + 1 - len(ways))
    assert outcome.status.tolist() == [Status.ok]
    assert 0.01 < span < TICK - 0.01
    places = outcome.series["state"][0, :, 0, :2]
    along = np.outer(ways, [np.cos(heading), np.sin(heading)])
    np.testing.assert_allclose(places - places[0], along, rtol=0, atol=1e-9)


def test_a_vehicle_cut_off_stops_where_its_limits_let_it():
    """`v̇ = -k1 (v - v(0)) - k0 s` within limits, until v is 0; without limits it stops sooner."""
    (k0, k1), speed, most = GAINS[2][0], 1.5, 1.5

    def rate(_, state):
        way, now = state
        return [now, np.clip(-k1 * (now - speed) - k0 * way, -most, most)]

    def rest(_, state):
        return state[1]

    rest.terminal = True
    known = solve_ivp(rate, (0.0, 10.0), [0.0, speed], events=rest, rtol=1e-11, atol=1e-13)
    keys = KEYS | {
        "vehicles": 2,
        "vehicle": {"kind": "unicycle", "limits": {"acceleration": most}},
        "gain": [k0, k1],
        "engine": {"kind": "nonlinear", "rtol": 1e-10, "atol": 1e-12},
        "topology": {"kind": "edges", "edges": [[1, 2, 1.0], [2, 0, 1.0]]},
        "navigator": {"kind": "driven", "speed": [1.0, 1.0], "turn_rate": [0.0, 0.0]},
        "initial": {"position": [[3.0, 0.0], [0.0, 0.0]], "heading": 0.0, "speed": [speed, 1.0]},
        "defence": {"kind": f"{LastDrops.__module__}:LastDrops", "isolated": "coast"},
    }
    outcome = systems.outcome(1, **keys)
    assert outcome.status.tolist() == [Status.ok]
    way = outcome.series["state"][0, -1, 0, 0] - 3.0
    assert way == pytest.approx(known.y_events[0][0][0], abs=1e-7)
    assert way > 0.6  # 0.5524 m without limits


@pytest.mark.long
def test_a_vehicle_that_has_stopped_stays_and_passes_nothing_on():
    """Vehicle 3 stops, hears the fleet again and stays; 4 hears it alone, is cut off and stops too.

    Vehicle 2 goes on with what 3 tells: from then on `ε_2 = y_2 - (y_0 + p) / 2` dies away. Both
    engines.
    """
    keys = KEYS | {"horizon": 24.0, "vehicle": "two_wheeled"}
    defence = {
        "kind": f"{LastDrops.__module__}:LastDrops",
        "isolated": "coast",
        "since": 0.7,
        "until": 12.0,
    }
    ends = []
    for engine in ("exact", "nonlinear"):
        one = systems.lanes(
            systems.study(engine=engine, gain=GAINS[3][1], defence=defence, **keys), 1
        )
        outcome, navigator = systems.simulate(one), navigator_at(one, 0)
        assert outcome.status.tolist() == [Status.ok]
        assert outcome.cut_off["stopped"].tolist() == [2]
        assert outcome.cut_off["cut_off_share"] == pytest.approx(2 * (241 - 7) / (4 * 241))
        states = outcome.series["state"][0]
        assert (states[120:, 2:] == states[120:121, 2:]).all()
        mean = (navigator(24.0)[0] + states[-1, 2, :2]) / 2
        np.testing.assert_allclose(states[-1, 1, :2], mean, atol=1e-6)
        ends.append(states[..., :2])
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-6)
