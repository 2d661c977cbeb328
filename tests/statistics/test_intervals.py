"""Intervals of shares, quantiles and means: exact where known, and held as often as they say."""

import itertools

import numpy as np
import pandas as pd
import pytest
from scipy import special, stats

from experiments import means as experiment
from jaxnet.kinds.metrics import COLUMNS_OF_METRIC
from jaxnet.statistics import intervals
from jaxnet.statistics.summary import metric_statistics
from jaxnet.view import columns


@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.999])
def test_the_interval_of_a_share_is_the_exact_one(confidence):
    """Against SciPy's binomial test."""
    for trials in (1, 7, 30):
        successes = np.arange(trials + 1)
        low, high = intervals.clopper_pearson(successes, np.full(trials + 1, trials), confidence)
        for k in successes:
            exact = stats.binomtest(int(k), trials).proportion_ci(confidence, method="exact")
            assert (low[k], high[k]) == (pytest.approx(exact.low), pytest.approx(exact.high))
    low, high = intervals.clopper_pearson(np.zeros(1, int), np.zeros(1, int), confidence)
    assert (low[0], high[0]) == (0.0, 1.0)


@pytest.mark.parametrize("quantile", [0.05, 0.5, 0.95])
@pytest.mark.parametrize("lanes", [5, 30, 400])
def test_the_interval_of_a_quantile_is_the_narrowest_that_holds(quantile, lanes):
    """u_(k) is a beta number: an end misses at most 2.5 %, the next inwards more."""
    low, high = intervals.quantile_interval(np.arange(1.0, lanes + 1), quantile, 0.95)
    if not np.isnan(low):
        assert stats.beta.sf(quantile, low, lanes - low + 1) <= 0.025
    assert stats.beta.sf(quantile, np.nan_to_num(low) + 1, lanes - np.nan_to_num(low)) > 0.025
    beyond = lanes + 1 if np.isnan(high) else high
    if not np.isnan(high):
        assert stats.beta.cdf(quantile, high, lanes - high + 1) <= 0.025
    assert stats.beta.cdf(quantile, beyond - 1, lanes - beyond + 2) > 0.025


def test_all_draws_are_below_their_greatest_seldom():
    for draws in (1, 10, 256):
        assert intervals.below_greatest(draws) ** draws == pytest.approx(0.05)


def test_a_mean_has_students_interval():
    """SciPy's, widened for skewness and by half a step; unit, origin and side do not matter."""
    values = np.random.default_rng(0).gamma(9.0, size=50)
    known = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    t, gap = stats.t.ppf(0.975, 49), max(b - a for a, b in itertools.pairwise(sorted(values)))
    factor = 1 + stats.skew(values) ** 2 * (t**4 + 2 * t**2 - 3) / (18 * 50)
    half = factor * (known.high - known.low) / 2 + gap / 100
    low, high = intervals.mean_interval(values, 0.95)
    assert factor > 1.005
    assert (low, high) == pytest.approx((values.mean() - half, values.mean() + half))
    assert intervals.mean_interval(-values, 0.95) == pytest.approx((-high, -low))
    for size in (1e-300, 1e300):
        assert intervals.mean_interval(size * values, 0.95) == pytest.approx(
            (size * low, size * high)
        )


def test_sums_stand_for_what_they_are_of():
    """The error of a ratio of sums, by hand; units that repeat one number are one each."""
    values = np.arange(-19.5, 20)
    sums, counts = np.array([1.0, 4.0, 3.0]), np.array([1.0, 2.0, 1.0])
    error = np.sqrt(1.5 * (1.0 + 0.0 + 1.0)) / 4  # mean 2; residuals -1, 0, 1
    half = special.stdtrit(2, 0.975) * error + 1 / 80  # 40 values without skewness, 1 apart
    found = intervals.student_interval(values, sums, counts, 0.95)
    assert found == pytest.approx((2 - half, 2 + half))
    values = np.random.default_rng(0).normal(size=40)
    values = np.append(values, -values)  # without skewness
    repeated = intervals.mean_interval(np.repeat(values, 5), 0.95, np.repeat(np.arange(80), 5))
    apart = np.subtract(intervals.mean_interval(values, 0.95), repeated)
    step = np.diff(np.sort(values)).max() / 2 * (1 / 80 - 1 / 400)
    assert apart == pytest.approx((-step, step))


