"""Constants of one axis by quadrature and search, the bounds of the notes, and their order."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import brentq

from jaxnet.kinds.graphs.path import Path
from jaxnet.kinds.graphs.star import Star
from jaxnet.theory import lyapunov, response, solution
from jaxnet.theory.announced import between_ticks
from jaxnet.theory.bounds import BOUND_KEYS, harmonic, ultimate_bounds
from jaxnet.theory.spread import AttackGain, attack_gain
from tests.matrices import matrix_of
from tests.theory.test_spread import ATTACKED, CUT_OFF, CYCLIC, TRIO, hearing, networks, of

GAIN = np.array([1.0, 3.0, 3.0])
GAINS = [[0.7], [2.0, 0.3], [0.4, 3.0], [5.0, 1.0], [1.354, 9.748, 0.259], [2.0, 3.0, 3.0]]
GAINS += [[1.0, 2.0, 3.0, 2.0], [50.0, 65.0, 34.0, 9.0], [9.13, 25.0, 11.08, 3.1]]
SWITCHING = ("peak_gain", "lyapunov_corrected", "lyapunov_best", "star_norm")


def gain_of(*poles):
    """Gain with these poles."""
    return np.poly(poles).real[:0:-1].copy()


def bounds_of(network, gain=GAIN):
    """All bounds on a network."""
    return ultimate_bounds(attack_gain(*network.spread), gain)


@pytest.mark.parametrize(
    ("gain", "eta", "printed", "root"),  # Q = I: η, 2‖PB‖, √κ(P)
    [
        ([1.0], np.sqrt(2), 1.0, 1.0),
        ([1.0, 2.0], 2.0, np.sqrt(2), 2.414214),
        ([1.0, 3.0, 3.0], 2.828427, 2.099107, 4.762563),
        ([1.0, 4.0, 6.0, 4.0], 4.0, 3.259601, 9.179216),
    ],
)
def test_constants_of_binomial_gains(gain, eta, printed, root):
    """theorems.md O5, published for order 3, worked out twice for the others."""
    gain = np.array(gain)
    assert response.impulse_norm(gain) == pytest.approx(1.0, abs=1e-6)
    assert response.harmonic_norm(gain) == pytest.approx(eta, abs=1e-6)
    assert lyapunov.printed_constant(gain) == pytest.approx(printed, abs=1e-6)
    assert lyapunov.corrected_constant(gain) == pytest.approx(printed * root, abs=1e-5)
    if len(gain) == 3:
        assert lyapunov.best_constant(gain) == pytest.approx(7.856, abs=5e-4)
        assert response.axis_star_norm(gain) == pytest.approx(1.183, abs=5e-4)


def absolute_integral(gain):
    """∫|h| by quadrature between h's zeros, from a dense grid; h from its partial fractions."""
    poles = np.roots([1.0, *gain[::-1]])
    residues = np.array([1 / np.prod(pole - np.delete(poles, k)) for k, pole in enumerate(poles)])

    def h(t):
        return (residues * np.exp(poles * np.asarray(t)[..., None])).sum(axis=-1).real

    end = 40 / -poles.real.max()
    grid = np.linspace(1e-3 / np.abs(poles).max(), end, 20_000)
    values = h(grid)
    falls = np.flatnonzero(values[:-1] * values[1:] < 0)
    zeros = [brentq(h, grid[n], grid[n + 1], xtol=1e-15) for n in falls]
    edges = np.unique([*zeros, *np.linspace(0, end, 50)])
    return sum(abs(quad(h, a, b, epsabs=1e-14, epsrel=1e-12)[0]) for a, b in pairwise(edges))


PAIRS = [  # a pole -p and a pair -σ ± iω
    *((1, 0.5, 1), (1, 0.1, 2), (3, 0.3, 5), (2, 0.1, 10)),  # rings for ever
    *((0.5, 1, 4), (0.1, 3, 0.5)),  # the pole hides the pair
    (0.4, 0.41, 30),  # below zero a few times, in the beginning
    *((1, 1, 3), (1, 0.999, 3), (1, 1.001, 3)),  # touches zero, or nearly
]
RINGING = [gain_of(-p, complex(-s, w), complex(-s, -w)) for p, s, w in PAIRS]


@pytest.mark.parametrize("gain", [*RINGING, *GAINS[1::3]])
def test_the_peak_gain_is_the_integral_of_the_absolute_impulse_response(gain):
    known = absolute_integral(np.array(gain))
    assert response.impulse_norm(np.array(gain)) == pytest.approx(known, rel=1e-10)


