"""Intervals of shares, quantiles and means: exact where known, and held as often as they say."""

import itertools

import numpy as np
import pandas as pd
import pytest
from scipy import special, stats

from experiments import means as experiment
from jaxnet.statistics import intervals
from jaxnet.statistics.summary import COLUMNS_OF_METRIC, metric_statistics
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
    """Against SciPy's t test; unit, origin and side do not matter."""
    values = np.random.default_rng(0).normal(5.0, 1.0, 50)
    known = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    low, high = intervals.mean_interval(values, 0.95)
    assert (low, high) == pytest.approx((known.low, known.high))
    assert intervals.mean_interval(-values, 0.95) == pytest.approx((-high, -low))
    for size in (1e-300, 1e300):
        assert intervals.mean_interval(size * values, 0.95) == pytest.approx(
            (size * low, size * high)
        )


def test_sums_stand_for_what_they_are_of():
    """The error of a ratio of sums, by hand; units that repeat one number are one each."""
    sums, counts = np.array([1.0, 4.0, 3.0]), np.array([1.0, 2.0, 1.0])
    error = np.sqrt(1.5 * (1.0 + 0.0 + 1.0)) / 4  # mean 2; residuals -1, 0, 1
    half = special.stdtrit(2, 0.975) * error
    assert intervals.student_interval(sums, counts, 0.95) == pytest.approx((2 - half, 2 + half))
    values = np.random.default_rng(0).normal(size=40)
    repeated = intervals.mean_interval(np.repeat(values, 5), 0.95, np.repeat(np.arange(40), 5))
    assert repeated == pytest.approx(intervals.mean_interval(values, 0.95))


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


FAST = ("normal", "exponential", "0.5 to 1.5, 95% zeros")


@pytest.mark.parametrize(
    ("name", "size"),
    [
        *itertools.product(FAST, (50, 256)),
        *(
            pytest.param(*each, marks=pytest.mark.long)
            for each in itertools.product(experiment.DISTRIBUTIONS, experiment.SIZES)
        ),
    ],
)
def test_an_interval_is_seldom_shown_and_wrong(name, size, request):
    """At most 5 %, but for two values (to 6.5 %: their shares have exact intervals) and chance."""
    repeats = 4000 if request.node.get_closest_marker("long") else 500
    most = 0.065 if name.startswith("ones") else 0.055
    chance = 3 * np.sqrt(0.05 * 0.95 / repeats)
    assert experiment.told(name, size, repeats, seed=1).wrong <= most + chance


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
    rows = pd.DataFrame(
        {"tail_max_mean": [1.875, 0.4, np.nan, 0.0], "tail_max_max": [1.875, 1, np.nan, 0.0]}
    )
    assert columns.alike_cells(rows.assign(ok=[50, 50, 0, 50]), "tail_max") == [
        True,
        False,
        False,
        True,
    ]
