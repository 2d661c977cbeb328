"""The car: a fleet of cars moves as one of robots."""

import jax
import numpy as np

from jaxnet.kinds.vehicles.car import STEERING
from tests import systems

KEYS = {"defence": "none", "horizon": 10.0, "tail": 1.0, "attack": {"magnitude": 4.0}}
WHEELBASE = {"kind": "car", "wheelbase": {"uniform": [0.3, 2.0]}}


def test_the_wheelbase_is_seen_in_the_steering_alone():
    """All else is the robot's; tan δ is wheelbase · turn rate / speed. A number is no program."""
    vehicles = (WHEELBASE, "two_wheeled", {"kind": "car", "wheelbase": 1.0})
    studies = (systems.study(engine="exact", vehicle=vehicle, **KEYS) for vehicle in vehicles)
    one, other, fixed = (systems.lanes(study, 3) for study in studies)
    assert one.plan == fixed.plan
    assert jax.tree.structure(one.inputs) == jax.tree.structure(fixed.inputs)
    cars, robots = systems.simulate(one), systems.simulate(other)
    assert cars.status.tolist() == [0] * 3
    for name, metric in cars.metrics.items():
        np.testing.assert_allclose(metric, robots.metrics[name], rtol=1e-12)
    car, robot = (np.moveaxis(each.series["state"], -1, 0) for each in (cars, robots))
    np.testing.assert_allclose(car[:4], robot[:4], rtol=0, atol=1e-12)
    wheelbase = one.inputs.lane.vehicle.wheelbase[:, None, None]
    np.testing.assert_allclose(np.tan(car[STEERING]), wheelbase * robot[4] / robot[3], rtol=1e-9)
