"""The car: a fleet of cars moves as one of robots."""

import numpy as np
import pytest

from jaxnet.kinds.vehicles.car import STEERING
from tests import systems
from tests.reference import exact

KEYS = {"defence": "none", "horizon": 10.0, "tail": 1.0, "attack": {"magnitude": 4.0}}
WHEELBASE = {"kind": "car", "wheelbase": {"uniform": [0.3, 2.0]}}


@pytest.fixture(scope="module")
def fleets():
    """Lanes of cars by either engine, with wheelbases of their own, and robots."""
    found = {}
    for engine, name in (("exact", "car"), ("nonlinear", "car"), ("exact", "robot")):
        vehicle = WHEELBASE if name == "car" else "two_wheeled"
        one = systems.lanes(systems.study(engine=engine, vehicle=vehicle, **KEYS), 3)
        found[engine, name] = one, systems.simulate(one)
        assert (found[engine, name][1].status == 0).all()
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
    (one, _), (car, _) = fleets["exact", "robot"], fleets["exact", "car"]
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
