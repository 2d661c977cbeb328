"""What stands in for a lost word, and errors of words: closed forms, and a plain program of all together."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxnet.config.document import ConfigError
from jaxnet.engine.status import Status
from jaxnet.kinds.losses import Loss
from jaxnet.kinds.navigators import Navigator
from jaxnet.kinds.noises import ChannelNoise
from tests import reference, systems
from tests.engine.test_channel import (
    KEYS,
    NEAR,
    ONE_STEP,
    TICK,
    TICKS,
    Plain,
    Striped,
    Wavy,
    errors_at,
    is_lost,
)


class Powers(Navigator):
    """Polynomials of time, their coefficients by axis."""

    x: list[float]
    y: list[float]

    def jets(self, time):
        xp = time.__array_namespace__()

        def derivative(coefficients, d):
            total = xp.zeros_like(time)
            for n in range(d, len(coefficients)):
                total = total + coefficients[n] * math.perm(n, d) * time ** (n - d)
            return total

        return xp.stack(
            [xp.stack([derivative(each, d) for each in (self.x, self.y)]) for d in range(4)]
        )


def errors(loss, missing, speed, horizon, lanes=1, **keys):
    """Errors along the path (lanes, outputs, m), from rest on a star whose navigator goes straight on."""
    keys = {"navigator": Powers(x=[0.0, speed], y=[0.0]), **keys}
    keys |= {"initial": {"position": 0.0, "heading": 0.0, "speed": speed}, "topology": "star"}
    keys |= {
        "attack": "none",
        "defence": "none",
        "tail": 0.0,
        "horizon": horizon,
        "output_step": 0.1,
    }
    keys |= {"engine": "exact", "tick": 0.1} | keys
    one = systems.lanes(systems.study(channel={"loss": loss, "missing": missing}, **keys), lanes)
    outcome = systems.simulate(one)
    assert (outcome.status == Status.ok).all()
    assert not outcome.unheard.any()
    time = np.arange(outcome.series["state"].shape[1]) * 0.1
    return outcome.series["state"][..., 0] - speed * time[:, None]


@pytest.mark.parametrize(
    ("loss", "expected"),
    [
        ({"kind": "bernoulli", "probability": 0.5}, -10 * 0.1 * 0.5 * 1.5 / (2 * 0.5)),
        ({"kind": "gilbert_elliott", "fail": 0.05, "recover": 0.25}, -10 * 0.1 * 0.583333333),
    ],
    ids=["bernoulli", "gilbert_elliott"],
)
def test_the_mean_error_on_a_ramp_is_the_age_of_the_words(loss, expected):
    """The held word is older by the mean age; inside the 99 % interval over independent vehicles."""
    means = errors(loss, "hold", 10.0, 40.0, lanes=16)[:, 120:].mean(axis=1).ravel()
    assert abs(means.mean() - expected) <= 2.6 * means.std() / np.sqrt(means.size)
    assert means.std() / np.sqrt(means.size) < 0.03


def test_a_jammed_vehicle_falls_behind_as_the_closed_form_says():
    """`E = -v (D - 3 + e^(-D)(3 + 2D + D²/2))` for D = 1, 2, 5 s from rest."""
    loss = {"kind": "jamming", "intervals": [[1.0, 6.5]]}
    error = errors(loss, "hold", 1.0, 6.0)
    for after, known in [(1, -0.0233369), (2, -0.218018), (5, -2.171818)]:
        expected = -(after - 3 + math.exp(-after) * (3 + 2 * after + after**2 / 2))
        assert abs(expected - known) < 1e-6
        assert np.abs(error[:, 10 * (1 + after)] - expected).max() <= 1e-9


def test_a_cubic_is_extrapolated_without_error():
    """A navigator tells its jerk too; to rounding."""
    path = Powers(x=[3.0, 2.0, 0.5, 0.1], y=[1.0, 0.0, -0.2, 0.05])
    speed, keys = (
        2.0,
        {"topology": "star", "attack": "none", "defence": "none", "tick": 0.1, "engine": "exact"},
    )
    keys |= {
        "initial": {"position": [[3.0, 1.0]] * 3, "heading": 0.0, "speed": speed},
        "vehicles": 3,
    }
    keys |= {"navigator": path, "tail": 0.0, "horizon": 6.0, "output_step": 0.1, "tick": 0.1}
    loss = {"kind": "jamming", "intervals": [[2.0, 9.0]]}
    ends = []
    for probability in ({"loss": "none"}, {"loss": loss, "missing": "extrapolate"}):
        outcome = systems.simulate(systems.lanes(systems.study(channel=probability, **keys), 1))
        assert outcome.status.tolist() == [0]
        ends.append(outcome.series["state"][..., :2])
    assert np.abs(np.subtract(*ends)).max() <= 1e-11


class Ripple(ChannelNoise):
    """Errors that differ by tick, listener, source, axis and order."""

    def next_errors(self, last, time, interval, sources):
        listeners, told = (
            jnp.arange(float(sources.shape[1]))[None, :, None],
            sources.astype(float)[..., None],
        )
        return tuple(
            jnp.stack([ripple(time[None, None], listeners, told, axis, k) for axis in range(2)])
            for k in range(3)
        )


def ripple(t, listener, source, axis, order):
    """The error of a word, for NumPy and JAX."""
    sine = np.sin if isinstance(t, float) else jnp.sin
    return 0.2 * sine((order + 1.0) * t + listener + 2.0 * source + axis)


class StandIns(Plain):
    """One lane: lost words are replaced by known functions of time, and words have errors."""

    def __init__(self, one, number, missing, rippled):
        super().__init__(one, number, noisy=True, lossy=True, rounds=0)
        self.missing, self.rippled = missing, rippled

    def error(self, t, i, j):
        """P of the errors of a word."""
        jets = [[ripple(t, i, j, axis, k) * self.rippled for axis in range(2)] for k in range(3)]
        return np.array(jets)

    def words(self, t, jets, x):
        """What each link carries at the end of a tick, as functions of time."""
        attack, navigator = self.attack(t), self.navigator(t)
        found = {}
        for i, j in np.argwhere(self.lane.weights > 0):
            error = self.error(self.before, i, j)
            if self.missing == "hold":
                source = self.k @ navigator if j == 0 else x[j - 1]
                value = source + np.tensordot(self.k, attack[:, i, j], 1) + self.fed_back(error)
                found[i, j] = lambda s, value=value: value
            else:
                told = attack[:3, i, j] + (navigator[:3] if j == 0 else jets[:, j - 1]) + error
                jerk = attack[3, i, j] + navigator[3] if j == 0 else np.zeros(2)
                found[i, j] = lambda s, t=t, told=told, jerk=jerk: self.continued(
                    [*told, jerk], s - t
                )
        return found

    def continued(self, jets, s):
        """R of a Taylor polynomial."""
        moved = [
            sum(jets[n] * s ** (n - k) / math.factorial(n - k) for n in range(k, 4))
            for k in range(4)
        ]
        return self.k @ np.array(moved)

    def positions(self):
        """(ticks + 1, m, 2)."""
        jets = reference.flat_jets(self.lane.initial.T)
        m, path, weights = jets.shape[1], [], self.lane.weights
        noise, jerk, words, heard, self.before = (
            np.zeros_like(jets),
            np.zeros((m, 2)),
            {},
            weights > 0,
            0.0,
        )
        silent = True
        for n in range(TICKS + 1):
            t = n * TICK
            path.append(jets[0])
            if silent:
                rippled, self.rippled = self.rippled, 0.0
            fresh = self.words(t, jets + noise, jerk + self.fed_back(jets + noise))
            if silent:
                self.rippled, silent = rippled, False
            words = {link: fresh[link] if heard[link] else words[link] for link in fresh}
            heard = (weights > 0) & ~is_lost(n, np.arange(m)[:, None], np.arange(m + 1)[None])
            noise, self.before = errors_at(t, m), t
            jets, jerk = self.tick(t, jets, noise, heard, words)
        return np.stack(path)

    def tick(self, t, jets, noise, heard, words):
        """A tick under the law with live and known words, and the jerk at its end."""
        m = jets.shape[1]
        live = np.where(heard, self.lane.weights, 0.0)
        inverse = np.linalg.inv(np.eye(m) - live[:, 1:])
        constant = np.zeros((m, 2))
        for i, j in np.argwhere(live > 0):
            constant[i] += live[i, j] * self.fed_back(self.error(t, i, j))
        lost = [(i, j) for i, j in words if not heard[i, j]]

        def jerk(s, jets):
            right = self.demanded(s, live) + constant
            for i, j in lost:
                right[i] += self.lane.weights[i, j] * words[i, j](s)
            return inverse @ right - self.fed_back(jets + noise)

        def field(s, flat):
            jets = flat.reshape(3, m, 2)
            return np.stack([jets[1], jets[2], jerk(t + s, jets)]).ravel()

        end = solve_ivp(field, (0.0, TICK), jets.ravel(), **ONE_STEP).y[:, -1]
        return end.reshape(3, m, 2), jerk(t + TICK, end.reshape(3, m, 2))


@pytest.mark.parametrize(
    ("engine", "missing", "orders", "rippled"),
    [
        ("exact", "hold", [0, 1, 2, 3], 1.0),
        ("exact", "extrapolate", [0], 1.0),  # what is received is no path with its derivatives
        ("nonlinear", "extrapolate", [0, 1, 2, 3], 1.0),
    ],
)
def test_vehicles_move_as_the_plain_program(engine, missing, orders, rippled):
    """On the ring under attack, sensors with errors, gains other than the default."""
    keys = (
        KEYS | NEAR | {"gain": [2.0, 4.0, 2.5], "defence": "none", "sensing": Wavy(), "vehicles": 5}
    )
    keys["attack"] = {"kind": "rotating", "orders": orders, "vehicles": [2, 4]}
    keys["channel"] = {"loss": Striped(), "missing": missing}
    if rippled:
        keys["channel"]["noise"] = Ripple()
    one = systems.lanes(systems.study(engine=engine, **keys), 1)
    outcome = systems.simulate(one)
    assert outcome.status.tolist() == [Status.ok]
    known = StandIns(one, 0, missing, rippled).positions()
    apart = np.abs(outcome.series["state"][0, :, :, :2] - known).max()
    assert apart <= (1e-7 if engine == "exact" else 1e-5)


def test_a_law_that_cannot_use_old_words_refuses_them():
    """With the keys that the user may change."""
    with pytest.raises(ConfigError, match="linearised knows live words alone"):
        systems.study(channel={"missing": "hold"}, law="linearised")


def test_agents_step_towards_what_they_hear_with_errors():
    """`x ← W (x + n)` under the local law, with lost words dropped."""
    keys = {
        "vehicle": "single_integrator",
        "navigator": "none",
        "law": "local",
        "gain": [1],
        "tick": 1.0,
    }
    keys |= {"output_step": 1.0, "tail": 0.0, "horizon": 20.0, "engine": "exact", "vehicles": 5}
    keys |= {"defence": "none", "attack": "none", "channel": {"loss": Fifths(), "noise": Ripple()}}
    one = systems.lanes(systems.study(**keys), 1)
    places, weights = systems.simulate(one).series["state"][0], systems.lane(one, 0).weights
    for t in range(20):
        expected = places[t].copy()
        for i in range(5):
            heard = [j for j in np.flatnonzero(weights[i]) if (t + i + j) % 5]
            error = [[ripple(float(t), i, j, axis, 0) for axis in range(2)] for j in heard]
            share = weights[i, heard] / weights[i, heard].sum()
            expected[i] = share @ (places[t, np.array(heard) - 1] + np.array(error))
        np.testing.assert_allclose(places[t + 1], expected, rtol=0, atol=1e-12)


class Fifths(Loss):
    """Of five ticks, a link loses one."""

    def lost(self, messages, memory):
        number = jnp.round(messages.time).astype(int)[None, None]
        listeners = jnp.arange(messages.sources.shape[1])[None, :, None]
        return (number + listeners + messages.sources[:, :, None]) % 5 == 0, memory
