"""What stands in for a lost message, against closed forms."""

import math

import numpy as np
import pytest

from jaxnet.engine.status import Status
from tests import systems
from tests.reference import Hashed, Powers, navigator_at


def errors(loss, missing, speed, horizon, lanes=1, **keys):
    """Errors along the path (lanes, outputs, m), from rest on a star with a straight navigator."""
    keys = {"navigator": Powers(x=[0.0, speed], y=[0.0]), **keys}
    keys |= {"initial": {"position": 0.0, "heading": 0.0, "speed": speed}, "topology": "star"}
    keys |= {"attack": "none", "defence": "none", "tail": 0.0, "horizon": horizon, "tick": 0.1}
    keys |= {"output_step": 0.1, "engine": "exact"}
    one = systems.lanes(systems.study(channel={"loss": loss, "missing": missing}, **keys), lanes)
    outcome = systems.simulate(one)
    assert (outcome.status == Status.ok).all()
    assert not outcome.unheard.any()
    time = np.arange(outcome.series["state"].shape[1]) * 0.1
    return outcome.series["state"][..., 0] - speed * time[:, None]


CHAIN = {"kind": "gilbert_elliott", "fail": 0.05, "recover": 0.25}


@pytest.mark.long
@pytest.mark.parametrize(
    ("loss", "age"), [({"kind": "bernoulli", "probability": 0.5}, 0.75), (CHAIN, 7 / 12)]
)
def test_the_mean_error_on_a_ramp_is_the_age_of_the_messages(loss, age):
    """At 10 m/s and a mean age in ticks of 0.1 s; inside the 99 % interval over vehicles."""
    means = errors(loss, "hold", 10.0, 40.0, lanes=16)[:, 120:].mean(axis=1).ravel()
    deviation = means.std() / np.sqrt(means.size)
    assert abs(means.mean() + 10.0 * 0.1 * age) <= 2.6 * deviation < 0.08


@pytest.mark.long
def test_a_jammed_vehicle_falls_behind_as_the_closed_form_says():
    """`E = -v (D - 3 + e^(-D)(3 + 2D + D²/2))` for D = 1, 2, 5 s from rest."""
    loss = {"kind": "jamming", "intervals": [[1.0, 6.5]]}
    error = errors(loss, "hold", 1.0, 6.0)
    for after, known in [(1, -0.0233369), (2, -0.218018), (5, -2.171818)]:
        expected = -(after - 3 + math.exp(-after) * (3 + 2 * after + after**2 / 2))
        assert abs(expected - known) < 1e-6
        assert np.abs(error[:, 10 * (1 + after)] - expected).max() <= 1e-9


def test_a_cubic_is_extrapolated_without_error():
    """A navigator tells its jerk too; to rounding."""
    path = Powers(x=[3.0, 2.0, 0.5, 0.1], y=[1.0, 0.0, -0.2, 0.05])
    keys = {"topology": "star", "attack": "none", "defence": "none", "tick": 0.1, "vehicles": 3}
    keys |= {"initial": {"position": [[3.0, 1.0]] * 3, "heading": 0.0, "speed": 2.0}}
    keys |= {"navigator": path, "tail": 0.0, "horizon": 6.0, "output_step": 0.1, "engine": "exact"}
    loss = {"kind": "jamming", "intervals": [[2.0, 9.0]]}
    ends = []
    for probability in ({"loss": "none"}, {"loss": loss, "missing": "extrapolate"}):
        outcome = systems.simulate(systems.lanes(systems.study(channel=probability, **keys), 1))
        assert outcome.status.tolist() == [0]
        ends.append(outcome.series["state"][..., :2])
    assert np.abs(np.subtract(*ends)).max() <= 1e-11


@pytest.mark.parametrize("delay", [0.0, 0.2])
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
