"""Attacks: consistent derivatives, a bound that holds and is attained, and where they are heard."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.model import attack, hearing

FLEET, LIARS = 12, [2, 5, 8, 11]
KINDS = ["bias", "rotating", "sinusoid"]

angles = st.tuples(*[st.floats(-7.0, 7.0)] * len(LIARS)).map(np.array)
frequencies = st.floats(-5.0, 5.0)
magnitudes = st.floats(1e-3, 1e3)
times = st.floats(0.0, 100.0)


def everybodys(angle):
    """The liars' angles among all vehicles', zero for the others."""
    among_all = np.zeros(FLEET)
    among_all[np.array(LIARS) - 1] = angle
    return among_all


def attack_of(kind, magnitude=10.0, frequency=0.7, phase=(0.0,) * 4, direction=(0.0,) * 4):
    """An attack of the paper's four liars in one lane, without an axis over lanes."""
    size, rate = np.array(magnitude), np.array(frequency)
    phase, direction = everybodys(phase), everybodys(direction)
    match kind:
        case "bias":
            signal = attack.bias(size, direction)
        case "rotating":
            signal = attack.rotating(size, rate, phase)
        case "sinusoid":
            signal = attack.sinusoid(size, rate, phase, direction)
    lies = np.isin(np.arange(1, FLEET + 1), LIARS)
    signal = signal._replace(cosine=signal.cosine * lies, sine=signal.sine * lies)
    return jax.tree.map(jnp.asarray, signal)


@jax.jit
def jets(given_attack, t):
    """Jets as they are given, and by differentiating the signal itself."""
    derivatives = [lambda t: given_attack.jets(t)[0]]
    for _ in range(3):
        derivatives.append(jax.jacfwd(derivatives[-1]))
    return jnp.stack(given_attack.jets(t)), jnp.stack([each(t) for each in derivatives])


@pytest.mark.parametrize("kind", KINDS)
@given(magnitudes, frequencies, angles, angles, times)
def test_derivatives_are_consistent_and_certified(kind, magnitude, frequency, phase, direction, t):
    signal, differentiated = jets(attack_of(kind, magnitude, frequency, phase, direction), jnp.asarray(t))
    np.testing.assert_allclose(signal, differentiated, rtol=1e-11, atol=1e-11 * magnitude)
    sizes = np.linalg.norm(signal, axis=1)
    assert (sizes <= magnitude * (1 + 1e-12)).all()
    honest = [i - 1 for i in range(1, FLEET + 1) if i not in LIARS]
    assert not sizes[:, honest].any()


@given(magnitudes, frequencies, angles, times)
def test_a_rotating_attack_uses_its_bound_up_at_every_moment(magnitude, frequency, phase, t):
    """In its value where it turns slowly, in its third derivative where it turns fast."""
    signal, _ = jets(attack_of("rotating", magnitude, frequency, phase), jnp.asarray(t))
    sizes = np.linalg.norm(signal, axis=1)[:, np.array(LIARS) - 1]
    order = 0 if abs(frequency) <= 1 else 3
    np.testing.assert_allclose(sizes[order], magnitude, rtol=1e-12)


@given(magnitudes, st.floats(-1.0, 1.0), angles, times)
def test_a_slow_rotating_attack_is_the_papers(magnitude, frequency, phase, t):
    signal, _ = jets(attack_of("rotating", magnitude, frequency, phase), jnp.asarray(t))
    angle = frequency * t + phase
    expected = magnitude * np.stack([np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose(
        signal[0][:, np.array(LIARS) - 1], expected, rtol=0, atol=1e-13 * max(1.0, magnitude)
    )


@pytest.mark.parametrize(("frequency", "order"), [(0.7, 0), (-0.7, 0), (3.0, 3), (-3.0, 3)])
def test_a_sinusoid_reaches_its_bound_at_its_crest(frequency, order):
    """`sin` crests a quarter period after its zero; its third derivative, a cosine, at the zero."""
    given_attack = attack_of("sinusoid", 10.0, frequency)
    crest = np.pi / 2 / abs(frequency) if order == 0 else 0.0
    signal, _ = jets(given_attack, jnp.asarray(crest))
    sizes = np.linalg.norm(signal, axis=1)[:, np.array(LIARS) - 1]
    np.testing.assert_allclose(sizes[order], 10.0, rtol=1e-12)


def test_a_bias_is_constant_and_as_long_as_allowed():
    signal, _ = jets(attack_of("bias", 10.0, direction=(0.0, 1.0, 2.0, 3.0)), jnp.asarray(7.0))
    liars = np.array(LIARS) - 1
    expected = 10.0 * np.stack([np.cos([0, 1, 2, 3]), np.sin([0, 1, 2, 3])])
    np.testing.assert_allclose(signal[0][:, liars], expected, rtol=1e-14)
    assert not np.asarray(signal[1:]).any()


def test_nobody_lies_without_an_attack():
    nobody = attack.Harmonic(jnp.asarray(0.7), *jnp.zeros((2, 2, FLEET)))
    signal, _ = jets(nobody, jnp.asarray(3.0))
    assert signal.shape == (4, 2, FLEET)
    assert not np.asarray(signal).any()


lies_heard = jax.jit(hearing.Hearing.lies)
mean = jax.jit(hearing.Hearing.mean)


@given(st.integers(0, 2**32 - 1))
def test_lies_add_up_over_the_links_that_carry_them(seed):
    """`d_i = Σ_j w_ij a_ij`, a_ij what j adds or, where j is the navigator, i's own receiver."""
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.0, 1.0, (FLEET, FLEET + 1)) * (rng.random((FLEET, FLEET + 1)) < 0.5)
    weights[range(FLEET), range(1, FLEET + 1)] = 0.0
    links = (rng.random((FLEET, FLEET + 1)) < 0.4) & (weights > 0)
    sources = hearing.slots(weights)
    by_slot = [jnp.asarray(hearing.by_slot(each, sources)) for each in (weights, links)]
    network = hearing.Hearing(jnp.asarray(sources), by_slot[1])
    signal = rng.normal(size=(4, 2, FLEET))
    expected = np.zeros((4, 2, FLEET))
    silence = jnp.zeros((2, FLEET + 1))
    for k in range(4):
        heard = np.asarray(lies_heard(network, jnp.asarray(signal[k])))
        for i in range(1, FLEET + 1):
            told_by = dict(zip(sources[:, i - 1], heard[:, :, i - 1].T, strict=True))
            for j in range(FLEET + 1):
                lie = signal[k, :, (j or i) - 1] if links[i - 1, j] else np.zeros(2)
                if weights[i - 1, j] > 0:
                    np.testing.assert_array_equal(told_by[j], lie)
                expected[k, :, i - 1] += weights[i - 1, j] * lie
        d = mean(network, by_slot[0], silence, jnp.asarray(signal[k]))
        np.testing.assert_allclose(d, expected[k], rtol=0, atol=1e-14 * FLEET)
