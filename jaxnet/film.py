"""Films of single lanes: links, motion, falsified positions, and the errors below the plane."""

import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from upath import UPath

from jaxnet.config.cells import Cell
from jaxnet.config.naming import MAGNITUDE, labels_title
from jaxnet.model import hearing
from jaxnet.model.graph import Digraph
from jaxnet.statistics.curves import LOG_FLOOR, magnitude_words
from jaxnet.statistics.steps import Steps
from jaxnet.store.folder import Folder, FolderError
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.panels import attacked_vehicles, falsified_links, fleet_centre
from jaxnet.view.figures.style import Figure

FILM_SIZE = (5.6, 7.2)  # [in]
FILM_RESOLUTION = 110
MOST_FRAMES_PER_FILM = 150
FRAME_RATE = 10  # frames a second
ARROW_LENGTH = 0.07  # of the frame, that a heading is long
FILM_FORMATS = (".mp4", ".gif")


class Film(NamedTuple):
    """Data of a film, frame by frame."""

    time: Float[np.ndarray, " times"]
    places: Float[np.ndarray, "times sources 2"]  # of the navigator, then of the vehicles [m]
    heading: Float[np.ndarray, "times m"]  # [rad]
    links: Int[np.ndarray, "2 links"]  # of the graph: listeners, from 0, and sources
    attacked: Bool[np.ndarray, " links"]
    kept: Bool[np.ndarray, "times links"]  # whether they are retained
    told: Float[np.ndarray, "times false 2"]  # where attacked links say that their sources are [m]
    truth: Float[np.ndarray, "times false 2"]  # and where these are
    liars: list[int]  # attacked vehicles
    leaderless: bool  # then the mean of the vehicles that are not attacked stands for the navigator

    @property
    def errors(self) -> Float[np.ndarray, "times m"]:
        """Distance of each vehicle from the navigator, or from the mean without one [m]."""
        return np.hypot(*np.moveaxis(self.places[:, 1:] - self.places[:, :1], -1, 0))


def film_of(
    lane: xr.Dataset, cell: Cell, graph: Digraph, ahead: Float[np.ndarray, "times m"]
) -> Film:
    """Extract a film of at most MOST_FRAMES_PER_FILM frames; `ahead` holds the headings [°]."""
    times = lane.sizes["time"]
    shown = np.linspace(0, times - 1, min(times, MOST_FRAMES_PER_FILM))
    frames = np.unique(shown.round().astype(int))
    vehicles, navigator = lane["states"].values[frames, :, :2], lane["navigator"].values[frames]
    attack, vehicles_attacked = cell.scenario.attack, attacked_vehicles(cell, lane)
    false = falsified_links(cell, graph, vehicles_attacked)
    liars = np.array(vehicles_attacked, int) - 1
    listeners, slots = graph.edges()
    sources, lied = graph.sources[listeners, slots], false[listeners, slots]
    signal = lane["attack"].values[frames][:, liars]
    from_navigator = bool(lied[sources == 0].any())
    truth = vehicles[:, liars]
    if from_navigator or attack.replaces():
        truth = np.repeat(navigator[:, None], len(liars), axis=1)
    kept = np.ones((len(frames), len(sources)), bool)
    if cell.scenario.defence.decides:
        kept = hearing.by_link(graph, lane["kept"].values[frames] > 0, lane["source"].values)
    leaderless = not cell.scenario.navigator.present
    centre = fleet_centre(vehicles, vehicles_attacked) if leaderless else navigator
    return Film(
        lane["time"].values[frames],
        np.concatenate([centre[:, None], vehicles], axis=1),
        np.radians(ahead[frames]),
        np.stack([listeners, sources]),
        lied,
        kept,
        truth + signal,
        vehicles[:, liars] if attack.replaces() and not from_navigator else truth,
        vehicles_attacked,
        leaderless,
    )


FILM_LINK_STYLES: dict[str, dict[str, Any]] = {
    "retained link": {"color": "0.6", "linewidth": 0.7},
    "retained link, attacked": {"color": style.RED, "linewidth": 0.9},
    "dropped link": {"color": style.BLUE, "linewidth": 0.7, "linestyle": (0, (1, 1.5))},
}


def links_at(film: Film, frame: int) -> list[Float[np.ndarray, "links 2 2"]]:
    """Return end points of the links at a frame [m], one array per style in FILM_LINK_STYLES."""
    places, kept = film.places[frame], film.kept[frame]
    listeners, sources = film.links
    ends = np.stack([places[sources], places[listeners + 1]], axis=1)
    return [ends[chosen] for chosen in (kept & ~film.attacked, kept & film.attacked, ~kept)]


