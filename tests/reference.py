"""Plain programs of the closed loop, NumPy and scipy alone, written from docs/ to be compared with.

`Fleet` is one lane with all that may happen to its messages. It knows the lane from the keys of its
config. Within a tick every signal is its values at Chebyshev's nodes. A delay is whole ticks, so a
late message is the values of an earlier tick. The law is one linear system a tick and axis.

`march` is exact from tick to tick where all messages arrive. With E = y - y_0 and
weights held over an interval of length h,

    E(t + h) = G(t + h) + expm(A_c h) (E(t) - G(t)),    G^(k) = L_res^{-1} d^(k),
    d_i^(k) = sum_j w_ij a_ij^(k),                      L_res = I - A_res.

Sources are numbered 0..m (0 is the navigator) and index the columns of `weights`; row i - 1 of any
array over vehicles belongs to vehicle i. Jets come first. The last axis is x, y.
"""

import functools
import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.polynomial import chebyshev
from scipy.linalg import expm
from scipy.stats import chi2

from jaxnet.engine.stages.late import DrawnDelay
from jaxnet.kinds.losses import Loss
from jaxnet.kinds.navigators import Navigator
from jaxnet.kinds.noises import ChannelNoise
from jaxnet.kinds.sensors import Sensor
from tests import systems

TICKS, DEGREE, HIGHEST = 20, 12, 7


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

        axes = [xp.stack([derivative(each, d) for d in range(4)]) for each in (self.x, self.y)]
        return xp.stack(axes, axis=1)


class Hashed(Loss):
    """Messages are lost by a hash of the tick, the listener and the source."""

    of: str
    factors: list[int]
    share: int

    def lost(self, messages, memory):
        """Of each link, each transmitter, or all."""
        tick = jnp.round(messages.time / messages.interval).astype(int)[None, None]
        listeners = jnp.arange(messages.sources.shape[1])[None, :, None]
        return is_lost(self, tick, listeners, messages.sources[:, :, None]), memory


def is_lost(loss, tick, listener, source):
    """Whether a message is lost at a tick, for NumPy and JAX."""
    a, b, c, d = loss.factors
    listener, source = listener * int(loss.of == "link"), source * int(loss.of != "all")
    mixed = a * tick + b * listener + c * source + d * listener * source + tick**2
    return mixed % 29 < loss.share


class Swinging(Sensor):
    """Errors of sensors by tick, vehicle, axis and order."""

    size: Any
    pace: Any

    def tells_deviations(self):
        """As if errors were normal."""
        return True

    def deviations(self):
        """Of three orders."""
        return [self.size] * 3

    def errors(self, time, vehicles):
        """Three orders."""
        vehicle, axis = jnp.arange(float(vehicles))[None, :, None], jnp.arange(2.0)[:, None, None]
        given = (each[None, None] for each in (self.size, self.pace, time))
        given = jnp, *given, vehicle, 0.0, axis
        return tuple(swung(*given, k) for k in range(3))


class Humming(ChannelNoise):
    """Errors of messages by tick, listener, source, axis and order, the highest order last."""

    size: Any
    pace: Any
    orders: str

    def tells_deviations(self):
        """As if errors were normal."""
        return True

    def deviations(self):
        """Of three orders."""
        return [self.size] * 3

    def errs_in_highest(self):
        """Errors of all orders, or of the lower ones."""
        return self.orders == "all"

    def next_errors(self, last, time, interval, sources):
        """Four orders."""
        listeners = jnp.arange(float(sources.shape[1]))[None, :, None]
        given = (each[None, None] for each in (self.size, self.pace, time))
        given = jnp, *given, listeners, sources.astype(float)[..., None]
        orders = (0, 1, 2, HIGHEST)[: 3 + self.errs_in_highest()]
        return tuple(jnp.stack([swung(*given, x, k) for x in (0.0, 1.0)]) for k in orders)


def swung(xp, size, pace, time, listener, source, axis, order):
    """The error at a tick."""
    return size * xp.sin((order + pace) * time + 1.3 * listener + 2.1 * source + 0.9 * axis)


class Patterned(DrawnDelay):
    """Delays in a pattern of ticks, listeners and slots; the tick [s] stands in for the key."""

    def draw(self, time, links):
        """By tick, slot and listener."""
        slots, listeners = jnp.arange(links[0])[:, None, None], jnp.arange(links[1])[None, :, None]
        return late_by(jnp.round(time / self.key).astype(int)[None, None], listeners, slots)


