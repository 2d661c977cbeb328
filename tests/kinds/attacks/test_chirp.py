"""The chirp: its derivatives, that it keeps ā and uses it up, and O2 in both engines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.kinds.attacks import signal_scale
from jaxnet.kinds.attacks.chirp import Chirp
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import signal
from tests import systems
from tests.kinds.attacks import by_hand

DRAWN = {
    "kind": "chirp",
    "magnitude": {"uniform": [2, 6]},
    "frequency": {"uniform": [-1, 1]},
    "rate": {"uniform": [-0.2, 0.2]},
}


def chirp(**numbers):
    """A chirp of 12 vehicles in one lane."""
    return Chirp(**numbers).drawn(Draw(Keyed(3), [0], 12), "attack")


def jets_of(attack, horizon, times):
    """The signals as the engines make them, times for lanes: (4, 2, m, times)."""
    return np.stack(
        signal.jets(
            attack.vectors() * signal_scale(attack, attack.sizes(horizon), 3), attack.basis(times)
        )
    )


@given(st.floats(-3, 3), st.floats(-0.5, 0.5), st.floats(1, 40), st.floats(0.1, 100))
def test_derivatives_are_right_and_within_the_magnitude_which_is_reached(
    frequency, rate, horizon, magnitude
):
    """Against derivatives of the plain formula, on a fine grid with both ends."""
    attack, times = (
        chirp(frequency=frequency, rate=rate, magnitude=magnitude),
        np.linspace(0, horizon, 201),
    )
    ours = jets_of(attack, horizon, times)
    plain = by_hand.unit_jets(attack, 0, 5, times)
    greatest = np.linalg.norm(plain, axis=-1).max()
    known = magnitude / greatest * plain
    np.testing.assert_allclose(ours[:, :, 4].swapaxes(1, 2), known, rtol=0, atol=1e-9 * magnitude)
    norms = np.linalg.norm(ours, axis=1)
    assert norms.max() <= magnitude * (1 + 1e-12)
    assert norms.max(axis=(0, 2)) == pytest.approx(np.full(12, magnitude), rel=1e-6)


@pytest.fixture(scope="module")
def simulated():
    """Lanes of the exact engine, untrimmed."""
    study = systems.study(
        engine="exact", attack=DRAWN, defence="none", topology="cyclic", horizon=15.0, tail=2.0
    )
    one = systems.lanes(study, 3)
    return study, one, systems.simulate(one)


def test_lanes_are_exact(simulated):
    """`E = free + L⁻¹ W_a a` with frequency, rate and phases of each lane."""
    study, one, outcome = simulated
    assert (outcome.status == 0).all()
    attack = by_hand.attack_of(study, 3)
    assert len(np.unique(attack.rate)) == 3
    for lane in range(3):
        greatest = by_hand.sizes(attack, lane, np.linspace(0, 15.0, 1501)).max()
        known = by_hand.positions(study, one, lane, attack.magnitude[lane] / greatest, 150, 0.1)
        assert np.abs(outcome.series["state"][lane, :, :, :2] - known).max() <= 1e-9


def test_numbers_compile_nothing_anew(simulated, compiled):
    """Magnitude, frequency, rate and phase, drawn or not."""
    for attack in ({"kind": "chirp", "rate": -0.3}, DRAWN | {"frequency": 2.0, "phase": 0.0}):
        keys = {
            "attack": attack,
            "defence": "none",
            "horizon": 30.0,
            "tail": 1.0,
            "output_step": 0.2,
        }
        assert (
            systems.simulate(systems.lanes(systems.study(engine="exact", **keys), 2)).status == 0
        ).all()
    assert not compiled


def test_a_chirp_that_slows_down_is_scaled_by_its_beginning():
    """From 2 rad/s to rest: the third derivative at t = 0 limits it."""
    attack = chirp(frequency=2.0, rate=-0.2, magnitude=1.0)
    jets = jets_of(attack, 10.0, np.array([0.0, 10.0]))
    assert np.linalg.norm(jets[3, :, 0, 0]) == pytest.approx(1.0)
    assert np.linalg.norm(jets[0, :, 0, 1]) == pytest.approx(1 / (2 * np.hypot(0.6, 4.0)))
