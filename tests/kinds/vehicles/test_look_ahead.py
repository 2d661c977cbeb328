"""The point ahead of a unicycle: flat in every state; its heading follows where the point goes."""

import math

import numpy as np
import pytest

import jaxnet
from tests import systems
from tests.reference import Powers

KEYS = {"vehicles": 1, "topology": "star", "attack": "none", "defence": "none"}
KEYS |= {"horizon": 4.0, "tail": 1.0}
KEYS |= {"vehicle": {"kind": "look_ahead", "ahead": 0.7}, "gain": [1.5]}


def test_a_constant_velocity_turns_the_heading_as_the_closed_form():
    """`tan(θ/2) = tan(θ(0)/2) exp(-v t / l)` for a point that moves along x with v; θ = π stays.

    The point starts on the navigator: E = 0. l is short: a tick turns headings by up to exp(-250).
    """
    headings, speed, ahead = [0.4, -1.6, 3.1, -math.pi], 5.0, 0.02
    keys = {"horizon": 1.0, "tail": 0.5, "output_step": 0.05}
    keys |= {"navigator": Powers(x=[0.0, speed], y=[0.0])}
    keys |= {"vehicle": {"kind": "look_ahead", "ahead": ahead}}
    places = [[[-ahead * math.cos(each), -ahead * math.sin(each)]] for each in headings]
    keys |= {"sweep": {"initial.heading": headings, "initial.position": places}}
    outcome = systems.outcome(1, **KEYS | {"engine": "exact"} | keys)
    assert (outcome.status == 0).all()
    states, times = outcome.series["state"][::5, :, 0].swapaxes(0, 1), np.arange(21) * 0.05
    turned = 2 * np.arctan(np.tan(np.array(headings) / 2) * np.exp(-speed * times[:, None] / ahead))
    off = np.sin((states[..., 2] - turned) / 2)
    np.testing.assert_allclose(off[:, :3], 0.0, atol=1e-9)
    along = np.stack([np.cos(states[..., 2]), np.sin(states[..., 2])], axis=-1)
    path = np.array([speed, 0.0]) * times[:, None, None]
    np.testing.assert_allclose(states[..., :2] + ahead * along - path, 0.0, atol=1e-9)


FLEET = KEYS | {"vehicles": 4, "topology": "complete", "horizon": 3.0, "tick": 0.1, "samples": 2}
FLEET["save"] = {"trajectories": "all"}
FLEET["attack"] = {"kind": "rotating", "vehicles": [2], "magnitude": 5.0, "frequency": 1.7}
LOCAL = {"law": {"kind": "local", "hold": False}, "defence": {"kind": "w_msr", "F": 1}}
LOSSY = {"channel": {"missing": "extrapolate", "loss": {"kind": "bernoulli", "probability": 0.3}}}
LOSSY |= {"sensing": {"kind": "gaussian", "position": 0.1}}
LOSSY |= {"attack": {"kind": "spoof", "vehicles": [2], "magnitude": [5.0, 2.0]}}
TIGHT = {"kind": "nonlinear", "solver": "dopri8", "rtol": 1e-11, "atol": 1e-11}
STACKED = {"kind": "stacked", "rtol": 1e-11, "atol": 1e-11}


@pytest.mark.long
@pytest.mark.parametrize(
    ("keys", "engine"),
    [(LOCAL, TIGHT), (LOSSY, TIGHT), ({}, STACKED)],
    ids=["local", "channel", "stacked"],
)
def test_engines_agree(keys, engine):
    """In every state, and in speeds and turn rates at output times.

    Velocities that rounds hold over a tick are those of the closed form above.
    """
    exact, nonlinear = (
        jaxnet.simulate(FLEET | keys | {"engine": each}, progress=False)
        for each in ("exact", engine)
    )
    assert (exact.lanes["status"] == "ok").all()
    apart = np.subtract(
        *(each.trajectories["states"].sel(cell=0).values for each in (exact, nonlinear))
    )
    np.testing.assert_allclose(apart[..., :2], 0.0, atol=1e-7)
    np.testing.assert_allclose(np.sin(apart[..., 2] / 2), 0.0, atol=1e-7)
    for name in ("tail_mean", "min_speed"):
        np.testing.assert_allclose(exact.lanes[name], nonlinear.lanes[name], atol=1e-6)