def late_by(tick, listener, slot):
    """Ticks by which a message is late, 1 to 3."""
    return 1 + (2 * tick + listener + slot + tick // 3) % 3


NODES = (1 - np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)) / 2  # of a tick of length 1
VALUES = chebyshev.chebvander(2 * NODES - 1, DEGREE)
ANTIDERIVATIVES = chebyshev.chebint(np.eye(DEGREE + 1), lbnd=-1, axis=0) / 2
INTEGRALS = (
    chebyshev.chebvander(2 * NODES - 1, DEGREE + 1) @ ANTIDERIVATIVES @ np.linalg.inv(VALUES)
)
POWERS = [np.linalg.matrix_power(INTEGRALS, n) for n in range(5)]  # from the tick to the nodes


def taylor(jets, by):
    """Jets (orders, …) later by a time, of the polynomial with these jets."""
    each = range(len(jets))
    steps = [by**n / math.factorial(n) for n in each]
    return np.stack([sum(jets[n] * steps[n - k] for n in each[k:]) for k in each])


def harmonic(time, order, frequency, phase):
    """Derivatives 0 to order of sin(frequency t + phase), (orders, times)."""
    return np.stack(
        [frequency**k * np.sin(frequency * time + phase + k * np.pi / 2) for k in range(order + 1)]
    )


