"""Errors of sensors and lost messages in all engines, against a plain program that shares no code."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxnet.engine.status import Status
from jaxnet.kinds.losses import Loss
from jaxnet.kinds.sensors import Sensor
from tests import reference, systems
from tests.engine.test_exactness import attack_on_links, navigator_at

TICK, TICKS = 0.1, 30
ONE_STEP = {
    "method": "DOP853",
    "first_step": TICK,
    "rtol": 1e-6,
    "atol": 1e-6,
}  # off by about 1e-12 a tick
KEYS = {"horizon": TICK * TICKS, "tail": 1.0, "output_step": TICK, "tick": TICK}
NEAR = {"initial": {"position": {"uniform": [-20.0, 20.0]}}}


class Striped(Loss):
    """Messages are lost in a pattern of ticks, listeners and sources; at times nobody hears anything."""

    def lost(self, messages, memory):
        """Of every seven about three, and all at two ticks in a row."""
        number = jnp.round(messages.time / TICK).astype(int)[None, None]
        listeners = jnp.arange(messages.sources.shape[1])[None, :, None]
        return is_lost(number, listeners, messages.sources[:, :, None]), memory


def is_lost(number, listener, source):
    """Whether a message is lost at a tick, for NumPy and JAX."""
    return ((5 * number + 3 * listener + 2 * source) % 7 < 3) | (number % 11 >= 9)


class Wavy(Sensor):
    """Errors that differ by tick, vehicle, axis and order."""

    def errors(self, time, vehicles):
        """Sines of the time."""
        phase = jnp.arange(float(vehicles))[None, :, None] + jnp.array([0.0, 2.0])[:, None, None]
        return tuple(0.3 * jnp.sin((order + 2.0) * time[None, None] + phase) for order in range(3))


def errors_at(t, m):
    """The errors of `Wavy`, (3, m, 2)."""
    phase = np.arange(m)[:, None] + 2.0 * np.arange(2)
    return np.stack([0.3 * np.sin((order + 2.0) * t + phase) for order in range(3)])


def keepers(heard):
    """Vehicles that hear nobody, and those that neither the navigator nor such a vehicle reaches."""
    m = len(heard)
    alone = {i for i in range(m) if not heard[i].any()}
    reached, grew = set(alone), True
    while grew:
        new = {
            i
            for i in range(m)
            if i not in reached
            and any(heard[i, j] and (j == 0 or j - 1 in reached) for j in range(m + 1))
        }
        reached, grew = reached | new, bool(new)
    return alone | (set(range(m)) - reached)


class Plain:
    """One lane: the law solved vehicle by vehicle from what arrived, and integrated by SciPy."""

    def __init__(self, one, number, noisy, lossy, rounds):
        self.lane, self.navigator = systems.lane(one, number), navigator_at(one, number)
        self.attack, self.noisy, self.lossy, self.rounds = (
            attack_on_links(one, number),
            noisy,
            lossy,
            rounds,
        )
        self.k = np.append(self.lane.gain, 1.0)

    def fed_back(self, jets):
        """P of jets (3, m, 2)."""
        return np.tensordot(self.k[:3], jets, 1)

    def demanded(self, t, weights):
        """`a0 R(y_0) + W R(a)`, (m, 2)."""
        words = self.attack(t)
        words[:, :, 0] += self.navigator(t)[:, None]
        return (weights[:, :, None] * np.tensordot(self.k, words, 1)).sum(axis=1)

    def positions(self):
        """(ticks + 1, m, 2), and the number of drives kept, the tick at the end included."""
        jets = reference.flat_jets(self.lane.initial.T)
        m, path, count = jets.shape[1], [], 0
        noise, jerk, kept = np.zeros_like(jets), np.zeros((m, 2)), {}
        for n in range(TICKS + 1):
            t = n * TICK
            path.append(jets[0])
            heard = self.lane.weights > 0
            if self.lossy:
                heard = heard & ~is_lost(n, np.arange(m)[:, None], np.arange(m + 1)[None])
            weights = np.where(heard, self.lane.weights, 0.0)
            last = jerk + self.fed_back(jets + noise)  # what each vehicle tells until now
            keeping = keepers(heard)
            kept = {i: kept.get(i, last[i]) for i in keeping}
            count += len(keeping)
            for i in range(m):
                weights[i] = 0.0 if i in keeping else weights[i] / weights[i].sum()
            noise = errors_at(t, m) if self.noisy else np.zeros_like(jets)
            if self.rounds:
                jerk = self.exchanged(t, jets + noise, weights, jerk, keeping)
                jets = self.coasted(jets, jerk)
            else:
                jets, jerk = self.moved(t, jets, noise, weights, kept)
        return np.stack(path), count

    def exchanged(self, t, sensed, weights, jerk, keeping):
        """The jerk after the rounds; who keeps holds its own."""
        demand = self.demanded(t, weights) - self.fed_back(sensed)
        demand = demand + weights[:, 1:] @ self.fed_back(sensed)
        for i in keeping:
            demand[i] = jerk[i]
        for _ in range(self.rounds):
            jerk = demand + weights[:, 1:] @ jerk
        return jerk

    def coasted(self, jets, jerk):
        """A tick with a jerk held."""
        y, v, a = jets
        return np.stack(
            [
                y + TICK * v + TICK**2 / 2 * a + TICK**3 / 6 * jerk,
                v + TICK * a + TICK**2 / 2 * jerk,
                a + TICK * jerk,
            ]
        )

    def moved(self, t, jets, noise, weights, kept):
        """A tick under the law solved at every instant, and the jerk at its end."""
        m = jets.shape[1]
        inverse = np.linalg.inv(np.eye(m) - weights[:, 1:])
        constant = np.stack([kept.get(i, np.zeros(2)) for i in range(m)])

        def jerk(s, jets):
            return inverse @ (self.demanded(s, weights) + constant) - self.fed_back(jets + noise)

        def field(s, flat):
            jets = flat.reshape(3, m, 2)
            return np.stack([jets[1], jets[2], jerk(t + s, jets)]).ravel()

        end = solve_ivp(field, (0.0, TICK), jets.ravel(), **ONE_STEP).y[:, -1]
        return end.reshape(3, m, 2), jerk(t + TICK, end.reshape(3, m, 2))


CASES = {
    "noise": {"noisy": True, "lossy": False},
    "loss": {"noisy": False, "lossy": True},
    "both": {"noisy": True, "lossy": True},
}
TWO_ROUNDS = {"kind": "rounds", "rounds": 2}


@pytest.mark.parametrize(
    ("case", "engine", "law", "orders"),
    [
        ("both", "exact", "exact", [0, 1, 2, 3]),
        ("loss", "exact", "exact", [0]),  # what is received is no path with its derivatives
        ("both", "nonlinear", "exact", [0, 1, 2, 3]),
        ("loss", "nonlinear", "exact", [0, 1, 2, 3]),  # a window that a loss ends leaves no error
        ("both", "stacked", "exact", [0, 1, 2, 3]),
        ("both", "exact", TWO_ROUNDS, [0, 1, 2, 3]),
        ("noise", "nonlinear", TWO_ROUNDS, [0, 1, 2, 3]),
    ],
)
def test_vehicles_move_as_the_plain_program(case, engine, law, orders):
    """On the ring under attack, with gains other than the default."""
    keys = KEYS | NEAR | {"gain": [2.0, 4.0, 2.5], "defence": "none", "law": law}
    keys["attack"] = {"kind": "rotating", "orders": orders}
    if CASES[case]["noisy"]:
        keys["sensing"] = Wavy()
    if CASES[case]["lossy"]:
        keys["channel"] = {"loss": Striped()}
    one = systems.lanes(systems.study(engine=engine, **keys), 2)
    outcome = systems.simulate(one)
    assert (outcome.status == Status.ok).all()
    for number in range(2):
        known, count = Plain(
            one, number, rounds=0 if law == "exact" else 2, **CASES[case]
        ).positions()
        apart = np.abs(outcome.series["state"][number, :, :, :2] - known).max()
        assert apart <= (1e-7 if engine == "exact" else 2e-8 if case == "loss" else 1e-5)
        assert outcome.unheard[number] == count
        assert (count > 20) == CASES[case]["lossy"]


def dropped(arrived, error, attack):
    """Whom one round of trimming with ϑ = 1 drops: the source farthest from the navigator, who is trusted."""
    away = np.zeros_like(arrived)
    for i in range(len(arrived)):
        heard = np.flatnonzero(arrived[i])
        if len(heard) >= 3 and 0 in heard:
            told = [np.append(np.zeros((1, 2)), error, axis=0)[j] + attack[i, j] for j in heard]
            away[i, heard[np.linalg.norm(told - told[0], axis=1).argmax()]] = True
    return away


def test_trimming_judges_what_arrived():
    """Everybody hears everybody: at every tick the farthest of those who arrived is dropped, if three did."""
    keys = KEYS | {
        "topology": "complete",
        "vehicles": 5,
        "engine": "exact",
        "channel": {"loss": Striped()},
    }
    keys |= {"attack": {"kind": "rotating", "vehicles": [2, 4]}, "defence": "trusted_trim"}
    one = systems.lanes(systems.study(**keys), 1)
    outcome, lane = systems.simulate(one), systems.lane(one, 0)
    attack, navigator, drops = attack_on_links(one, 0), navigator_at(one, 0), 0
    for n in range(TICKS + 1):
        arrived = (lane.weights > 0) & ~is_lost(n, np.arange(5)[:, None], np.arange(6)[None])
        error = outcome.series["state"][0, n, :, :2] - navigator(n * TICK)[0]
        away = dropped(arrived, error, attack(n * TICK)[0])
        keeping = keepers(arrived & ~away)
        expected = arrived & ~away & ~np.isin(np.arange(5), list(keeping))[:, None]
        np.testing.assert_array_equal(outcome.series["kept"][0, n] > 0, expected)
        drops += away.sum()
    assert drops > 20


@pytest.mark.parametrize("delay", [0, 2 * TICK])
def test_a_substituted_message_counts_with_the_weight_of_its_source(delay):
    channel = {"loss": Striped(), "missing": "hold", "delay": delay}
    keys = KEYS | {"engine": "exact", "channel": channel, "defence": "none"}
    one = systems.lanes(systems.study(**keys), 1)
    outcome, lane = systems.simulate(one), systems.lane(one, 0)
    navigator, state = navigator_at(one, 0), outcome.series["state"][0]
    error = np.stack([now[:, :2] - navigator(n * TICK)[0] for n, now in enumerate(state)])
    sources = np.append(np.zeros_like(error[:, :1]), error, axis=1)
    apart = np.linalg.norm(error - np.asarray(lane.weights) @ sources, axis=-1).mean(axis=1)
    heard = slice(4, None)  # every source by then
    np.testing.assert_allclose(outcome.series["disagreement"][0, heard], apart[heard], rtol=1e-6)
