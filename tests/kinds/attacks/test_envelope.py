"""The envelope: smooth at its ends, the attack inside once risen, within ā, and exact."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxnet
from jaxnet.kinds.attacks import signal_scale
from jaxnet.kinds.attacks.bias import Bias
from jaxnet.kinds.attacks.chirp import Chirp
from jaxnet.kinds.attacks.envelope import Envelope
from jaxnet.kinds.attacks.rotating import Rotating
from jaxnet.kinds.attacks.sinusoid import Sinusoid
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import signal
from tests import systems
from tests.kinds.attacks import by_hand

HORIZON = 20.0
INNER = {
    "bias": Bias(direction=0.3),
    "rotating": Rotating(frequency=0.7),
    "sinusoid": Sinusoid(direction=1.0, frequency=0.9),
    "chirp": Chirp(frequency=0.2, rate=0.03),
}


def drawn(attack):
    """An attack of 12 vehicles in one lane."""
    return attack.drawn(Draw(Keyed(3), [0], 12), "attack")


def jets_of(attack, times, horizon=HORIZON):
    """The signals as the engines make them, times for lanes: (4, 2, m, times)."""
    return np.stack(
        signal.jets(
            attack.vectors() * signal_scale(attack, attack.sizes(horizon), 3), attack.basis(times)
        )
    )


@pytest.mark.parametrize("kind", INNER)
@given(st.floats(0, 5), st.floats(0.2, 8), st.floats(0, 4), st.floats(0.1, 100))
def test_jets_are_the_derivatives_and_within_the_magnitude(kind, start, rise, plateau, magnitude):
    """Against derivatives of the product itself; no norm is over ā, and none of the four is far below."""
    stop = start + rise + plateau
    attack = drawn(Envelope(of=INNER[kind], start=start, rise=rise, stop=stop, magnitude=magnitude))
    rising, falling = (begin + rise * np.linspace(1e-6, 1 - 1e-6, 150) for begin in (start, stop))
    times = np.concatenate([rising, np.linspace(start + rise, stop, 50)[1:-1], falling])
    horizon = stop + rise
    ours = jets_of(attack, times, horizon)
    known = signal_scale(attack, attack.sizes(horizon), 3) * by_hand.unit_jets(attack, 0, 5, times)
    scale = np.abs(known).max(axis=(1, 2), keepdims=True) + 1e-12
    np.testing.assert_allclose(
        ours[:, :, 4].swapaxes(1, 2) / scale, known / scale, rtol=0, atol=1e-9
    )
    norms = np.linalg.norm(ours, axis=1)
    assert norms.max() <= magnitude * (1 + 1e-12)
    assert norms.max() >= magnitude * 0.3


@pytest.mark.parametrize("kind", INNER)
def test_it_is_smooth_at_both_ends_of_rise_and_fall(kind):
    """No jet jumps there, and all are 0 before the start and after the fall."""
    attack = drawn(Envelope(of=INNER[kind], start=2.0, rise=3.0, stop=9.0))
    step = 1e-7
    for instant in (2.0, 5.0, 9.0, 12.0):
        before, after = np.moveaxis(
            jets_of(attack, np.array([instant - step, instant + step])), -1, 0
        )
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-4)
    silent = jets_of(attack, np.array([0.0, 1.0, 2.0, 12.0, 15.0]))
    np.testing.assert_allclose(silent, 0.0, rtol=0, atol=1e-13)


@pytest.mark.parametrize("kind", INNER)
def test_once_risen_it_is_the_attack_inside(kind):
    """With all of the magnitude where the rise is slow."""
    envelope = drawn(Envelope(of=INNER[kind], start=1.0, rise=15.0, magnitude=4.0))
    inside = drawn(Envelope(of=INNER[kind])).of
    times = np.linspace(16.0, HORIZON, 40)
    known = signal.jets(4.0 * inside.vectors(), inside.signal().basis(times))
    np.testing.assert_allclose(jets_of(envelope, times), np.stack(known), rtol=0, atol=1e-12)


ATTACK = {
    "kind": "envelope",
    "start": {"uniform": [1, 3]},
    "rise": {"uniform": [2, 4]},
    "stop": 9.0,
    "magnitude": {"uniform": [2, 6]},
}


def test_lanes_are_exact():
    """`E = free + L⁻¹ W_a a`, with start and rise of each lane."""
    keys = {"defence": "none", "horizon": 15.0, "tail": 2.0}
    given_study = systems.study(engine="exact", attack=ATTACK | {"of": "chirp"}, **keys)
    one = systems.lanes(given_study, 3)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    assert len(np.unique(one.inputs.lane.signal.start)) == 3
    for lane in range(3):
        scale = systems.lane(one, lane).attack_scale
        known = by_hand.positions(given_study, one, lane, scale, 150, 0.1)
        assert np.abs(outcome.series["state"][lane, :, :, :2] - known).max() <= 1e-9


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ({"stop": 2.9, "start": 1.0, "rise": 2.0}, "must not be before start + rise"),
        (
            {"stop": 5.0, "start": {"uniform": [0, 2]}, "rise": {"uniform": [1, 4]}},
            "before start + rise",
        ),
        ({"of": {"kind": "rotating", "magnitude": 3}}, "belongs outside: give attack.magnitude"),
        ({"of": {"kind": "bias", "vehicles": [1]}}, "belongs outside: give attack.vehicles"),
        ({"of": {"kind": "rotating", "threat": "replaces"}}, "belongs outside: give attack.threat"),
        ({"rise": 0.0}, "greater than 0"),
    ],
)
def test_what_cannot_be_is_said(keys, word):
    """A fall before the top, and what the envelope says itself."""
    with pytest.raises(jaxnet.ConfigError, match=word.replace("+", r"\+")):
        jaxnet.load({"attack": {"kind": "envelope", "of": "rotating", **keys}})


def test_a_stop_just_at_the_top_is_one():
    """Whatever rounding makes of the sum."""
    jaxnet.load(
        {"attack": {"kind": "envelope", "of": "bias", "start": 0.1, "rise": 0.2, "stop": 0.3}}
    )