def film_figure(film: Film, cell: Cell, sample: int) -> tuple[Figure, Callable[[int], None]]:
    """Return the figure, and a function that moves it to a frame."""
    drawn = Figure(figsize=FILM_SIZE, dpi=FILM_RESOLUTION)
    plane, below = drawn.subplots(2, 1, height_ratios=[3.2, 1])
    cursor = draw_errors_below(below, film, cell)
    links = [LineCollection([], zorder=1, **look) for look in FILM_LINK_STYLES.values()]
    for each in links:
        plane.add_collection(each)
    lies = {"color": style.RED, "linewidth": 0.6, "linestyle": (0, (1, 1)), "zorder": 2}
    false_links = LineCollection([], **lies)
    plane.add_collection(false_links)
    (false,) = plane.plot([], [], "x", color=style.RED, markersize=5, zorder=4)
    (navigator,) = plane.plot([], [], "s", color="0.15", markersize=6, zorder=5)
    if not film.leaderless:
        plane.plot(*film.places[:, 0].T, color="0.8", linewidth=1.0, zorder=0)
    edges = [style.RED if one + 1 in film.liars else "0.15" for one in range(film.heading.shape[1])]
    vehicles = plane.scatter(
        *film.places[0, 1:].T, s=26, c="white", edgecolors=edges, linewidths=1.2, zorder=3
    )
    everything = np.concatenate([film.places, film.told], axis=1)
    reach = float(np.ceil(1.08 * np.nanmax(np.abs(everything), initial=1.0)))
    plane.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x [m]", ylabel="y [m]")
    plane.set_aspect("equal")
    arrows = plane.quiver(
        *film.places[0, 1:].T,
        *(ARROW_LENGTH * reach * heading_vectors(film, 0)),
        color=edges,
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.004,
        zorder=3.5,
    )
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
        vehicles.set_offsets(film.places[frame, 1:])
        arrows.set_offsets(film.places[frame, 1:])
        arrows.set_UVC(*(ARROW_LENGTH * reach * heading_vectors(film, frame)))
        clock.set_text(f"t = {film.time[frame]:.1f} s")
        cursor.set_xdata([film.time[frame]] * 2)

    return drawn, show


def heading_vectors(film: Film, frame: int) -> Float[np.ndarray, "2 m"]:
    return np.stack([np.cos(film.heading[frame]), np.sin(film.heading[frame])])


def draw_errors_below(panel: Axes, film: Film, cell: Cell) -> Line2D:
    """Draw each vehicle's error over time; return the line that marks the current time."""
    for number, errors in enumerate(np.maximum(LOG_FLOOR, film.errors.T), start=1):
        colour = style.RED if number in film.liars else "0.55"
        panel.plot(film.time, errors, color=colour, linewidth=0.7)
    distance = r"$\|y_i - \bar{y}\|$ [m]" if film.leaderless else r"$\|y_i - y_0\|$ [m]"
    panel.set(yscale="log", xlabel="t [s]", ylabel=distance, xlim=film.time[[0, -1]])
    multiples.log_ticks(panel.yaxis)
    return panel.axvline(0.0, color=style.BLACK, linewidth=0.8)


def film_legend(film: Film) -> list[Line2D]:
    """Return legend entries for the links and markers that occur in the film."""
    rim = {"markerfacecolor": "white", "markeredgecolor": style.RED}
    markers: dict[str, dict[str, Any]] = {
        "navigator": {"marker": "s", "color": "0.15"},
        "vehicle and heading": {"marker": "o", "color": "0.15", "markerfacecolor": "white"},
        "attacked vehicle": {"marker": "o", **rim},
        "place that is told falsely": {"marker": "x", "color": style.RED},
    }
    if film.leaderless:
        del markers["navigator"]
    if not film.told.size:
        markers = {called: look for called, look in markers.items() if look.get("color") == "0.15"}
    handles = [
        Line2D([], [], linestyle="", markersize=5, label=called, **look)
        for called, look in markers.items()
    ]
    frames = [links_at(film, frame) for frame in range(len(film.time))]
    for style_number, (called, look) in enumerate(FILM_LINK_STYLES.items()):
        if any(len(ends[style_number]) for ends in frames):
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
        allowed = " or ".join(FILM_FORMATS)
        raise FolderError(f"out: a film is a file that ends in {allowed} (got {out})")
    if kind == ".mp4" and not find_ffmpeg():
        told = f"out: {out} needs ffmpeg, and none is found: install it, or pip install"
        raise FolderError(f"{told} 'jaxnet-sim[video]', or ask for a .gif")
    return kind


def save_film(folder: Folder, name: str, film: Film, cell: Cell, sample: int, told: Steps) -> UPath:
    ffmpeg = find_ffmpeg()
    looks: dict[Any, Any] = {"animation.ffmpeg_path": ffmpeg} if ffmpeg else {}
    with mpl.rc_context(style.PRINT_STYLE | looks), tempfile.TemporaryDirectory() as scratch:
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
