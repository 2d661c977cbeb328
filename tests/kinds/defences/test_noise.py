"""Noise in what is judged: how often it has the wrong one dropped."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxnet.kinds.defences import Neighbourhood
from jaxnet.kinds.defences.w_msr import WMSR

LANES, NOISE = 40_000, 2.0
KEY = jnp.asarray(np.random.default_rng(0).random(LANES))
NOISY = {"noise": jnp.full(LANES, NOISE), "key": KEY, "drop_trusted": False}


def dropped(rule, places):
    """How often sources at these places on a line are dropped by one at 0 that trusts the first."""
    weights = jnp.ones((len(places), 1, LANES))
    trusted = jnp.arange(len(places))[:, None] == 0
    position = jnp.stack([jnp.asarray(places)[:, None, None] * weights, 0 * weights])
    time = jnp.full(LANES, 0.1)
    seen = jax.jit(rule.judges_by)((position,) * 3, time)
    own = (jnp.zeros((2, 1, LANES)),) * 3
    around = Neighbourhood(None, weights, trusted, jnp.ones((3, LANES)), time, ())
    decision, _ = rule.decide(own, seen, jnp.ones(weights.shape, bool), rule.start(around), around)
    return 1 - np.asarray(decision).reshape(-1, len(places), LANES)[0].mean(axis=1)


def near(rate, known):
    """Whether a rate in as many lanes is a probability, by four standard deviations."""
    return abs(rate - known) < 4 * np.sqrt(known * (1 - known) / LANES)


@pytest.mark.parametrize("apart", [0.0, 1.0, 3.0])
def test_w_msr_drops_the_wrong_one_by_the_normal_law(apart):
    """Of two far above oneself the nearer is dropped with probability Φ(-d / (σ √2))."""
    _, nearer, farther = dropped(WMSR.filled({"F": 1, **NOISY}), [0.0, 50.0, 50.0 + apart])
    assert near(nearer, stats.norm.cdf(-apart / (NOISE * np.sqrt(2))))
    assert nearer + farther == pytest.approx(1)


def test_noise_is_of_the_size_it_says_and_of_nobody_else():
    """Normal, of each order, axis, source, tick and lane its own; the same in whatever company."""
    rule, jets = WMSR.filled({"F": 1, **NOISY}), (jnp.zeros((2, 2, 3, LANES)),) * 3
    observed = jax.jit(rule.judges_by)
    now, later = (np.stack(observed(jets, jnp.full(LANES, time))) for time in (0.1, 0.2))
    rows = np.concatenate([each.reshape(-1, LANES) for each in (now, later)])
    assert stats.kstest(rows.ravel()[::7] / NOISE, "norm").pvalue > 1e-3
    apart = np.corrcoef(rows) - np.eye(len(rows))
    assert np.abs(apart).max() < 5 / np.sqrt(LANES)
    few = WMSR.filled({"F": 1, **NOISY, "noise": NOISY["noise"][5:9], "key": KEY[5:9]})
    alone = jax.jit(few.judges_by)(jax.tree.map(lambda jet: jet[..., 5:9], jets), jnp.full(4, 0.1))
    np.testing.assert_array_equal(np.stack(alone), now[..., 5:9])