class Fleet:
    """One lane, tick by tick. Sources are 0 to m. Jets have the axes (…, orders, 2)."""

    def __init__(self, keys, delays):
        self.keys, self.channel, self.delays, self.h = keys, keys["channel"], delays, keys["tick"]
        self.nodes, self.integrals = (
            self.h * NODES,
            [self.h**n * each for n, each in enumerate(POWERS)],
        )
        self.attack, self.defence, self.law = keys["attack"], keys["defence"], keys["law"]["kind"]
        self.holds = self.law == "rounds" or keys["law"].get("hold", False)
        self.r, self.m, self.k = len(keys["gain"]), keys["vehicles"], np.append(keys["gain"], 1.0)
        self.damping = np.zeros(self.r)  # gains of own derivatives, compared with nobody's
        if keys["law"].get("damping") == "absolute":
            self.damping[1:], self.k[1:] = self.k[1:-1], 0.0
        topology = keys["topology"]
        self.networks = [self.weights_of(each) for each in topology.get("networks", [topology])]
        self.links = [(int(i), int(j)) for i, j in np.argwhere(sum(self.networks) > 0)]
        self.at_tick, self.sent, self.rounding = [], [], []  # by tick, then by link
        self.own: list[np.ndarray] = []  # jets that vehicles sense of themselves, by tick
        self.words, self.last, self.newest, self.kept = {}, {}, {}, {}  # by link; by vehicle
        self.believed = np.ones((self.m, self.m + 1, 2), bool)
        self.noise, self.fails_at = np.zeros((self.m, self.r, 2)), None
        self.detector = keys.get("detector", {"cuts": "never"})
        self.alarms, self.true, self.until = 0, [], {}  # jets by tick; ends of cuts by link
        self.filters, self.sums = {}, {}  # by link

    def weights_of(self, topology):
        """Normalised weights of a list of edges."""
        weights = np.zeros((self.m, self.m + 1))
        for i, j, w in topology["edges"]:
            weights[i - 1, j] = w
        return weights / weights.sum(axis=1, keepdims=True)

    def network(self, n):
        """Weights of the network in force at a tick, without links that alarms have cut."""
        ticks = round(self.keys["topology"].get("every", 1e6) / self.h)
        weights = self.networks[n // ticks % len(self.networks)].copy()
        for link, until in self.until.items():
            if until > n * self.h + 1e-9:
                weights[link] = 0.0
        return weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)

    def cut(self, n, arrived):
        """Messages without those that an alarm cuts; it may cut their links too."""
        given, left = self.detector, dict(arrived)
        for (i, j), b in arrived.items() if given["cuts"] != "never" else ():
            predicted, spread = self.predicted(i, j, b)
            if b is None:
                continue
            told = self.at_tick[b][i, j] + self.rounding[b][i, j] + self.errors[i, j]
            told = told[: self.r]
            if predicted is None or not self.alarm((i, j), told - predicted, spread):
                self.learn((i, j), told, predicted, spread)
                continue
            left[i, j], self.alarms = None, self.alarms + 1
            back = [(j - 1, i + 1)] if j > 0 and given["cuts"] == "both_ways" else []
            for link in [(i, j), *back] if given["cuts"] != "message" else []:
                self.until[link] = n * self.h + (given.get("return_after") or math.inf)
        for link, until in self.until.items():
            if until > n * self.h + 1e-9:
                self.filters.pop(link, None)
                self.sums.pop(link, None)
        return left

    def variance(self, j):
        """Variances of messages, by order."""
        total = np.zeros(self.r) + np.array(self.channel["quantisation"]) ** 2 / 12
        for errors in (self.channel["noise"], self.keys["sensing"] if j > 0 else None):
            total[:3] += getattr(errors, "size", 0.0) ** 2
        return total

    def predicted(self, i, j, b):
        """Jets that a listener expects, None if it knows none, and covariance of the residual."""
        if self.detector.get("predicts") is None:
            return None if b is None else self.true[b][j], np.diag(self.variance(j))
        if (i, j) not in self.filters:
            return None, None
        jets, spread = self.filters[i, j]
        moved, push = expm(self.h * np.diag(np.ones(self.r - 1), 1)), np.zeros((self.r, 1))
        push[:, 0] = [self.h**k / math.factorial(k) for k in range(self.r, 0, -1)]
        push = self.detector["predicts"]["unknown"] * push
        spread = moved @ spread @ moved.T + push @ push.T
        self.filters[i, j] = moved @ jets, spread
        return moved @ jets, spread + np.diag(self.variance(j))

    def learn(self, link, told, predicted, spread):
        """A filter's update with a message."""
        if self.detector.get("predicts") is None:
            return
        if predicted is None:
            self.filters[link] = told, np.diag(self.variance(link[1]))
            return
        jets, before = self.filters[link]
        gain = before @ np.linalg.inv(spread)
        self.filters[link] = jets + gain @ (told - predicted), before - gain @ before

    def alarm(self, link, residual, spread):
        """Whether a residual raises an alarm."""
        given = self.detector
        if given["kind"] == "distance":
            return np.linalg.norm(residual[0]) > given["threshold"]
        z = np.einsum("kx,kl,lx", residual, np.linalg.inv(spread), residual)
        if given["kind"] == "cusum":
            total = max(0.0, self.sums.get(link, 0.0) + z - given["drift"])
            self.sums[link] = 0.0 if total > given["threshold"] else total
            return total > given["threshold"]
        last = self.sums[link] = [*self.sums.get(link, []), z][-given["window"] :]
        return chi2.sf(sum(last), 2 * len(last) * self.r) < given["false_alarms"]

    def navigator(self, time):
        """Jets of the path."""
        given = self.keys["navigator"]
        numbers = zip(given["amplitude"], given["frequency"], given["phase"], strict=True)
        axes = [size * harmonic(time, self.r, *turning) for size, *turning in numbers]
        return np.stack(axes, axis=-1).transpose(1, 0, 2)

    def is_attacked(self, i, j):
        """Whether a link is attacked."""
        given = self.attack
        if given["kind"] == "none" or given.get("moves") == "input":
            return False
        if given["links"] == "navigator":
            return j == 0 and i + 1 in given["vehicles"]
        return j in given["vehicles"]

    def is_replaced(self, i, j):
        """Whether a link carries nothing of its source."""
        return self.is_attacked(i, j) and self.attack["threat"] == "replaces"

    def signal(self, time, i, j):
        """Jets of the signal on an attacked link."""
        given, r = self.attack, self.r
        place = given["vehicles"].index(j or i + 1)
        if given["kind"] == "own_path":
            swing = harmonic(time, r, given["frequency"], given["phase"] + np.pi / 2)
            jets = np.array(given["swing"]) * swing.T[..., None]
            jets[:, 0] += given["centre"]
            return jets
        if given["kind"] in ("bias", "spoof"):
            angle = given["direction"][place]
            jets = np.zeros((len(time), r + 1, 2))
            jets[:, : r + 1 if given["kind"] == "spoof" else 1] = [np.cos(angle), np.sin(angle)]
            return given["magnitude"] * jets * self.falsified()
        frequency = given["frequency"][place]
        size = given["magnitude"] / max(frequency**k for k in np.flatnonzero(self.falsified()))
        if given["kind"] == "rotating":
            phase = given["phase"][place]
            axes = [harmonic(time, r, frequency, phase + turn) for turn in (np.pi / 2, 0.0)]
            return size * np.stack(axes, axis=-1).transpose(1, 0, 2) * self.falsified()
        angle = given["direction"][place]
        wave = harmonic(time, r, frequency, given["phase"][place]).T[..., None]
        return size * wave * np.array([np.cos(angle), np.sin(angle)]) * self.falsified()

    def falsified(self):
        """1 for orders that carry the signal, (orders, 1)."""
        misused = [0] if self.attack.get("moves") == "input" else range(self.r + 1)
        orders = self.attack.get("orders", misused)
        return np.array([[float(k in orders)] for k in range(self.r + 1)])

    def inputs(self, n):
        """Inputs at the nodes, (nodes, 2), of the vehicles that misuse theirs."""
        if self.attack.get("moves") != "input":
            return {}
        times = n * self.h + self.nodes * (not self.holds)
        return {i - 1: self.signal(times, 0, i)[:, 0] for i in self.attack["vehicles"]}

    def carried(self, time, i, j, own):
        """Jets that a link carries, with `own` those that its source tells."""
        jets = self.navigator(time) if j == 0 else own
        if self.is_attacked(i, j):
            if self.attack["kind"] == "own_path":
                jets = self.signal(time, i, j)
            elif self.is_replaced(i, j):
                jets = self.navigator(time) + self.signal(time, i, j)
            else:
                jets = jets + self.signal(time, i, j)
        if self.law == "local" and (j > 0 or self.k[-1] == 0):
            jets = jets * (np.arange(self.r + 1) < self.r)[:, None]
        return jets

    def sensed_errors(self, n):
        """Errors of sensors, (m, orders below r, 2)."""
        errors, given = np.zeros((self.m, self.r, 2)), self.keys["sensing"]
        if isinstance(given, Swinging):
            for i, k, x in np.ndindex(self.m, min(self.r, 3), 2):
                errors[i, k, x] = swung(np, given.size, given.pace, n * self.h, i, 0.0, x, k)
        return errors

    def word_errors(self, n, i, j):
        """Errors of a message, (orders, 2)."""
        errors, given = np.zeros((self.r + 1, 2)), self.channel["noise"]
        if isinstance(given, Humming):
            for k, x in np.ndindex(self.r + 1, 2):
                order = HIGHEST if k == self.r else k
                if k == self.r or k < 3:
                    errors[k, x] = swung(np, given.size, given.pace, n * self.h, i, j, x, order)
            errors[self.r] *= given.orders == "all"
        return errors

    def rounded(self, jets):
        """What rounding adds to jets at a tick, (orders, 2)."""
        step = np.zeros((self.r + 1, 1))
        step[: self.r, 0] = self.channel["quantisation"]
        nearest = step * np.round(jets / np.where(step > 0, step, 1.0))
        return np.where(step > 0, nearest - jets, 0.0)

    def arrival(self, n, i, j):
        """The tick at which the message was sent that is heard at tick n, None where none is."""
        loss, after = self.channel["loss"], self.newest.get((i, j), -1) + 1
        came = [b for b in range(max(0, n - 3, after), n + 1) if b + self.delays(b, i, j) == n]
        lost = isinstance(loss, Hashed) and is_lost(loss, n, i, j)
        if not came or lost or self.network(n)[i, j] == 0:
            return None
        return came[-1]

    def start(self):
        """Jets at t = 0, (m, orders, 2)."""
        given, jets = self.keys["initial"], np.zeros((self.m, self.r, 2))
        jets[:, 0] = given["position"]
        if self.r in (2, 3):
            heading = given["heading"]
            jets[:, 1] = given["speed"] * np.array([np.cos(heading), np.sin(heading)])
        return jets

    def motion(self):
        """Jets at the ticks, (ticks + 1, m, orders, 2)."""
        jets, path = self.start(), []
        top = np.zeros((self.m, 2))
        for n in range(TICKS + 1):
            path.append(jets)
            jets, top = self.tick(n, jets, top)
        return np.stack(path)

    def tick(self, n, jets, top):
        """Jets and highest derivatives at the end of a tick, of those at its begin."""
        t, links = n * self.h, self.links
        before = np.einsum("k,ikx->ix", self.k[:-1], jets + self.noise) + top
        self.noise = self.sensed_errors(n)
        told = np.concatenate([jets + self.noise, top[:, None]], axis=1)
        now = {(i, j): self.carried(t + np.zeros(1), i, j, told[None, j - 1])[0] for i, j in links}
        self.at_tick.append(now)
        self.rounding.append({link: self.rounded(each) for link, each in now.items()})
        self.errors = {link: self.word_errors(n, *link) for link in links}
        if n == 0 and self.channel["missing"] != "drop" and self.channel["delay"] == 0:
            self.know_the_start(jets)
        self.true.append([self.navigator(t + np.zeros(1))[0, : self.r], *jets])
        arrived = self.cut(n, {link: self.arrival(n, *link) for link in links})
        weights = self.network(n)
        arrived = {link: b if weights[link] > 0 else None for link, b in arrived.items()}
        self.newest |= {link: b for link, b in arrived.items() if b is not None}
        known, live = self.hear(n, {link: b for link, b in arrived.items() if weights[link] > 0})
        if self.defence["kind"] == "vote":
            if self.law == "exact":  # R alone counts
                told = np.concatenate([np.zeros_like(jets), before[:, None]], axis=1)
            self.vote(t, weights, told, known, live)
        else:
            self.judge(jets + self.noise, arrived)
        shares = np.zeros((self.m, self.m + 1, 2))
        for link in [*known, *live]:
            shares[link] = weights[link] * self.believed[link]
        shares /= np.maximum(shares.sum(axis=1, keepdims=True), 1e-12)
        keeping = self.keepers(n, shares, weights)
        self.kept = {i: self.kept.get(i, (top if self.holds else before)[i]) for i in keeping}
        free = self.free(jets)
        highest = self.solved(n, free, shares, known, live, top)
        orders = [self.integrals[self.r - k] for k in range(self.r)]
        moved = free + np.stack([np.einsum("cd,idx->icx", n, highest) for n in orders], axis=2)
        own = np.concatenate([moved + self.noise[:, None], highest[:, :, None]], axis=2)
        self.own.append(told[:, None] if self.holds else own)
        self.sent.append({(i, j): self.carried(t + self.nodes, i, j, own[j - 1]) for i, j in links})
        for link in live:
            self.last[link] = n + 1, self.heard(n, n, link)[-1]
            self.words[link] = self.value(self.heard(n, n, link))
        return moved[:, -1], highest[:, -1]

    def free(self, jets):
        """Jets at the nodes of a motion without highest derivative, (m, nodes, orders, 2)."""
        return np.stack([taylor(jets.swapaxes(0, 1), s).swapaxes(0, 1) for s in self.nodes], axis=1)

    def heard(self, n, b, link):
        """Jets that a listener hears from tick n on, of the message of tick b."""
        jets = self.at_tick[b][link][None] if self.holds else self.sent[b][link]
        if self.channel.get("own_delay"):
            jets = jets - self.own[b][link[0]] * (np.arange(self.r + 1) < self.r)[:, None]
        jets = jets + self.rounding[b][link]
        if self.channel["extrapolate"] != "none":
            some = self.r + (self.channel["extrapolate"] == "jerk")
            continued = taylor(jets[:, :some].swapaxes(0, 1), (n - b) * self.h).swapaxes(0, 1)
            jets = np.concatenate([continued, jets[:, some:]], axis=1)
        return jets + self.errors[link]

    def value(self, jets):
        """What a listener uses of jets."""
        return np.einsum("k,...kx->...x", self.k, jets)

    def know_the_start(self, jets):
        """The messages of t = 0, which stand in for first messages that are lost."""
        for i, j in self.links:
            own = np.concatenate([jets + self.noise * self.holds, np.zeros((self.m, 1, 2))], axis=1)
            told = self.carried(np.zeros(1), i, j, own[None, j - 1])[0]
            if self.holds:
                told = told + self.rounding[0][i, j] + self.errors[i, j]
            self.words[i, j] = self.value(told) + np.zeros((DEGREE + 1, 1))
            self.last[i, j] = 0, told

    def judge(self, own, arrived):
        """Whom vehicles believe of those that arrived."""
        for i in range(self.m):
            came = {j: b for (a, j), b in arrived.items() if a == i and b is not None}
            links = [(b, (i, j)) for j, b in came.items()]
            told = [
                (self.at_tick[b][x] + self.rounding[b][x] + self.errors[x])[0] for b, x in links
            ]
            self.believed[i, list(came)] = True
            for j, axis in self.dropped(own[i, 0], dict(zip(came, told, strict=True))):
                self.believed[i, j, axis] = False

    def vote(self, time, weights, told, known, live):
        """Whom vehicles believe, by R of what links carry at a tick, of jets that vehicles tell."""
        values = {link: each[0] for link, each in known.items()}
        for i, j in live:
            jets = self.carried(np.array([time]), i, j, told[None, j - 1])[0]
            values[i, j] = self.value(jets + self.rounding[-1][i, j] + self.errors[i, j])
        for i in range(self.m):
            heard = {j: values.get((i, j)) for j in range(self.m + 1) if weights[i, j] > 0}
            self.believed[i] = False
            self.believed[i, voted(heard, self.earlier[i], *self.trusts(i))] = True

    @functools.cached_property
    def earlier(self):
        """Sources before each vehicle in its order."""
        heard = [{j for a, j in self.links if a == i} for i in range(self.m)]
        return earlier(heard, *zip(*map(self.trusts, range(self.m)), strict=True))

    def trusts(self, i):
        """Sources that a vehicle trusts, and its ϑ."""
        given = self.defence["trusted"]
        trusted = set() if given == "none" else {0, *given.get(i + 1, [])}
        return trusted, self.defence["theta"].get(i + 1, 0)

    def dropped(self, own, told):
        """Sources that a vehicle drops, with the axes."""
        kind, others = self.defence["kind"], [j for j in told if j > 0]
        count = self.defence.get("theta", self.defence.get("F", 0))
        if kind == "w_msr":
            away = {(j, axis): told[j][axis] - own[axis] for j in others for axis in range(2)}
            found = []
            for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
                beyond = [each for each in away if each[1] == axis and sign * away[each] > 0]
                found += sorted(beyond, key=lambda each: -abs(away[each]))[:count]
            return found
        few = len(told) < 2 * count + 1 or len(told) - len(others) < count
        if kind == "trusted_trim" and few:
            return []
        middle = told[0] if kind == "trusted_trim" and count else own
        farthest = sorted(others, key=lambda j: -np.linalg.norm(told[j] - middle))
        return [(j, slice(None)) for j in farthest[:count]]

    def hear(self, n, arrived):
        """Words at the nodes, of links on which they are known; links on which they are live."""
        known, live = {}, []
        for link, b in arrived.items():
            if b == n and not self.holds:
                live.append(link)
                continue
            if b is not None:
                jets = self.heard(n, b, link)
                self.words[link] = self.value(jets) + np.zeros((DEGREE + 1, 1))
                self.last[link] = n, jets[-1]
            elif self.channel["missing"] == "drop" or link not in self.words:
                continue
            elif self.channel["missing"] == "hold":
                self.words[link] = self.words[link][-1:] + np.zeros((DEGREE + 1, 1))
            else:
                begin, jets = self.last[link]
                jets = np.concatenate([jets[:-1], jets[-1:] * (link[1] == 0)])
                times = (n - begin) * self.h + self.nodes * (not self.holds)
                self.words[link] = np.stack([self.value(taylor(jets, s)) for s in times])
            known[link] = self.words[link]
        return known, live

    def keepers(self, n, shares, weights):
        """Vehicles that keep their last drive. Notes whether the lane fails."""
        if self.law == "local":
            return set()
        heard = np.moveaxis(shares > 0, 2, 0)
        alone = {int(i) for i in np.argwhere(~heard.any(axis=2))[:, 1]}
        cut_off = self.unreached(np.moveaxis((weights > 0)[..., None] & self.believed, 2, 0), set())
        if self.defence.get("isolated") == "coast":
            alone |= cut_off
        elif cut_off and len(self.networks) == 1 and self.fails_at is None:
            self.fails_at = n
        if self.channel["missing"] == "drop" or self.channel["delay"] != 0:
            alone |= self.unreached(heard, alone)
        return alone

    def unreached(self, by_axis, sources):
        """Vehicles that no navigator's or replaced word reaches on some axis, nor these."""
        replaced = [link for link in self.links if self.is_replaced(*link)]
        by_axis = by_axis.copy()
        for i, j in replaced:
            by_axis[:, i, 0] |= by_axis[:, i, j]
        return {i for heard in by_axis for i in set(range(self.m)) - reached(heard, sources)}

    def solved(self, n, free, shares, known, live, top):
        """Highest derivatives at the nodes, (m, nodes, 2), where `top` was held until now."""
        m, count = self.m, DEGREE + 1

        def of_gain(gain):
            felt = np.einsum("k,ickx->icx", gain, free + self.noise[:, None])
            return felt, sum(gain[k] * self.integrals[self.r - k] for k in range(self.r))

        felt = self.k[:-1] * (not self.channel.get("own_delay"))
        (fed_back, flow), (damped, own_flow) = map(of_gain, (felt, self.damping))
        right, graph = np.zeros((m, count, 2)), np.zeros((m, m, 2))
        for (i, j), values in known.items():
            right[i] += shares[i, j] * values
        for i, j in live:
            added = self.carried(n * self.h + self.nodes, i, j, np.zeros((count, self.r + 1, 2)))
            added = added + self.rounding[n][i, j] + self.errors[i, j]
            right[i] += shares[i, j] * self.value(added)
            if j > 0 and not self.is_replaced(i, j):
                graph[i, j - 1] = shares[i, j]
        hears, solved = shares.any(axis=1), np.zeros((m, count, 2))
        taken = self.inputs(n)
        obeys = np.array([i not in taken for i in range(m)], float)
        if self.holds:
            demand = right - fed_back
            for _ in range(self.keys["law"].get("rounds", 1) - 1):  # each hears the last round's
                new, before = demand[:, 0], top
                for i, j in known:
                    if j > 0 and not self.is_replaced(i, j):
                        right[i] += shares[i, j] * (new[j - 1] - before[j - 1])
                top, demand = new, right - fed_back
            solved += (demand * hears[:, None] - damped)[:, :1]
            for i, values in [*self.kept.items(), *taken.items()]:
                solved[i] = values
            return solved
        for i, kept in self.kept.items():
            right[i], graph[i], hears[i] = kept, 0.0, True
        for i, values in taken.items():
            right[i], graph[i], hears[i], damped[i] = values, 0.0, False, 0.0
        for x in range(2):
            own = np.diag(hears[:, x].astype(float)) - graph[:, :, x] * (self.law == "local")
            drive = right[:, :, x]
            if self.law == "exact":
                drive = np.linalg.solve(np.eye(m) - graph[:, :, x], drive)
            matrix = np.eye(m * count) + np.kron(own, flow) + np.kron(np.diag(obeys), own_flow)
            right_side = drive - own @ fed_back[:, :, x] - damped[:, :, x]
            values = np.linalg.solve(matrix, right_side.ravel())
            solved[:, :, x] = values.reshape(m, count)
        return solved