@pytest.mark.long
def test_a_ring_that_hardly_decays_has_the_peak_gain_of_its_sine():
    """In the limit the pair alone rings, at the pole's strength |1 / (jω + p)| / ω."""
    sigma, gain = 1e-5, gain_of(-1, complex(-1e-5, 1), complex(-1e-5, -1))
    ringing = abs(1 / (1j + 1)) * (2 / np.pi) / sigma
    assert response.impulse_norm(gain) == pytest.approx(ringing, rel=1e-4)


@pytest.mark.parametrize("gain", GAINS)
def test_the_harmonic_norm_is_the_greatest_on_a_grid(gain):
    """|R(iω)| / max(1, ω^r), with r the order."""
    omega = np.concatenate([np.linspace(0, 1, 20_001), np.geomspace(1, 1e4, 20_001)])
    R = np.polyval([1.0, *gain[::-1]], 1j * omega)
    greatest = (np.abs(R) / np.maximum(1, omega ** len(gain))).max()
    assert response.harmonic_norm(np.array(gain)) == pytest.approx(greatest, rel=1e-6)


def driven(gain, step, direction, steps=60_000):
    """State at the end under ρ(t) = sign c'h(T - t), by the exact solution for constant ρ."""
    flow = expm(solution.companion(gain) * step)
    push = np.linalg.solve(solution.companion(gain), flow - np.eye(3))[:, 2]
    impulse = [np.array([0.0, 0.0, 1.0])]
    for _ in range(steps):
        impulse.append(flow @ impulse[-1])
    state = np.zeros(3)
    for sign in np.sign(np.array(impulse[::-1]) @ direction):
        state = flow @ state + push * sign
    return state


def test_a_disturbance_can_attain_the_peak_gain():
    gain = gain_of(-1, -0.2 + 2j, -0.2 - 2j)
    state = driven(gain, 1e-3, np.array([1.0, 0.0, 0.0]))
    assert state[0] == pytest.approx(response.impulse_norm(gain), rel=1e-4)


@pytest.mark.long
def test_the_printed_constant_is_false_in_general():
    """A disturbance brings ‖η‖ above it, and not above the corrected one."""
    gain, direction = np.array([1.354, 9.748, 0.259]), np.array([0.0, 1.0, 0.0])
    for _ in range(5):  # each time towards where the last one led
        direction = driven(gain, 5e-3, direction)
    assert np.linalg.norm(direction) == pytest.approx(10.67, abs=0.02)
    assert lyapunov.printed_constant(gain) == pytest.approx(9.480, abs=5e-4)
    assert np.linalg.norm(direction) < lyapunov.corrected_constant(gain)


@pytest.mark.parametrize("gain", [GAIN.tolist(), [2.0], [1.0, 2.0], [1.0, 4.0, 6.0, 4.0], GAINS[4]])
def test_lemma_1_bounds_the_flow_of_the_errors(gain):
    """At dense times."""
    factor, rate = solution.decay_constants(np.array(gain))
    times = np.linspace(0, 40, 801)
    flow = [np.linalg.norm(expm(solution.companion(np.array(gain)) * t), 2) for t in times]
    assert (flow <= factor * np.exp(-rate * times) * (1 + 1e-12)).all()
    assert rate > 0


GRAPHS = {"star": matrix_of(Star(), 12), "cyclic": CYCLIC, "path": matrix_of(Path(), 12)}


@pytest.mark.parametrize(
    ("name", "static", "peak", "printed", "corrected"),
    [("star", 1, 8, 33.6, 160), ("cyclic", 3.103, 24.8, 213.7, 1018), ("path", 4, 32, 267.4, 1274)],
)
def test_the_table_of_the_notes(name, static, peak, printed, corrected):
    """theorems.md O5: worst vehicle, and the fleet by the paper's form, untrimmed."""
    found = bounds_of(of(GRAPHS[name], ATTACKED, theta=0))
    assert tuple(found) == BOUND_KEYS
    assert found["static"].worst == pytest.approx(static, abs=5e-4)
    assert found["peak_gain"].worst == pytest.approx(peak, abs=0.05)
    assert found["lyapunov_printed"].fleet == pytest.approx(printed, abs=0.05)
    assert found["lyapunov_corrected"].fleet == pytest.approx(corrected, abs=0.5)
    best = found["lyapunov_best"].fleet / found["lyapunov_corrected"].fleet
    assert best == pytest.approx(7.856 / 9.997, rel=1e-4)


