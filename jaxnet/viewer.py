"""One lane in the viewer rerun, over time: robots, links, what attacked links tell, the formation.

The plane is that of z = 0. Times are the lane's, on the timeline `time`.
"""

import tempfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from upath import UPath

from jaxnet.film import links_at
from jaxnet.statistics.steps import Steps
from jaxnet.store.folder import Folder, FolderError
from jaxnet.view.drawings.scene import LaneScene

ARROW_LENGTH = 0.07  # of the scene, that a heading is long
BIG, SMALL, THIN = -5.0, -3.0, -1.0  # radii; below 0 rerun takes them as points of the screen
GREY, RED, BLUE = (90, 90, 90), (213, 60, 40), (40, 110, 200)
LIGHT, SKY = (190, 190, 190), (150, 195, 240)
LINK_COLOURS = {"links/believed": GREY, "links/attacked": RED, "links/dropped": SKY}


def load_rerun() -> Any:
    """The module `rerun`; raise FolderError where it is not installed."""
    try:
        import_module("rerun.blueprint")
        return import_module("rerun")
    except ImportError:
        raise FolderError("view needs rerun: pip install 'jaxnet-sim[view]'") from None


def with_height(points: Float[np.ndarray, "*some 2"]) -> Float[np.ndarray, "*some 3"]:
    return np.pad(points, [*[(0, 0)] * (points.ndim - 1), (0, 1)])


def entities(rerun: Any, scene: LaneScene, frame: int, size: float) -> Iterator[tuple[str, Any]]:
    """Yield what is shown at a frame, by the path of its entity."""
    places = with_height(scene.places[frame])
    colours = [RED if one in scene.attacked else GREY for one in range(1, len(places))]
    names = [str(one) for one in range(1, len(places))]
    yield "robots", rerun.Points3D(places[1:], labels=names, colors=colours, radii=BIG)
    if scene.heading is not None:
        angles = np.radians(scene.heading[frame])
        ahead = ARROW_LENGTH * size * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        arrows = {"origins": places[1:], "colors": colours, "radii": THIN}
        yield "robots/headings", rerun.Arrows3D(vectors=with_height(ahead), **arrows)
    for (name, colour), ends in zip(LINK_COLOURS.items(), links_at(scene, frame), strict=True):
        yield name, rerun.LineStrips3D(with_height(ends), colors=colour, radii=THIN)
    told = with_height(scene.told[frame])
    lies = np.stack([with_height(scene.truth[frame]), told], axis=1)
    yield "told", rerun.Points3D(told, colors=RED, radii=SMALL)
    yield "told/instead_of", rerun.LineStrips3D(lies, colors=RED, radii=THIN)
    centre = "centre" if scene.leaderless else "navigator"
    yield centre, rerun.Points3D(places[:1], labels=[centre], colors=BLUE, radii=BIG)
    if scene.shape is not None:
        yield (
            "formation",
            rerun.Points3D(with_height(scene.shape[frame]), colors=LIGHT, radii=SMALL),
        )


def show_lane(title: str, scene: LaneScene, save: UPath | None, told: Steps) -> UPath | None:
    """Open the viewer, or write a recording and return its path."""
    rerun = load_rerun()
    finite = np.flatnonzero(np.isfinite(scene.places).all(axis=(1, 2)))
    middle = with_height(np.nanmean(scene.places, axis=(0, 1)))
    size = max(1e-3, float(np.abs(with_height(scene.places) - middle)[finite].max(initial=0.0)))
    above = {"position": middle + np.array([0.0, 0.0, 2 * size]), "look_target": middle}
    eye = rerun.blueprint.EyeControls3D(eye_up=(0.0, 1.0, 0.0), **above)
    seen = rerun.blueprint.Spatial3DView(origin="/", name=title, eye_controls=eye)
    blueprint = rerun.blueprint.Blueprint(seen, collapse_panels=True)
    recording = rerun.RecordingStream("jaxnet")
    with tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / "lane.rrd"
        if save is None:
            recording.spawn(default_blueprint=blueprint)
        else:
            recording.save(made, default_blueprint=blueprint)
        recording.send_recording_name(title)
        paths = with_height(scene.places[finite].swapaxes(0, 1))
        drawn = rerun.LineStrips3D(paths[scene.leaderless :], colors=LIGHT, radii=THIN)
        recording.log("paths", drawn, static=True)
        for number, frame in enumerate(finite.tolist(), 1):
            recording.set_time("time", duration=float(scene.time[frame]))
            for name, entity in entities(rerun, scene, frame, size):
                recording.log(name, entity)
            told("frames", number, len(finite))
        recording.flush()
        recording.disconnect()
        if save is None:
            return None
        return Folder(save.parent).put(save.name, made.read_bytes())