def earlier(heard, trusted, theta):
    """Sources before each vehicle in the order of a vote; all, for one without a place in it."""
    place, before, found = {0}, None, [set(range(len(heard) + 1)) for _ in heard]
    while place != before:
        before = set(place)
        for i in {i for i in range(len(heard)) if i + 1 not in before}:
            mine = heard[i] & trusted[i]
            if mine <= before if mine else len(heard[i] & before) > 2 * theta[i]:
                found[i] = before
                place.add(i + 1)
    return found


def voted(heard, earlier, trusted, theta):
    """The sources that a vehicle believes, of those it hears with their values, or None."""
    panel, mine = [j for j in heard if j in earlier], [j for j in heard if j in trusted]
    if mine or len(panel) < 2 * theta + 1:
        return mine or list(heard)
    there = [j for j in panel if heard[j] is not None]
    if len(there) < 2 * theta + 1:
        return [j for j in panel if j not in there]
    middle = np.median([heard[j] for j in there], axis=0)
    far = {j: max(np.linalg.norm(heard[j] - middle), 1e-9) for j in there}
    return sorted(there, key=far.get)[: theta + 1]


def reached(heard, sources):
    """Vehicles that the navigator or these vehicles reach over links, (m, m + 1)."""
    found, grew = set(sources), True
    while grew:
        left = set(range(len(heard))) - found
        new = {i for i in left if heard[i, 0] or any(heard[i, j + 1] for j in found)}
        found, grew = found | new, bool(new)
    return found


