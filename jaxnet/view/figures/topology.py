"""Graphs of a study with weights, attacked links and trusted links."""

import math
from collections.abc import Sequence
from functools import cached_property
from textwrap import shorten
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba_array
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch
from matplotlib.patheffects import withStroke

from jaxnet.config.cells import Cell
from jaxnet.config.naming import NO_BREAK, labels_title, value_name
from jaxnet.config.scenario import situation_of
from jaxnet.config.sweep import keys_in
from jaxnet.model.graph import Digraph
from jaxnet.model.wording import count_between
from jaxnet.runs.watched import MOST_VEHICLES
from jaxnet.statistics.groups import Label, evenly_over
from jaxnet.view.drawings.scene import attacked_vehicles
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.style import Figure

MOST_IN_ROW = 4  # graphs in a row
MATRICES_IN_ROW = 2  # of them, where any is shown by its matrix
LEAST_SNAKE_ROW = 4  # vehicles, at least, in a row of a graph that is more of a chain
SNAKE_SPACING = 0.62
NAVIGATOR_ASIDE, NAVIGATOR_ABOVE = -1.2, 0.25  # of a grid's spacing: in line with no row
MOST_ON_CIRCLE = 16  # more vehicles than this are too many for one circle
INNER_RADIUS = 0.8  # radius of a crowd's second circle
GRAPH_MARGIN = 0.3  # around the outermost nodes, where the vehicles stand on a unit circle
LEAST_TEXT_SIZE = 6.0  # [pt] type that can be read in print
NODE_DIAMETER = 11.0  # [pt] diameter of a node where there is room for it
TOPOLOGY_LEGEND_HEIGHT = 0.55  # [in]
LEAST_NUMBERED_NODE = 9.5  # [pt] diameter of a node whose number can be read
WANTED_SPACING = 18.0  # [pt] from one node to the next that panels grow for
LEAST_GRAPH = 108.0  # [pt] of a panel, and of its title
NODE_IN_WAY = 0.08  # of a link's length: a node so near to it is in the way
MOST_NAME = 16  # characters of a vehicle's name
MOST_WEIGHTS = 16  # links of a graph that all have their weights written on them
FEW_WEIGHTS, MOST_CLASSES = 8, 3  # links with labels however alike; distinct weights in a title
MAKERS = {"topology", "vehicles"}  # roots of keys that make a graph
MATRIX_BINS = 60  # of listeners, and of sources
STRIP_WIDTH = 0.05  # of the matrix's width, that the navigator's column takes
STRIP_GAP = 0.04  # of the width, from the navigator's column to the matrix
LINK_GREYS = (0.75, 0.15)  # of one link in a bin, and of as many as any bin has
LINK_LOOKS: dict[str, dict[str, Any]] = {
    "trusted link": {"color": style.BLUE, "linewidth": 1.6, "linestyle": "-"},
    "attacked link": {"color": style.RED, "linewidth": 1.0, "linestyle": (0, (3, 1.2))},
    "link of the navigator": {"color": "0.15", "linewidth": 1.2, "linestyle": "-", "zorder": 1.5},
    "other link": {"color": "0.62", "linewidth": 0.7, "linestyle": "-"},
}
REDRAWN = "one example: each lane has another graph"
HEAD = "|>,head_length=3.2,head_width=1.5"
WEIGHT_BOX = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}


def topology_name(cell: Cell) -> str:
    topology = cell.scenario.topology
    name = cell.labels.get("topology", topology.label or topology.kind)
    return value_name("topology", name)


def graph_labels(cell: Cell) -> dict[str, Label]:
    """The name of the graph, and the swept values that tell it from others of this name."""
    told = (key for key in cell.labels if {inner.split(".")[0] for inner in keys_in(key)} & MAKERS)
    return {"topology": topology_name(cell)} | {key: cell.labels[key] for key in told}


