"""What stands in for a lost message counts as the message. Motions: test_reference.py."""

import numpy as np
import pytest

from tests import systems
from tests.reference import Hashed, navigator_at


@pytest.mark.parametrize("delay", [0.0, pytest.param(0.2, marks=pytest.mark.long)])
def test_a_substituted_message_counts_with_the_weight_of_its_source(delay):
    loss = Hashed(of="link", factors=[5, 3, 2, 1], share=12)
    channel = {"loss": loss, "missing": "hold", "delay": delay}
    keys = {"engine": "exact", "channel": channel, "defence": "none", "tick": 0.1}
    one = systems.lanes(systems.study(**keys, horizon=3.0, tail=1.0, output_step=0.1), 1)
    outcome, lane = systems.simulate(one), systems.lane(one, 0)
    navigator, state = navigator_at(one, 0), outcome.series["state"][0]
    error = np.stack([now[:, :2] - navigator(0.1 * n)[0] for n, now in enumerate(state)])
    sources = np.append(np.zeros_like(error[:, :1]), error, axis=1)
    apart = np.linalg.norm(error - np.asarray(lane.weights) @ sources, axis=-1).mean(axis=1)
    heard = slice(15, None)  # every source by then
    np.testing.assert_allclose(outcome.series["disagreement"][0, heard], apart[heard], rtol=1e-6)
