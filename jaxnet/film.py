"""Films of single lanes: links, motion, falsified positions, and the errors below the plane."""

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from PIL import Image
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
    """Extract a film of at most MOST_FRAMES_PER_FILM frames from a lane; `ahead` holds the headings [°]."""
    times = lane.sizes["time"]
    frames = np.unique(
        np.linspace(0, times - 1, min(times, MOST_FRAMES_PER_FILM)).round().astype(int)
    )
    vehicles, navigator = lane["states"].values[frames, :, :2], lane["navigator"].values[frames]
    attack, vehicles_attacked = cell.scenario.attack, attacked_vehicles(cell, lane)
    false, liars = (
        falsified_links(cell, graph, vehicles_attacked),
        np.array(vehicles_attacked, int) - 1,
    )
    listeners, slots = graph.edges()
    sources, lied = graph.sources[listeners, slots], false[listeners, slots]
    signal = lane["attack"].values[frames][:, liars]
    from_navigator = bool(lied[sources == 0].any())
    about_navigator = from_navigator or attack.replaces()
    truth = (
        np.repeat(navigator[:, None], len(liars), axis=1) if about_navigator else vehicles[:, liars]
    )
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


def film_figure(
    film: Film, cell: Cell, sample: int
) -> tuple[Figure, list[Artist], Callable[[int], None]]:
    """Return the figure, its moving artists, and a function that moves these artists to a frame."""
    drawn = Figure(figsize=FILM_SIZE, dpi=FILM_RESOLUTION)
    plane, below = drawn.subplots(2, 1, height_ratios=[3.2, 1])
    cursor = draw_errors_below(below, film, cell)
    links = [LineCollection([], zorder=1, **look) for look in FILM_LINK_STYLES.values()]
    for each in links:
        plane.add_collection(each)
    false_links = LineCollection(
        [], color=style.RED, linewidth=0.6, linestyle=(0, (1, 1)), zorder=2
    )
    plane.add_collection(false_links)
    (false,) = plane.plot([], [], "x", color=style.RED, markersize=5, zorder=4)
    (navigator,) = plane.plot([], [], "s", color="0.15", markersize=6, zorder=5)
    if not film.leaderless:
        plane.plot(*film.places[:, 0].T, color="0.8", linewidth=1.0, zorder=0)
    edges = [style.RED if one + 1 in film.liars else "0.15" for one in range(film.heading.shape[1])]
    vehicles = plane.scatter(
        *film.places[0, 1:].T, s=26, c="white", edgecolors=edges, linewidths=1.2, zorder=3
    )
    frame_plane(plane, film)
    reach = plane.get_xlim()[1]
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

    return drawn, [*links, false_links, vehicles, arrows, false, navigator, clock, cursor], show


def heading_vectors(film: Film, frame: int) -> Float[np.ndarray, "2 m"]:
    """Return unit vectors along the headings at a frame."""
    return np.stack([np.cos(film.heading[frame]), np.sin(film.heading[frame])])


def frame_plane(plane: Axes, film: Film) -> None:
    """Set axes around all finite positions of the film, true and falsified."""
    everything = np.concatenate([film.places, film.told], axis=1)
    reach = float(np.ceil(1.08 * np.nanmax(np.abs(everything), initial=1.0)))
    plane.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x [m]", ylabel="y [m]")
    plane.set_aspect("equal")


def draw_errors_below(panel: Axes, film: Film, cell: Cell) -> Line2D:
    """Draw each vehicle's error over time; return the line that marks the current time."""
    for number, errors in enumerate(film.errors.T):
        attacked = number + 1 in film.liars
        panel.plot(
            film.time,
            np.maximum(LOG_FLOOR, errors),
            color=style.RED if attacked else "0.55",
            linewidth=0.7,
        )
    distance = r"$\|y_i - \bar{y}\|$ [m]" if film.leaderless else r"$\|y_i - y_0\|$ [m]"
    panel.set(yscale="log", xlabel="t [s]", ylabel=distance, xlim=film.time[[0, -1]])
    multiples.log_ticks(panel.yaxis)
    return panel.axvline(0.0, color=style.BLACK, linewidth=0.8)