class DrawnGraph:
    """A graph as it is drawn: listeners count from 0, sources and places from the navigator."""

    def __init__(self, cell: Cell):
        self.cell, self.situation = cell, situation_of(cell.scenario)
        self.graph, self.attacked = self.situation.graph, attacked_vehicles(cell)
        self.is_large = self.graph.vehicles > MOST_VEHICLES
        self.places = source_places(self.graph, getattr(cell.scenario.topology, "columns", 0))
        extent = np.ptp(self.places, axis=0).max() + 2 * GRAPH_MARGIN
        apart = np.hypot(*(self.places[:-1] - self.places[-1]).T).min()
        self.spacing = float(apart / extent)  # of the last node from its neighbour, in widths
        self.weights = {} if self.is_large else self.graph.pairs()  # by listener and source
        # The distinct weights that the title tells, and whether the navigator has them.
        self.classes = sorted({(j == 0, round(w, 6)) for (_, j), w in self.weights.items()})
        if len(self.weights) <= (MOST_WEIGHTS if len(self.classes) > MOST_CLASSES else FEW_WEIGHTS):
            self.classes = []

    def diameter(self, size: float) -> float:
        """Diameter of a node [pt] in a panel of a size [pt]."""
        return min(NODE_DIAMETER, 0.8 * self.spacing * size)

    @property
    def labelled(self) -> list[tuple[int, int]]:
        """The links that get a weight label: all of few, whose weights the title does not tell."""
        return [] if self.classes else [*self.weights]

    @cached_property
    def names(self) -> dict[tuple[int, int], str]:
        """The legend's name of each link."""
        links, decides = self.graph.edges(), self.cell.scenario.defence.decides
        either = zip(self.situation.attacked[links], self.situation.trusted[links], strict=True)
        found = {}
        for ends, (lies, trusts) in zip(self.weights, either, strict=True):
            other = "other link" if ends[1] else "link of the navigator"
            found[ends] = "trusted link" if decides and trusts else other
            if self.attacked and lies:
                found[ends] = "attacked link"
        return found

    @property
    def title(self) -> str:
        """The graph's name, whether it is an example, and weights of many links."""
        inner = {key: value for key, value in graph_labels(self.cell).items() if key != "topology"}
        name = ", ".join(filter(None, [topology_name(self.cell), labels_title(inner)]))
        words = []
        for source, leads in (("neighbours", False), ("navigator", True)):
            weights = [f"{weight:.3g}" for of, weight in self.classes if of == leads]
            if len(weights) > MOST_CLASSES:
                weights = [f"{weights[0]} to {weights[-1]}"]
            words += [f"{source} {' or '.join(weights)}".replace(" ", NO_BREAK)] * bool(weights)
        lines = [multiples.escape_dollars(name)]
        lines += [REDRAWN] * self.cell.scenario.topology.redrawn()
        return "\n".join([*lines, *[f"weights: {', '.join(words)}"] * bool(words)])

    def bends(self, listener: int, source: int) -> bool:
        """Whether a link is bent: a link back looks otherwise, or a node is in the way."""
        ends = self.places[[source, listener + 1]]
        others = np.delete(self.places, [source, listener + 1], axis=0)
        along = ends[1] - ends[0]
        part = np.clip((others - ends[0]) @ along / (along @ along), 0.1, 0.9)
        from_link = np.hypot(*(others - ends[0] - part[:, None] * along).T)
        blocked = bool((from_link < NODE_IN_WAY * np.hypot(*along)).any())
        return blocked or self.back(listener, source) not in (None, self.names[listener, source])

    def back(self, listener: int, source: int) -> str | None:
        """The legend's name of the link back, if there is one."""
        return self.names.get((source - 1, listener + 1))


def source_places(graph: Digraph, columns: int = 0) -> Float[np.ndarray, "sources 2"]:
    """Places of navigator and vehicles: on a circle, a serpentine, or rows of so many `columns`.

    A chain, whose links are short in the order of the vehicles, is a serpentine behind the
    navigator, unless a third of the vehicles hear it. Else the navigator is the centre. Many
    vehicles alternate between two circles, which leaves space for the links between neighbours.
    """
    m = graph.vehicles
    if columns:
        row, column = np.divmod(np.arange(m), columns)
        navigator = [[NAVIGATOR_ASIDE, -(m / columns - 1) / 2 + NAVIGATOR_ABOVE]]
        return np.concatenate([navigator, np.stack([column, -row], axis=1)]) * SNAKE_SPACING
    informed = int((graph.heard & (graph.sources == 0)).sum())
    longest = max((abs(i + 1 - j) for i, j in graph.pairs() if j), default=0)
    if informed == 0 or informed * 3 >= m or longest > m / 2:
        angle = np.pi / 2 - 2 * np.pi * np.arange(m) / m
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        if m > MOST_ON_CIRCLE:
            circle[1::2] *= INNER_RADIUS
        return np.concatenate([np.zeros((1, 2)), circle])
    order, across = np.arange(m + 1), max(LEAST_SNAKE_ROW, math.isqrt(m) + 1)
    row, column = order // across, order % across
    column = np.where(row % 2, across - 1 - column, column)
    return np.stack([column, -row], axis=1) * SNAKE_SPACING