def compared(keys):
    """Greatest distance from the program by tick and order [m, m/s, …], until the lane fails; its
    status, and the program.
    """
    one, late, by_link = systems.lanes(systems.study(**keys), 1), keys["channel"]["delay"], None
    slots, lane = np.asarray(one.network.hearing.sources), one.inputs.lane
    if keys["channel"]["delay_of"] == "message":
        patterned = Patterned(lane.interval, lane.delay.chances)
        one = one._replace(inputs=one.inputs._replace(lane=lane._replace(delay=patterned)))
    elif not isinstance(late, float):
        by_link = np.round(np.asarray(lane.delay.time)[0] / keys["tick"])

    def delays(b, i, j):
        if isinstance(late, float):
            return round(late / keys["tick"])
        slot = int(np.flatnonzero(slots[:, i] == j)[0])
        return late_by(b, i, slot) if by_link is None else by_link[slot, i]

    outcome, fleet = systems.simulate(one), Fleet(keys, delays)
    states = outcome.series["state"][0].transpose(2, 1, 0)  # the ticks take the place of lanes
    jets = np.stack(lane.vehicle.output_jets(states))
    apart = np.abs(jets.transpose(3, 2, 0, 1) - fleet.motion()).max(axis=(1, 3))
    return apart[: fleet.fails_at], outcome.status[0], fleet


