"""The Lissajous figure: derivatives against autodiff, slowest moment against dense sampling."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxnet.kinds.navigators.lissajous import Lissajous

FIGURE_EIGHT = Lissajous()


def pairs(low, high):
    return st.lists(st.floats(low, high), min_size=2, max_size=2)


navigators = st.builds(
    Lissajous, amplitude=pairs(0.0, 200.0), frequency=pairs(-2.0, 2.0), phase=pairs(-7.0, 7.0)
)


@jax.jit
def slopes(amplitude, frequency, phase, t):
    path = Lissajous.filled({"amplitude": amplitude, "frequency": frequency, "phase": phase})
    return path.jets(t), jax.jacfwd(lambda t: path.jets(t)[:3])(t)


@given(navigators, st.floats(0.0, 100.0))
def test_each_jet_is_the_slope_of_the_one_before(navigator, t):
    numbers = [
        np.array(each) for each in (navigator.amplitude, navigator.frequency, navigator.phase)
    ]
    scale = (np.abs(numbers[1]) ** np.arange(4.0)[:, None] * numbers[0]).max() + 1e-300
    in_jax, expected = slopes(*map(jnp.asarray, numbers), jnp.asarray(t))
    np.testing.assert_allclose(in_jax[1:] / scale, expected / scale, atol=1e-12)
    np.testing.assert_allclose(navigator.jets(np.array(t)) / scale, in_jax / scale, atol=1e-12)


def test_lanes_have_figures_of_their_own():
    rng = np.random.default_rng(0)
    amplitude, frequency, phase = rng.uniform(0.1, 2.0, (3, 2, 5))
    times = rng.uniform(0.0, 30.0, 5)
    drawn = Lissajous.filled({"amplitude": amplitude, "frequency": frequency, "phase": phase})
    together = drawn.jets(times)
    assert together.shape == (4, 2, 5)
    for lane in range(5):
        numbers = {key: value[:, lane].tolist() for key, value in vars(drawn).items()}
        np.testing.assert_array_equal(together[..., lane], Lissajous(**numbers).jets(times[lane]))


def test_figure_eight_is_the_curve_of_the_paper():
    times = np.linspace(0.0, 30.0, 301)
    curve = np.stack([100 * np.sin(0.2 * times), 50 * np.sin(0.4 * times)])
    jets = FIGURE_EIGHT.jets(times)
    assert jets.shape == (4, 2, 301)
    np.testing.assert_allclose(jets[0], curve, atol=1e-12)


@settings(max_examples=300)
@given(navigators, st.floats(0.1, 60.0))
def test_no_sampled_moment_is_slower_than_the_slowest(navigator, horizon):
    least, when = navigator.slowest(horizon)
    tolerance = 1e-4 * np.hypot(*(np.array(navigator.amplitude) * navigator.frequency))
    times = np.linspace(0.0, horizon, 20_001)
    sampled = np.linalg.norm(navigator.jets(times)[1], axis=0).min()
    assert least <= sampled + tolerance + 1e-12
    assert 0.0 <= when <= horizon
    assert np.linalg.norm(navigator.jets(np.array(when))[1]) == pytest.approx(least, abs=1e-12)


def test_the_figure_eight_never_falls_under_thirteen():
    """With c = cos² 0.2t its speed is 20 √(4c² - 3c + 1), least at c = 3/8, where it is 5 √7."""
    least, _ = FIGURE_EIGHT.slowest(30.0)
    assert least == pytest.approx(5 * np.sqrt(7.0), abs=1e-4 * np.hypot(20.0, 20.0))
    assert least > 13.0


def test_a_navigator_that_stays_is_found_to_stand():
    still = Lissajous(amplitude=[50.0, 50.0], frequency=[0.0, 0.0], phase=[0.3, 0.0])
    assert still.slowest(30.0)[0] == 0.0
