"""Films of single lanes: links, motion, falsified positions, and the errors below the plane."""

import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.naming import MAGNITUDE, labels_title
from jaxnet.model.graph import Digraph
from jaxnet.statistics.curves import LOG_FLOOR, magnitude_words
from jaxnet.statistics.steps import Steps
from jaxnet.store.folder import Folder, FolderError
from jaxnet.view.drawings.scene import LaneScene, scene_of
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

FILM_SIZE = (5.6, 7.2)  # [in]
FILM_RESOLUTION = 110
MOST_FRAMES_PER_FILM = 150
FRAME_RATE = 10  # frames a second
FILM_FORMATS = (".mp4", ".gif")
DARK = "0.15"
FILM_LINK_LOOKS: dict[str, dict[str, Any]] = {
    "retained link": {"color": "0.6", "linewidth": 0.7},
    "retained link, attacked": {"color": style.RED, "linewidth": 0.9},
    "dropped link": {"color": style.BLUE, "linewidth": 0.7, "linestyle": (0, (1, 1.5))},
}
SHAPE_LOOK: dict[str, Any] = {"marker": "+", "color": "0.6", "linestyle": "", "markersize": 5}
TOUCHING_LOOK: dict[str, Any] = {"s": 120, "facecolors": "none", "edgecolors": style.PURPLE}
FALSE_LOOK: dict[str, Any] = {"color": style.RED, "linewidth": 0.6, "linestyle": (0, (1, 1))}


def film_of(lane: xr.Dataset, cell: Cell, graph: Digraph) -> LaneScene:
    """The lane in at most MOST_FRAMES_PER_FILM frames."""
    times = lane.sizes["time"]
    frames = np.linspace(0, times - 1, min(times, MOST_FRAMES_PER_FILM)).round().astype(int)
    return scene_of(lane.isel(time=np.unique(frames)), cell, graph)


def links_at(film: LaneScene, frame: int) -> list[Float[np.ndarray, "links 2 2"]]:
    """End points of the links at a frame [m], one array for each of FILM_LINK_LOOKS."""
    places, kept = film.places[frame], film.kept[frame]
    listeners, sources = film.links
    ends = np.stack([places[sources], places[listeners + 1]], axis=1)
    return [ends[chosen] for chosen in (kept & ~film.lied, kept & film.lied, ~kept)]


def film_figure(film: LaneScene, cell: Cell, sample: int) -> tuple[Figure, Callable[[int], None]]:
    """The figure, and a function that moves it to a frame."""
    drawn = Figure(figsize=FILM_SIZE, dpi=FILM_RESOLUTION)
    plane, below = drawn.subplots(2, 1, height_ratios=[3.2, 1])
    cursor = draw_errors_below(below, film)
    links = [LineCollection([], zorder=1, **look) for look in FILM_LINK_LOOKS.values()]
    false_links = LineCollection([], zorder=2, **FALSE_LOOK)
    for each in (*links, false_links):
        plane.add_collection(each)
    (false,) = plane.plot([], [], "x", color=style.RED, markersize=5, zorder=4)
    (navigator,) = plane.plot([], [], "s", color=DARK, markersize=6, zorder=5)
    if not film.leaderless:
        plane.plot(*film.places[:, 0].T, color="0.8", linewidth=1.0, zorder=0)
    vehicles = range(1, film.places.shape[1])
    edges = [style.RED if one in film.attacked else DARK for one in vehicles]
    rim = {"s": 26 if film.heading is None else 50, "edgecolors": edges, "linewidths": 1.2}
    fleet = plane.scatter(*film.places[0, 1:].T, c="white", zorder=3, **rim)
    touching = plane.scatter([], [], zorder=3, **TOUCHING_LOOK)
    (shape,) = plane.plot([], [], zorder=1, **SHAPE_LOOK)
    everything = np.abs(np.concatenate([film.places, film.told], axis=1))
    x, y = film.arena or (0.0, 0.0)
    plane.add_patch(Rectangle((-x, -y), 2 * x, 2 * y, fill=False, edgecolor="0.6"))
    reach = 1.08 * float(max(np.nanmax(everything, initial=0.0), x, y))
    plane.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x [m]", ylabel="y [m]")
    plane.set_aspect("equal")
    clock = plane.text(0.98, 0.98, "", transform=plane.transAxes, ha="right", va="top", fontsize=9)
    size = [] if MAGNITUDE in cell.labels else [magnitude_words(cell)]
    named = ", ".join(filter(None, [labels_title(cell.labels), *size, f"sample {sample}"]))
    plane.set_title(multiples.escape_dollars(named), loc="left")
    drawn.legend(handles=film_legend(film), loc="outside lower center", ncols=3, handlelength=2.2)

    def show(frame: int) -> None:
        for each, ends in zip(links, links_at(film, frame), strict=True):
            each.set_segments(list(ends))
        false_links.set_segments(list(np.stack([film.truth[frame], film.told[frame]], axis=1)))
        false.set_data(*film.told[frame].T)
        if not film.leaderless:
            navigator.set_data(*film.places[frame, :1].T)
        fleet.set_offsets(film.places[frame, 1:])
        if film.heading is not None:
            fleet.set_paths([*map(style.pointer, film.heading[frame])])
        fleet.set_facecolor([style.LIMITED if each else "white" for each in film.saturated[frame]])
        touching.set_offsets(film.places[frame, 1:][film.colliding[frame]])
        if film.shape is not None:
            shape.set_data(*film.shape[frame].T)
        clock.set_text(f"t = {film.time[frame]:.1f} s")
        cursor.set_xdata([film.time[frame]] * 2)

    return drawn, show


