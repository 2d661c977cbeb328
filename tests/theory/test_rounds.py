"""Stability of exchanges: known figures, a polynomial by hand, closed forms, all rounds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.rounds import greatest_tick, least_rate
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.path import Path
from jaxnet.theory import rounds
from tests.matrices import matrix_of

GAIN = np.array([1.0, 3.0, 3.0])
RING = matrix_of(Cyclic(), 12)
KNOWN = [  # of the paper's ring, found by two independent programs
    *((0.05, 1, 1.0458), (0.05, 2, 0.9667), (0.05, 10, 0.9612), (0.05, 10_000, 0.9591)),
    *((0.02, 1, 0.9862), (0.1, 1, 1.2140), (0.1, 2, 0.9574)),
]


@pytest.mark.parametrize(("tick", "number", "known"), KNOWN)
def test_the_papers_ring(tick, number, known):
    """To the figures that are known."""
    assert rounds.spectral_radius(RING, GAIN, tick, number) == pytest.approx(known, abs=5e-5)


NUMBERS = st.floats(-0.99, 0.99)


@given(
    real=NUMBERS,
    imaginary=NUMBERS,
    tick=st.floats(0.01, 1.0),
    gain=st.tuples(*[st.floats(0.1, 9)] * 3),
)
def test_growth_is_that_of_the_polynomial(real, imaginary, tick, gain):
    """`(z - μ)(z - 1)³ + (1 - μ) z N(z)`, N from what a held jerk adds over a tick."""
    mu, (k0, k1, k2), h = real + 1j * imaginary, gain, tick
    N = (
        k0 * h**3 / 6 * np.array([1, 4, 1])
        + k1 * h**2 / 2 * np.array([1, 0, -1])
        + k2 * h * np.array([1, -2, 1])
    )
    polynomial = np.polyadd(np.polymul([1, -mu], np.poly([1, 1, 1])), (1 - mu) * np.append(N, 0))
    known = np.abs(np.roots(polynomial)).max()
    assert rounds.growth(mu, np.array(gain), tick) == pytest.approx(known, rel=1e-4)


def test_the_greatest_tick_of_one_round_on_the_ring():
    """Where z = -1 solves that polynomial for λ = -0.9."""
    found = greatest_tick(RING, GAIN, 1)
    assert 1.9 * (4 * 3 * found - found**3 / 3) == pytest.approx(8 * 0.1, rel=1e-9)
    assert found == pytest.approx(2 * 0.1 / (3 * 1.9), rel=1e-3)


@pytest.mark.parametrize("gain", [(1, 3, 3), (6, 11, 6), (2, 1, 5)])
def test_short_ticks_ask_for_a_rate_of_exchanges(gain):
    """A slow eigenvalue alone: just below it grows, just above it shrinks, for any rounds."""
    gain = np.array(gain, float)
    for left in (0.99, 0.999):
        rate = least_rate(left, gain)
        for number in (1, 3):
            tick = number / rate
            assert (
                rounds.growth(left**number, gain, 1.1 * tick)
                > 1
                > rounds.growth(left**number, gain, 0.9 * tick)
            )


def digraphs():
    """Two rings, a path and some that are drawn."""
    yield from (RING, matrix_of(Cyclic(navigator=[1]), 7), matrix_of(Path(), 5))
    for seed in range(4):
        weights = np.random.default_rng(seed).random((6, 7)) ** 3
        weights[:, 1:][np.eye(6, dtype=bool)] = 0
        yield weights / weights.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("tick", [0.02, 0.1, 0.18, 0.3])
def test_the_least_rounds_by_trying_them_all(tick):
    """None before the first number is stable, and from the second on all are."""
    for weights in digraphs():
        few, surely = rounds.least_rounds(weights, GAIN, tick)
        stable = [rounds.spectral_radius(weights, GAIN, tick, n) < 1 for n in range(1, surely + 40)]
        assert not any(stable[: few - 1])
        assert stable[few - 1]
        assert all(stable[surely - 1 :])


def test_more_rounds_may_be_worse():
    """At 0.18 s two rounds are stable on the ring, three and five are not; nothing is at 0.75 s."""
    stable = [rounds.spectral_radius(RING, GAIN, 0.18, n) < 1 for n in range(1, 6)]
    assert stable == [False, True, False, True, False]
    assert rounds.least_rounds(RING, GAIN, 0.75) is None


def test_no_number_of_rounds_is_enough_for_who_is_cut_off():
    """Two who hear each other alone."""
    apart = np.array([[1.0, 0, 0, 0], [0, 0, 0, 1.0], [0, 0, 1.0, 0]])
    assert rounds.least_rounds(apart, GAIN, 0.05) is None


@pytest.mark.long
def test_ticks_up_to_the_greatest_are_stable():
    """And just beyond it is not."""
    for weights in digraphs():
        for number in (1, 2, 5):
            most = greatest_tick(weights, GAIN, number)
            ticks = most * np.array([0.01, 0.3, 0.7, 0.9999, 1.0001])
            stable = [rounds.spectral_radius(weights, GAIN, tick, number) < 1 for tick in ticks]
            assert stable == [True, True, True, True, False]


def test_known_losses_of_whole_ticks():
    """Of one round on the ring and on stars, found by two independent programs."""
    ring, star = rounds.eigenvalues(RING), np.zeros(1)
    assert rounds.mean_square_growth(ring, GAIN, 0.02, 0.3) == pytest.approx(0.988181, abs=5e-7)
    assert rounds.mean_square_growth(ring, GAIN, 0.02, 0.5) == pytest.approx(1.008875, abs=5e-7)
    assert rounds.critical_loss(ring, GAIN, 0.02) == pytest.approx(0.413127, abs=5e-7)
    assert rounds.critical_loss(ring, GAIN, 0.05) == 0.0  # one round is unstable
    known = {0.02: 0.922509, 0.05: 0.817195, 0.1: 0.666681, 0.2: 0.438192}
    for tick, critical in known.items():
        assert rounds.critical_loss(star, GAIN, tick) == pytest.approx(critical, abs=5e-7)


def late_polynomial(value, gain, tick, late):
    """`(z^{d+1} - λ)(z - 1)³ + (z^{d+1} - λ z) N(z)`, by its coefficients."""
    k0, k1, k2 = gain
    bracket = k2 * tick * np.poly1d([1, -2, 1]) + k1 * tick**2 / 2 * np.poly1d([1, 0, -1])
    bracket = bracket + k0 * tick**3 / 6 * np.poly1d([1, 4, 1])
    ahead = np.poly1d([1.0, *[0.0] * (late + 1)])
    return (ahead - value) * np.poly1d([1, -1]) ** 3 + (ahead - value * np.poly1d([1, 0])) * bracket


def test_radii_of_late_words():
    """Known on the ring at 0.02 s; on others the roots of the polynomial."""
    known = {0: 0.986192, 1: 0.986432, 2: 0.986695, 3: 0.988730, 5: 0.992472, 10: 0.995887}
    ring, word = rounds.eigenvalues(RING), np.append(GAIN, 1.0)
    for late, radius in known.items():
        if late:
            assert rounds.late_growth(ring, GAIN, word, 0.02, late) == pytest.approx(
                radius, abs=5e-7
            )
        roots = [late_polynomial(value, GAIN, 0.02, late).roots for value in ring]
        assert max(np.abs(each).max() for each in roots) == pytest.approx(radius, abs=5e-6)
    for weights in digraphs():
        values = rounds.eigenvalues(weights)
        roots = [np.abs(late_polynomial(value, GAIN, 0.1, 2).roots).max() for value in values]
        assert rounds.late_growth(values, GAIN, word, 0.1, 2) == pytest.approx(max(roots), abs=2e-5)


@pytest.mark.parametrize("lost", [0.2, 0.6])
def test_second_moments_grow_as_those_of_a_plain_program(lost):
    """Two vehicles of order 2 that hear each other: means of squares of 200,000 histories."""
    weights = np.array([[0.5, 0.0, 0.5], [0.3, 0.7, 0.0]])
    gain, tick, random = np.array([2.0, 1.5]), 0.4, np.random.default_rng(0)
    position, velocity, jerk = random.normal(size=(3, 200_000, 2))
    sizes = []
    for _ in range(24):
        wanted = -(gain[0] * position + gain[1] * velocity) @ (np.eye(2) - weights[:, 1:]).T
        heard = random.random((200_000, 1)) >= lost
        jerk = np.where(heard, jerk @ weights[:, 1:].T + wanted, jerk)
        position, velocity = position + tick * velocity + tick**2 / 2 * jerk, velocity + tick * jerk
        sizes.append((position**2 + velocity**2 + jerk**2).mean())
    grown = (sizes[-1] / sizes[9]) ** (1 / 28)
    known = rounds.mean_square_growth(rounds.eigenvalues(weights), gain, tick, lost)
    assert grown == pytest.approx(known, rel=0.03)
