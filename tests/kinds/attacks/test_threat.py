"""Links that replace what is sent: exact answers, bounds that hold and are attained."""

import numpy as np
import pytest

from tests import systems
from tests.engine.test_exactness import navigator_at

CONSTANT = {"kind": "bias", "magnitude": 2.0, "threat": "replaces"}
ATTACKED = {2, 5, 8, 11}


@pytest.fixture(scope="module")
def settled():
    """Rings and paths under a constant attack in phase, after a minute."""
    sweep = {"topology": ["cyclic", "path"]}
    keys = {"defence": "none", "horizon": 60.0, "tail": 5.0, "output_step": 0.2}
    study = systems.study(engine="exact", attack=CONSTANT, sweep=sweep, **keys)
    one = systems.lanes(study, 2)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    return study, one, outcome


def errors_at_the_end(one, outcome, lane):
    """Each vehicle's error [m]."""
    navigator = navigator_at(one, lane)(60.0)[0]
    return outcome.series["state"][lane, -1, :, :2] - navigator


def test_a_constant_in_phase_ends_where_threats_say(settled):
    """9/11 ā at honest vehicles of the ring, 1 ā at those of the path behind an attacked one."""
    _, one, outcome = settled
    ring = [0.9 * 9 / 11 if i in ATTACKED else 9 / 11 for i in range(1, 13)]
    path = [float(i >= 3) for i in range(1, 13)]
    for lane, known in ((0, ring), (1, ring), (2, path), (3, path)):
        expected = 2.0 * np.stack([known, np.zeros(12)], axis=1)
        np.testing.assert_allclose(
            errors_at_the_end(one, outcome, lane), expected, rtol=0, atol=1e-5
        )