def topology_figure(cells: Sequence[Cell], width: float = style.FIGURE_WIDTH) -> Figure:
    """Draw a panel a graph with the most links attacked, random weights as medians."""
    there = networks_of(cells)
    wanted = [WANTED_SPACING / each.spacing for each in there if not each.is_large]
    most = MOST_IN_ROW if len(wanted) == len(there) else MATRICES_IN_ROW
    across = max(1, min(most, int(72 * width / max([LEAST_GRAPH, *wanted]))))
    columns = -(-len(there) // -(-len(there) // across))  # rows of alike length
    size = width / max(columns, min(across, 3 * width / style.FIGURE_WIDTH))
    most = columns * max(1, int((style.GREATEST_HEIGHT - TOPOLOGY_LEGEND_HEIGHT) / size))
    labels = [graph_labels(each.cell) for each in there]
    places = evenly_over(labels, most)
    shown = [there[place] for place in places]
    rows = -(-len(shown) // columns)
    drawn = Figure(figsize=(width, size * rows + TOPOLOGY_LEGEND_HEIGHT))
    grid = GridSpec(rows, columns, figure=drawn)
    for number, network in enumerate(shown):
        row, column = divmod(number, columns)
        panel = drawn.add_subplot(grid[row, column])
        letters, lines = multiples.TITLE_LETTERS_PER_INCH * size, network.title.split("\n")
        panel.set_title("\n".join(multiples.filled_lines(line, letters) for line in lines), pad=2)
        (draw_matrix if network.is_large else draw_graph)(panel, network, 72 * size)
    higher = multiples.write_legend(drawn, topology_legend(shown), handlelength=2.4)
    drawn.set_figheight(min(style.GREATEST_HEIGHT, drawn.get_figheight() + higher))
    small = [each for each in shown if not each.is_large]
    if any(each.diameter(72 * size) < LEAST_NUMBERED_NODE for each in small):
        words = "There is no room for the numbers of vehicles that are not attacked"
        multiples.write_note(drawn, words)
    attacks = [cell.scenario.attack for cell in cells]
    if drawn_for := {each.number() for each in attacks if each.number() and not each.targets()}:
        words = count_between(drawn_for, "attacked vehicle")
        multiples.write_note(drawn, f"{words} drawn for each lane, not marked here")
    part = [labels[place] for place in places], labels, "graphs"
    multiples.write_left_out(drawn, part, where="study.yaml")
    return drawn


def networks_of(cells: Sequence[Cell]) -> list[DrawnGraph]:
    """Each graph, of the cell with the most attacked links."""
    graphs: dict[tuple[Label, ...], list[DrawnGraph]] = {}
    for cell in cells:
        graphs.setdefault(tuple(graph_labels(cell).values()), []).append(DrawnGraph(cell))

    def attacked(network: DrawnGraph) -> int:
        return int(network.situation.attacked.sum()) if network.attacked else 0

    return [max(each, key=attacked) for each in graphs.values()]


def draw_graph(panel: Axes, network: DrawnGraph, size: float) -> None:
    """Draw a graph of this size [pt], arrows towards listeners."""
    places, across = network.places, network.diameter(size)
    edge = across / 2 + 0.5  # [pt] of a node
    for (i, j), called in network.names.items():
        both = network.back(i, j) == called
        if both and i >= j:
            continue  # drawn with the link back
        look: dict[str, Any] = {"shrinkA": edge, "shrinkB": edge, "mutation_scale": 1, "zorder": 1}
        look |= LINK_LOOKS[called] | {"arrowstyle": f"{'<' * both}{'|' * both}-{HEAD}"}
        bend = f"arc3,rad={0.16 if network.bends(i, j) else 0.0}"
        ends = tuple(places[j]), tuple(places[i + 1])
        panel.add_patch(FancyArrowPatch(*ends, connectionstyle=bend, **look))
    middle: dict[str, Any] = {"ha": "center", "va": "center"}
    for i, j in network.labelled:
        along = places[i + 1] - places[j]
        aside = np.array([along[1], -along[0]]) / max(1e-9, float(np.hypot(*along)))
        x, y = places[j] + along / 2 + (0.22 if network.bends(i, j) else 0.12) * aside
        weight = f"{network.weights[i, j]:.3g}"
        panel.text(x, y, weight, fontsize=6.5, bbox=WEIGHT_BOX, zorder=4, **middle)
    first = 0 if network.cell.scenario.navigator.present else 1
    for source, place in enumerate(places[first:], start=first):
        draw_node(panel, source, place, source in network.attacked, across)
    given = network.cell.scenario.topology.vehicle_names()
    for name, (x, y) in zip(given, places[1:], strict=False):
        side, anchor = (1, "bottom") if y > 0.1 else (-1, "top")  # above nodes in the upper half
        panel.annotate(
            multiples.escape_dollars(shorten(name, MOST_NAME, placeholder="…")),
            (x, y),
            xytext=(0, side * (across / 2 + 1)),
            textcoords="offset points",
            ha="center",
            va=anchor,
            fontsize=LEAST_TEXT_SIZE,
            zorder=5,
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
        )
    panel.set_aspect("equal", anchor="N")
    panel.axis("off")
    (left, low), (right, high) = places[first:].min(axis=0), places[first:].max(axis=0)
    panel.set_xlim(left - GRAPH_MARGIN, right + GRAPH_MARGIN)
    panel.set_ylim(low - GRAPH_MARGIN, high + GRAPH_MARGIN)


def draw_node(panel: Axes, source: int, place: np.ndarray, lies: bool, across: float) -> None:
    """Draw a node of a diameter [pt]; its number is written where the diameter permits.

    The navigator is a dark square. Attacked vehicles have the attack's colour. Both are large
    enough for a number.
    """
    if source == 0 or lies:
        across = max(across, LEAST_NUMBERED_NODE)
    marker, face, ink = ("s", "0.15", "white") if source == 0 else ("o", "white", "black")
    rim, width, front = (style.RED, 1.6, 2.5) if lies else ("0.15", 0.8, 2)
    look: dict[str, Any] = {"markersize": across, "markerfacecolor": face, "zorder": front}
    x, y = place
    panel.plot(x, y, marker, markeredgecolor=rim, markeredgewidth=width, **look)
    if across >= LEAST_NUMBERED_NODE:
        size = max(LEAST_TEXT_SIZE, 0.6 * across)
        written: dict[str, Any] = {"ha": "center", "va": "center", "color": ink, "zorder": 3}
        panel.text(x, y, str(source), fontsize=size, **written)


def draw_matrix(panel: Axes, network: DrawnGraph, size: float) -> None:
    """Draw listeners against sources, the navigator's column apart, and mark attacked sources."""
    graph, attacked = network.graph, network.attacked
    m, (listeners, slots) = graph.vehicles, graph.edges()
    sources = graph.sources[listeners, slots]
    edges = np.linspace(0.5, m + 0.5, MATRIX_BINS + 1)
    links, _, _ = np.histogram2d(listeners + 1, sources, bins=(edges, edges))
    heard, _ = np.histogram(listeners[sources == 0] + 1, bins=edges)
    shade = np.where(links > 0, np.interp(links, (0, max(1, links.max())), LINK_GREYS), 1.0)
    look: dict[str, Any] = {"interpolation": "nearest", "cmap": "gray", "vmin": 0, "vmax": 1}
    panel.imshow(shade, extent=(0.5, m + 0.5, m + 0.5, 0.5), **look)
    share = heard / np.histogram(np.arange(1, m + 1), bins=edges)[0]
    left, opaque = -(STRIP_GAP + STRIP_WIDTH) * m, np.where(share > 0, 0.25 + 0.75 * share, 0.0)
    strip = np.stack([to_rgba_array(style.BLUE, alpha) for alpha in opaque])
    beside = left, left + STRIP_WIDTH * m, m + 0.5, 0.5
    panel.imshow(strip, extent=beside, interpolation="nearest")
    above = np.full(len(attacked), -0.03 * m)
    panel.plot(attacked, above, "v", color=style.RED, markersize=3, zorder=3)
    panel.set(xlim=(left, m + 0.5), ylim=(m + 0.5, -0.06 * m), xlabel="source", ylabel="listener")
    panel.locator_params(nbins=4)


def topology_legend(shown: Sequence[DrawnGraph]) -> list[Line2D | Patch]:
    large, small = ([each for each in shown if each.is_large == wanted] for wanted in (True, False))
    handles: list[Line2D | Patch] = []
    node: dict[str, Any] = {"linestyle": "", "markersize": 7}
    if any(each.cell.scenario.navigator.present for each in small):
        handles.append(Line2D([], [], marker="s", color="0.15", label="navigator", **node))
    if any(each.attacked for each in small):
        rim = {"markerfacecolor": "white", "markeredgecolor": style.RED, "markeredgewidth": 1.6}
        handles.append(Line2D([], [], marker="o", label="attacked vehicle", **node, **rim))
    present = {called for each in small for called in each.names.values()}
    is_plain = present <= {"attacked link", "other link"}
    for called, look in LINK_LOOKS.items():
        if called in present:
            label = "link" if is_plain and called == "other link" else called
            handles.append(Line2D([], [], label=label, **look))
    if large:
        handles.append(Patch(color=str(LINK_GREYS[1]), label="links, darker where more"))
        handles.append(Patch(color=style.BLUE, label="who hears the navigator"))
    if any(each.attacked for each in large):
        marks: dict[str, Any] = {"linestyle": "", "marker": "v", "color": style.RED}
        handles.append(Line2D([], [], label="attacked vehicles", markersize=4, **marks))
    return handles