def film_legend(film: Film) -> list[Line2D]:
    """Return legend entries for the links and markers that occur in the film."""
    node: dict[str, Any] = {"linestyle": "", "markersize": 5}
    handles = [
        *[Line2D([], [], marker="s", color="0.15", label="navigator", **node)]
        * (not film.leaderless),
        Line2D(
            [],
            [],
            marker="o",
            color="0.15",
            markerfacecolor="white",
            label="vehicle and heading",
            **node,
        ),
    ]
    if film.told.size:
        rim = {"markerfacecolor": "white", "markeredgecolor": style.RED}
        handles.append(Line2D([], [], marker="o", label="attacked vehicle", **rim, **node))
        handles.append(
            Line2D([], [], marker="x", color=style.RED, label="place that is told falsely", **node)
        )
    shown = np.array(
        [[len(ends) for ends in links_at(film, frame)] for frame in range(len(film.time))]
    )
    ever_shown: Any = shown.any(axis=0)
    looks = [
        (called, look)
        for (called, look), ever in zip(FILM_LINK_STYLES.items(), ever_shown, strict=True)
        if ever
    ]
    return handles + [Line2D([], [], **look, label=called) for called, look in looks]


def find_ffmpeg() -> str | None:
    """Return the path of ffmpeg, from the system or the extra `video`, or None."""
    if found := shutil.which("ffmpeg"):
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        return None


def film_format(out: str | None) -> str:
    """Return the requested file extension, or .mp4 if ffmpeg is found, or .gif."""
    kind = Path(out).suffix.lower() if out else ".mp4" if find_ffmpeg() else ".gif"
    if kind not in FILM_FORMATS:
        raise FolderError(
            f"out: a film is a file that ends in {' or '.join(FILM_FORMATS)} (got {out})"
        )
    if kind == ".mp4" and not find_ffmpeg():
        raise FolderError(
            f"out: {out} needs ffmpeg, and none is found: install it, or pip install 'jaxnet-sim[video]', or"
            " ask for a .gif"
        )
    return kind


def film_frames(film: Film, cell: Cell, sample: int) -> Iterator[Image.Image]:
    """Yield the frames in order; draw the static background once."""
    drawn, moving, show = film_figure(film, cell, sample)
    canvas = FigureCanvasAgg(drawn)
    for each in moving:
        each.set_animated(True)
    canvas.draw()
    still = canvas.copy_from_bbox(drawn.bbox)
    for frame in range(len(film.time)):
        show(frame)
        canvas.restore_region(still)
        for each in moving:
            drawn.draw_artist(each)
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def write_gif(file: Path, frames: Iterator[Image.Image]) -> None:
    """Write the frames as a GIF that loops."""
    reduced = [frame.quantize(128, dither=Image.Dither.NONE) for frame in frames]
    reduced[0].save(
        file, save_all=True, append_images=reduced[1:], duration=1000 // FRAME_RATE, loop=0
    )


def write_mp4(file: Path, frames: Iterator[Image.Image]) -> None:
    """Write the frames as an H.264 video, which browsers and slides play."""
    width, height = (int(inches * FILM_RESOLUTION) for inches in FILM_SIZE)
    raw = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {FRAME_RATE} -i -".split()
    words = [
        str(find_ffmpeg()),
        "-loglevel",
        "error",
        "-y",
        *raw,
        "-c:v",
        "libx264",
        "-pix_fmt",
        "yuv420p",
        str(file),
    ]
    with subprocess.Popen(words, stdin=subprocess.PIPE) as process:
        assert process.stdin is not None
        for frame in frames:
            process.stdin.write(frame.tobytes())
        process.stdin.close()
    if process.returncode:
        raise FolderError(f"out: ffmpeg ended with status {process.returncode}; ask for a .gif")


def save_film(folder: Folder, name: str, film: Film, cell: Cell, sample: int, told: Steps) -> UPath:
    """Draw a film and store the complete file in a results folder."""

    def counted() -> Iterator[Image.Image]:
        for number, frame in enumerate(film_frames(film, cell, sample), 1):
            yield frame
            told("frames", number, len(film.time))

    with mpl.rc_context(style.PRINT_STYLE), tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / name
        (write_gif if made.suffix.lower() == ".gif" else write_mp4)(made, counted())
        return folder.put(name, lambda file: file.write(made.read_bytes()))
