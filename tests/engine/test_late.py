"""Late words: closed forms of harmonics and ramps, and a plain program of all that a channel does."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxnet.config.document import ConfigError
from jaxnet.engine.status import Status
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.path import Path
from jaxnet.kinds.graphs.star import Star
from tests import reference, systems
from tests.engine.test_channel import (
    KEYS,
    NEAR,
    TICK,
    TICKS,
    Striped,
    Wavy,
    dropped,
    errors_at,
    is_lost,
    keepers,
)
from tests.engine.test_exactness import attack_on_links, navigator_at
from tests.engine.test_stand_ins import Powers
from tests.matrices import matrix_of

LOCAL = {"kind": "local", "hold": False}
QUIET = {"attack": "none", "defence": "none", "engine": "exact", "tail": 0.0}


def factors(weights, frequency, delay):
    """What each vehicle makes of a harmonic of the navigator: `(1 - A e)⁻¹ a0 e`, with e = exp(-iωτ)."""
    turn = np.exp(-1j * frequency * delay)
    return np.linalg.solve(np.eye(len(weights)) - turn * weights[:, 1:], turn * weights[:, 0])


@pytest.mark.parametrize(
    ("graph", "vehicle", "tick", "known"),
    [
        (Cyclic(), "two_wheeled", 0.1, (19.649121, 18.697850)),
        (Path(), "two_wheeled", 0.1, (23.942441, None)),
        (Star(), "planar_quadrotor", 0.005, (1.999967, 1.999867)),
        (Path(), "single_integrator", 0.1, (23.942441, None)),
    ],
)
def test_a_figure_eight_is_off_as_the_closed_form_says(graph, vehicle, tick, known):
    """The path 100 sin 0.2 t, 50 sin 0.4 t [m] and words 0.1 s late: the last vehicle, along each axis.

    Neither the order of the vehicles nor the gain nor the tick matters.
    """
    given = {
        "vehicle": vehicle,
        "topology": graph.kind,
        "channel": {"delay": 0.1},
        "tick": tick,
        "output_step": 0.5,
    }
    outcome = systems.simulate(systems.lanes(systems.study(horizon=100.0, **given, **QUIET), 1))
    assert (outcome.status == Status.ok).all()
    time = np.arange(201) * 0.5
    settled = slice(140, None)
    for axis, (size, frequency) in enumerate([(100.0, 0.2), (50.0, 0.4)]):
        found = outcome.series["state"][0, settled, -1, axis]
        expected = (
            size * factors(matrix_of(graph, 12), frequency, 0.1)[-1] * np.exp(1j * frequency * time)
        )
        assert found == pytest.approx(expected.imag[settled], abs=2e-6)
        off = abs(expected[0] - size)
        assert known[axis] is None or off == pytest.approx(known[axis], abs=6e-7)


def test_behind_a_navigator_on_a_line_words_are_late_once_for_each_link():
    """`E = -v τ L⁻¹1`: 1 on a star, i on a path, whatever the gain."""
    for topology, hops in (("star", np.ones(4)), ("path", np.arange(1.0, 5.0))):
        keys = {"navigator": Powers(x=[0.0, 3.0], y=[1.0]), "vehicles": 4, "gain": [2.0, 4.0, 2.5]}
        keys |= {"initial": {"position": 0.0, "heading": 0.0, "speed": 3.0}, "topology": topology}
        keys |= {"channel": {"delay": 0.3}, "tick": 0.1, "horizon": 40.0, "output_step": 40.0}
        outcome = systems.simulate(systems.lanes(systems.study(**keys, **QUIET), 1))
        ends = outcome.series["state"][0, -1, :, :2]
        assert ends[:, 0] == pytest.approx(120.0 - 3.0 * 0.3 * hops, abs=1e-6)
        assert ends[:, 1] == pytest.approx(np.ones(4), abs=1e-6)


class PlainLate:
    """One lane with words d ticks late: every word by recursion into the past, motion by SciPy."""

    def __init__(self, one, number, late, trims):
        self.lane, self.navigator = systems.lane(one, number), navigator_at(one, number)
        self.attack, self.late, self.trims = attack_on_links(one, number), late, trims
        self.k = np.append(self.lane.gain, 1.0)
        self.weights, self.kept, self.told, self.known = [], [], [], {}  # by tick

    def words(self, tick, s):
        """What links carry at time s of a tick, (m, m + 1, 2)."""
        sent = np.concatenate(
            [(self.k @ self.navigator(s).reshape(4, 2))[None], self.drive(tick, s)]
        )
        return sent[None] + np.tensordot(self.k, self.attack(s), 1)

    def drive(self, tick, s):
        """What vehicles follow at time s of a tick, (m, 2)."""
        key = tick, round((s - tick * TICK) * 1e9)
        if tick >= self.late and key not in self.known:
            heard = self.words(tick - self.late, s - self.late * TICK)
            self.known[key] = (self.weights[tick][:, :, None] * heard).sum(axis=1)
        return self.kept[tick] + self.known.get(key, 0.0)

    def decide(self, n, jets, noise, last):
        """Weights and kept drives of a tick."""
        m, t = jets.shape[1], n * TICK
        self.told.append(jets[0] + noise[0])
        heard = (self.lane.weights > 0) & ~is_lost(n, np.arange(m)[:, None], np.arange(m + 1)[None])
        heard &= n >= self.late
        if self.trims and n >= self.late:
            before = t - self.late * TICK
            error = self.told[n - self.late] - self.navigator(before)[0]
            heard &= ~dropped(heard, error, self.attack(before)[0])
        keeping = keepers(heard)
        weights = np.where(heard, self.lane.weights, 0.0)
        for i in range(m):
            weights[i] = 0.0 if i in keeping else weights[i] / weights[i].sum()
        self.keeping = {i: self.keeping.get(i, last[i]) for i in keeping}
        self.weights.append(weights)
        self.kept.append(np.stack([self.keeping.get(i, np.zeros(2)) for i in range(m)]))

    def positions(self):
        """(ticks + 1, m, 2)."""
        jets = reference.flat_jets(self.lane.initial.T)
        m, path, self.keeping = jets.shape[1], [], {}
        last = np.tensordot(self.k[:3], jets, 1)
        for n in range(TICKS + 1):
            t, noise = n * TICK, errors_at(n * TICK, m)
            path.append(jets[0])
            self.decide(n, jets, noise, last if n == 0 else self.drive(n - 1, t))

            def field(s, flat, n=n, t=t, noise=noise):
                jets = flat.reshape(3, m, 2)
                asked = self.drive(n, t + s) - np.tensordot(self.k[:3], jets + noise, 1)
                return np.stack([jets[1], jets[2], asked]).ravel()

            one_step = {"method": "DOP853", "first_step": TICK, "rtol": 1e-6, "atol": 1e-6}
            end = solve_ivp(field, (0.0, TICK), jets.ravel(), **one_step)
            jets = end.y[:, -1].reshape(3, m, 2)
        return np.stack(path)


@pytest.mark.parametrize(
    ("engine", "late", "orders", "accuracy"),
    [
        ("exact", 2, [0], 1e-7),
        ("exact", 1, [0, 1, 2, 3], 1e-7),
        ("nonlinear", 3, [0, 1, 2, 3], 1e-5),
    ],
)
def test_vehicles_with_late_words_move_as_the_plain_program(engine, late, orders, accuracy):
    """All at once: late and lost words, errors of sensors, attacks, trimming, and other gains."""
    keys = (
        KEYS
        | NEAR
        | {"gain": [2.0, 4.0, 2.5], "vehicles": 5, "topology": "complete", "sensing": Wavy()}
    )
    keys |= {"attack": {"kind": "rotating", "orders": orders, "vehicles": [2, 4]}, "engine": engine}
    keys |= {"defence": "trusted_trim", "channel": {"loss": Striped(), "delay": late * TICK}}
    one = systems.lanes(systems.study(**keys), 1)
    outcome = systems.simulate(one)
    assert (outcome.status == Status.ok).all()
    plain = PlainLate(one, 0, late, trims=True)
    apart = np.abs(outcome.series["state"][0, :, :, :2] - plain.positions()).max()
    assert apart <= accuracy
    kept = np.stack(plain.weights) > 0
    np.testing.assert_array_equal(outcome.series["kept"][0] > 0, kept)
    assert 0.2 < kept[late:].mean() < 0.6


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"channel": {"delay": 0.07}}, "multiple of tick = 0.05"),
        ({"channel": {"delay": 20.0}}, "at most 200 times tick"),
        ({"channel": {"delay": 0.1}, "tick": 0.0}, "give a tick"),
        (
            {"channel": {"delay": 0.1}, "law": {"kind": "rounds", "rounds": 2}},
            "makes one at a tick",
        ),
        (
            {"channel": {"missing": "hold"}, "law": {"kind": "rounds", "rounds": 2}},
            "makes one at a tick",
        ),
        ({"channel": {"delay": 0.1, "missing": "extrapolate"}}, "dropped or held"),
        (
            {"channel": {"delay": 0.1, "extrapolate": "jerk"}, "law": "local"},
            "no highest derivative",
        ),
        (
            {"channel": {"delay": 0.4}, "law": LOCAL, "tick": 0.2, "gain": [9, 9, 9]},
            "fastest time constant",
        ),
        ({"channel": {"delay": {"uniform": [0.02, 0.1]}}}, "at least half a tick"),
        ({"channel": {"delay": {"normal": [0.2, 0.1]}}}, "must be at least 0"),
        ({"channel": {"delay": -0.1}}, "must be at least 0"),
        ({"channel": {"delay": 0.1}, "law": "linearised"}, "live words alone"),
        ({"channel": {"noise": {"position": 0.1}}, "law": "linearised"}, "no noise of words"),
        ({"channel": {"delay": 0.1}, "gain": [[1, 3, 3], [1, 3, 4]]}, "a number for each order"),
    ],
    ids=str,
)
def test_what_is_refused(keys, words):
    """Each with its key."""
    with pytest.raises(ConfigError, match=words):
        systems.study(**keys)


@pytest.mark.parametrize(("extrapolate", "known"), [("jets", 2.408082), ("jerk", 0.174020)])
def test_extrapolated_words_are_off_less(extrapolate, known):
    """The figure eight on the ring, words late by a part of what the margin allows.

    With the factors c_n of y^(n) in a word and e = exp(-iωτ): `X = e (A w X + a0 w R)`, w the word over X.
    """
    delay = {"jets": 0.1, "jerk": 0.03}[extrapolate]
    given = {
        "topology": "cyclic",
        "channel": {"delay": delay, "extrapolate": extrapolate},
        "tick": delay,
    }
    keys = given | {"horizon": 240.0, "output_step": 0.3, "initial": {"position": 0.0}} | QUIET
    outcome = systems.simulate(systems.lanes(systems.study(**keys), 1))
    time, weights, settled = np.arange(801) * 0.3, matrix_of(Cyclic(), 12), slice(700, None)
    s = 0.2j
    taylor = [(s * delay) ** j / (1, 1, 2, 6)[j] for j in range(4)]
    word = s**3 + sum(k * s**n * sum(taylor[: 3 - n]) for n, k in enumerate([1.0, 3.0, 3.0]))
    if extrapolate == "jerk":
        word += sum(k * s**n * taylor[3 - n] for n, k in enumerate([1.0, 3.0, 3.0]))
    turn = np.exp(-s * delay) * word / (s + 1) ** 3
    factor = np.linalg.solve(np.eye(12) - turn * weights[:, 1:], turn * weights[:, 0])
    expected = (100.0 * factor[0] * np.exp(s * time)).imag
    assert outcome.series["state"][0, settled, 0, 0] == pytest.approx(expected[settled], abs=1e-5)
    if delay == 0.1:
        assert 100 * abs(factor[0] - 1) == pytest.approx(known, abs=6e-7)


@pytest.mark.parametrize(("delay", "grows"), [(0.035, False), (0.038, True)])
def test_the_margin_of_extrapolated_jerks_on_the_ring(delay, grows):
    """Stable below 0.0363729 s: of two lanes with other starts, the difference shrinks or grows."""
    keys = {"topology": "cyclic", "channel": {"delay": delay, "extrapolate": "jerk"}, "tick": delay}
    keys |= {"horizon": 8000 * delay, "output_step": 2000 * delay} | QUIET
    positions = systems.simulate(systems.lanes(systems.study(**keys), 2)).series["state"][..., :2]
    apart = np.abs(positions[0] - positions[1]).max(axis=(1, 2))
    assert (apart[-1] > 10 * apart[2]) == grows
