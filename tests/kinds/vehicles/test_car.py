"""The car: two descriptions of one vehicle, its motion; a fleet of cars moves as one of robots."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.kinds.vehicles.car import STEERING, Car
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.uniforms import Keyed
from tests import systems
from tests.reference import exact

seeds = st.integers(0, 2**32 - 1)
drawn = Car(wheelbase={"uniform": [0.2, 3.0]}).drawn(Draw(Keyed(0), range(3), 5), "vehicle")


def states(seed):
    """Five cars in each of three lanes, forwards, steered by at most 1.3 rad: (6, 5, 3)."""
    rng = np.random.default_rng(seed)
    low, high = np.array([[-50, -50, -3, 0.1, -1.3, -2], [50, 50, 3, 5, 1.3, 2]])
    return jnp.asarray(np.moveaxis(rng.uniform(low, high, (5, 3, 6)), -1, 0))


@given(seeds)
def test_states_and_jets_are_two_descriptions(seed):
    """`state_of(output_jets(x)) = x`, and the turn rate is that of the path."""
    state = states(seed)
    jets = drawn.output_jets(state)
    np.testing.assert_allclose(drawn.state_of(jets), state, rtol=1e-9, atol=1e-9)
    _, velocity, acceleration = jets
    turning = (velocity[0] * acceleration[1] - velocity[1] * acceleration[0]) / (velocity**2).sum(
        axis=0
    )
    np.testing.assert_allclose(
        drawn.pace(state, jnp.zeros_like(state[:2])), [state[3], turning], rtol=1e-12, atol=1e-12
    )


@jax.jit
def differentiated(state, inputs):
    """d/dt of the jets along the motion."""
    return jax.jvp(drawn.output_jets, (state,), (drawn.motion(state, inputs),))[1]


@given(seeds)
def test_jets_follow_each_other_along_the_motion(seed):
    """d/dt y = ẏ, d/dt ẏ = ÿ, and d/dt ÿ = σ + ψ u, whatever u, as the kinematic bicycle."""
    state, inputs = states(seed), jnp.asarray(np.random.default_rng(seed).normal(size=(2, 5, 3)))
    _, velocity, acceleration = drawn.output_jets(state)
    jerk = drawn.drift(state) + jnp.einsum("xu...,u...->x...", drawn.decoupling(state), inputs)
    known = np.stack([velocity, acceleration, jerk])
    np.testing.assert_allclose(np.stack(differentiated(state, inputs)), known, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(drawn.inputs_for(state, jerk), inputs, rtol=1e-8, atol=1e-8)
    *_, heading, speed, steering, acceleration = np.asarray(state)
    bicycle = [
        speed * np.cos(heading),
        speed * np.sin(heading),
        speed * np.tan(steering) / drawn.wheelbase,
    ]
    rest = [acceleration, inputs[1], inputs[0]]
    np.testing.assert_allclose(drawn.motion(state, inputs), bicycle + rest, rtol=1e-12, atol=1e-12)


KEYS = {"defence": "none", "horizon": 10.0, "tail": 1.0, "attack": {"magnitude": 4.0}}
WHEELBASE = {"kind": "car", "wheelbase": {"uniform": [0.3, 2.0]}}


@pytest.fixture(scope="module")
def fleets():
    """Lanes of cars by either engine, with wheelbases of their own, and robots."""
    found = {}
    for engine, vehicle in (
        ("exact", WHEELBASE),
        ("nonlinear", WHEELBASE),
        ("exact", "two_wheeled"),
    ):
        given_study = systems.study(engine=engine, vehicle=vehicle, **KEYS)
        one = systems.lanes(given_study, 3)
        outcome = systems.simulate(one)
        assert (outcome.status == 0).all()
        found[engine, "robot" if vehicle == "two_wheeled" else "car"] = one, outcome
    return found


@pytest.mark.long
def test_the_closed_loop_is_the_exact_solution(fleets):
    """O2 with O1 in it, to 1e-5 m, for each lane's wheelbase."""
    one, outcome = fleets["nonlinear", "car"]
    assert len(np.unique(one.inputs.lane.vehicle.wheelbase)) == 3
    for lane in range(3):
        known = exact_from_robot(fleets, lane)
        assert np.abs(outcome.series["state"][lane, :, :, :2] - known).max() <= 1e-5


def exact_from_robot(fleets, lane):
    """The exact solution of a robot that starts with the car's pose and speed, and all else 0."""
    one, _ = fleets["exact", "robot"]
    car, _ = fleets["exact", "car"]
    np.testing.assert_array_equal(systems.lane(one, lane).initial, systems.lane(car, lane).initial)
    return exact(one, lane, 0.1, 100)["positions"]


@pytest.mark.long
def test_exact_and_nonlinear_rows_agree(fleets):
    """Speeds and turn rates, recovered from the outputs, and the steering angles at the end."""
    (_, ours), (_, theirs) = fleets["exact", "car"], fleets["nonlinear", "car"]
    for name in ("tail_mean", "tail_max", "tail_disagreement", "peak_error"):
        np.testing.assert_allclose(ours.metrics[name], theirs.metrics[name], atol=1e-5, rtol=0)
    np.testing.assert_allclose(ours.metrics["min_speed"], theirs.metrics["min_speed"], atol=1e-3)
    np.testing.assert_allclose(
        ours.metrics["peak_turn_rate"], theirs.metrics["peak_turn_rate"], rtol=1e-2
    )
    angles = (each.series["state"][:, -1, :, STEERING] for each in (ours, theirs))
    np.testing.assert_allclose(*angles, atol=1e-4)


def test_the_wheelbase_is_seen_in_the_steering_alone(fleets):
    """All else is the robot's; tan δ is wheelbase · turn rate / speed."""
    (one, cars), (_, robots) = fleets["exact", "car"], fleets["exact", "robot"]
    for name, metric in cars.metrics.items():
        np.testing.assert_allclose(metric, robots.metrics[name], rtol=1e-12)
    car, robot = (np.moveaxis(each.series["state"], -1, 0) for each in (cars, robots))
    np.testing.assert_allclose(car[:4], robot[:4], rtol=0, atol=1e-12)
    wheelbase = one.inputs.lane.vehicle.wheelbase[:, None, None]
    np.testing.assert_allclose(np.tan(car[STEERING]), wheelbase * robot[4] / robot[3], rtol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("engine", ["exact", "nonlinear"])
def test_numbers_compile_nothing_anew(fleets, engine, compiled):
    """A wheelbase that is drawn or not, a gain."""
    other = {"vehicle": {"kind": "car", "wheelbase": 1.0}, "gain": [2, 4, 4]}
    systems.simulate(systems.lanes(systems.study(engine=engine, **KEYS, **other), 2))
    assert not compiled
