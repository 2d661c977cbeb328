"""Films of a lane: what they show is what the engine did, and they end up whole or not at all."""

import itertools
import re

import numpy as np
import pytest
from PIL import Image

import jaxnet
from jaxnet import film as animation
from jaxnet.config.scenario import situation_of
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model.graph import dense
from jaxnet.runs.replay import stored_trajectory, trajectory_of
from jaxnet.runs.watched import watched
from jaxnet.store.folder import Folder, FolderError
from jaxnet.view.drawings.scene import attacked_vehicles, scene_of
from jaxnet.view.page import trajectories
from jaxnet.view.text import check
from tests import systems


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Star and cyclic networks, the first sample's trajectories stored."""
    sweep = {"topology": ["star", "cyclic"], "attack.threat": ["adds", "replaces"]}
    keys = {"save": {"errors": True, "trajectories": {"samples": [0]}}, "sweep": sweep}
    study = systems.study(engine="exact", samples=2, horizon=2.0, tail=0.5, **keys)
    return jaxnet.run(study, tmp_path_factory.mktemp("film") / "out")


def film(results, cell, sample=0):
    """What the film of a lane shows, and the lane."""
    lane, graph = trajectory_of(results, cell, sample)
    return animation.film_of(lane, results.study.cells[cell], graph), lane


@pytest.mark.parametrize("cell", range(4))
def test_a_film_shows_the_lane(results, cell):
    """Errors are the stored ones, headings the states', links the graph's; lies are off by ā."""
    shown, lane = film(results, cell)
    tracking = results.errors["tracking"].values[cell, 0]
    np.testing.assert_allclose(shown.off.mean(axis=1), tracking, rtol=1e-6)
    heading = lane["states"].values[:, :, 2]
    np.testing.assert_allclose(np.cos(np.radians(shown.heading)), np.cos(heading), atol=1e-12)
    situation = situation_of(results.study.cells[cell].scenario)
    np.testing.assert_array_equal(shown.links.T, np.argwhere(dense(situation.graph)))
    frames = [animation.links_at(shown, frame) for frame in range(len(shown.time))]
    retained, lied, dropped = (sum(map(len, ends)) for ends in zip(*frames, strict=True))
    assert retained + lied + dropped == len(shown.time) * situation.graph.heard.sum()
    assert lied > 0
    assert (dropped > 0) == (cell >= 2)
    liars, star_or_replaces = [1, 4, 7, 10], cell != 2
    source = shown.places[:, :1] if star_or_replaces else shown.places[:, 1:][:, liars]
    np.testing.assert_allclose(shown.told - source, lane["attack"].values[:, liars], atol=1e-12)
    assert np.hypot(*np.moveaxis(shown.told - source, -1, 0)).max() <= 5 + 1e-9


def test_a_stored_lane_is_not_simulated_again(results):
    """And another is, with the same states as by the run."""
    assert stored_trajectory(results, 3, 0) is not None
    assert not (results.path / "replays" / "cell-3-sample-0.zarr").exists()
    assert stored_trajectory(results, 3, 1) is None
    lane, _ = trajectory_of(results, 3, 1)
    assert stored_trajectory(results, 3, 1) is not None
    apart = lane["states"].values[..., :2] - lane["navigator"].values[:, None]
    error = np.hypot(apart[..., 0], apart[..., 1])
    tracking = results.errors["tracking"].values[3, 1]
    np.testing.assert_allclose(error.mean(axis=1), tracking, rtol=1e-6)


@pytest.mark.parametrize("kind", ["gif", pytest.param("mp4", marks=pytest.mark.long)])
def test_films_are_written(results, tmp_path, kind):
    """A frame for each output; something moves; nothing else is left behind."""
    path = results.animate(2, 0, tmp_path / f"film.{kind}")
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    if kind == "mp4":
        content = path.read_bytes()
        assert content[4:8] == b"ftyp"
        assert len(content) > 10_000
        return
    with Image.open(path) as image:
        assert image.n_frames == 21
        first = np.asarray(image.convert("RGB")).astype(int)
        image.seek(20)
        assert np.abs(np.asarray(image.convert("RGB")) - first).max() > 100


