"""Every vehicle is flat: its output is r integrators for each axis (theorems.md O4); its motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxnet.kinds import registry
from jaxnet.kinds.vehicles import HEADING, SPEED
from jaxnet.kinds.vehicles.planar_quadrotor import GRAVITY, PITCH, THRUST
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import plane

# The greatest absolute value of each random state
GREATEST = {
    "single_integrator": [10] * 2,
    "double_integrator": [10] * 4,
    "unicycle": [10] * 4,
    "two_wheeled": [200, 200, 10, 50, 10, 10],
    "car": [50, 50, 3, 5, 1.3, 2],
    "look_ahead": [10] * 3,
    "planar_quadrotor": [3] * 8,
}
OWN_NUMBERS = {
    "car": {"wheelbase": {"uniform": [0.2, 3.0]}},
    "look_ahead": {"ahead": {"uniform": [0.05, 0.5]}},
}
QUADROTOR = [1.0, 2.0, 3.0, 4.0, np.pi / 6, 5.0, 2.0, 6.0]  # pitched to the left, with thrust 2


def vehicle_of(name):
    vehicle = registry.find("vehicle", name)(**OWN_NUMBERS.get(name, {}))
    return vehicle.drawn(Draw(Keyed(0), range(3), 5), "vehicle")


def fleet(name, seed, ahead=False):
    """States (n, 5, 3) away from the singular set, ahead and astern, and inputs."""
    rng, lead = np.random.default_rng(seed), THRUST if name == "planar_quadrotor" else SPEED
    state = (
        rng.uniform(-1, 1, (len(GREATEST[name]), 5, 3)) * np.array(GREATEST[name])[:, None, None]
    )
    if vehicle_of(name).singular:
        state[lead] += 0.1 * np.sign(state[lead])
        state[lead] = abs(state[lead]) if ahead else state[lead]
    return jnp.asarray(state), jnp.asarray(rng.uniform(-10, 10, (2, 5, 3)))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", GREATEST)
def test_each_jet_s_rate_is_the_next_jet(name, seed):
    """Along `motion`, the last `σ + ψ u`; `inputs_for` inverts it; `margin` is det ψ and lead."""
    vehicle, (state, inputs) = vehicle_of(name), fleet(name, seed)
    jets, rates = jax.jvp(vehicle.output_jets, (state,), (vehicle.motion(state, inputs),))
    assert (len(vehicle.states), len(vehicle.units), len(jets)) == (
        *[len(state)] * 2,
        vehicle.order,
    )
    psi = vehicle.decoupling(state)
    highest = vehicle.drift(state) + jnp.einsum("xu...,u...->x...", psi, inputs)
    np.testing.assert_allclose(np.stack(rates), [*jets[1:], highest], rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(vehicle.inputs_for(state, highest), inputs, rtol=1e-11, atol=1e-11)
    determinant = abs(np.linalg.det(np.moveaxis(np.asarray(psi), (0, 1), (-2, -1))))
    if vehicle.singular:
        margin = abs(np.asarray(vehicle.margin(state)))
        lead = vehicle.lead(jets[vehicle.singular])
        np.testing.assert_allclose(np.linalg.norm(lead, axis=0), margin, rtol=1e-12)
    known = {"look_ahead": lambda: vehicle.ahead, "car": lambda: vehicle.sideways(state)}
    known = known.get(name, lambda: margin if vehicle.singular else 1.0)()
    np.testing.assert_allclose(determinant, np.broadcast_to(known, (5, 3)), rtol=1e-12)


@pytest.mark.parametrize("name", [name for name in GREATEST if name != "look_ahead"])
def test_jets_determine_the_state_of_a_vehicle_that_goes_ahead(name):
    vehicle, (state, _) = vehicle_of(name), fleet(name, 7, ahead=True)
    off = np.array(vehicle.state_of(vehicle.output_jets(state)) - state)
    turning = {"planar_quadrotor": PITCH}.get(name, HEADING)
    if "integrator" not in name:
        off[turning] -= 2 * np.pi * np.round(off[turning] / (2 * np.pi))
    np.testing.assert_allclose(off, 0.0, atol=1e-11)


@pytest.mark.parametrize("name", GREATEST)
def test_the_pace_is_that_of_the_path(name):
    """Speed and turn rate, of vehicles of order 3 found from velocity and acceleration alone."""
    vehicle, (state, inputs) = vehicle_of(name), fleet(name, 3, ahead=True)
    jets = vehicle.output_jets(state)
    still = 0.0 * state[0]
    known = {
        "unicycle": lambda: (state[SPEED], inputs[1]),
        "look_ahead": lambda: (abs(inputs[0]), inputs[1]),
        "single_integrator": lambda: (plane.length(inputs), still),
        "double_integrator": lambda: (plane.length(jets[1]), still),
        "planar_quadrotor": lambda: (plane.length(jets[1]), state[PITCH + 1]),
    }.get(name, lambda: plane.pace(jets))
    np.testing.assert_allclose(vehicle.pace(state, inputs), known(), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(
    ("name", "state", "inputs", "rates"),
    [
        ("unicycle", [7, 8, np.pi / 6, 2], [5, 3], [np.sqrt(3), 1, 3, 5]),
        ("two_wheeled", [1, 2, np.pi / 2, 3, 5, 7], [11, 13], [0, 3, 5, 7, 13, 11]),
        ("car", [1, 2, np.pi / 2, 3, np.pi / 4, 7], [11, 13], [0, 3, 3 / 0.5, 7, 13, 11]),
        ("planar_quadrotor", QUADROTOR, [7, 8], [3, 4, -1, np.sqrt(3) - GRAVITY, 5, 8, 6, 7]),
    ],
)
def test_it_moves_as_its_equation_says(name, state, inputs, rates):
    """The unicycle; the robot with u = [Ḟ, ω̇]; the bicycle; `ẍ = -T sin φ`, `ÿ = T cos φ - g`."""
    one = registry.find("vehicle", name)()
    one = one.drawn(Draw(Keyed(0), range(1), 1), "vehicle")
    column = [jnp.array(each, float)[:, None, None] for each in (state, inputs)]
    np.testing.assert_allclose(one.motion(*column)[:, 0, 0], rates, rtol=1e-14, atol=1e-14)


def test_it_starts_with_its_pose_and_speed_or_hovers():
    """All other states are 0; all jets of a quadrotor are 0 but its position."""
    position, heading = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([0.5, 0.6])
    speed = np.array([7.0, 8.0])
    found = vehicle_of("two_wheeled").start(position, heading, speed)
    np.testing.assert_array_equal(found, [*position, heading, speed, [0, 0], [0, 0]])
    quadrotor = vehicle_of("planar_quadrotor")
    state = quadrotor.start(position, heading, speed)
    jets = np.stack(quadrotor.output_jets(state))
    np.testing.assert_array_equal(jets, [position, *[np.zeros((2, 2))] * 3])
    np.testing.assert_array_equal(quadrotor.motion(state, np.zeros((2, 2))), 0.0)
