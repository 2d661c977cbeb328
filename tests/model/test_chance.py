"""Random numbers at ticks, against the bits of `jax.random` and the normal distribution."""

import zlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import jaxnet
from jaxnet.kinds.losses import Loss
from jaxnet.model import chance

KEYS = np.array([0.1, 0.7, 1 / 3])
TIMES = np.array([0.0, 0.35, 0.35])


@pytest.mark.parametrize("shape", [(), (5,), (2, 3, 4)])
def test_uniform_numbers_are_those_of_jax(shape):
    mine = chance.drawn(jnp.asarray(KEYS), jnp.asarray(TIMES), "loss", "uniform", shape)
    assert mine.shape == (*shape, len(KEYS))
    for lane, (number, time) in enumerate(zip(KEYS, TIMES, strict=True)):
        key = jax.random.wrap_key_data(jnp.asarray(number.view("2u4")), impl="threefry2x32")
        for word in (zlib.crc32(b"loss"), *time.view("2u4")):
            key = jax.random.fold_in(key, np.uint32(word))
        np.testing.assert_array_equal(mine[..., lane], jax.random.uniform(key, shape, float))


def test_the_inverse_of_the_error_function_is_that_of_scipy():
    """To 1e-6 of normal numbers, for all 2¹² parts of the interval and its ends."""
    odd = np.concatenate([np.arange(-(2**24) + 1, 2**24, 2**13 - 2), [2**24 - 1, -1, 1]])
    number = (odd * 2.0**-24).astype(np.float32)
    mine = np.sqrt(2.0) * np.asarray(jax.jit(chance.inverse_error)(number), float)
    np.testing.assert_allclose(
        mine, stats.norm.ppf((1 + number.astype(float)) / 2), rtol=0, atol=1e-6
    )


def test_normal_numbers_are_normal():
    numbers = np.ravel(
        chance.drawn(jnp.full(2, 0.3), jnp.array([0.0, 0.1]), "x", "normal", (250_000,))
    )
    assert stats.kstest(numbers, "norm").pvalue > 0.01
    for power, expected, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        spread = np.sqrt(variance / len(numbers))
        assert abs(np.mean(numbers**power) - expected) < stats.norm.ppf(0.999) * spread
    for bound in (2, 3, 4):
        share = 2 * stats.norm.sf(bound)
        low, high = stats.binom.interval(0.998, len(numbers), share)
        assert low <= (np.abs(numbers) > bound).sum() <= high


def test_purposes_times_and_keys_draw_other_numbers():
    def one(key, time, purpose):
        return chance.drawn(jnp.array([key]), jnp.array([time]), purpose, "normal", (1000,))[:, 0]

    first = one(0.3, 0.1, "a")
    np.testing.assert_array_equal(first, one(0.3, 0.1, "a"))
    for other in (one(0.4, 0.1, "a"), one(0.3, 0.2, "a"), one(0.3, 0.1, "b")):
        assert abs(np.corrcoef(first, other)[0, 1]) < 0.1


class Sampler(Loss):
    kind = "sampler"

    def draws(self):
        return True

    def lost(self, messages, memory):
        return self.random(messages.time, "loss", "gamma", messages.sources.shape) < 0.5, memory


def test_another_distribution_is_refused():
    keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5, "channel": {"loss": Sampler()}}
    with pytest.raises(
        jaxnet.KindError,
        match=r"sampler: random\(…\) draws from 'uniform' or 'normal' \(got 'gamma'",
    ):
        jaxnet.simulate(keys, samples=2, progress=False)
