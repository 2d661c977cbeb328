"""Stability of held laws: known figures, polynomials by hand, whole fleets, all rounds."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

import jaxnet
from experiments.rounds import greatest_tick, least_rate, spectral_radius
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.graphs.erdos_renyi import ErdosRenyi
from jaxnet.kinds.graphs.path import Path
from jaxnet.theory import delay, rounds
from tests.matrices import matrix_of
from tests.theory.test_certificate import case_of

GAIN = np.array([1.0, 3.0, 3.0])
RING = matrix_of(Cyclic(), 12)
KNOWN = [  # of the paper's ring, found by two independent programs
    *((0.05, 1, 1.0458), (0.05, 2, 0.9667), (0.05, 10, 0.9612), (0.05, 10_000, 0.9591)),
    *((0.02, 1, 0.9862), (0.1, 1, 1.2140), (0.1, 2, 0.9574)),
]


@pytest.mark.parametrize(("tick", "number", "known"), KNOWN)
def test_the_papers_ring(tick, number, known):
    """To the figures that are known."""
    assert spectral_radius(RING, GAIN, tick, number) == pytest.approx(known, abs=5e-5)


NUMBERS = st.floats(-0.99, 0.99)


@given(
    real=NUMBERS,
    imaginary=NUMBERS,
    tick=st.floats(0.01, 1.0),
    gain=st.tuples(*[st.floats(0.1, 9)] * 3),
)
def test_growth_is_that_of_the_polynomial(real, imaginary, tick, gain):
    """`(z - μ)(z - 1)³ + (1 - μ) z N(z)`, N from what a held jerk adds over a tick."""
    mu = real + 1j * imaginary
    left = np.polymul([1, -mu], np.poly([1, 1, 1]))
    polynomial = np.polyadd(left, (1 - mu) * np.append(held_jerk(gain, tick), 0))
    known = np.abs(np.roots(polynomial)).max()
    assert rounds.growth(mu, np.array(gain), tick) == pytest.approx(known, rel=1e-4)


def held_jerk(gain, tick):
    """N(z), the coefficients of what a held jerk adds over a tick."""
    k0, k1, k2 = gain
    of_position = k0 * tick**3 / 6 * np.array([1, 4, 1])
    return of_position + k1 * tick**2 / 2 * np.array([1, 0, -1]) + k2 * tick * np.array([1, -2, 1])


def test_the_greatest_tick_of_one_round_on_the_ring():
    """Where z = -1 solves that polynomial for λ = -0.9."""
    found = greatest_tick(RING, GAIN, 1)
    assert 1.9 * (4 * 3 * found - found**3 / 3) == pytest.approx(8 * 0.1, rel=1e-9)
    assert found == pytest.approx(2 * 0.1 / (3 * 1.9), rel=1e-3)


@pytest.mark.parametrize("gain", [(1, 3, 3), (6, 11, 6), (2, 1, 5)])
def test_short_ticks_ask_for_a_rate_of_exchanges(gain):
    """A slow eigenvalue alone: just below it grows, just above it shrinks, for any rounds."""
    gain = np.array(gain, float)
    for left, number in ((0.99, 1), (0.99, 3), (0.999, 1), (0.999, 3)):
        tick = number / least_rate(left, gain)
        above, below = (rounds.growth(left**number, gain, share * tick) for share in (1.1, 0.9))
        assert above > 1 > below


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
        stable = [spectral_radius(weights, GAIN, tick, n) < 1 for n in range(1, surely + 40)]
        assert not any(stable[: few - 1])
        assert stable[few - 1]
        assert all(stable[surely - 1 :])


def test_more_rounds_may_be_worse():
    stable = [spectral_radius(RING, GAIN, 0.18, n) < 1 for n in range(1, 6)]
    assert stable == [False, True, False, True, False]


def test_no_number_of_rounds_is_stable():
    """At a long tick; or for two vehicles that hear each other alone."""
    apart = np.array([[1.0, 0, 0, 0], [0, 0, 0, 1.0], [0, 0, 1.0, 0]])
    assert rounds.least_rounds(RING, GAIN, 0.75) is None
    assert rounds.least_rounds(apart, GAIN, 0.05) is None


LOSSES = [  # tick and critical probability, found by two independent programs
    *((RING, 0.02, 0.413127), (RING, 0.05, 0.0)),  # one round is unstable at 0.05 s
    *((np.eye(1, 2), 0.02, 0.922509), (np.eye(1, 2), 0.2, 0.438192)),
]


@pytest.mark.parametrize(("weights", "tick", "critical"), LOSSES)
def test_known_losses_of_whole_ticks(weights, tick, critical):
    """Of one round on the ring, and of graphs without a cycle."""
    found = rounds.critical_loss(rounds.eigenvalues(weights), GAIN, tick)
    assert found == pytest.approx(critical, abs=5e-7)


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


@pytest.mark.parametrize("gain", [[0.7], [0.4, 3.0], [1.354, 9.748, 0.259], [9.1, 25.0, 11.1, 3.1]])
@pytest.mark.parametrize("kind", [Cyclic(), ErdosRenyi(probability=0.4, navigator={"share": 0.5})])
def test_the_local_law_grows_by_the_spectral_radius_of_the_whole_fleet(gain, kind):
    """Of the step matrix of all vehicles, held for a tick; and the rate of it at every instant."""
    weights, order, tick, gain = matrix_of(kind, 12), len(gain), 0.3, np.array(gain)
    pull = np.kron(gain[None], np.eye(12) - weights[:, 1:])
    whole = np.zeros((12 * (order + 1), 12 * (order + 1)))
    whole[:-12, :-12] = np.kron(np.eye(order, k=1), np.eye(12))
    whole[-24:-12, -12:] = np.eye(12)
    flow = expm(whole * tick)[:-12]
    radius = np.abs(np.linalg.eigvals(flow[:, :-12] - flow[:, -12:] @ pull)).max()
    values = rounds.eigenvalues(weights)
    assert rounds.growth(0 * values, gain, tick, 1 - values) == pytest.approx(radius, rel=1e-6)
    motion = whole[:-12, :-12].copy()
    motion[-12:] -= pull
    rate = np.linalg.eigvals(motion).real.max()
    assert rounds.local_rate(values, gain) == pytest.approx(rate, abs=1e-6)


ALONE = {"law": "local", "navigator": "none"}


@pytest.mark.parametrize("move", ["exact", "euler"])
@pytest.mark.parametrize(
    ("vehicle", "gain", "more"),
    [
        ("single_integrator", [4.2], {}),
        ("double_integrator", [1.0, 4.2], {}),
        ("single_integrator", [2.0], ALONE),
        ("single_integrator", [3.3], ALONE),
        ("double_integrator", [1.0, 3.0], ALONE),
    ],
)
def test_fleets_with_held_inputs_grow_as_told(vehicle, gain, more, move):
    """As simulated, over 60 ticks after the start; nothing is known of Euler's step at order 2."""
    keys = {"vehicle": vehicle, "gain": gain, "engine": {"kind": "sampled", "move": move}, **more}
    keys |= {"tick": 0.5, "output_step": 0.5, "tail": 10.0, "attack": "none", "defence": "none"}
    told = rounds.stability(case_of(**keys))
    if (vehicle, move) == ("double_integrator", "euler"):
        assert told is None
        return
    what = "spread_max" if more else "tail_max_max"
    ends = [jaxnet.simulate({**keys, "horizon": end}, 1).cells[what][0] for end in (30.0, 60.0)]
    assert told.growth == pytest.approx((ends[1] / ends[0]) ** (1 / 60), rel=1e-3)


