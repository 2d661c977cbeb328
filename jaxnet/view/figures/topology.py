"""Who hears whom: the graphs of a study with their weights, attacked and trusted links."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch

from jaxnet.config.cells import Cell
from jaxnet.config.scenario import Situation, situation_of
from jaxnet.model.graph import Digraph
from jaxnet.view.figures import adjacency, multiples, style
from jaxnet.view.figures.panels import attacked_vehicles, name
from jaxnet.view.figures.style import Figure

MOST_IN_ROW = 4  # graphs in a row
MATRICES_IN_ROW = 2  # of them, where any is shown by its matrix
SNAKE = 4  # vehicles, at least, in a row of a graph that is more of a chain
CROWD = 16  # more vehicles than this are too many for one circle
INNER = 0.8  # radius of a crowd's second circle
EDGE = 0.3  # around the outermost nodes, where the vehicles stand on a unit circle
SMALLEST = 6.0  # [pt] type that can be read in print
NODE = 11.0  # [pt] diameter of a node where there is room for it
KEY_HEIGHT = 0.55  # [in]
LEGIBLE = 9.5  # [pt] diameter of a node whose number can be read
APART = 18.0  # [pt] from one node to the next that panels grow for
MOST_WEIGHTS = 16  # links of a graph that all have their weights written on them

PLAIN = {"color": "0.55", "linewidth": 0.8, "linestyle": "-"}
TRUSTED = {"color": style.BLUE, "linewidth": 1.6, "linestyle": "-"}
ATTACKED = {"color": style.RED, "linewidth": 1.0, "linestyle": (0, (3, 1.2))}
LINKS = {"trusted link": TRUSTED, "attacked link": ATTACKED, "other link": PLAIN}


def figure(cells: Sequence[Cell], width: float = style.WIDTH) -> Figure:
    """One panel per graph, as a page has room for, each with the most attacked links that the study has.

    Weights that are drawn lane by lane are those of the graph of their medians.
    """
    there = [(cell, situation_of(cell.scenario)) for cell in most_attacked(cells)]
    across = side_by_side([network.graph for _, network in there], width)
    columns = min(across, len(there))
    size = width / max(columns, min(3, across))
    shown = there[: columns * max(1, int((style.TALLEST - KEY_HEIGHT) / size))]
    graphs = [network.graph for _, network in shown]
    rows = -(-len(shown) // columns)
    drawn = Figure(figsize=(width, size * rows + KEY_HEIGHT))
    for number, (cell, network) in enumerate(shown):
        draw_graph(drawn.add_subplot(rows, columns, number + 1), cell, network, 72 * size)
    handles, ncols = legend(shown), multiples.legend_columns(width, 5)
    drawn.legend(handles=handles, loc="outside lower center", ncols=ncols, handlelength=2.4)
    words = left_out(graphs, 72 * size)
    if words:
        multiples.note(drawn, f"There is no room for {' and '.join(words)}")
    multiples.note_left_out(drawn, (len(shown), len(there), "graphs"), where="study.yaml")
    return drawn


def most_attacked(cells: Sequence[Cell]) -> list[Cell]:
    """Of each graph the cell with the most attacked links."""
    graphs: dict[str, Cell] = {}
    for cell in cells:
        known = graphs.get(name(cell))
        if known is None or attacked_links(cell) > attacked_links(known):
            graphs[name(cell)] = cell
    return list(graphs.values())


def side_by_side(graphs: Sequence[Digraph], width: float) -> int:
    """How many graphs stand in a row: as many as leave APART between the nodes of each."""
    wanted = [APART / spacing(graph, 1.0) for graph in graphs if not adjacency.too_large(graph)]
    most = MOST_IN_ROW if len(wanted) == len(graphs) else MATRICES_IN_ROW
    return max(1, min(most, int(72 * width / max(wanted, default=1.0))))


def spacing(graph: Digraph, size: float) -> float:
    """From the last node to the nearest in a panel of this size [pt]."""
    places = positions(graph)
    extent = np.ptp(places, axis=0).max() + 2 * EDGE
    return float(np.hypot(*(places[:-1] - places[-1]).T).min() / extent * size)


def diameter(graph: Digraph, size: float) -> float:
    """Of a node in a panel of this size [pt]."""
    return min(NODE, 0.8 * spacing(graph, size))


def left_out(graphs: Sequence[Digraph], size: float) -> list[str]:
    """What panels of this size [pt] have no room for."""
    words, graphs = [], [graph for graph in graphs if not adjacency.too_large(graph)]
    if any(diameter(graph, size) < LEGIBLE for graph in graphs):
        words.append("the numbers of vehicles that are not attacked")
    if any(graph.heard.any() and not labelled_links(graph) for graph in graphs):
        words.append("the weights of all links")
    return words


def attacked_links(cell: Cell) -> int:
    """Number of attacked links, none if the attack has no size."""
    return int(situation_of(cell.scenario).attacked.sum()) if attacked_vehicles(cell) else 0


def link_names(cell: Cell, network: Situation) -> dict[tuple[int, int], str]:
    """What the legend calls the link of each vehicle, from 0, with each source that it hears."""
    attacked, decides = attacked_vehicles(cell), cell.scenario.defence.decides
    links = network.graph.edges()
    either = zip(network.attacked[links].tolist(), network.trusted[links].tolist(), strict=True)
    return {
        ends: "attacked link" if attacked and lies else "trusted link" if decides and trusts else "other link"
        for ends, (lies, trusts) in zip(network.graph.pairs(), either, strict=True)
    }


def draw_graph(panel: Axes, cell: Cell, network: Situation, size: float) -> None:
    """Arrows run as the signals do, from the source to the vehicle that hears it, on size [pt].

    A large fleet's links are a density.
    """
    panel.set_title(heading(cell, network.graph), pad=2)
    if adjacency.too_large(network.graph):
        adjacency.draw(panel, network, attacked_vehicles(cell))
        return
    places = positions(network.graph)
    attacked = attacked_vehicles(cell)
    across = diameter(network.graph, size)
    names = link_names(cell, network)
    for (i, j), called in names.items():
        mutual = (j - 1, i + 1) in names
        bend = 0.16 if mutual else 0.0
        draw_link(panel, places[j], places[i + 1], bend, across / 2 + 0.5, LINKS[called])
    if network.graph.vehicles <= CROWD or not weight_classes(network.graph):
        label_weights(panel, network.graph, places)
    for source, (x, y) in enumerate(places):
        draw_node(panel, source, x, y, source in attacked, across)
    panel.set_aspect("equal")
    panel.axis("off")
    panel.set_xlim(places[:, 0].min() - EDGE, places[:, 0].max() + EDGE)
    panel.set_ylim(places[:, 1].min() - EDGE, places[:, 1].max() + EDGE)


def positions(graph: Digraph) -> np.ndarray:
    """Where the sources stand: around the navigator, or in a snake if few vehicles hear it.

    A crowd stands on two circles by turns, which leaves room for the links between neighbours.
    """
    m = graph.vehicles
    if (graph.heard & (graph.sources == 0)).sum() * 3 >= m:
        angle = np.pi / 2 - 2 * np.pi * np.arange(m) / m
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        if m > CROWD:
            circle[1::2] *= INNER
        return np.concatenate([np.zeros((1, 2)), circle])
    order, across = np.arange(m + 1), max(SNAKE, math.isqrt(m) + 1)
    row, column = order // across, order % across
    column = np.where(row % 2, across - 1 - column, column)
    return np.stack([column, -row], axis=1) * 0.62


def draw_link(
    panel: Axes, source: np.ndarray, listener: np.ndarray, bend: float, rim: float, look: dict[str, object]
) -> None:
    """An arrow that ends at the rim of the listener's node, so far from its middle [pt]."""
    arrow = FancyArrowPatch(
        tuple(source),
        tuple(listener),
        connectionstyle=f"arc3,rad={bend}",
        arrowstyle="-|>,head_length=3.2,head_width=1.5",
        shrinkA=rim,
        shrinkB=rim,
        mutation_scale=1,
        zorder=1,
        **look,  # pyright: ignore[reportArgumentType]
    )
    panel.add_patch(arrow)


