"""The least separation, and a metric from outside, against the stored trajectory."""

import numpy as np
import pytest

import jaxnet
from jaxnet.kinds.metrics import Metric
from tests import systems

KEYS = {"horizon": 4.0, "tail": 1.0, "defence": "none"}


def force(seen):
    """Absolute acceleration along the heading [m/s²]."""
    return abs(seen.state[5])


EFFORT = Metric("effort", "m/s²", force, "run", "mean", "mean")
HARDEST = Metric("hardest", "m/s²", force, "run", "max", "min")
EASIEST = Metric("easiest", "m/s²", force, "run", "min", "max")
LATE_EFFORT = Metric("late_effort", "m/s²", force, "tail", "mean", "max")
LATE_HARDEST = Metric("late_hardest", "m/s²", force, "tail", "max", "mean")
LATE_EASIEST = Metric("late_easiest", "m/s²", force, "tail", "min", "min")
OWN = ("EFFORT", "HARDEST", "EASIEST", "LATE_EFFORT", "LATE_HARDEST", "LATE_EASIEST")


@pytest.fixture(scope="module")
def measured():
    metrics = ["min_separation", *(f"{__name__}:{name}" for name in OWN)]
    one = systems.lanes(systems.study(engine="exact", metrics=metrics, **KEYS), 3)
    return one, systems.simulate(one)


def test_the_least_separation_is_that_of_the_trajectory(measured):
    _, outcome = measured
    assert outcome.status.tolist() == [0] * 3
    for lane in range(3):
        positions = outcome.series["state"][lane, :, :, :2]
        apart = np.linalg.norm(positions[:, :, None] - positions[:, None], axis=-1)
        least = apart[:, *np.triu_indices(12, 1)].min()
        assert outcome.metrics["min_separation"][lane] == pytest.approx(least, rel=1e-9)


@pytest.mark.parametrize("name", OWN)
def test_a_metric_of_one_s_own_is_reduced_as_it_says(measured, name):
    """First over the output times of the run or of the tail, then over the vehicles."""
    (_, outcome), metric = measured, globals()[name]
    for lane in range(3):
        values = np.abs(outcome.series["state"][lane, :, :, 5])
        values = values[-11:] if metric.over == "tail" else values
        by_vehicle = getattr(np, metric.time)(values, axis=0)
        known = getattr(np, metric.vehicles)(by_vehicle)
        assert outcome.metrics[metric.name][lane] == pytest.approx(known, rel=1e-9, abs=1e-12)


def test_one_vehicle_is_infinitely_far_from_the_next():
    alone = {"vehicles": 1, "topology": "star", "attack": "none", "engine": "exact"}
    results = jaxnet.simulate({"metrics": ["min_separation"], **alone, **KEYS}, 2, progress=False)
    assert results.lanes["status"].tolist() == ["ok", "ok"]
    assert np.isinf(results.lanes["min_separation"]).all()
    assert np.isinf(results.cells["min_separation_median"]).all()


def test_robots_start_with_their_axles_in_the_formation_and_are_apart_by_their_points():
    """In stored states: the axle is at the start plus the offset, the point `ahead` of it."""
    places = np.array([[-0.6, 0.0], [0.3, 0.2], [0.1, -0.5]])
    offsets = np.array([[0.1, 0.0], [0.0, 0.2], [0.0, -0.3]])
    robots = {
        "vehicles": 3,
        "vehicle": {"kind": "robotarium", "ahead": 0.05},
        "topology": {"kind": "circulant", "offsets": [1, -1]},
        "navigator": "none",
        "law": "local",
        "gain": [1],
        "engine": {"kind": "sampled", "move": "euler"},
        "initial": {"position": places, "heading": [0.3, 1.7, -2.5]},
        "formation": {"kind": "offsets", "offsets": offsets},
        **systems.QUIET,
        "metrics": ["min_separation"],
        **systems.clock(0.033, 0.99, 0.33),
        "save": {"trajectories": {"samples": [0]}},
    }
    results = jaxnet.simulate(robots, 1, progress=False)
    states = results.trajectories["states"].to_numpy()[0]
    np.testing.assert_allclose(states[0, :, :2], places + offsets, atol=1e-12)
    heading = np.stack([np.cos(states[..., 2]), np.sin(states[..., 2])], axis=-1)
    points = states[..., :2] + 0.05 * heading
    least = []
    for each in (points, states[..., :2]):
        apart = np.linalg.norm(each[:, :, None] - each[:, None], axis=-1)
        least.append(apart[:, *np.triu_indices(3, 1)].min())
    assert least[0] < least[1] - 0.05
    np.testing.assert_allclose(results.lanes["min_separation"], least[0], rtol=1e-9)
