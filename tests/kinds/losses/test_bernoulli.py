"""Lost messages: counts against the binomial distribution, and lanes with a known motion."""

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import expm

from jaxnet.config.document import ConfigError
from tests import systems

QUIET = {"attack": "none", "defence": "none", "engine": "exact"}


def loss(probability):
    """The key `channel`."""
    return {"loss": {"kind": "bernoulli", "probability": probability}}


def test_a_vehicle_with_one_source_keeps_its_drive_as_often_as_messages_are_lost():
    """On the star; inside the 99.9 % interval of a binomial number."""
    study = systems.study(topology="star", channel=loss(0.3), horizon=10.0, tail=1.0, **QUIET)
    outcome = systems.simulate(systems.lanes(study, 50, ()))
    number = 50 * 12 * 201
    low, high = stats.binom.ppf([0.0005, 0.9995], number, 0.3)
    assert low <= outcome.unheard.sum() <= high


def test_who_never_hears_anything_goes_on_as_it_began():
    """Its drive stays P(y) of the start with jerk 0: y‴ + P(y - y*) = 0, `k0 y* = P(y)`."""
    keys = QUIET | {"engine": "exact", "channel": loss(1.0), "horizon": 10.0, "tail": 1.0}
    lanes = systems.lanes(systems.study(**keys), 2)
    outcome = systems.simulate(lanes)
    assert outcome.status.tolist() == [0, 0]
    assert outcome.unheard.tolist() == [12 * 201] * 2
    x, y, heading, speed = np.moveaxis(lanes.inputs.lane.initial[:, :4], 1, 0)
    velocity = np.stack([speed * np.cos(heading), speed * np.sin(heading)], axis=-1)
    flow = expm(10.0 * np.array([[0, 1, 0], [0, 0, 1], [-1, -3, -3]]))
    start = np.stack([x, y], axis=-1)
    end = start + 3 * velocity + flow[0, 0] * -3 * velocity + flow[0, 1] * velocity
    assert np.abs(outcome.series["state"][:, -1, :, :2] - end).max() <= 1e-9


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"tick": 0}, "channel.loss: messages are lost at ticks: give a tick"),
        ({"defence": {"kind": "trusted_trim", "score": "announced"}}, "needs every message"),
    ],
)
def test_a_loss_that_cannot_be_simulated_is_refused(keys, message):
    """With the key that the user may change."""
    with pytest.raises(ConfigError, match=message):
        systems.study(channel=loss(0.1), **keys)
