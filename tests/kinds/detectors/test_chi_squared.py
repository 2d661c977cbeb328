"""Alarms about messages: their law, whom they count, covert attacks, engines."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxnet.kinds.detectors import Detector, JudgedMessages
from jaxnet.kinds.detectors.chi_squared import ChiSquared, limits
from tests import systems

SIGMA = 0.1
KEYS = {
    "engine": "exact",
    "vehicles": 6,
    "defence": "none",
    "horizon": 10.0,
    "tail": 1.0,
    "channel": {"noise": {"position": SIGMA}},
    "detector": {"kind": "chi_squared", "false_alarms": 0.01},
}
TICKS = 201  # from 0 to the horizon
SILENT = {"attack": "none"}


class Always(Detector):
    def alarms(self, messages, memory):
        return messages.judged, memory


class Parity(Detector):
    """An alarm where a residual has an odd number of 1 bits: another bit changes the alarm."""

    def alarms(self, messages, memory):
        bits = jax.lax.bitcast_convert_type(messages.residuals, jnp.uint64)
        return (jax.lax.population_count(bits).sum(axis=(0, 1)) % 2 == 1) & messages.judged, memory


def shares(lanes=8, /, **keys):
    found = systems.outcome(lanes, (), **KEYS | keys)
    assert (found.status == 0).all()
    return found.metrics["alarms"], found.metrics["false_alarms"]


def bias(size, vehicles=(1,), **more):
    return {"attack": {"kind": "bias", "magnitude": size * SIGMA, "vehicles": [*vehicles], **more}}


def inside(share, known, words):
    return abs(share - known) <= 2.576 * np.sqrt(known * (1 - known) / words)


@pytest.mark.parametrize(("size", "seen"), [(2.0, 0.203948), (3.0, 0.553331)])
def test_a_constant_bias_is_seen_as_published(size, seen):
    """On the ring: 2 of 18 links carry it; the rest gives 1 % false alarms."""
    attacked, honest = shares(**bias(size, direction=0.7))
    assert inside(attacked.mean(), seen, 8 * TICKS * 2)
    assert inside(honest.mean(), 0.01, 8 * TICKS * 16)
    assert seen == pytest.approx(stats.ncx2.sf(9.210340, 2, size**2), abs=1e-6)


def test_all_noisy_orders_count_together_and_sensors_too():
    """Position and velocity: χ² of four degrees. A source's own errors add to a word's variance."""
    noise, sensing = {"position": 0.03, "velocity": 0.2}, {"position": 0.04}
    keys = {"channel": {"noise": noise}, "sensing": sensing}
    _, honest = shares(**keys, **SILENT)
    assert inside(honest.mean(), 0.01, 8 * TICKS * 18)
    # Three deviations √(0.03² + 0.04²)
    attack = {"kind": "bias", "magnitude": 0.15, "vehicles": [1, 4]}
    attacked, _ = shares(**keys, attack=attack)
    seen = stats.ncx2.sf(stats.chi2.ppf(0.99, 4), 4, 9)
    assert inside(attacked.mean(), seen, 8 * TICKS * 4)


def test_outliers_raise_alarms():
    """A word is whitened by its total variance V = σ² (1 + p (f² - 1)); of outliers most raise an
    alarm.
    """
    noise = {"position": SIGMA, "outliers": 0.1, "outlier_factor": 4.0}
    _, honest = shares(channel={"noise": noise}, **SILENT)
    inside_of = np.exp(-9.210340 / 2 * (1 + 0.1 * 15))
    assert inside(honest.mean(), 0.9 * inside_of + 0.1 * inside_of ** (1 / 16), 8 * TICKS * 18)


def test_p_values_are_those_of_chi_squared():
    """For one to four orders; orders without noise are 0 and do not count."""
    judged = np.ones((1, 4, 1), bool)
    orders = np.array([[[1], [2], [3], [4]]])
    size = np.array([1.5, 1.9, 2.1, 2.5])
    residuals = np.zeros((4, 2, 1, 4, 1))
    for vehicle in range(4):
        residuals[: vehicle + 1, :, 0, vehicle, 0] = size[vehicle]
    known = np.array([stats.chi2.sf(2 * (v + 1) * size[v] ** 2, 2 * (v + 1)) for v in range(4)])
    given = orders[..., 0], jnp.asarray(residuals), orders, judged
    messages = JudgedMessages(np.zeros(1), *given, np.ones(1), residuals[0])
    for factor, expected in ((1.000001, True), (0.999999, False)):
        for vehicle in range(4):
            share = jnp.asarray(known[vehicle : vehicle + 1] * factor)
            rule = ChiSquared.filled({"false_alarms": share, "window": 1})
            assert bool(rule.alarms(messages, rule.start(messages))[0][0, vehicle, 0]) is expected


@pytest.mark.parametrize("most", [1, 3, 150])
def test_limits_are_those_of_scipy(most):
    rates = np.array([1e-100, 1e-12, 5e-5, 0.01, 0.5, 0.999])
    known = stats.chi2.isf(rates, 2 * np.arange(1, most + 1)[:, None])
    np.testing.assert_allclose(limits(jnp.asarray(rates), most), known, rtol=1e-12)


def test_a_vehicle_that_moves_as_it_tells_is_covert():
    """All residuals are those of the lane without attack, bit for bit."""
    attack = {"kind": "own_path", "vehicles": [2], "magnitude": 5.0, "swing": [3.0, 1.0]}
    keys = {"horizon": 3.0, "detector": Parity(), "vehicle": "single_integrator"}
    attacked, honest = shares(**keys, attack=attack | {"moves": "as_told"})
    _, silent = shares(**keys, **SILENT)
    np.testing.assert_allclose((2 * attacked + 16 * honest) / 18, silent, rtol=0, atol=1e-15)
    assert 0.3 < silent.mean() < 0.7


def test_only_words_that_arrive_are_judged():
    """Every word that arrives alarms; no share where all are lost or without attacked links."""
    loss = {"kind": "bernoulli", "probability": 0.4}
    keys = {"channel": KEYS["channel"] | {"loss": loss, "missing": "hold"}}
    keys |= {"detector": Always(), "horizon": 2.0}
    attacked, honest = shares(2, **keys, **bias(2.0))
    assert attacked.tolist() == honest.tolist() == [1.0, 1.0]
    attacked, _ = shares(2, **keys, **SILENT)
    assert np.isnan(attacked).all()
    lost = keys["channel"] | {"loss": loss | {"probability": 1.0}}
    assert np.isnan(shares(2, **keys | {"channel": lost}, **bias(2.0))).all()


def test_a_link_is_attacked_only_while_it_is():
    """A vehicle that lies for a tenth of the time counts as honest for the rest."""
    attack = bias(100.0)["attack"] | {"vehicles": {"at": [4.0, 5.0], "sets": [[1], []]}}
    attacked, honest = shares(attack=attack)
    assert attacked.tolist() == [1.0] * 8
    assert inside(honest.mean(), 0.01, 8 * TICKS * 18)
