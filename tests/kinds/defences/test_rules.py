"""Rules that weigh what is received, against plain loops on neighbourhoods with ties."""

import math
import statistics

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import binom

from jaxnet.kinds.defences import Neighbourhood
from jaxnet.kinds.defences.clipping import Clipping
from jaxnet.kinds.defences.coordinate_median import CoordinateMedian
from jaxnet.kinds.defences.geometric_median import GeometricMedian
from jaxnet.kinds.defences.ms_norm import MSNorm
from jaxnet.kinds.defences.trust import Trust
from jaxnet.kinds.defences.trusted_only import TrustedOnly
from jaxnet.kinds.defences.w_msr import WMSR
from jaxnet.model import retained

SLOTS, VEHICLES, LANES = 6, 4, 600
TICKS = 3


class Around:
    """What one vehicle has before it: its position, those received, weights, and whom it trusts."""

    def __init__(self, own, received, weights, trusted):
        self.own, self.weights, self.trusted = tuple(own), list(weights), list(trusted)
        self.received = [tuple(each) for each in received]
        self.heard = [k for k, weight in enumerate(weights) if weight > 0]

    def apart(self, k, there):
        return math.dist(self.received[k], there)


def trusted_only(around):
    believed = [k for k in around.heard if around.trusted[k]] or around.heard
    return [around.weights[k] if k in believed else 0.0 for k in range(SLOTS)]


def ms_norm(around, f=2):
    candidates = [k for k in around.heard if not around.trusted[k]]
    farthest = sorted(candidates, key=lambda k: (-around.apart(k, around.own), k))[:f]
    return [0.0 if k in farthest else around.weights[k] for k in range(SLOTS)]


def clipping(around, radius=2.5):
    weights = list(around.weights)
    for k in around.heard:
        if not around.trusted[k] and around.apart(k, around.own) > radius:
            weights[k] *= radius / around.apart(k, around.own)
    return weights


def geometric_median(around, smoothing=0.5, rounds=4):
    weights = list(around.weights)
    for _ in range(rounds):
        middle = np.average(around.received, axis=0, weights=weights)
        apart = [max(smoothing, around.apart(k, middle)) for k in range(SLOTS)]
        weights = [w / far for w, far in zip(around.weights, apart, strict=True)]
    return weights


def coordinate_median(around):
    """By axis: who is at the lower or upper median, each value 4w times, and the trusted."""
    by_axis = []
    for axis in (0, 1):
        value = [y[axis] for y in around.received]
        copies = [value[k] for k in around.heard for _ in range(round(4 * around.weights[k]))]
        medians = statistics.median_low(copies), statistics.median_high(copies)
        kept = [around.trusted[k] or value[k] in medians for k in range(SLOTS)]
        by_axis.append([w if keep else 0.0 for w, keep in zip(around.weights, kept, strict=True)])
    return by_axis


RULES = [
    (TrustedOnly.filled({"trusted": {}}), trusted_only),
    (MSNorm.filled({"F": 2, "drop_trusted": False}), ms_norm),
    (Clipping.filled({"radius": np.full(1, 2.5), "drop_trusted": False}), clipping),
    (GeometricMedian.filled({"smoothing": np.full(1, 0.5), "rounds": 4}), geometric_median),
    (CoordinateMedian.filled({"drop_trusted": False}), coordinate_median),
]


def neighbourhoods(seed):
    """2,400 of them, on whole numbers, with weights that make exact halves now and then."""
    rng = np.random.default_rng(seed)
    shape = (SLOTS, VEHICLES, LANES)
    own = rng.integers(-3, 4, (2, VEHICLES, LANES)).astype(float)
    received = rng.integers(-3, 4, (2, *shape)).astype(float)
    weights = rng.integers(1, 4, shape) * (rng.random(shape) < 0.8) / 4.0
    weights[:3] = np.maximum(weights[:3], 0.25)
    trusted = np.zeros((SLOTS, VEHICLES), bool)
    trusted[0, 1:], trusted[3, 2] = True, True
    return own, received, weights, trusted


def plain(own, received, weights, trusted, vehicle, lane):
    at = slice(None), vehicle, lane
    return Around(own[at], received[:, *at].T, weights[at], trusted[:, vehicle])


@pytest.mark.parametrize(("rule", "reference"), RULES, ids=[rule.kind for rule, _ in RULES])
def test_it_is_the_rule(rule, reference):
    """Weights in force to 1e-12, and to the last slot who has none."""
    own, received, weights, trusted = given = neighbourhoods(1)
    around = Neighbourhood(None, weights, trusted, None, None, (), linked=weights > 0)
    last = np.ones(weights.shape, bool)
    decision, _ = rule.decide((own,) * 3, (received,) * 3, last, rule.start(around), around)
    found = np.broadcast_to(retained.in_force(weights, decision), (2, *weights.shape))
    for vehicle in range(VEHICLES):
        for lane in range(LANES):
            known = np.array(reference(plain(*given, vehicle, lane)))
            known = np.broadcast_to(known / known.sum(axis=-1, keepdims=True), (2, SLOTS))
            ours = found[:, :, vehicle, lane]
            assert ((ours > 0) == (known > 0)).all()
            np.testing.assert_allclose(ours, known, rtol=0, atol=1e-12)


