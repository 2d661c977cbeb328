"""Control inputs in rows and trajectories drive the vehicles, and engines agree on them."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import jaxnet
from tests import systems

KEYS = {"horizon": 2.0, "tail": 1.0, "output_step": 0.05, "tick": 0.05}
TURNING = {"kind": "rotating", "magnitude": 3, "frequency": 0.7}
BUSY = {
    "sensing": {"position": 0.05, "velocity": 0.05, "acceleration": 0.05},
    "channel": {"loss": {"kind": "bernoulli", "probability": 0.5}},
}
HELD = {"law": {"kind": "rounds", "rounds": 3}}


def car(state, inputs):
    """Equations of a car with a wheelbase of 0.5 m: state `[x, y, θ, v, δ, a]`, input `[ȧ, δ̇]`"""
    _, _, heading, speed, steering, acceleration = state
    turn_rate = speed * np.tan(steering) / 0.5
    return [
        speed * np.cos(heading),
        speed * np.sin(heading),
        turn_rate,
        acceleration,
        inputs[1],
        inputs[0],
    ]


def test_inputs_drive_the_vehicles_along_the_stored_states():
    """Inputs without jumps, interpolated and put into the vehicle's equations.

    The first 0.2 s are left out: vehicles that start slowly turn faster than output times can show.
    """
    keys = {"engine": "exact", "attack": TURNING, "defence": "none", "vehicle": "car"}
    keys |= {"horizon": 1.0, "tail": 0.5, "output_step": 0.002, "tick": 0.002}
    results = jaxnet.simulate({**keys, "save": {"trajectories": "all"}}, 1, progress=False)
    lane = results.trajectories.isel(cell=0, sample=0, time=slice(100, None))
    time = lane["time"].values
    for number in lane["vehicle"].values[:3]:
        one = lane.sel(vehicle=number)
        states, given = one["states"].values, CubicSpline(time, one["inputs"].values)
        states[:, 2] = np.unwrap(states[:, 2])
        found = solve_ivp(
            lambda now, state, given=given: car(state, given(now)),
            time[[0, -1]],
            states[0],
            t_eval=time,
            rtol=1e-9,
            atol=1e-9,
        )
        size = np.abs(states).max(axis=0)
        np.testing.assert_allclose(found.y.T / size, states / size, atol=2e-3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("keys", "engines"),
    [
        (BUSY | {"vehicle": "car"}, ["nonlinear", "stacked"]),
        (HELD, [{"kind": "nonlinear", "solver": "dopri8"}]),
    ],
    ids=["busy", "held"],
)
def test_engines_agree_on_the_inputs(keys, engines):
    """After each decision: inputs jump where a vehicle drops, senses anew or loses a message."""
    known, *others = (
        systems.outcome(2, ("inputs",), engine=engine, attack=TURNING, **KEYS, **keys).series[
            "inputs"
        ]
        for engine in ("exact", *engines)
    )
    assert np.isfinite(known).all()
    for inputs in others:
        np.testing.assert_allclose(inputs, known, rtol=1e-5, atol=1e-5 * np.abs(known).max())
