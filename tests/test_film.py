"""Films of a lane: what they show is what the engine did, and they end up whole or not at all."""

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
from jaxnet.view.figures.panels import attacked_vehicles
from jaxnet.view.page import trajectories
from jaxnet.view.page.trajectories import headings
from jaxnet.view.text import check
from tests import systems


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Star and cyclic networks, the first sample's trajectories stored."""
    study = systems.study(
        engine="exact",
        samples=2,
        horizon=2.0,
        tail=0.5,
        sweep={"topology": ["star", "cyclic"], "attack.threat": ["adds", "replaces"]},
        save={"errors": True, "trajectories": {"samples": [0]}},
    )
    return jaxnet.run(study, tmp_path_factory.mktemp("film") / "out")


def film(results, cell):
    """What the film of a cell's first lane shows."""
    lane, graph = trajectory_of(results, cell, 0)
    return animation.film_of(lane, results.study.cells[cell], graph, headings(lane["states"])), lane


@pytest.mark.parametrize("cell", range(4))
def test_a_film_shows_the_lane(results, cell):
    """The errors are those stored, headings the states', weights the graph's."""
    shown, lane = film(results, cell)
    tracking = results.errors["tracking"].values[cell, 0]
    np.testing.assert_allclose(shown.errors.mean(axis=1), tracking, rtol=1e-6)
    np.testing.assert_allclose(
        np.cos(shown.heading), np.cos(lane["states"].values[:, :, 2]), atol=1e-12
    )
    situation = situation_of(results.study.cells[cell].scenario)
    np.testing.assert_array_equal(shown.links.T, np.argwhere(dense(situation.graph)))
    retained, lied, dropped = (sum(map(len, ends)) for ends in zip(*links(shown), strict=True))
    assert retained + lied + dropped == len(shown.time) * situation.graph.heard.sum()
    assert lied > 0
    assert (dropped > 0) == (cell >= 2)


def links(shown):
    """Links by look, frame by frame."""
    return [animation.links_at(shown, frame) for frame in range(len(shown.time))]


@pytest.mark.parametrize("cell", range(4))
def test_what_is_told_falsely_is_off_by_the_attack(results, cell):
    """By the bound ā at most."""
    shown, lane = film(results, cell)
    liars = [1, 4, 7, 10]
    star_or_replaces = cell != 2
    source = shown.places[:, :1] if star_or_replaces else shown.places[:, 1:][:, liars]
    np.testing.assert_allclose(shown.told - source, lane["attack"].values[:, liars], atol=1e-12)
    assert np.hypot(*np.moveaxis(shown.told - source, -1, 0)).max() <= 5 + 1e-9


def test_a_stored_lane_is_not_simulated_again(results):
    """And another is, with the same states as by the run."""
    assert stored_trajectory(results, 3, 0) is not None
    assert stored_trajectory(results, 3, 1) is None
    lane, _ = trajectory_of(results, 3, 1)
    apart = lane["states"].values[..., :2] - lane["navigator"].values[:, None]
    tracking = results.errors["tracking"].values[3, 1]
    np.testing.assert_allclose(np.linalg.norm(apart, axis=-1).mean(axis=1), tracking, rtol=1e-6)


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
    (left,) = tmp_path.iterdir()
    assert (left.name, left.read_text()) == ("film.gif", "before")


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
    study = systems.study(
        engine="exact",
        samples=3,
        horizon=1.0,
        tail=0.5,
        attack={"kind": "rotating", "vehicles": {"random": 2}},
        save={"trajectories": "all"},
    )
    results, cell = jaxnet.run(study, tmp_path / "out"), study.cells[0]
    sets = cell.scenario.attack.chosen(Draw(Keyed(0), range(3), 12))
    assert len(np.unique(sets, axis=1).T) == 3
    for each in watched(results):
        wanted = (np.flatnonzero(sets[:, each.sample]) + 1).tolist()
        shown = film_of_sample(results, each.sample)
        page = trajectories.lane_data(results, each, 5)
        assert shown.liars == page["attacked"] == wanted
        assert attacked_vehicles(cell, each.arrays(results)) == wanted
        said = [(i, j) for i, j, false in page["links"] if false]
        assert said == [(i + 1, int(j)) for i, j in shown.links.T[shown.attacked]]
        assert {j for _, j in said} == set(wanted)
        assert len(said) == 4
    assert "rotating on 2 drawn for each lane in what they transmit" in check.check_text(study)


def film_of_sample(results, sample):
    """What the film of a lane of the first cell shows."""
    lane, graph = trajectory_of(results, 0, sample)
    return animation.film_of(lane, results.study.cells[0], graph, headings(lane["states"]))
