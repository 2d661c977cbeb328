"""Who hears whom: the graphs of a study with their weights, attacked and trusted links."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch

from jaxnet.config.cells import Cell
from jaxnet.config.scenario import Situation, situation_of
from jaxnet.view.figures import style
from jaxnet.view.figures.panels import attacked_vehicles, name
from jaxnet.view.figures.style import Figure

MOST_IN_ROW = 4  # graphs in a row
SNAKE = 4  # vehicles in a row of a graph that is more of a chain
NODE = 0.13  # radius of a node where the vehicles stand on a unit circle

PLAIN = {"color": "0.55", "linewidth": 0.8, "linestyle": "-"}
TRUSTED = {"color": style.BLUE, "linewidth": 1.6, "linestyle": "-"}
ATTACKED = {"color": style.RED, "linewidth": 1.0, "linestyle": (0, (3, 1.2))}


def figure(cells: Sequence[Cell]) -> Figure:
    """One panel per graph, each with the most attacked links that the study has on it.

    Weights that are drawn lane by lane are those of the graph of their medians.
    """
    graphs: dict[str, Cell] = {}
    for cell in cells:
        known = graphs.get(name(cell))
        if known is None or attacked_links(cell) > attacked_links(known):
            graphs[name(cell)] = cell
    shown = list(graphs.values())
    columns = min(MOST_IN_ROW, len(shown))
    rows = -(-len(shown) // columns)
    size = style.WIDTH / max(columns, 3)
    drawn = Figure(figsize=(size * columns if columns >= 3 else style.WIDTH, size * rows + 0.55))
    for number, cell in enumerate(shown):
        panel = drawn.add_subplot(rows, columns, number + 1)
        draw_graph(panel, cell, situation_of(cell.scenario))
    drawn.legend(handles=legend(), loc="outside lower center", ncols=5, handlelength=2.4)
    return drawn


def attacked_links(cell: Cell) -> int:
    """Number of attacked links, none if the attack has no size."""
    return int(situation_of(cell.scenario).attacked.sum()) if attacked_vehicles(cell) else 0


def draw_graph(panel: Axes, cell: Cell, network: Situation) -> None:
    """Arrows run as the signals do, from the source to the vehicle that hears it."""
    places = positions(network.weights)
    attacked = attacked_vehicles(cell)
    decides = cell.scenario.defence.decides
    for i, j in np.argwhere(network.weights > 0):
        under_attack = attacked and network.attacked[i, j]
        look = ATTACKED if under_attack else TRUSTED if decides and network.trusted[i, j] else PLAIN
        mutual = j > 0 and network.weights[j - 1, i + 1] > 0
        bend = 0.16 if mutual else 0.0
        draw_link(panel, places[j], places[i + 1], bend, look)
    label_weights(panel, network.weights, places)
    for source, (x, y) in enumerate(places):
        draw_node(panel, source, x, y, source in attacked)
    panel.set_title(name(cell), pad=2)
    panel.set_aspect("equal")
    panel.axis("off")
    panel.set_xlim(places[:, 0].min() - 0.3, places[:, 0].max() + 0.3)
    panel.set_ylim(places[:, 1].min() - 0.3, places[:, 1].max() + 0.3)


def positions(weights: np.ndarray) -> np.ndarray:
    """Where the sources stand: around the navigator, or in a snake if few vehicles hear it."""
    m = len(weights)
    if (weights[:, 0] > 0).sum() * 3 >= m:
        angle = np.pi / 2 - 2 * np.pi * np.arange(m) / m
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.concatenate([np.zeros((1, 2)), circle])
    order = np.arange(m + 1)
    row, column = order // SNAKE, order % SNAKE
    column = np.where(row % 2, SNAKE - 1 - column, column)
    return np.stack([column, -row], axis=1) * 0.62


def draw_link(
    panel: Axes, source: np.ndarray, listener: np.ndarray, bend: float, look: dict[str, object]
) -> None:
    """An arrow that ends at the rim of the listener's node."""
    arrow = FancyArrowPatch(
        tuple(source),
        tuple(listener),
        connectionstyle=f"arc3,rad={bend}",
        arrowstyle="-|>,head_length=3.2,head_width=1.5",
        shrinkA=6,
        shrinkB=6,
        mutation_scale=1,
        zorder=1,
        **look,  # pyright: ignore[reportArgumentType]
    )
    panel.add_patch(arrow)


def label_weights(panel: Axes, weights: np.ndarray, places: np.ndarray) -> None:
    """Each link's weight, or where few values recur, one link of each value from navigator and vehicles."""
    links = [(int(i), int(j)) for i, j in np.argwhere(weights > 0)]
    classes: dict[tuple[bool, float], tuple[int, int]] = {}
    for i, j in links:
        classes.setdefault((j == 0, round(float(weights[i, j]), 6)), (i, j))
    labelled = links if len(links) <= 8 or len(classes) > 3 else list(classes.values())
    for i, j in labelled:
        middle = 0.5 * (places[i + 1] + places[j])
        along = places[i + 1] - places[j]
        aside = np.array([along[1], -along[0]]) / max(1e-9, float(np.hypot(*along)))
        mutual = j > 0 and weights[j - 1, i + 1] > 0  # bent arrows need more room
        x, y = middle + (0.22 if mutual else 0.12) * aside
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
        panel.text(x, y, f"{weights[i, j]:.3g}", fontsize=6.5, ha="center", va="center", bbox=box, zorder=4)


def draw_node(panel: Axes, source: int, x: float, y: float, lies: bool) -> None:
    """A numbered node: the navigator square and dark, an attacked vehicle in the attack's colour."""
    marker, face, text = ("s", "0.15", "white") if source == 0 else ("o", "white", "black")
    edge = style.RED if lies else "0.15"
    width = 1.6 if lies else 0.8
    panel.plot(
        x,
        y,
        marker,
        markersize=11,
        markerfacecolor=face,
        markeredgecolor=edge,
        markeredgewidth=width,
        zorder=2,
    )
    panel.text(x, y - 0.005, str(source), fontsize=6.5, ha="center", va="center", color=text, zorder=3)


def legend() -> list[Line2D]:
    """What is what."""
    node = {"linestyle": "", "markersize": 7}
    return [
        Line2D([], [], marker="s", color="0.15", label="navigator", **node),
        Line2D(
            [],
            [],
            marker="o",
            markerfacecolor="white",
            markeredgecolor=style.RED,
            markeredgewidth=1.6,
            color="white",
            label="attacked vehicle",
            **node,
        ),
        Line2D([], [], **TRUSTED, label="trusted link"),
        Line2D([], [], **ATTACKED, label="attacked link"),
        Line2D([], [], **PLAIN, label="other link"),
    ]