def test_an_interrupt_leaves_no_torn_film(results, tmp_path):
    """Nor what was there before."""
    shown, _ = film(results, 2)

    def interrupt(what, done, total):
        if done == 3:
            raise KeyboardInterrupt

    (tmp_path / "film.gif").write_text("before")
    cell = results.study.cells[2]
    with pytest.raises(KeyboardInterrupt):
        animation.save_film(Folder(tmp_path), "film.gif", shown, cell, 0, interrupt)
    found = [(each.name, each.read_text()) for each in tmp_path.iterdir()]
    assert found == [("film.gif", "before")]


def test_without_ffmpeg_films_are_gifs(monkeypatch):
    """And an .mp4 is refused with the remedy."""
    assert animation.film_format(None) == ".mp4"
    monkeypatch.setattr(animation, "find_ffmpeg", lambda: None)
    assert animation.film_format(None) == ".gif"
    with pytest.raises(FolderError, match=r"pip install 'jaxnet-sim\[video\]', or ask for a \.gif"):
        animation.film_format("x.mp4")
    with pytest.raises(FolderError, match=r"ends in \.mp4 or \.gif \(got x\.avi\)"):
        animation.film_format("x.avi")


def test_who_is_attacked_in_a_lane_is_marked_in_its_pictures(tmp_path):
    """Where attackers are drawn: in the film, in the panels and on the page, vehicles and links."""
    keys = {"attack": {"kind": "rotating", "vehicles": {"random": 2}}}
    keys |= {"save": {"trajectories": "all"}}
    study = systems.study(engine="exact", samples=3, horizon=1.0, tail=0.5, **keys)
    results, cell = jaxnet.run(study, tmp_path / "out"), study.cells[0]
    sets = cell.scenario.attack.chosen(Draw(Keyed(0), range(3), 12))
    assert len(np.unique(sets, axis=1).T) == 3
    for each in watched(results):
        wanted = (np.flatnonzero(sets[:, each.sample]) + 1).tolist()
        shown, _ = film(results, 0, each.sample)
        page = trajectories.lane_data(results, each, 5)
        panels = attacked_vehicles(cell, each.arrays(results))
        assert shown.attacked == page["attacked"] == panels == wanted
        said = [(i, j) for i, j, false in page["links"] if false]
        assert said == [(i + 1, int(j)) for i, j in shown.links.T[shown.lied]]
        assert {j for _, j in said} == set(wanted)
        assert len(said) == 4
    told = " ".join(check.check_text(study).split())
    assert "rotating on 2 vehicles drawn for each lane in what they transmit" in told


ARENA = {
    "vehicles": 6,
    "vehicle": "robotarium",
    "engine": {"kind": "sampled", "move": "euler"},
    **dict.fromkeys(("tick", "output_step"), 0.033),
    "horizon": 6.6,
    "tail": 0.99,
    "navigator": "none",
    "law": "local",
    "gain": [1.0],
    "initial": {"position": {"uniform": [-0.5, 0.5]}},
    "attack": {"kind": "bias", "magnitude": 0.2, "vehicles": [2]},
    "formation": {"kind": "circle", "radius": 0.4},
    "metrics": [
        "saturated_steps",
        {"kind": "collisions", "distance": 0.3},
        {"kind": "outside_arena", "x": 1, "y": 2},
    ],
    "save": {"trajectories": "all"},
}


@pytest.fixture(scope="module")
def arena(tmp_path_factory):
    """Robots in an arena, with the metrics whose keys pictures show."""
    return jaxnet.run(systems.study(samples=2, **ARENA), tmp_path_factory.mktemp("arena") / "out")