def weight_classes(graph: Digraph) -> dict[tuple[bool, float], tuple[int, int]]:
    """Weights of navigator and vehicles where there are few of them, with one link of each; else nothing."""
    classes: dict[tuple[bool, float], tuple[int, int]] = {}
    weights = graph.pairs()
    for (i, j), weight in weights.items():
        classes.setdefault((j == 0, round(weight, 6)), (i, j))
    return classes if len(weights) > 8 and len(classes) <= 3 else {}


def labelled_links(graph: Digraph) -> list[tuple[int, int]]:
    """All links, or where few values recur, one of each from navigator and vehicles; none of too many."""
    links = list(graph.pairs())
    return list(weight_classes(graph).values()) or (links if len(links) <= MOST_WEIGHTS else [])


def heading(cell: Cell, graph: Digraph) -> str:
    """A graph's name; in a crowd, where no label is clear of the nodes, with the weights that recur."""
    words = [
        f"{weight:.3g} from {'0' if navigator else 'vehicles'}" for navigator, weight in weight_classes(graph)
    ]
    crowded = graph.vehicles > CROWD and words
    return f"{caption(cell)}\nweights: {', '.join(words)}" if crowded else caption(cell)


def caption(cell: Cell) -> str:
    """A graph's name, and how many are attacked where who they are is drawn."""
    attack = cell.scenario.attack
    unmarked = attack.amplitude() != 0 and not attack.targets() and attack.number()
    return name(cell) + (f", attacked: {attack.whom()}" if unmarked else "")


