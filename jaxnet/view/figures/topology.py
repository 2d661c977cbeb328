"""Graphs of a study with weights, attacked links and trusted links."""

import math
from collections.abc import Container, Sequence
from textwrap import shorten
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba_array
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch
from matplotlib.patheffects import withStroke

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.scenario import Situation, situation_of
from jaxnet.model.graph import Digraph
from jaxnet.runs.watched import MOST_VEHICLES
from jaxnet.view.figures import multiples, style
from jaxnet.view.figures.panels import attacked_vehicles, topology_name
from jaxnet.view.figures.style import Figure

MOST_IN_ROW = 4  # graphs in a row
MATRICES_IN_ROW = 2  # of them, where any is shown by its matrix
LEAST_SNAKE_ROW = 4  # vehicles, at least, in a row of a graph that is more of a chain
MOST_ON_CIRCLE = 16  # more vehicles than this are too many for one circle
INNER_RADIUS = 0.8  # radius of a crowd's second circle
GRAPH_MARGIN = 0.3  # around the outermost nodes, where the vehicles stand on a unit circle
LEAST_TEXT_SIZE = 6.0  # [pt] type that can be read in print
NODE_DIAMETER = 11.0  # [pt] diameter of a node where there is room for it
TOPOLOGY_LEGEND_HEIGHT = 0.55  # [in]
LEAST_NUMBERED_NODE = 9.5  # [pt] diameter of a node whose number can be read
WANTED_SPACING = 18.0  # [pt] from one node to the next that panels grow for
NODE_IN_WAY = 0.08  # of a link's length: a node so near its middle is in the way
MOST_NAME = 16  # characters of a vehicle's name
MOST_WEIGHTS = 16  # links of a graph that all have their weights written on them

MATRIX_BINS = 60  # of listeners, and of sources
STRIP_WIDTH = 0.05  # of the matrix's width, that the navigator's column takes
LINK_GREYS = (0.75, 0.15)  # of one link in a bin, and of as many as any bin has
STRIP_GAP = 0.04  # of the width, from the navigator's column to the matrix

OTHER_LINK = {"color": "0.55", "linewidth": 0.8, "linestyle": "-"}
TRUSTED_LINK = {"color": style.BLUE, "linewidth": 1.6, "linestyle": "-"}
ATTACKED_LINK = {"color": style.RED, "linewidth": 1.0, "linestyle": (0, (3, 1.2))}
ARROW: dict[str, Any] = {
    "arrowstyle": "-|>,head_length=3.2,head_width=1.5",
    "mutation_scale": 1,
    "zorder": 1,
}
LINK_STYLES: dict[str, dict[str, Any]] = {
    "trusted link": TRUSTED_LINK,
    "attacked link": ATTACKED_LINK,
    "other link": OTHER_LINK,
}