def test_the_ring_that_trims_may_switch():
    """19.8 and 16.2; static and printed say nothing."""
    found = bounds_of(of(CYCLIC, ATTACKED))
    assert sorted(set(found["peak_gain"].vehicles.round(9))) == [16.2, 19.8]
    assert found["peak_gain"].fleet == pytest.approx(np.sqrt(8 * 19.8**2 + 4 * 16.2**2))
    for name in ("static", "lyapunov_printed"):
        assert np.isnan([*found[name].vehicles, found[name].worst, found[name].fleet]).all()


def test_attacks_that_may_jump_have_no_static_bound():
    """A strategic attack's vectors and G change at ticks: the peak gain alone covers that."""
    network = of(CYCLIC, ATTACKED, theta=0)
    smooth = bounds_of(network)
    jumping = ultimate_bounds(attack_gain(*network.spread, smooth=False), GAIN)
    assert np.isnan(jumping["static"].vehicles).all()
    np.testing.assert_array_equal(jumping["peak_gain"].vehicles, smooth["peak_gain"].vehicles)


def test_who_always_drops_the_same_does_not_switch():
    """1 hears the navigator, 2 and 3, trusts 0 and 2 and always drops 3: 0 and 2 have half each."""
    network = of(hearing({1: [0, 2, 3], 2: [0], 3: [0]}), [2, 3], trusted={1: [2]})
    found = bounds_of(network)
    assert found["static"].vehicles.tolist() == [0.5, 0, 0]
    assert found["lyapunov_printed"].fleet > 0


def test_a_vehicle_that_may_be_cut_off_has_no_finite_bound():
    """With a choice of whom to retain static and printed are silent; else infinite too."""
    trio = {1: [2, 3, 4], 2: [1, 3, 4], 3: [1, 2, 4]}
    choice = bounds_of(of(hearing({**trio, 4: [0], 5: [0, 4, 6], 6: [0]}), [4], trusted=TRIO))
    for name, bound in choice.items():
        expected = np.inf if name in SWITCHING else np.nan
        np.testing.assert_equal([bound.worst, bound.fleet], [expected] * 2)
    settled = bounds_of(of(CUT_OFF, [4], trusted=TRIO))
    for bound in settled.values():
        assert bound.worst == bound.fleet == np.inf
        assert bound.vehicles.tolist() == [np.inf, np.inf, np.inf, 0.0]


@st.composite
def gains(draw):
    """Stable gains with real or complex poles."""
    p, sigma, omega = (draw(st.floats(0.2, 4.0)) for _ in range(3))
    pair = [complex(-sigma, omega), complex(-sigma, -omega)]
    return gain_of(-p, *draw(st.sampled_from([pair, [-sigma, -omega]])))


@settings(max_examples=20)
@given(networks(), gains())
def test_no_bound_is_below_one_that_it_must_not_be_below(network, gain):
    """Static ≤ harmonic ≤ peak gain ≤ corrected, best, star; best ≤ corrected; worst ≤ fleet."""
    found = bounds_of(network, gain) | {"harmonic": harmonic(attack_gain(*network.spread), gain)}
    slopes = {name: np.append(each.vehicles, each.fleet) for name, each in found.items()}
    greater = [("static", "harmonic"), ("harmonic", "peak_gain")]
    greater += [("peak_gain", name) for name in SWITCHING[1:]]
    for less, more in (*greater, ("lyapunov_best", "lyapunov_corrected")):
        below = slopes[less] <= slopes[more] * (1 + 1e-9)
        assert (np.isnan(slopes[less]) & (less == "static") | below).all()
    for bound in found.values():
        assert np.isnan(bound.fleet) or bound.worst <= bound.fleet * (1 + 1e-9)


@pytest.mark.parametrize("frequency", [0.0, 0.3, 0.7, 1.0, 2.5, 16.0])
@pytest.mark.parametrize("orders", [(0, 1, 2, 3), (3,), (0, 1)])
def test_the_drive_changes_no_faster_within_a_tick_than_theorem_3_is_told(frequency, orders):
    """Λ of a turning attack as great as ā allows, exactly derived; one order alone attains it."""
    reach = AttackGain(np.array([1.0]), 1.0, None, np.nan, orders)
    bound = between_ticks(reach, GAIN, frequency, tick=0.1, one_frequency=orders == (0, 1, 2, 3))[0]
    size = 1.0 / max(frequency**order for order in orders) if frequency else 1.0
    rate = abs(sum(np.append(GAIN, 1.0)[k] * (1j * frequency) ** (k + 1) for k in orders)) * size
    assert rate * 0.1 <= bound * (1 + 1e-12)
    if len(orders) == 1:
        assert bound == pytest.approx(rate * 0.1)