def label_weights(panel: Axes, graph: Digraph, places: np.ndarray) -> None:
    """Write the weights beside their links."""
    weights = graph.pairs()
    for i, j in labelled_links(graph):
        middle = 0.5 * (places[i + 1] + places[j])
        along = places[i + 1] - places[j]
        aside = np.array([along[1], -along[0]]) / max(1e-9, float(np.hypot(*along)))
        mutual = (j - 1, i + 1) in weights  # bent arrows need more room
        x, y = middle + (0.22 if mutual else 0.12) * aside
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
        panel.text(x, y, f"{weights[i, j]:.3g}", fontsize=6.5, ha="center", va="center", bbox=box, zorder=4)


def draw_node(panel: Axes, source: int, x: float, y: float, lies: bool, across: float) -> None:
    """A node so many points across: the navigator square and dark, attacked vehicles in the attack's colour.

    It has its number if that can be read; navigator and attacked vehicles are as large as that takes.
    """
    if source == 0 or lies:
        across = max(across, LEGIBLE)
    marker, face, text = ("s", "0.15", "white") if source == 0 else ("o", "white", "black")
    edge = style.RED if lies else "0.15"
    width = 1.6 if lies else 0.8
    panel.plot(
        x,
        y,
        marker,
        markersize=across,
        markerfacecolor=face,
        markeredgecolor=edge,
        markeredgewidth=width,
        zorder=2.5 if lies else 2,
    )
    if across >= LEGIBLE:
        panel.text(
            x,
            y,
            str(source),
            fontsize=max(SMALLEST, 0.6 * across),
            ha="center",
            va="center",
            color=text,
            zorder=3,
        )


def legend(shown: Sequence[tuple[Cell, Situation]]) -> list[Line2D | Patch]:
    """What is what, of what is there."""
    large = [each for each in shown if adjacency.too_large(each[1].graph)]
    keys = adjacency.legend(any(attacked_vehicles(cell) for cell, _ in large)) if large else []
    return of_nodes([each for each in shown if not adjacency.too_large(each[1].graph)]) + keys


def of_nodes(shown: Sequence[tuple[Cell, Situation]]) -> list[Line2D | Patch]:
    """What is what, where vehicles are drawn one by one."""
    if not shown:
        return []
    node = {"linestyle": "", "markersize": 7}
    handles: list[Line2D | Patch] = [Line2D([], [], marker="s", color="0.15", label="navigator", **node)]
    if any(attacked_vehicles(cell) for cell, _ in shown):
        rim = {"markerfacecolor": "white", "markeredgecolor": style.RED, "markeredgewidth": 1.6}
        handles.append(Line2D([], [], marker="o", color="white", label="attacked vehicle", **rim, **node))
    present = {called for cell, network in shown for called in link_names(cell, network).values()}
    looks = [(called, look) for called, look in LINKS.items() if called in present]
    return handles + [Line2D([], [], **look, label=called) for called, look in looks]
