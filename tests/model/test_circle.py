"""Cosine and sine together: against NumPy's in extended precision, wherever an angle may lie."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.model.circle import angle, circle

COMPILED, ANGLE = jax.jit(circle), jax.jit(angle)
HOW = {"numpy": circle, "jax": lambda angle: circle(jnp.asarray(angle))}
HOW["compiled"] = lambda angle: COMPILED(jnp.asarray(angle))


def check(how, angle, error):
    """Both against NumPy's, whose own rounding is out of the way."""
    exact = angle.astype(np.longdouble)
    cosine, sine = (np.asarray(each) for each in HOW[how](angle))
    assert np.abs(cosine - np.cos(exact)).max() <= error
    assert np.abs(sine - np.sin(exact)).max() <= error


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize(("greatest", "error"), [(1.0, 2e-16), (1e3, 2e-16), (1e8, 1e-9)])
@given(st.integers(0, 2**32 - 1))
def test_cosine_and_sine_are_numpys(how, greatest, error, seed):
    check(how, np.random.default_rng(seed).uniform(-greatest, greatest, 1000), error)


@pytest.mark.parametrize("how", HOW)
def test_quarter_turns_and_the_borders_between_them(how):
    """Multiples of π/4 and their neighbours among the numbers, where the quadrant is chosen."""
    corners = np.arange(-200, 201) * np.pi / 4
    angles = np.stack([np.nextafter(corners, -np.inf), corners, np.nextafter(corners, np.inf)])
    check(how, angles, 2e-16)


@pytest.mark.parametrize("how", ["numpy", "jax", "compiled"])
@given(st.integers(0, 2**32 - 1))
def test_the_angle_of_a_vector_is_numpys(how, seed):
    """In each octant and on its borders, of any size: within 2.5 units in the last place."""
    rng = np.random.default_rng(seed)
    corners = np.arange(-8, 8) * np.pi / 8
    anywhere = rng.uniform(-np.pi, np.pi, 500)
    around = np.concatenate([anywhere, corners, corners + 1e-16, [1e-100, 3.0]])
    size = 10.0 ** rng.uniform(-50, 50, around.shape)
    vectors = size * np.cos(around), size * np.sin(around)
    given = vectors if how == "numpy" else map(jnp.asarray, vectors)
    found = np.asarray({"numpy": angle, "jax": angle, "compiled": ANGLE}[how](*given))
    exact = np.arctan2(*(each.astype(np.longdouble) for each in vectors[::-1]))
    assert np.abs((found - exact) / np.spacing(np.abs(found))).max() < 2.5
