"""The least separation against the stored trajectory."""

import numpy as np
import pytest

import jaxnet
from tests import systems

KEYS = {"horizon": 4.0, "tail": 1.0, "defence": "none"}


def test_the_least_separation_is_that_of_the_trajectory():
    outcome = systems.outcome(3, engine="exact", metrics=["min_separation"], **KEYS)
    assert outcome.status.tolist() == [0] * 3
    for lane in range(3):
        positions = outcome.series["state"][lane, :, :, :2]
        apart = np.linalg.norm(positions[:, :, None] - positions[:, None], axis=-1)
        least = apart[:, *np.triu_indices(12, 1)].min()
        assert outcome.metrics["min_separation"][lane] == pytest.approx(least, rel=1e-9)


def test_one_vehicle_is_infinitely_far_from_the_next():
    alone = {"vehicles": 1, "topology": "star", "attack": "none", "engine": "exact"}
    results = jaxnet.simulate({"metrics": ["min_separation"], **alone, **KEYS}, 2, progress=False)
    assert results.lanes["status"].tolist() == ["ok", "ok"]
    assert np.isinf(results.lanes["min_separation"]).all()
    assert np.isinf(results.cells["min_separation_median"]).all()


@pytest.mark.long
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