@pytest.mark.parametrize(
    ("values", "told"),
    [
        (np.arange(27.0), False),
        (np.arange(28.0), True),
        (np.arange(50) < 25, True),
        (np.arange(50) < 2, False),  # G = 4.7
        (np.append(np.arange(29.0), np.inf), False),
        (np.full(100, 1.875), False),
        (np.full(100, 1.875) * (1 + 1e-12 * np.arange(100)), False),
        (np.zeros(100), False),
        (np.zeros(0), False),
    ],
)
def test_few_skewed_and_alike_numbers_have_no_interval_of_their_mean(values, told):
    assert np.isfinite(intervals.mean_interval(values.astype(float), 0.95)).all() == told


@pytest.mark.parametrize("size", [30, 50, 80, 128, 256, 512])
def test_an_interval_of_two_values_is_seldom_shown_and_wrong(size):
    """At most 5 % for every share of either value, by exact sums over their numbers."""
    told = [intervals.mean_interval((np.arange(size) < k) * 1.0, 0.95) for k in range(size + 1)]
    low, high = np.transpose(told)[..., None]
    shares = np.linspace(0.001, 0.999, 999)
    wrong = (shares < low) | (high < shares)  # never without an interval
    chances = stats.binom.pmf(np.arange(size + 1)[:, None], size, shares)
    assert (chances * wrong).sum(axis=0).max() <= 0.05


FAST = [
    *("normal", "uniform", "exponential", "Weibull, 0.7", "lognormal, 0.5", "Poisson, 2"),
    *("clusters, 30%", "0, 1 or 10", "0.5 to 1.5, 95% zeros", "0.9 to 1.1, 50% zeros"),
]
SEEN = [name for name in experiment.DISTRIBUTIONS if name not in experiment.UNSEEN]


@pytest.mark.parametrize(
    ("name", "size", "repeats"),
    [
        *itertools.product(FAST, (50, 256), [2000]),
        *(
            pytest.param(*each, 4000, marks=pytest.mark.long)
            for each in itertools.product(SEEN, experiment.SIZES)
        ),
    ],
)
def test_an_interval_is_seldom_shown_and_wrong(name, size, repeats):
    """At most 5 %, but for chance."""
    chance = 3 * np.sqrt(0.05 * 0.95 / repeats)
    assert experiment.told(name, size, repeats, seed=1).wrong <= 0.05 + chance


def test_a_far_cluster_that_no_number_shows_is_in_no_interval():
    """As validation.md says: no interval of a mean holds for every distribution."""
    assert experiment.told("0.9 to 1.1, 1% zeros", 100, 500).wrong > 0.05


@pytest.mark.parametrize(("up", "down"), [(0.1, 0.1), (0.25, 0.05), (0.05, 0.0), (0.45, 0.45)])
def test_the_interval_of_a_difference_of_shares_holds(up, down):
    """By exact sums over all outcomes of 20 pairs."""
    held = 0.0
    for a in range(21):
        for b in range(21 - a):
            low, high = intervals.paired_share_interval(a, b, 20, 0.95)
            if low <= up - down <= high:
                held += stats.multinomial.pmf([a, b, 20 - a - b], 20, [up, down, 1 - up - down])
    assert held >= 0.95


def test_nothing_and_infinite_lanes():
    """No lane has no number; an infinite one leaves the mean without an interval."""
    assert np.isnan([*metric_statistics(np.array([])).values()]).all()
    values = np.append(np.arange(1.0, 40.0), np.inf)
    found = metric_statistics(values)
    assert np.isnan([found["low"], found["high"]]).all()
    assert (found["median"], found["max"], tuple(found)) == (20.5, np.inf, COLUMNS_OF_METRIC)
    assert found["median_low"] < 20.5 < found["median_high"]
    dependent = metric_statistics(np.arange(64.0), np.arange(64) // 4)
    assert np.isnan(dependent["median_low"])
    assert np.isfinite(dependent["low"])


def test_lanes_that_agree_are_told_alike():
    """Errors that are rounding beside ā agree; an unknown ā counts as 1 m."""
    cells = {  # mean, greatest, lanes, ā
        (1.875, 1.875, 50, 5.0): True,
        (0.4, 1.0, 50, 5.0): False,
        (np.nan, np.nan, 0, 5.0): False,
        (1.0, 1.0, 1, 5.0): False,
        (np.inf, np.inf, 50, 5.0): False,
        (0.0, 0.0, 50, 0.0): True,
        (1e-11, 2e-11, 50, 5.0): True,
        (1e-11, 2e-11, 50, np.nan): True,
        (1e-11, 2e-11, 50, 0.0): False,
        (1e-9, 50e-9, 50, 5.0): False,  # one lane of fifty
    }
    found = columns.all_alike(*(pd.Series(each) for each in zip(*cells, strict=True)))
    assert found.tolist() == [*cells.values()]
