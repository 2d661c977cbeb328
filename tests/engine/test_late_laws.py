"""Late and lost words under the local law and under exchanges, against plain NumPy programs."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxnet.engine.status import Status
from jaxnet.kinds.losses import Loss
from tests import reference, systems
from tests.engine import test_channel
from tests.engine.test_channel import KEYS, NEAR, TICK, TICKS, Striped, Wavy, errors_at
from tests.engine.test_exactness import attack_on_links, navigator_at
from tests.engine.test_orders import subsequence
from tests.engine.test_stand_ins import Ripple, ripple

H = 0.1
AGENTS = {"vehicle": "single_integrator", "navigator": "none", "law": "local", "gain": [1 / H], "tick": H}
AGENTS |= {"output_step": H, "horizon": 30.0, "tail": 0.0, "engine": "exact", "vehicles": 6}
AGENTS |= {"initial": {"position": {"uniform": [-1.0, 1.0]}}}
WEIGHTS = np.array([[0.5 + (3 * i + 5 * j) % 7 / 10 for j in range(6)] for i in range(6)])
EDGES = [[i + 1, j + 1, float(WEIGHTS[i, j])] for i in range(6) for j in range(6)]
LIE = {"kind": "rotating", "magnitude": 0.7, "frequency": 0.9, "vehicles": [2]}


class Thirds(Loss):
    """Links lose words in a pattern of ticks, listeners and sources, the first ones too."""

    def lost(self, messages, memory):
        """About a third."""
        number = jnp.round(messages.time / H).astype(int)[None, None]
        return is_lost(number, jnp.arange(messages.sources.shape[1])[None, :, None], messages.sources[..., None]), memory


def is_lost(number, listener, source):
    """Whether a word is lost at a tick, for NumPy and JAX."""
    return (3 * number + 7 * listener + 2 * source) % 10 < 4


def stepped(x, lies, late, missing, trims, lost):
    """`x_i ← w_ii x_i + Σ_j w_ij word_j`; a word is d ticks late, lost, held or dropped."""
    path, m = [x], len(x)
    words, heard = np.zeros((m, m, 2)), np.full((m, m), missing == "hold" and late == 0)
    believed = np.ones((m, m, 2), bool)
    words[:] = (x + lies[0])[None]
    for n in range(len(lies) - 1):
        x, new = path[-1], np.empty_like(x)
        for i in range(m):
            others = [j for j in range(m) if j != i]
            fresh = [j for j in others if n >= late and not (lost and is_lost(n, i, j + 1))]
            for j in fresh:
                words[i, j] = path[n - late][j] + lies[n - late][j]
            heard[i] = heard[i] & (missing == "hold")
            heard[i, fresh] = True
            for axis in range(2):
                if trims and fresh:
                    kept, _ = subsequence(x[i, axis], words[i, fresh, axis], np.ones(len(fresh)), set(), 1)
                    believed[i, fresh, axis] = np.isin(np.arange(len(fresh)), kept)
                used = [j for j in others if heard[i, j] and believed[i, j, axis]]
                total = WEIGHTS[i, i] * x[i, axis] + WEIGHTS[i, used] @ words[i, used, axis]
                new[i, axis] = total / (WEIGHTS[i, i] + WEIGHTS[i, used].sum())
        path.append(new)
    return np.stack(path)


@pytest.mark.parametrize(
    ("late", "missing", "trims", "lost", "engine"),
    [
        (3, "drop", False, False, "exact"),
        (2, "drop", True, True, "exact"),
        (0, "hold", False, True, "exact"),
        (0, "hold", True, True, "nonlinear"),
        (2, "hold", True, True, "exact"),
    ],
)
def test_agents_step_towards_old_words(late, missing, trims, lost, engine):
    """300 steps of single integrators that hold their velocity, to 1e-12 m; two lanes."""
    channel = {"delay": late * H, "missing": missing} | ({"loss": Thirds()} if lost else {})
    keys = AGENTS | {"topology": {"kind": "edges", "edges": EDGES}, "engine": engine}
    keys |= {"attack": LIE, "defence": "w_msr" if trims else "none", "channel": channel}
    one = systems.lanes(systems.study(**keys), 2)
    outcome = systems.simulate(one)
    assert (outcome.status == Status.ok).all()
    for number in range(2):
        states, lies = (outcome.series[name][number] for name in ("state", "attack"))
        known = stepped(states[0], lies, late, missing, trims, lost)
        np.testing.assert_allclose(states, known, rtol=0, atol=1e-12)


class OldWords:
    """One lane, link by link: late, lost, held and extrapolated words, errors, attacks, trimming; SciPy."""

    def __init__(self, one, law, late, missing, told="none", rippled=1.0):
        self.lane, self.navigator, self.attack = systems.lane(one, 0), navigator_at(one, 0), attack_on_links(one, 0)
        self.rounds, self.holds = law == "rounds", law != AT_EVERY_INSTANT
        self.late, self.missing, self.told, self.rippled = late, missing, told, rippled
        self.k = np.append(self.lane.gain, 1.0)
        self.motions, self.noise, self.last = [], [], []  # by tick: jets (3, m, 2) as functions of time, …

    def carried(self, n, s, i, j):
        """The four jets on a link at time s of tick n, and what a listener makes of them after the delay."""
        if j == 0:
            jets = self.navigator(s).reshape(4, 2).copy()
        else:
            own = self.motions[n](s)[:, j - 1] + self.noise[n][:, j - 1]
            jets = np.concatenate([own, self.last[n][None, j - 1] * self.rounds])
        jets += self.attack(s)[:, i, j]
        if j > 0 and not self.rounds:
            jets[3] = 0.0
        if self.told == "jets":
            jets[:3] = taylor(jets[:3], self.late * TICK)
        return jets

    def error(self, n, i, j):
        """The error of a word that arrives at a tick, (4, 2)."""
        jets = [[ripple(n * TICK, i, j, axis, k) * self.rippled for axis in range(2)] for k in range(3)]
        return np.array([*jets, [0.0, 0.0]])

    def hear(self, n):
        """Note what has come at tick n: words as functions of time, and which of them are believed."""
        t, m = n * TICK, len(self.lane.weights)
        links = np.argwhere(self.lane.weights > 0)
        fresh = {
            (i, j): not test_channel.is_lost(n, i, j) and n >= self.late for i, j in links
        }
        for i, j in links:
            if fresh[i, j]:
                error, before = self.error(n, i, j), n - self.late
                self.words[i, j] = lambda s, b=before, i=i, j=j, e=error: self.k @ (
                    self.carried(b, (t if self.holds else s) - self.late * TICK, i, j) + e
                )
            elif self.missing == "hold" and (i, j) in self.words:
                value = self.words[i, j](t)
                self.words[i, j] = lambda s, value=value: value
            elif self.missing == "extrapolate" and self.live.get((i, j), False):
                begin = t - TICK * self.holds
                jets = self.carried(n - 1, begin, i, j) + self.error(n - 1, i, j)
                jets[3] *= j == 0
                self.words[i, j] = lambda s, jets=jets, begin=begin: self.k @ taylor(jets, s - begin)
        self.live = fresh
        for i in range(m):
            came = [j for j in range(m + 1) if fresh.get((i, j), False)]
            if self.trims and came:
                self.believed[i, came] = True
            if self.trims and len(came) >= 3 and 0 in came:
                told = [self.carried_plainly(n - self.late, i, j) + self.error(n, i, j)[0] for j in came]
                away = np.linalg.norm(np.array(told) - told[0], axis=1).argmax()
                self.believed[i, came[away]] = False
        usable = self.lane.weights > 0
        if self.missing == "drop":
            usable = np.array([[fresh.get((i, j), False) for j in range(m + 1)] for i in range(m)])
        elif self.late:
            usable = np.array([[(i, j) in self.words for j in range(m + 1)] for i in range(m)])
        weights = np.where(usable & self.believed, self.lane.weights, 0.0)
        total = weights.sum(axis=1, keepdims=True)
        return weights / np.where(total > 0, total, 1.0)

    def carried_plainly(self, n, i, j):
        """The position on a link at tick n, as it is."""
        told, self.told = self.told, "none"
        jets = self.carried(n, n * TICK, i, j)
        self.told = told
        return jets[0]

    def positions(self, trims):
        """(ticks + 1, m, 2)."""
        jets, self.trims, self.words, self.live = reference.flat_jets(self.lane.initial.T), trims, {}, {}
        m, path, q, weights = jets.shape[1], [], np.zeros((jets.shape[1], 2)), self.lane.weights
        self.believed = np.ones(weights.shape, bool)
        if self.missing != "drop" and not self.late:
            self.know_the_start(jets)
        for n in range(TICKS + 1):
            t = n * TICK
            path.append(jets[0])
            self.noise.append(errors_at(t, m))
            self.last.append(q)
            now = {"jets": jets}
            self.motions.append(lambda s, now=now: now["jets"])
            weights = self.hear(n)

            def asked(s, jets, n=n, weights=weights, now=now):
                now["jets"], found = jets, np.zeros((m, 2))
                for i, j in np.argwhere(weights > 0):
                    found[i] += weights[i, j] * self.words[i, j](s)
                own = np.tensordot(self.k[:3], jets + self.noise[n], 1)
                if self.rounds:
                    kept = np.isin(np.arange(m), list(test_channel.keepers(weights > 0)))
                    return np.where(kept[:, None], self.last[n], found - own)
                return np.where((weights == 0).all(axis=1, keepdims=True), 0.0, found - own)

            if self.holds:
                q = asked(t, jets)
                jets = np.stack(taylor([*jets, q], TICK)[:3])
            else:

                def field(s, flat):
                    jets = flat.reshape(3, m, 2)
                    return np.stack([jets[1], jets[2], asked(s, jets)]).ravel()

                method = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-10, "dense_output": True}
                end = solve_ivp(field, (t, t + TICK), jets.ravel(), **method)
                jets = end.y[:, -1].reshape(3, m, 2)
                now["jets"] = jets
                self.motions[-1] = lambda s, dense=end.sol: dense(s).reshape(3, m, 2)
        return np.stack(path)

    def know_the_start(self, jets):
        """The words at the start are known."""
        m = jets.shape[1]
        self.motions, self.noise, self.last = [lambda s: jets], [np.zeros_like(jets)], [np.zeros((m, 2))]
        for i, j in np.argwhere(self.lane.weights > 0):
            at_start = self.carried(0, 0.0, i, j)
            if self.holds:
                self.noise[0] = errors_at(0.0, m)
                at_start = self.carried(0, 0.0, i, j) + self.error(0, i, j)
                self.noise[0] = np.zeros_like(jets)
            at_start[3] *= j == 0 or (self.rounds and self.missing == "hold")
            extrapolated = self.missing == "extrapolate"
            self.words[i, j] = lambda s, a=at_start, e=extrapolated: self.k @ (taylor(a, s) if e else a)
        self.motions, self.noise, self.last = [], [], []


def taylor(jets, by):
    """Jets later by a time, of the polynomial with these jets."""
    each = range(len(jets))
    return np.array([sum(jets[n] * by ** (n - k) / math.factorial(n - k) for n in each[k:]) for k in each])


AT_EVERY_INSTANT = {"kind": "local", "hold": False}


@pytest.mark.parametrize(
    ("law", "late", "missing", "told", "engine"),
    [
        (AT_EVERY_INSTANT, 2, "hold", "none", "exact"),
        (AT_EVERY_INSTANT, 1, "drop", "jets", "nonlinear"),
        (AT_EVERY_INSTANT, 0, "extrapolate", "none", "exact"),
        (AT_EVERY_INSTANT, 0, "hold", "none", "nonlinear"),
        ("local", 0, "extrapolate", "none", "exact"),
        ("rounds", 2, "hold", "jets", "exact"),
        ("rounds", 1, "drop", "none", "nonlinear"),
        ("rounds", 0, "hold", "none", "exact"),
    ],
)
def test_vehicles_move_as_the_plain_program(law, late, missing, told, engine):
    """All at once: errors of sensors and words, loss, attacks on some orders, trimming, other gains."""
    keys = KEYS | NEAR | {"gain": [2.0, 4.0, 2.5], "vehicles": 4, "topology": "complete", "law": law}
    keys |= {"sensing": Wavy(), "defence": "trusted_trim", "engine": engine}
    keys |= {"attack": {"kind": "rotating", "orders": [0, 1, 2, 3] if late else [0, 3], "vehicles": [2, 4]}}
    keys["channel"] = {"delay": late * TICK, "missing": missing, "extrapolate": told}
    keys["channel"] |= {"loss": Striped(), "noise": Ripple()}
    one = systems.lanes(systems.study(**keys), 1)
    outcome = systems.simulate(one)
    assert (outcome.status == Status.ok).all()
    known = OldWords(one, law, late, missing, told).positions(trims=True)
    apart = np.abs(outcome.series["state"][0, :, :, :2] - known).max()
    assert apart <= (1e-5 if engine == "nonlinear" else 1e-7)
