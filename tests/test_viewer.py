"""A recording for rerun has the lane's places, links and false positions at the lane's times."""

import sys

import numpy as np
import pytest
from click.testing import CliRunner

import jaxnet
from jaxnet.cli import main
from jaxnet.runs.replay import lane_graph, trajectory_of
from jaxnet.view.drawings.scene import scene_of

KEYS = {
    "vehicles": 4,
    "vehicle": "double_integrator",
    "engine": "exact",
    "samples": 2,
    "horizon": 2.0,
    "tail": 0.5,
    "output_step": 0.5,
    "attack": {"kind": "rotating", "vehicles": [2], "magnitude": 4.0},
    "defence": "none",
    "channel": {"loss": {"kind": "bernoulli", "probability": 0.3}},
    "formation": {"kind": "circle", "radius": 3.0, "turn_rate": 0.2, "phase": {"uniform": [0, 6]}},
    "save": {"trajectories": {"samples": [0]}},
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return jaxnet.run(KEYS, tmp_path_factory.mktemp("viewer") / "out", progress=False)


def view(results, *words):
    return CliRunner().invoke(main, ["view", str(results.path), "--cell", "0", *words])


def contents(path):
    """What a recording has: a list over time for each entity and component."""
    reader = pytest.importorskip("rerun.chunk").RrdReader(path)
    found = {}
    for chunk in reader.stream().to_chunks():
        for name, column in chunk.to_record_batch().to_pydict().items():
            key = chunk.entity_path, name.partition(":")[2] or name
            found[key] = [*found.get(key, []), *column]
    return found


@pytest.mark.parametrize(
    "sample",
    [
        pytest.param(0, id="stored"),
        pytest.param(1, id="simulated again", marks=pytest.mark.long),
    ],
)
def test_a_recording_shows_the_lane(results, sample, tmp_path):
    pytest.importorskip("rerun")
    place = tmp_path / "lane.rrd"
    ended = view(results, "--sample", str(sample), "--save", str(place))
    assert ended.exit_code == 0, ended.output
    assert str(place) in ended.output
    assert not (results.path / "replays" / f"cell-0-sample-{sample}.zarr").exists()
    lane, _ = trajectory_of(results, 0, sample)
    known, found = contents(place), lane["states"].values[..., :2]
    times = [time.total_seconds() for time in known["/robots", "time"]]
    assert times == lane["time"].values.tolist()

    def points(entity, component="positions"):
        return np.array(known[entity, component])[..., :2]

    np.testing.assert_allclose(points("/robots"), found, rtol=1e-6)
    np.testing.assert_allclose(points("/navigator")[:, 0], lane["navigator"], rtol=1e-6, atol=1e-6)
    lie = lane["attack"].values[:, [1]]
    np.testing.assert_allclose(points("/told"), found[:, [1]] + lie, rtol=1e-6)
    # The formation stands about the navigator, at rest relative to it but for its turn.
    places = points("/formation") - points("/navigator")
    np.testing.assert_allclose(np.hypot(*np.moveaxis(places, -1, 0)), 3.0, rtol=1e-4)
    turn = np.diff(np.unwrap(np.arctan2(places[..., 1], places[..., 0]), axis=0), axis=0)
    np.testing.assert_allclose(turn, 0.1, atol=1e-4)
    weights, linked = lane["kept"].values, 3 * 4  # each hears the navigator and two others
    dropped = [len(each or []) for each in known["/links/dropped", "strips"]]
    assert dropped == [linked - int((one > 0).sum()) for one in weights]
    assert sum(dropped) > 0
    every = [len(known[f"/links/{name}", "strips"][2] or []) for name in ("believed", "attacked")]
    assert sum(every) + dropped[2] == linked


def test_without_rerun_the_extra_is_named(results, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    ended = view(results, "--sample", "0", "--save", "lane.rrd")
    assert ended.exit_code == 2
    assert "view needs rerun: pip install 'jaxnet-sim[view]'" in ended.output
    assert (
        "ends in .rrd (got lane.mp4)" in view(results, "--sample", "0", "--save", "lane.mp4").output
    )


def test_the_film_drops_lost_messages_too(results):
    """Without a defence the links that are out of force are those of lost messages."""
    lane = results.trajectories.isel(lane=0)
    scene = scene_of(lane, results.study.cells[0], lane_graph(results, 0, 0))
    heard = (lane["kept"].values > 0).sum(axis=(1, 2))
    np.testing.assert_array_equal(scene.kept.sum(axis=1), heard)
    assert heard.min() < 12
