"""The amplitude in force is what lanes show: the greatest shift of a position that is received."""

import numpy as np
import pytest

from jaxnet.statistics.amplitude import amplitude_in_force, amplitude_note
from tests import systems

KINDS = {
    "slow": {"kind": "rotating", "frequency": 0.5, "magnitude": 8.0},
    "fast": {"kind": "rotating", "frequency": 2.0, "magnitude": 8.0},
    "sinusoid": {"kind": "sinusoid", "frequency": 3.0, "magnitude": 8.0},
    "one order": {"kind": "rotating", "frequency": 2.0, "magnitude": 8.0, "orders": [0]},
    "constant": {"kind": "bias", "magnitude": 8.0},
}


@pytest.mark.parametrize("name", KINDS)
def test_lanes_show_the_amplitude(name):
    """Over 20 s at 0.1 s: the greatest signal of any vehicle is within 1 % of it, and never over it."""
    keys = {"engine": "exact", "horizon": 20.0, "tail": 1.0, "defence": "none", "vehicles": 4}
    study = systems.study(attack=KINDS[name] | {"vehicles": [2]}, **keys)
    shown = systems.simulate(systems.lanes(study, 4)).series["attack"]
    greatest = np.linalg.norm(shown, axis=-1).max()
    amplitude = amplitude_in_force(study.cells[0].scenario)
    assert 0.99 * amplitude <= greatest <= amplitude * (1 + 1e-12)


def test_it_is_known_by_formula_and_said():
    """ā / ω³ above 1 rad/s; unknown where lanes differ; a note gives the least share of ā."""
    sweep = {"attack.frequency": [0.5, 1.0, 2.0, 4.0]}
    study = systems.study(attack={"kind": "rotating", "magnitude": 8.0}, sweep=sweep)
    found = [amplitude_in_force(cell.scenario) for cell in study.cells]
    assert found == pytest.approx([8.0, 8.0, 1.0, 0.125], rel=1e-15)
    assert "a position is shifted by less, 0.016 ā at least" in amplitude_note(study.cells)
    assert amplitude_note(study.cells[:2]) == ""
    drawn = systems.study(attack={"kind": "rotating", "frequency": {"uniform": [1.0, 2.0]}})
    assert np.isnan(amplitude_in_force(drawn.cells[0].scenario))