def test_robots_are_marked_at_their_limits_and_where_they_touch(arena):
    """The share of limited vehicle-steps is the row's; pairs and headings as a plain loop says."""
    for sample in range(2):
        lane, graph = trajectory_of(arena, 0, sample)
        shown = scene_of(lane, arena.study.cells[0], graph)
        limited = shown.saturated
        assert limited.mean() == pytest.approx(arena.row(0, sample)["saturated"], abs=1e-12)
        assert limited.any(axis=1).sum() == arena.row(0, sample)["saturated_steps"] > 0
        touched, pairs = np.zeros_like(shown.colliding), 0
        for time, robots in enumerate(lane["states"].values):
            ahead = [(x + 0.025 * np.cos(h), y + 0.025 * np.sin(h)) for x, y, h in robots]
            for one, other in itertools.permutations(range(6), 2):
                near = np.hypot(*np.subtract(ahead[one], ahead[other])) <= 0.3
                touched[time, one] |= near
                pairs += near * (time + 1 < len(touched))
        assert arena.row(0, sample)["collisions"] == pairs / 2
        np.testing.assert_array_equal(shown.colliding, touched)
        assert 0 < touched.mean() < 1
        heading = lane["states"].sel(state="heading").values
        np.testing.assert_allclose(shown.heading, np.degrees(heading))
        assert shown.arena == (1, 2)


def test_pictures_have_true_places_and_errors_less_the_offsets(tmp_path):
    """Errors of a formation are those of the same lane without one; places differ by its shape."""
    keys = ARENA | {"vehicle": "single_integrator", "engine": "exact", "metrics": []}
    scenes = []
    for radius in (0.0, 3.0):
        formation = {"kind": "circle", "radius": radius, "turn_rate": 0.5} if radius else "none"
        study = systems.study(samples=1, **keys | {"formation": formation})
        results = jaxnet.run(study, tmp_path / f"{radius:g}")
        lane, graph = trajectory_of(results, 0, 0)
        scenes.append(scene_of(lane, results.study.cells[0], graph))
    plain, shaped = scenes
    np.testing.assert_allclose(shaped.off, plain.off, atol=1e-12)
    angles = 0.5 * plain.time[:, None] + np.arange(6) * np.pi / 3
    circle = 3.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    np.testing.assert_allclose(shaped.places[:, 1:], plain.places[:, 1:] + circle, atol=1e-12)
    middle = np.delete(plain.places[:, 1:], 1, axis=1).mean(axis=1)
    np.testing.assert_allclose(shaped.shape, middle[:, None] + circle, atol=1e-12)
    assert plain.shape is None
    assert plain.heading is None
    assert not shaped.saturated.any() | shaped.colliding.any()


def test_film_panels_and_page_show_what_robots_do(arena):
    """Triangles, the arena's sides, marks of limits and touches, places in the formation."""
    lane, graph = trajectory_of(arena, 0, 0)
    film = animation.film_of(lane, arena.study.cells[0], graph)
    drawn, show = animation.film_figure(film, arena.study.cells[0], 0)
    words = {text.get_text() for text in drawn.legends[0].get_texts()}
    marks = {"place in the formation", "input saturated", "touches another"}
    assert marks <= words
    show(1)
    (fleet, touching), (box,) = drawn.axes[0].collections[-2:], drawn.axes[0].patches
    assert (box.get_width(), box.get_height()) == (2, 4)
    tips = [path.vertices[0] for path in fleet.get_paths()]
    np.testing.assert_allclose(np.degrees([np.arctan2(y, x) for x, y in tips]) % 360,
                               film.heading[1] % 360, atol=1e-9)  # fmt: skip
    assert len(touching.get_offsets()) == film.colliding[1].sum()
    page, _ = trajectories.lanes_data(arena)
    assert page[0]["arena"] == (1, 2)
    assert all(page[0][name] for name in ("formation", "saturated", "colliding"))
    assert marks <= {*re.findall('data-name="(.*?)"', trajectories.lanes_html(page))}
    panels = arena.plot.panels()
    written = {text.get_text() for text in panels.legends[0].get_texts()}
    assert marks - {"place in the formation"} <= written
    assert any(patch.get_width() == 2 for patch in panels.axes[0].patches)
