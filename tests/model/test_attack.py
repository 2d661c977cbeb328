"""Attacks: consistent derivatives, a bound that holds and is attained, and where they are heard."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.model import attack

FLEET, LIARS = 12, [2, 5, 8, 11]
KINDS = ["bias", "rotating", "sinusoid"]

angles = st.tuples(*[st.floats(-7.0, 7.0)] * len(LIARS)).map(np.array)
frequencies = st.floats(-5.0, 5.0)
magnitudes = st.floats(1e-3, 1e3)
times = st.floats(0.0, 100.0)


def units(angle):
    """Unit vectors at the liars' angles, zero for the others."""
    vectors = np.zeros((FLEET, 2))
    vectors[np.array(LIARS) - 1] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return jnp.asarray(vectors)


def attack_of(kind, magnitude=10.0, frequency=0.7, phase=(0.0,) * 4, direction=(0.0,) * 4):
    """An attack of the paper's four liars on everything that they transmit."""
    links = jnp.zeros((FLEET, FLEET + 1), dtype=bool).at[:, jnp.array(LIARS)].set(True)
    size, rate = jnp.asarray(magnitude), jnp.asarray(frequency)
    match kind:
        case "bias":
            return attack.Bias(links, size, units(np.array(direction)))
        case "rotating":
            return attack.Rotating(links, size, rate, units(np.array(phase)))
        case "sinusoid":
            return attack.Sinusoid(links, size, rate, units(np.array(phase)), units(np.array(direction)))


@jax.jit
def jets(given_attack, t):
    """Jets as they are given, and by differentiating the signal itself."""
    derivatives = [lambda t: given_attack.jets(t)[0]]
    for _ in range(3):
        derivatives.append(jax.jacfwd(derivatives[-1]))
    return given_attack.jets(t), jnp.stack([each(t) for each in derivatives])


@pytest.mark.parametrize("kind", KINDS)
@given(magnitudes, frequencies, angles, angles, times)
def test_derivatives_are_consistent_and_certified(kind, magnitude, frequency, phase, direction, t):
    signal, differentiated = jets(attack_of(kind, magnitude, frequency, phase, direction), jnp.asarray(t))
    np.testing.assert_allclose(signal, differentiated, rtol=1e-11, atol=1e-11 * magnitude)
    sizes = np.linalg.norm(signal, axis=-1)
    assert (sizes <= magnitude * (1 + 1e-12)).all()
    honest = [i - 1 for i in range(1, FLEET + 1) if i not in LIARS]
    assert not sizes[:, honest].any()


@given(magnitudes, frequencies, angles, times)
def test_a_rotating_attack_uses_its_bound_up_at_every_moment(magnitude, frequency, phase, t):
    """In its value where it turns slowly, in its third derivative where it turns fast."""
    signal, _ = jets(attack_of("rotating", magnitude, frequency, phase), jnp.asarray(t))
    sizes = np.linalg.norm(signal, axis=-1)[:, np.array(LIARS) - 1]
    order = 0 if abs(frequency) <= 1 else 3
    np.testing.assert_allclose(sizes[order], magnitude, rtol=1e-12)


@given(magnitudes, st.floats(-1.0, 1.0), angles, times)
def test_a_slow_rotating_attack_is_the_papers(magnitude, frequency, phase, t):
    signal, _ = jets(attack_of("rotating", magnitude, frequency, phase), jnp.asarray(t))
    angle = frequency * t + phase
    expected = magnitude * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    np.testing.assert_allclose(
        signal[0, np.array(LIARS) - 1], expected, rtol=0, atol=1e-13 * max(1.0, magnitude)
    )


@pytest.mark.parametrize(("frequency", "order"), [(0.7, 0), (-0.7, 0), (3.0, 3), (-3.0, 3)])
def test_a_sinusoid_reaches_its_bound_at_its_crest(frequency, order):
    """`sin` crests a quarter period after its zero; its third derivative, a cosine, at the zero."""
    given_attack = attack_of("sinusoid", 10.0, frequency)
    crest = np.pi / 2 / abs(frequency) if order == 0 else 0.0
    signal, _ = jets(given_attack, jnp.asarray(crest))
    sizes = np.linalg.norm(signal, axis=-1)[:, np.array(LIARS) - 1]
    np.testing.assert_allclose(sizes[order], 10.0, rtol=1e-12)


def test_a_bias_is_constant_and_as_long_as_allowed():
    signal, _ = jets(attack_of("bias", 10.0, direction=(0.0, 1.0, 2.0, 3.0)), jnp.asarray(7.0))
    liars = np.array(LIARS) - 1
    expected = 10.0 * np.stack([np.cos([0, 1, 2, 3]), np.sin([0, 1, 2, 3])], axis=1)
    np.testing.assert_allclose(signal[0, liars], expected, rtol=1e-14)
    assert not np.asarray(signal[1:]).any()


def test_nobody_lies_without_an_attack():
    nobody = attack.NoAttack(jnp.zeros((FLEET, FLEET + 1), dtype=bool))
    signal, _ = jets(nobody, jnp.asarray(3.0))
    assert signal.shape == (4, FLEET, 2)
    assert not np.asarray(signal).any()


corruption = jax.jit(attack.corruption)
on_links = jax.jit(attack.on_links)


@given(st.integers(0, 2**32 - 1))
def test_lies_add_up_over_the_links_that_carry_them(seed):
    """`d_i = Σ_j w_ij a_ij`, a_ij what j adds or, where j is the navigator, i's own receiver."""
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.0, 1.0, (FLEET, FLEET + 1)) * (rng.random((FLEET, FLEET + 1)) < 0.5)
    links = (rng.random((FLEET, FLEET + 1)) < 0.4) & (weights > 0)
    signal = rng.normal(size=(4, FLEET, 2))
    expected = np.zeros((4, FLEET, 2))
    for k in range(4):
        heard = np.asarray(on_links(jnp.asarray(signal[k]), jnp.asarray(links)))
        for i in range(1, FLEET + 1):
            for j in range(FLEET + 1):
                lie = signal[k, (j or i) - 1] if links[i - 1, j] else np.zeros(2)
                np.testing.assert_array_equal(heard[i - 1, j], lie)
                expected[k, i - 1] += weights[i - 1, j] * lie
    d = corruption(jnp.asarray(signal), jnp.asarray(links), jnp.asarray(weights))
    np.testing.assert_allclose(d, expected, rtol=0, atol=1e-14 * FLEET)