def trim(row, received, trusted, theta, dropped_before):
    """One vehicle's decision: (weights in force, set of dropped sources, margin).

    `row` (m+1,) are its weights, `received` (m+1, 2) the positions that it hears.
    """
    heard = [j for j in range(len(row)) if row[j] > 0]
    heard_trusted = [j for j in heard if j in trusted]
    untrusted = [j for j in heard if j not in trusted]
    protected = len(heard) >= 2 * theta + 1 and len(heard_trusted) >= theta
    if theta == 0 or not protected:
        return row.copy(), set(), math.inf

    score = {}
    for k in untrusted:
        total = sum(math.hypot(*(received[j] - received[k])) for j in heard_trusted)
        score[k] = total / len(heard_trusted) + 1e-9 * (k in dropped_before)

    # Largest score first; among equal scores the lower number first. A slice never takes more
    # than the untrusted neighbours that there are.
    order = sorted(untrusted, key=lambda k: (-score[k], k))
    drop, keep = order[:theta], order[theta:]
    gap = score[drop[-1]] - score[keep[0]] if drop and keep else math.inf

    result = row.copy()
    for k in drop:
        result[k] = 0.0
    return result / result.sum(), set(drop), gap


def march(choose, carried, gain, start, interval, ticks):
    """E with two derivatives at every tick: (ticks + 1, 3, m, 2), from `start` (3, m, 2).

    `choose(n, error)` gives the weights (2, m, m+1) by axis in force from tick n on and `added`, a
    function of time [s] with the jets (3, m, m+1, 2) that attacks add to each link. `carried` (m,
    m+1) are the links that carry what their source says.
    """
    flow = expm(companion(gain) * interval)
    path = [np.asarray(start, float)]
    for n in range(ticks):
        weights, added = choose(n, path[-1])
        now, then = (displaced(weights, carried, added(t * interval)) for t in (n, n + 1))
        path.append(then + np.einsum("kl,lmx->kmx", flow, path[-1] - now))
    return np.stack(path)


