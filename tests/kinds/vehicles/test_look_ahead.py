"""The point ahead of a unicycle: flat in every state, and its heading follows where the point goes."""

import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import jaxnet
from jaxnet.kinds.vehicles.look_ahead import LookAhead
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.uniforms import Keyed
from tests.kinds.vehicles.flatness import assert_flat

DRAWN = LookAhead(ahead={"uniform": [0.05, 0.5]}).drawn(Draw(Keyed(0), range(2), 6), "vehicle")


@given(st.integers(0, 2**32 - 1))
def test_it_is_an_integrator_for_each_axis(seed):
    """Never singular: det ψ = l in every state."""
    rng = np.random.default_rng(seed)
    state = jnp.asarray(rng.uniform(-10, 10, (3, 6, 2)))
    inputs = jnp.asarray(rng.uniform(-10, 10, (2, 6, 2)))
    assert_flat(DRAWN, state, inputs)
    determinant = np.linalg.det(np.moveaxis(np.asarray(DRAWN.decoupling(state)), (0, 1), (-2, -1)))
    np.testing.assert_allclose(determinant, np.broadcast_to(DRAWN.ahead, (6, 2)), rtol=1e-9)
    np.testing.assert_array_equal(DRAWN.pace(state, inputs), [abs(inputs[0]), inputs[1]])


KEYS = {"vehicles": 1, "topology": "star", "attack": "none", "defence": "none", "horizon": 4.0, "tail": 1.0}
KEYS |= {"vehicle": {"kind": "look_ahead", "ahead": 0.7}, "gain": [1.5], "save": {"trajectories": "all"}}


def test_the_heading_follows_a_plain_integration():
    """`q = ẏ_0 - k0 (y - y_0)`, `ṗ = (h·q) h` and `θ̇ = n·q / l` by a Runge–Kutta method in the test."""
    results = jaxnet.simulate({**KEYS, "engine": "nonlinear", "samples": 2}, progress=False)
    path = results.study.config.navigator.jets
    data = results.trajectories["states"].sel(cell=0).values[..., 0, :]

    def rates(time, state):
        heading = np.array([np.cos(state[2]), np.sin(state[2])])
        left, navigator = np.array([-heading[1], heading[0]]), np.asarray(path(np.asarray(time)))
        asked = navigator[1] - 1.5 * (state[:2] + 0.7 * heading - navigator[0])
        return [*(heading @ asked) * heading, left @ asked / 0.7]

    times = results.trajectories["time"].values
    for states in data:
        known = solve_ivp(rates, (0, 4), states[0], t_eval=times, rtol=1e-10, atol=1e-10, method="DOP853")
        apart = states - known.y.T
        np.testing.assert_allclose(apart[:, :2], 0.0, atol=1e-5)
        np.testing.assert_allclose(np.sin(apart[:, 2] / 2), 0.0, atol=1e-5)  # headings are told in (-π, π]
