"""Attacks' signals: consistent derivatives, a bound that holds and is attained, for whom they are meant."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.config.keys import Scenario
from jaxnet.kinds.attacks.bias import Bias
from jaxnet.kinds.attacks.none import NoAttack
from jaxnet.kinds.attacks.rotating import Rotating
from jaxnet.kinds.attacks.sinusoid import Sinusoid
from jaxnet.kinds.fields import Uniform
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.jobs import attack_of, tree
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import signal

FLEET, ATTACKED, LANES, HORIZON = 12, [2, 5, 8, 11], 2, 100.0
ROWS = np.array(ATTACKED) - 1
ANYWHERE = Uniform(uniform=[-7.0, 7.0])
KINDS = {
    "bias": lambda size, rate: Bias(magnitude=size, direction=ANYWHERE),
    "rotating": lambda size, rate: Rotating(magnitude=size, frequency=rate, phase=ANYWHERE),
    "sinusoid": lambda size, rate: Sinusoid(
        magnitude=size, frequency=rate, phase=ANYWHERE, direction=ANYWHERE
    ),
}

seeds = st.integers(0, 2**32 - 1)
frequencies = st.floats(-5.0, 5.0)
magnitudes = st.floats(1e-3, 1e3)
times = st.floats(0.0, HORIZON)


def drawn(attack, seed=0):
    """The numbers of an attack in some lanes, its functions and its vectors."""
    draw = Draw(Keyed(seed), range(LANES), FLEET)
    scenario = Scenario(attack=attack, horizon=HORIZON)
    navigator = scenario.navigator.drawn(draw, "navigator")
    functions, vectors, *_ = attack_of(scenario, draw, navigator, np.zeros((2, 12, 1)))
    return attack.drawn(draw, "attack"), tree(functions, LANES), jnp.asarray(vectors)


@jax.jit
def jets(functions, vectors, t):
    """Jets (4, 2, m, lanes) as they are given, and by differentiating the signal itself."""

    def given_jets(t):
        return signal.jets(vectors, functions.basis(jnp.full(LANES, t)))

    derivatives = [lambda t: given_jets(t)[0]]
    for _ in range(3):
        derivatives.append(jax.jacfwd(derivatives[-1]))
    return jnp.stack(given_jets(t)), jnp.stack([each(t) for each in derivatives])


def jets_at(attack, t, seed=0):
    """Jets of an attack's signals."""
    return np.asarray(jets(*drawn(attack, seed)[1:], jnp.asarray(t))[0])


@pytest.mark.parametrize("kind", KINDS)
@given(magnitudes, frequencies, seeds, times)
def test_derivatives_are_consistent_and_certified(kind, magnitude, frequency, seed, t):
    _, functions, vectors = drawn(KINDS[kind](magnitude, frequency), seed)
    found, differentiated = jets(functions, vectors, jnp.asarray(t))
    np.testing.assert_allclose(found, differentiated, rtol=1e-11, atol=1e-11 * magnitude)
    sizes = np.linalg.norm(found, axis=1)
    assert (sizes <= magnitude * (1 + 1e-12)).all()
    assert sizes[:, ROWS].max(axis=0).all()
    assert not np.delete(sizes, ROWS, axis=1).any()


@given(magnitudes, frequencies, seeds, times)
def test_a_rotating_attack_uses_its_bound_up_at_every_moment(magnitude, frequency, seed, t):
    """In its value where it turns slowly, in its third derivative where it turns fast."""
    found = jets_at(KINDS["rotating"](magnitude, frequency), t, seed)
    order = 0 if abs(frequency) <= 1 else 3
    np.testing.assert_allclose(np.linalg.norm(found[order][:, ROWS], axis=0), magnitude, rtol=1e-12)


@given(magnitudes, st.floats(-1.0, 1.0), seeds, times)
def test_a_slow_rotating_attack_is_the_papers(magnitude, frequency, seed, t):
    numbers, functions, vectors = drawn(KINDS["rotating"](magnitude, frequency), seed)
    found, _ = jets(functions, vectors, jnp.asarray(t))
    angle = frequency * t + numbers.phase[ROWS]
    assert len(np.unique(angle)) == angle.size, (
        "each attacked vehicle and lane has a phase of its own"
    )
    expected = magnitude * np.stack([np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose(
        found[0][:, ROWS], expected, rtol=0, atol=1e-13 * max(1.0, magnitude)
    )


@pytest.mark.parametrize(("frequency", "order"), [(0.7, 0), (-0.7, 0), (3.0, 3), (-3.0, 3)])
def test_a_sinusoid_reaches_its_bound_at_its_crest(frequency, order):
    """`sin` crests a quarter period after its zero; its third derivative, a cosine, at the zero."""
    crest = np.pi / 2 / abs(frequency) if order == 0 else 0.0
    found = jets_at(Sinusoid(magnitude=10.0, frequency=frequency, phase=0.0), crest)
    np.testing.assert_allclose(np.linalg.norm(found[order][:, ROWS], axis=0), 10.0, rtol=1e-12)


@given(magnitudes, st.floats(-1.0, 1.0), seeds, times)
def test_a_slow_sinusoid_is_one_along_its_direction(magnitude, frequency, seed, t):
    numbers, functions, vectors = drawn(KINDS["sinusoid"](magnitude, frequency), seed)
    found, _ = jets(functions, vectors, jnp.asarray(t))
    along, swing = numbers.direction[ROWS], np.sin(frequency * t + numbers.phase[ROWS])
    expected = magnitude * swing * np.stack([np.cos(along), np.sin(along)])
    np.testing.assert_allclose(
        found[0][:, ROWS], expected, rtol=0, atol=1e-13 * max(1.0, magnitude)
    )


def test_a_bias_is_constant_and_as_long_as_allowed():
    numbers, functions, vectors = drawn(KINDS["bias"](10.0, 0.0))
    found, _ = jets(functions, vectors, jnp.asarray(7.0))
    along = numbers.direction[ROWS]
    np.testing.assert_allclose(
        found[0][:, ROWS], 10.0 * np.stack([np.cos(along), np.sin(along)]), rtol=1e-14
    )
    assert not np.asarray(found[1:]).any()


def test_nobody_is_attacked_without_an_attack():
    found = jets_at(NoAttack(), 3.0)
    assert found.shape == (4, 2, FLEET, LANES)
    assert not found.any()
