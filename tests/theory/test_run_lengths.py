"""Mean run lengths by the integral equation: published values, and plain simulation."""

import numpy as np
import pytest
from scipy import stats

from jaxnet.kinds.detectors import AlarmRule
from jaxnet.theory.run_lengths import mean_first, mean_run, unseen

MANY = 10_000  # links that are simulated at once
PAGE4, PAGE5 = (AlarmRule(limit, drift=0.5, squared=False) for limit in (4.0, 5.0))


def simulated(rule, lie=0.0, of=MANY, orders=1):
    """Ticks of the first alarms of links, by a loop that knows nothing of `jaxnet.theory`."""
    random = np.random.default_rng(0)
    sums, last, runs = np.zeros(of), np.zeros((rule.window, of)), np.zeros(of, int)
    tick = 0
    while not runs.all():
        tick += 1
        drawn = random.standard_normal((2 * orders if rule.squared else 1, of))
        drawn[0] += lie
        z = (drawn**2).sum(axis=0) if rule.squared else drawn[0]
        last[tick % rule.window] = z
        sums = last.sum(axis=0) if rule.drift is None else np.maximum(0, sums + z - rule.drift)
        runs = np.where((sums > rule.limit) & (runs == 0), tick, runs)
    return runs


def interval(runs):
    """Ends of the interval of 99 % of a mean."""
    half = 2.576 * runs.std() / np.sqrt(len(runs))
    return runs.mean() - half, runs.mean() + half


@pytest.mark.parametrize(
    ("rule", "lie", "known", "digits"),
    [
        (PAGE4, 0.0, 335.3676, 4),
        (PAGE4, 0.5, 26.6792, 4),
        (PAGE4, 1.0, 8.3832, 4),
        (PAGE4, 2.0, 3.3428, 4),
        (PAGE5, 0.0, 930.8870, 4),
        (PAGE5, 0.5, 38.0096, 4),
        (PAGE5, 1.0, 10.3760, 4),
        (PAGE5, 2.0, 4.0089, 4),
        (AlarmRule(8.0, drift=4.0), 0.0, 245.0234, 4),
        (AlarmRule(10.0, drift=4.0), 0.0, 551.100, 3),
        (AlarmRule(10.0, drift=3.0), 0.0, 186.070, 3),
    ],
)
def test_runs_of_a_cusum_are_those_published(rule, lie, known, digits):
    """Shared facts, section 2, to the digits given."""
    run = mean_run(rule, 1, lie)
    assert run.least == run.most
    assert run.least == pytest.approx(known, abs=0.51 * 10.0**-digits)


@pytest.mark.parametrize(
    ("rule", "lie", "orders"),
    [
        (PAGE4, 0.0, 1),
        (PAGE5, 1.0, 1),
        (AlarmRule(8.0, drift=4.0), 0.0, 1),
        (AlarmRule(10.0, drift=3.0), 2.0, 1),
        (AlarmRule(9.0, drift=7.0), 0.7, 2),
        (AlarmRule(6.0), 0.0, 1),
        (AlarmRule(9.210340), 2.0, 1),
    ],
)
def test_runs_are_those_of_a_plain_simulation(rule, lie, orders):
    """Inside intervals of 99 %."""
    low, high = interval(simulated(rule, lie, orders=orders))
    run = mean_run(rule, orders, lie)
    assert low < run.least == run.most < high


@pytest.mark.parametrize(
    ("window", "known"), [(1, 9.210340), (2, 13.276704), (5, 23.209251), (10, 37.566235)]
)
def test_runs_of_a_window_have_two_ends(window, known):
    """At 1 %: from 100 to 100 n ticks, and a plain simulation is between them."""
    run = mean_run(AlarmRule(known, window), 1)
    assert (run.least, run.most) == pytest.approx((100.0, 100.0 * window), rel=1e-6)
    if window > 1:
        low, high = interval(simulated(AlarmRule(known, window), of=2000))
        assert run.least < low < high < run.most


def test_a_lie_counts_in_each_tick_of_a_window():
    run = mean_run(AlarmRule(13.276704, 2), 1, 2.0)
    assert run.least == pytest.approx(1 / stats.ncx2.sf(13.276704, 4, 8.0), rel=1e-9)


@pytest.mark.parametrize("rule", [PAGE4, AlarmRule(8.0, drift=4.0), AlarmRule(9.210340)])
def test_the_first_alarm_of_a_fleet_is_that_of_its_fastest_link(rule):
    """Of ten independent links, inside intervals of 99 %; of one it is the run of a link."""
    first = simulated(rule, of=MANY).reshape(-1, 10).min(axis=1)
    low, high = interval(first)
    assert low < mean_run(rule, 1, links=10).least < high


def test_the_sum_over_ticks_is_the_solution_of_the_equations():
    """A chain of three states that is left with probability 0.01, or not at all in one step."""
    step = np.array([[0.9, 0.09, 0.0], [0.5, 0.3, 0.2], [0.1, 0.2, 0.6]])
    quiet = [np.linalg.matrix_power(step, t).sum(axis=1)[0] for t in range(20_000)]
    assert mean_first(step, 1) == pytest.approx(sum(quiet), rel=1e-9)
    assert mean_first(step, 3) == pytest.approx(sum(p**3 for p in quiet), rel=1e-9)


def test_no_run_of_a_cusum_with_too_long_a_range():
    assert mean_run(AlarmRule(1000.0, drift=3.0), 1) is None


def alarms(rule, squares):
    """Whether a sequence of squared residuals raises an alarm."""
    if rule.drift is None:
        return np.convolve(squares, np.ones(rule.window)).max() > rule.limit * (1 + 1e-12)
    level, greatest = 0.0, 0.0
    for z in squares:
        level = max(0.0, level + z - rule.drift)
        greatest = max(greatest, level)
    return greatest > rule.limit * (1 + 1e-12)


BOUNDED = pytest.mark.parametrize(
    "rule", [AlarmRule(9.210340), AlarmRule(23.209251, 5), AlarmRule(8.0, drift=4.0)]
)


@BOUNDED
def test_the_greatest_lie_that_raises_no_alarm(rule):
    """A lie of the rate, after a burst, raises none; a little more at one tick, or at all, does."""
    rate, burst, first = unseen(rule)
    steady = np.full(2 * rule.window, rate)
    assert not alarms(rule, [first, *steady])
    assert alarms(rule, [first, *steady * 1.000001])
    assert alarms(rule, [first * 1.000001, *steady])
    assert alarms(rule, [(rate + burst) * 1.000001])


@BOUNDED
def test_what_raises_no_alarm_is_within_rate_and_burst(rule):
    """Of drawn sequences, in each number of ticks in a row."""
    random, (rate, burst, _), tried = np.random.default_rng(1), unseen(rule), 0
    for _ in range(2000):
        squares = random.exponential(0.6 * rate, 12) * (random.random(12) < 0.6)
        if not alarms(rule, squares):
            tried += 1
            sums = [
                np.convolve(squares, np.ones(n), "valid").max() - rate * n for n in range(1, 13)
            ]
            assert max(sums) <= burst + 1e-9
    assert tried > 50


def test_a_direction_bounds_no_lie():
    """A lie against the direction raises no alarm, however great."""
    assert unseen(PAGE4) is None