def test_trust_is_earned_tick_by_tick():
    """Over three ticks, by plain sums; the first trusted source is who others are compared with."""
    keys = {"observation": "deviation", "radius": np.full(1, 2.0), "drop_trusted": False}
    rule = Trust.filled(keys)
    ticks = [neighbourhoods(seed) for seed in range(TICKS)]
    weights, trusted = ticks[0][2:]
    around = Neighbourhood(None, weights, trusted, None, None, ())
    memory, last = rule.start(around), np.ones(weights.shape, bool)
    for own, received, *_ in ticks:
        last, memory = rule.decide((own,) * 3, (received,) * 3, last, memory, around)
    for vehicle in range(VEHICLES):
        for lane in range(LANES):
            told = [plain(*each[:2], weights, trusted, vehicle, lane) for each in ticks]
            believed = [j for j in told[0].heard if trusted[j, vehicle]]
            there = [tick.received[believed[0]] if believed else tick.own for tick in told]
            earned = {}
            for k in told[0].heard:
                apart = [tick.apart(k, at) for tick, at in zip(told, there, strict=True)]
                earned[k] = math.fsum(2.0 / (2.0 + far) - 0.5 for far in apart)
            least = min(0.0, max(earned.values()))
            for k in earned:
                if k in believed or abs(earned[k] - least) > 1e-12:
                    assert last[k, vehicle, lane] == (k in believed or earned[k] > least)


@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        (MSNorm, {"F": 2}),
        (WMSR, {"F": 2}),
        (Clipping, {"radius": np.full(1, 2.5)}),
        (CoordinateMedian, {}),
    ],
)
def test_trusted_sources_can_be_judged_as_others_are(kind, keys):
    """`drop_trusted` gives the rule of who trusts nobody, not the one that spares the trusted."""
    own, received, weights, trusted = neighbourhoods(2)

    def decided(trusted, drop):
        around = Neighbourhood(None, weights, trusted, None, None, ())
        given = (own,) * 3, (received,) * 3, np.ones(weights.shape, bool), (), around
        return kind.filled({**keys, "drop_trusted": drop}).decide(*given)[0]

    nobody = decided(np.zeros_like(trusted), drop=False)
    np.testing.assert_array_equal(decided(trusted, drop=True), nobody)
    assert (decided(trusted, drop=False) != nobody).any()


def test_random_trust_errs_as_often_as_coins_do():
    """Honest and attacked ones of 60,000 links after each tick, against the binomial distribution.

    A source is retained while at least half of its observations speak for it; Hoeffding holds.
    """
    lanes, ticks, accuracy = 15_000, 12, 0.7
    attacked = np.zeros((4, 1, lanes), bool)
    attacked[2:] = True
    chance = np.random.default_rng(0).random(lanes)
    keys = {"observation": "random", "drop_trusted": False, "accuracy": np.full(lanes, accuracy)}
    keys |= {"observed": None}
    rule = Trust.filled(keys | {"key": jnp.asarray(chance)})
    weights = jnp.ones((4, 1, lanes))
    nobody, truth = jnp.zeros((4, 1), bool), jnp.asarray(attacked)
    around = Neighbourhood(None, weights, nobody, None, None, (), attacked=truth)
    own, received, everybody = jnp.zeros((2, 1, lanes)), jnp.zeros((2, 4, 1, lanes)), weights > 0
    memory = rule.start(around)

    @jax.jit
    def after(memory, time):
        here = around._replace(time=time)
        return rule.decide((own,) * 3, (received,) * 3, everybody, memory, here)[1]

    for tick in range(1, ticks + 1):
        memory = after(memory, jnp.full(lanes, 0.1 * tick))
        positive = np.asarray(memory) >= 0
        against = (tick - 1) // 2  # errors that still retain an attacked source
        rates = (~positive[:2]).mean(), positive[2:].mean()
        exact = binom.cdf(against, tick, accuracy), binom.sf(-(-tick // 2) - 1, tick, 1 - accuracy)
        for rate, known in zip(rates, exact, strict=True):
            assert abs(rate - known) < 4 * math.sqrt(known * (1 - known) / (2 * lanes))
            assert known <= math.exp(-2 * tick * (accuracy - 0.5) ** 2)


def kept_values(own, values, candidates, f):
    """Which values of one vehicle on one axis it retains, by LeBlanc et al. (2013), section IV.A.

    "If there are less than F values strictly larger than its own, the node removes all values that
    are strictly larger than its own. Otherwise, it removes precisely the largest F values in the
    sorted list"; so for the smaller ones. Of equal ones those that come first.
    """
    keep = [True] * len(values)
    for side in (1, -1):
        beyond = sorted((-side * values[k], k) for k in candidates if side * (values[k] - own) > 0)
        for _, k in beyond[: min(f, len(beyond))]:
            keep[k] = False
    return keep


@pytest.mark.parametrize("f", [0, 1, 2, 3, 9])
def test_it_is_the_rule_of_the_paper(f):
    """On 10,000 neighbourhoods of whole numbers, most of them with ties, some of a few sources."""
    slots, m, lanes = 7, 4, 2500
    rng = np.random.default_rng(f)
    own = rng.integers(-3, 4, (2, m, lanes)).astype(float)
    received = rng.integers(-3, 4, (2, slots, m, lanes)).astype(float)
    weights = rng.random((slots, m, lanes)) * (rng.random((slots, m, lanes)) < 0.8)
    trusted = np.zeros((slots, m), bool)
    trusted[0] = True
    around = Neighbourhood(None, weights, trusted, None, None, ())
    last = np.ones(weights.shape, bool)
    decision, _ = WMSR(F=f).decide((own,) * 3, (received,) * 3, last, (), around)
    assert decision.shape == received.shape
    for i in range(m):
        for lane in range(lanes):
            candidates = [k for k in range(1, slots) if weights[k, i, lane] > 0]
            for axis in (0, 1):
                values = received[axis, :, i, lane].tolist()
                known = kept_values(own[axis, i, lane], values, candidates, f)
                assert decision[axis, :, i, lane].tolist() == known