def topology_figure(cells: Sequence[Cell], width: float = style.FIGURE_WIDTH) -> Figure:
    """Draw a panel a graph with the most links attacked, random weights as medians."""
    there = [(cell, situation_of(cell.scenario)) for cell in most_attacked(cells)]
    across = graphs_per_row([network.graph for _, network in there], width)
    columns = min(across, len(there))
    size = width / max(columns, min(3, across))
    shown = there[: columns * max(1, int((style.GREATEST_HEIGHT - TOPOLOGY_LEGEND_HEIGHT) / size))]
    graphs = [network.graph for _, network in shown]
    rows = -(-len(shown) // columns)
    drawn = Figure(figsize=(width, size * rows + TOPOLOGY_LEGEND_HEIGHT))
    for number, (cell, network) in enumerate(shown):
        draw_graph(drawn.add_subplot(rows, columns, number + 1), cell, network, 72 * size)
    multiples.write_legend(drawn, topology_legend(shown), 5, handlelength=2.4)
    words = omitted_labels(graphs, 72 * size)
    if words:
        multiples.write_note(drawn, f"There is no room for {' and '.join(words)}")
    multiples.write_left_out(drawn, (len(shown), len(there), "graphs"), where="study.yaml")
    return drawn


def most_attacked(cells: Sequence[Cell]) -> list[Cell]:
    graphs: dict[str, list[Cell]] = {}
    for cell in cells:
        graphs.setdefault(topology_name(cell), []).append(cell)

    def most_attack(cell: Cell) -> tuple[int, int]:
        return attacked_links(cell), cell.scenario.attack.number()

    return [max(each, key=most_attack) for each in graphs.values()]


def graphs_per_row(graphs: Sequence[Digraph], width: float) -> int:
    """The number of graphs in a row that keeps WANTED_SPACING between nodes."""
    wanted = [WANTED_SPACING / node_spacing(graph, 1.0) for graph in graphs if not too_large(graph)]
    most = MOST_IN_ROW if len(wanted) == len(graphs) else MATRICES_IN_ROW
    return max(1, min(most, int(72 * width / max(wanted, default=1.0))))


def node_spacing(graph: Digraph, size: float) -> float:
    """Distance from the last node to its nearest neighbour [pt] in a panel of a size [pt]."""
    places = source_positions(graph)
    extent = np.ptp(places, axis=0).max() + 2 * GRAPH_MARGIN
    return float(np.hypot(*(places[:-1] - places[-1]).T).min() / extent * size)


def node_diameter(graph: Digraph, size: float) -> float:
    return min(NODE_DIAMETER, 0.8 * node_spacing(graph, size))


def omitted_labels(graphs: Sequence[Digraph], size: float) -> list[str]:
    """Descriptions of the labels that do not fit panels of this size [pt]."""
    words, graphs = [], [graph for graph in graphs if not too_large(graph)]
    if any(node_diameter(graph, size) < LEAST_NUMBERED_NODE for graph in graphs):
        words.append("the numbers of vehicles that are not attacked")
    if any(graph.heard.any() and not labelled_links(graph) for graph in graphs):
        words.append("the weights of all links")
    return words


def attacked_links(cell: Cell) -> int:
    """The number of attacked links; 0 if the attack has magnitude 0."""
    return int(situation_of(cell.scenario).attacked.sum()) if attacked_vehicles(cell) else 0


def link_names(cell: Cell, network: Situation) -> dict[tuple[int, int], str]:
    """The legend's name of each link (vehicle from 0, source)."""
    attacked, decides = attacked_vehicles(cell), cell.scenario.defence.decides
    links = network.graph.edges()
    either = zip(network.attacked[links].tolist(), network.trusted[links].tolist(), strict=True)
    return {
        ends: "attacked link"
        if attacked and lies
        else "trusted link"
        if decides and trusts
        else "other link"
        for ends, (lies, trusts) in zip(network.graph.pairs(), either, strict=True)
    }


def draw_graph(panel: Axes, cell: Cell, network: Situation, size: float) -> None:
    """Draw a graph of this size [pt], arrows towards listeners, large graphs as densities."""
    panel.set_title(graph_title(cell, network.graph), pad=2)
    if too_large(network.graph):
        draw_adjacency(panel, network, attacked_vehicles(cell))
        return
    places = source_positions(network.graph)
    attacked = attacked_vehicles(cell)
    across = node_diameter(network.graph, size)
    names = link_names(cell, network)
    for (i, j), called in names.items():
        bend = 0.16 if is_bent(i, j, names, places) else 0.0
        edge = across / 2 + 0.5  # [pt] of a node
        rim: dict[str, Any] = {"shrinkA": edge, "shrinkB": edge}
        ends, look = (tuple(places[j]), tuple(places[i + 1])), rim | LINK_STYLES[called] | ARROW
        panel.add_patch(FancyArrowPatch(*ends, connectionstyle=f"arc3,rad={bend}", **look))
    if network.graph.vehicles <= MOST_ON_CIRCLE or not weight_classes(network.graph):
        label_weights(panel, network.graph, places)
    first = 0 if cell.scenario.navigator.present else 1
    for source, (x, y) in enumerate(places[first:], start=first):
        draw_node(panel, source, x, y, source in attacked, across)
    for name, (x, y) in zip(cell.scenario.topology.vehicle_names(), places[1:], strict=False):
        write_name(panel, name, x, y, across)
    panel.set_aspect("equal")
    panel.axis("off")
    panel.set_xlim(places[:, 0].min() - GRAPH_MARGIN, places[:, 0].max() + GRAPH_MARGIN)
    panel.set_ylim(places[:, 1].min() - GRAPH_MARGIN, places[:, 1].max() + GRAPH_MARGIN)


def source_positions(graph: Digraph) -> np.ndarray:
    """Positions of navigator and vehicles in the drawing, on a circle or a serpentine.

    The navigator stands in the centre where a third of the vehicles hear it, or nobody does. Many
    vehicles alternate between two circles, which leaves space for the links between neighbours.
    """
    m = graph.vehicles
    informed = int((graph.heard & (graph.sources == 0)).sum())
    if informed == 0 or informed * 3 >= m:
        angle = np.pi / 2 - 2 * np.pi * np.arange(m) / m
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        if m > MOST_ON_CIRCLE:
            circle[1::2] *= INNER_RADIUS
        return np.concatenate([np.zeros((1, 2)), circle])
    order, across = np.arange(m + 1), max(LEAST_SNAKE_ROW, math.isqrt(m) + 1)
    row, column = order // across, order % across
    column = np.where(row % 2, across - 1 - column, column)
    return np.stack([column, -row], axis=1) * 0.62


def is_bent(
    listener: int, source: int, links: Container[tuple[int, int]], places: np.ndarray
) -> bool:
    """Whether the arrow of a link is bent: there is a link back, or a node stands in the way.

    Listeners count from 0, places and sources from the navigator.
    """
    ends = places[[source, listener + 1]]
    others = np.delete(places, [source, listener + 1], axis=0)
    from_middle = np.hypot(*(others - ends.mean(axis=0)).T)
    blocked = bool((from_middle < NODE_IN_WAY * np.hypot(*(ends[1] - ends[0]))).any())
    return blocked or (source - 1, listener + 1) in links


def weight_classes(graph: Digraph) -> dict[tuple[bool, float], tuple[int, int]]:
    """The distinct weights with an example link each, if they are few; else nothing."""
    classes: dict[tuple[bool, float], tuple[int, int]] = {}
    weights = graph.pairs()
    for (i, j), weight in weights.items():
        classes.setdefault((j == 0, round(weight, 6)), (i, j))
    return classes if len(weights) > 8 and len(classes) <= 3 else {}


def labelled_links(graph: Digraph) -> list[tuple[int, int]]:
    """The links that get a weight label: all, or one per weight, or none of too many."""
    links = list(graph.pairs())
    return list(weight_classes(graph).values()) or (links if len(links) <= MOST_WEIGHTS else [])


def graph_title(cell: Cell, graph: Digraph) -> str:
    """The title of a graph; the title of a large graph includes the weights that recur."""
    words = [
        f"{weight:.3g} from {'0' if navigator else 'vehicles'}"
        for navigator, weight in weight_classes(graph)
    ]
    crowded = graph.vehicles > MOST_ON_CIRCLE and words
    caption = multiples.escape_dollars(graph_caption(cell))
    return f"{caption}\nweights: {', '.join(words)}" if crowded else caption


def graph_caption(cell: Cell) -> str:
    """The name of a graph, and the number of attacked vehicles where they are random."""
    attack = cell.scenario.attack
    unmarked = attack.amplitude() != 0 and not attack.targets() and attack.number()
    return topology_name(cell) + (f", attacked: {attack.whom()}" if unmarked else "")


def label_weights(panel: Axes, graph: Digraph, places: np.ndarray) -> None:
    weights = graph.pairs()
    for i, j in labelled_links(graph):
        middle = 0.5 * (places[i + 1] + places[j])
        along = places[i + 1] - places[j]
        aside = np.array([along[1], -along[0]]) / max(1e-9, float(np.hypot(*along)))
        x, y = middle + (0.22 if is_bent(i, j, weights, places) else 0.12) * aside
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
        panel.text(
            x, y, f"{weights[i, j]:.3g}", fontsize=6.5, ha="center", va="center", bbox=box, zorder=4
        )


def draw_node(panel: Axes, source: int, x: float, y: float, lies: bool, across: float) -> None:
    """Draw a node of a diameter [pt]; its number is written where the diameter permits.

    The navigator is a dark square. Attacked vehicles have the attack's colour. Both are large
    enough for a number.
    """
    if source == 0 or lies:
        across = max(across, LEAST_NUMBERED_NODE)
    marker, face, ink = ("s", "0.15", "white") if source == 0 else ("o", "white", "black")
    look: dict[str, Any] = {"markersize": across, "markerfacecolor": face}
    look |= {"markeredgecolor": style.RED if lies else "0.15"}
    look |= {"markeredgewidth": 1.6 if lies else 0.8, "zorder": 2.5 if lies else 2}
    panel.plot(x, y, marker, **look)
    if across >= LEAST_NUMBERED_NODE:
        size = max(LEAST_TEXT_SIZE, 0.6 * across)
        written: dict[str, Any] = {"ha": "center", "va": "center", "color": ink, "zorder": 3}
        panel.text(x, y, str(source), fontsize=size, **written)


def write_name(panel: Axes, name: str, x: float, y: float, across: float) -> None:
    """Write the name of a vehicle beside its node of a diameter [pt], away from the centre."""
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


def topology_legend(shown: Sequence[tuple[Cell, Situation]]) -> list[Line2D | Patch]:
    large = [cell for cell, network in shown if too_large(network.graph)]
    small = [each for each in shown if not too_large(each[1].graph)]
    handles: list[Line2D | Patch] = []
    node: dict[str, Any] = {"linestyle": "", "markersize": 7}
    rim = {"markerfacecolor": "white", "markeredgecolor": style.RED, "markeredgewidth": 1.6}
    if any(cell.scenario.navigator.present for cell, _ in small):
        handles.append(Line2D([], [], marker="s", color="0.15", label="navigator", **node))
    if any(attacked_vehicles(cell) for cell, _ in small):
        look = node | rim | {"marker": "o", "color": "white"}
        handles.append(Line2D([], [], label="attacked vehicle", **look))
    present = {called for cell, network in small for called in link_names(cell, network).values()}
    plain = {}
    if small and (len(present) == 1 or is_leaderless([cell for cell, _ in small])):
        plain = {"other link": "link"}
    looks = [(called, look) for called, look in LINK_STYLES.items() if called in present]
    handles += [Line2D([], [], **look, label=plain.get(called, called)) for called, look in looks]
    if large:
        handles.append(Patch(color=str(LINK_GREYS[1]), label="links, darker where more"))
        handles.append(Patch(color=style.BLUE, label="who hears the navigator"))
    if any(attacked_vehicles(cell) for cell in large):
        look: dict[str, Any] = {"linestyle": "", "marker": "v", "color": style.RED}
        handles.append(Line2D([], [], label="attacked vehicles", markersize=4, **look))
    return handles


def too_large(graph: Digraph) -> bool:
    """Whether a graph has too many vehicles to draw one by one."""
    return graph.vehicles > MOST_VEHICLES


def draw_adjacency(panel: Axes, network: Situation, attacked: list[int]) -> None:
    """Draw listeners against sources, the navigator's column apart, and mark attacked sources."""
    graph = network.graph
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
    panel.imshow(
        strip, extent=(left, left + STRIP_WIDTH * m, m + 0.5, 0.5), interpolation="nearest"
    )
    panel.plot(
        attacked, np.full(len(attacked), -0.03 * m), "v", color=style.RED, markersize=3, zorder=3
    )
    panel.set(xlim=(left, m + 0.5), ylim=(m + 0.5, -0.06 * m), xlabel="source", ylabel="listener")
    panel.locator_params(nbins=4)