def displaced(weights, carried, added):
    """`(I - A_H)⁻¹ d` of each axis with its derivatives, (3, m, 2)."""
    found = np.empty((3, *weights.shape[1:2], 2))
    for axis in (0, 1):
        rows = weights[axis] / weights[axis].sum(axis=1, keepdims=True)
        believed = np.where(carried, rows, 0.0)[:, 1:]
        d = np.einsum("ij,kij->ki", rows, added[..., axis])
        found[..., axis] = np.linalg.solve(np.eye(len(rows)) - believed, d.T).T
    return found


def received(error, carried, added):
    """Jets relative to the navigator's, by listener and source: (3, m, m+1, 2)."""
    sources = np.concatenate([np.zeros((3, 1, 2)), error], axis=1)
    return np.where(carried[None, :, :, None], sources[:, None], 0.0) + added


def companion(gain):
    """Matrix of `s^r + … + k1 s + k0` on y with its derivatives below r."""
    matrix = np.diag(np.ones(len(gain) - 1), 1)
    matrix[-1] = -np.asarray(gain)
    return matrix


def nominal(navigator, gain, initial, times):
    """O1: positions (len(times), m, 2) without attack, by expm; `initial` is at t = 0."""
    error = np.asarray(initial, dtype=float) - np.asarray(navigator(0.0))[:3, None, :]
    flows = expm(companion(gain) * np.asarray(times)[:, None, None])
    paths = np.asarray(navigator(np.asarray(times)))[0].T
    return paths[:, None] + np.einsum("tl,lmx->tmx", flows[:, 0], error)


def flat_jets(state):
    """(m, 6) robot states [x, y, θ, v, ω, F] -> (3, m, 2) jets y, ẏ, ÿ."""
    jets = np.empty((3, len(state), 2))
    for i, (x, y, heading, speed, turn_rate, force) in enumerate(state):
        along = np.array([math.cos(heading), math.sin(heading)])
        across = np.array([-math.sin(heading), math.cos(heading)])
        jets[0, i] = x, y
        jets[1, i] = speed * along
        jets[2, i] = force * along + speed * turn_rate * across
    return jets


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