def test_other_vehicles_with_held_inputs_have_no_known_factor():
    keys = {"engine": "sampled", "attack": "none", "defence": "none", "output_step": 0.05}
    assert rounds.stability(case_of(**keys, vehicle="two_wheeled")) is None


def test_of_a_fleet_that_hears_nobody_no_stability_is_known():
    """Vehicles of a star without a navigator have themselves alone."""
    keys = {"topology": {"kind": "star", "own_weight": 0.5}, "navigator": "none", "attack": "none"}
    assert rounds.stability(case_of(**keys, law="local", defence="none", vehicles=4)) is None


def late_polynomial(value, gain, tick, late):
    """`(z^{d+1} - λ)(z - 1)³ + (z^{d+1} - λ z) N(z)`, by its coefficients."""
    ahead, moved = np.poly1d([1.0, *[0.0] * (late + 1)]), np.poly1d(held_jerk(gain, tick))
    return (ahead - value) * np.poly1d([1, -1]) ** 3 + (ahead - value * np.poly1d([1, 0])) * moved


def test_radii_of_late_messages():
    """Known on the ring at 0.02 s; on others the roots of the polynomial."""
    known = {1: 0.986432, 2: 0.986695, 3: 0.988730, 5: 0.992472, 10: 0.995887}
    ring, message = rounds.eigenvalues(RING), np.append(GAIN, 1.0)
    for late, radius in known.items():
        found = delay.late_growth(ring, GAIN, message, 0.02, late)
        assert found == pytest.approx(radius, abs=5e-7)
    for weights in digraphs():
        values = rounds.eigenvalues(weights)
        roots = [np.abs(late_polynomial(value, GAIN, 0.1, 2).roots).max() for value in values]
        found = delay.late_growth(values, GAIN, message, 0.1, 2)
        assert found == pytest.approx(max(roots), abs=2e-5)


@pytest.mark.parametrize(
    ("topology", "each"), [("star", 0.1), ("path", 0.1 * np.arange(1, 13)), ("cyclic", 1.0)]
)
def test_lags(topology, each):
    """The delay once for each link on the way: 1 on a star, i on a path, 10 on the ring."""
    case = case_of(topology=topology, channel={"delay": 0.1}, tick=0.05)
    assert delay.lag_behind(case) == pytest.approx(np.zeros(12) + each)


def test_margins_of_the_delay():
    """Known on the ring, by hand at order 1, infinite without a cycle."""
    assert delay.jerk_margin(RING, GAIN) == pytest.approx(0.0363729, abs=5e-8)
    assert delay.jerk_margin(RING, np.array([2.0])) == pytest.approx((1 / 0.9 - 1) / 2)
    assert delay.jerk_margin(matrix_of(Path(), 12), GAIN) == math.inf


@pytest.mark.parametrize("extrapolate", ["none", "jets", "jerk"])
def test_a_message_has_the_value_of_its_polynomial_after_the_delay(extrapolate):
    """R of the Taylor polynomial of a motion, and the highest derivative as it was sent."""
    gain, jets, late = np.append(GAIN, 1.0), np.array([2.0, -1.0, 0.5, 4.0]), 0.3
    known = jets[: 3 + (extrapolate == "jerk")]
    path = np.polynomial.Polynomial(known / [math.factorial(n) for n in range(len(known))])
    after = [path.deriv(n)(late if extrapolate != "none" else 0.0) for n in range(4)]
    after[3] = jets[3]
    found = delay.message_factors(GAIN, late, extrapolate, local=False)
    assert found @ jets == pytest.approx(gain @ after)
    local = delay.message_factors(GAIN, late, extrapolate, local=True)
    assert local.tolist() == [*found[:3], 0.0]
