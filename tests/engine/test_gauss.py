"""Gauss collocation of one window, against polynomials and the exact flow of a linear equation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.linalg import expm

from jaxnet.engine import gauss
from jaxnet.model import plane

GAIN = np.array([1.0, 3.1, 2.7])
LENGTHS = np.array([0.3, 1.0, 2.5])  # [s], of the windows of three lanes
LANES = len(LENGTHS)
START = np.array([0.0, 1.5, 7.0])  # [s]
RATE = 1.3  # [rad/s]


def polynomials(rng, degree):
    """Jerks (2, m, lanes) of one vehicle and their jets at the start."""
    jerks = [[Polynomial(rng.normal(size=degree + 1)) for _ in range(LANES)] for _ in range(2)]
    return jerks, rng.normal(size=(3, 2, 1, LANES))


def window_of(jerks, jets):
    """The window that knows these jerks at its nodes alone."""
    at_nodes = np.array(
        [[[p(gauss.RULE.nodes * h) for p, h in zip(row, LENGTHS, strict=True)]] for row in jerks]
    )
    values = jnp.asarray(np.moveaxis(at_nodes, -1, 0))
    return gauss.window_of(
        jnp.asarray(START), jnp.asarray(LENGTHS), tuple(map(jnp.asarray, jets)), values
    )


@pytest.mark.parametrize("past", [0.0, 0.31, 1.0])
def test_a_polynomial_of_degree_7_is_exact_at_every_time(past):
    """Its integrals by NumPy."""
    jerks, jets = polynomials(np.random.default_rng(0), gauss.STAGES - 1)
    window, time = window_of(jerks, jets), START + past * LENGTHS
    found = window.jets_at(jnp.asarray(time))
    for at in START + np.linspace(0.0, 1.0, 51)[:, None] * LENGTHS:
        size = jnp.hypot(*window.jerk_at(jnp.asarray(at)))
        assert (size <= window.greatest_jerk() * (1 + 1e-12)).all()
    for axis in range(2):
        for lane in range(LANES):
            t, once = past * LENGTHS[lane], jerks[axis][lane].integ()
            y, v, a = jets[:, axis, 0, lane]
            known = (
                y + v * t + a * t**2 / 2 + once.integ().integ()(t),
                v + a * t + once.integ()(t),
                a + once(t),
            )
            for ours, theirs in zip(found, known, strict=True):
                np.testing.assert_allclose(
                    ours[axis, 0, lane], theirs, rtol=1e-11, atol=1e-11
                )  # rounding times coefficients
            jerk = window.jerk_at(jnp.asarray(time))[axis, 0, lane]
            np.testing.assert_allclose(jerk, jerks[axis][lane](t), rtol=1e-10, atol=1e-10)


def solved(length, start):
    """Jets at the end of a window under `y‴ = cos(rate t) - P(y)`, from the jets at the start."""
    times = jnp.asarray(gauss.RULE.nodes)[:, None] * length[None]
    coasted, drive = gauss.coasted(start, times), jnp.cos(RATE * times)[:, None, None]
    gain = jnp.broadcast_to(jnp.asarray(GAIN)[:, None], (3, len(length)))

    def asked(jets):
        return drive - sum(k * jet for k, jet in zip(GAIN, jets, strict=True))

    jerks = gauss.times(gauss.linear(gain, length), asked(coasted))
    window = gauss.window_of(jnp.zeros_like(length), length, start, jerks)
    moved = plane.plus(coasted, gauss.integrated(length, jerks, 3))
    return window.jets_at(length), jerks - asked(moved)


def known_end(length, start):
    """The same by the exponential of a matrix, with cosine and sine as two more states."""
    whole = np.zeros((5, 5))
    whole[0, 1] = whole[1, 2] = whole[2, 3] = 1.0
    whole[2, :3] = -GAIN
    whole[3, 4], whole[4, 3] = -RATE, RATE
    return (expm(whole * length) @ np.concatenate([start, [1.0, 0.0]]))[:3]


BEGIN = np.array([1.0, -2.0, 0.5])


def end_errors(length):
    """Errors of y, ẏ and ÿ at the end of windows of these lengths; the residual at the nodes."""
    start = tuple(jnp.full((2, 1, len(length)), value) for value in BEGIN)
    traced_anew = jax.jit(lambda *given: solved(*given))  # with the rule of the test
    found, residual = traced_anew(jnp.asarray(length), start)
    known = np.stack([known_end(each, BEGIN) for each in length], axis=1)
    return np.abs(np.stack([jet[0, 0] for jet in found]) - known), residual


def test_the_linear_equation_is_solved():
    errors, residual = end_errors(np.array([0.5, 1.0]))
    assert np.abs(residual).max() < 1e-12
    assert errors.max() < 5e-12  # rounding, times the coefficients of the cardinal polynomials


@pytest.mark.parametrize("nodes", [2, 3])
def test_the_order_is_twice_the_number_of_nodes(nodes, monkeypatch):
    """Half the window errs 2^(order + 1) times less; eight nodes are exact before that shows."""
    monkeypatch.setattr(gauss, "STAGES", nodes)
    monkeypatch.setattr(gauss, "RULE", gauss.gauss_rule(nodes))
    errors, _ = end_errors(np.array([0.1, 0.2]))
    assert np.abs(np.log2(errors[:, 1] / errors[:, 0]) - (2 * nodes + 1)).max() < 0.5


def test_the_effect_of_the_highest_degree_is_the_greatest_of_its_integrals():
    """On a grid, by cumulative sums."""
    grid = np.linspace(0.0, 1.0, 40_001)
    jerk = np.polynomial.Legendre.basis(gauss.STAGES - 1, domain=[0, 1])(grid)
    effects = gauss.effect(jnp.asarray(LENGTHS), jnp.ones((2, 1, LANES)), 4)
    for order, told in enumerate(effects[::-1], start=1):
        jerk = np.concatenate([[0.0], np.cumsum((jerk[1:] + jerk[:-1]) / 2 * np.diff(grid))])
        np.testing.assert_allclose(told[0, 0], LENGTHS**order * np.abs(jerk).max(), rtol=1e-4)


def missed(function):
    """How far a function of the share of a window is from its polynomial."""
    return gauss.unresolved(
        function(jnp.concatenate([gauss.RULE.nodes, gauss.PLACES]))[:, None, None]
    )[0, 0]


@pytest.mark.parametrize("place", [0.001, 0.05, 0.3, 0.5, 0.72, 0.96, 0.999])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_kink_is_seen_wherever_it_is(place, sign):
    """A ramp that starts or ends somewhere, also before the first node and after the last."""
    assert missed(lambda times: jnp.maximum(sign * (times - place), 0.0)) > 2e-4
    assert missed(jnp.sin) < 1e-8