def draw_errors_below(panel: Axes, film: LaneScene) -> Line2D:
    """Draw each vehicle's error over time; return the line that marks the current time."""
    for vehicle, errors in enumerate(np.maximum(LOG_FLOOR, film.off).T, 1):
        colour = style.RED if vehicle in film.attacked else "0.55"
        panel.plot(film.time, errors, color=colour, linewidth=0.7)
    centre = r"\bar{y}" if film.leaderless else "y_0"
    less = "" if film.shape is None else r" - \delta_i"
    distance = rf"$\|y_i{less} - {centre}\|$ [m]"
    panel.set(yscale="log", xlabel="t [s]", ylabel=distance, xlim=film.time[[0, -1]])
    multiples.log_ticks(panel.yaxis)
    return panel.axvline(0.0, color=style.BLACK, linewidth=0.8)


def film_legend(film: LaneScene) -> list[Line2D]:
    """Legend entries for the links and markers that occur in the film."""
    rim = {"markerfacecolor": "white", "markeredgecolor": style.RED}
    marker: Any = "o" if film.heading is None else style.pointer(0.0)
    markers: dict[str, dict[str, Any]] = {
        "navigator": {"marker": "s", "color": DARK},
        "vehicle": {"marker": marker, "color": DARK, "markerfacecolor": "white"},
        "attacked vehicle": {"marker": marker, **rim},
        "false place in messages": {"marker": "x", "color": style.RED},
        "place in the formation": SHAPE_LOOK,
        "input saturated": {"marker": marker, "color": DARK, "markerfacecolor": style.LIMITED},
        "touches another": {"marker": "o", "color": style.PURPLE, "markerfacecolor": "none"},
    }
    lies = bool(film.told.size)
    marks = film.shape is not None, film.saturated.any(), film.colliding.any()
    shown = [not film.leaderless, True, lies, lies, *marks]
    handles = [
        Line2D([], [], label=called, **{"linestyle": "", "markersize": 5, **look})
        for (called, look), there in zip(markers.items(), shown, strict=True)
        if there
    ]
    fates = film.kept & ~film.lied, film.kept & film.lied, ~film.kept
    for (called, look), fate in zip(FILM_LINK_LOOKS.items(), fates, strict=True):
        if fate.any():
            handles.append(Line2D([], [], label=called, **look))
    return handles


def find_ffmpeg() -> str | None:
    if found := shutil.which("ffmpeg"):
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        return None


def film_format(out: str | None) -> str:
    kind = Path(out).suffix.lower() if out else ".mp4" if find_ffmpeg() else ".gif"
    if kind not in FILM_FORMATS:
        raise FolderError(
            f"out: a film is a file that ends in {' or '.join(FILM_FORMATS)} (got {out})"
        )
    if kind == ".mp4" and not find_ffmpeg():
        told = f"out: {out} needs ffmpeg, and none is found: install it, or pip install"
        raise FolderError(f"{told} 'jaxnet-sim[video]', or ask for a .gif")
    return kind


def save_film(
    folder: Folder, name: str, film: LaneScene, cell: Cell, sample: int, told: Steps
) -> UPath:
    ffmpeg = find_ffmpeg()
    look: style.Style = {**style.PRINT_STYLE} | (
        {"animation.ffmpeg_path": ffmpeg} if ffmpeg else {}
    )
    with mpl.rc_context(look), tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / name
        drawn, show = film_figure(film, cell, sample)
        drawn.canvas.draw()
        drawn.set_layout_engine("none")  # which would place the panels anew for each frame
        if made.suffix.lower() == ".gif":
            writer = PillowWriter(FRAME_RATE)
        else:  # an H.264 video, which browsers and slides play
            writer = FFMpegWriter(FRAME_RATE, "libx264", extra_args=["-pix_fmt", "yuv420p"])
        try:
            with writer.saving(drawn, str(made), FILM_RESOLUTION):
                for frame in range(len(film.time)):
                    show(frame)
                    writer.grab_frame()
                    told("frames", frame + 1, len(film.time))
        except subprocess.CalledProcessError as error:
            ended = f"out: ffmpeg ended with status {error.returncode}; ask for a .gif"
            raise FolderError(ended) from error
        return folder.put(name, lambda file: file.write(made.read_bytes()))
