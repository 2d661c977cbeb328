"""Who hears whom in a fleet too large to draw each vehicle: the adjacency matrix, as a density of links."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxnet.config.scenario import Situation
from jaxnet.model.graph import Digraph
from jaxnet.view.figures import style

MOST_DRAWN = 300  # vehicles that are drawn one by one
BINS = 60  # of listeners, and of sources
STRIP = 0.05  # of the matrix's width, that the navigator's column takes
GREYS = ("0.75", "0.15")  # of one link in a bin, and of as many as any bin has
REST = 0.04  # of the width, from the navigator's column to the matrix


def too_large(graph: Digraph) -> bool:
    """Whether a graph's vehicles cannot be told from each other in a panel."""
    return graph.vehicles > MOST_DRAWN


def draw(panel: Axes, network: Situation, attacked: list[int]) -> None:
    """Listeners by sources, the navigator's column apart; who is attacked is marked above their columns."""
    graph = network.graph
    m, (listeners, slots) = graph.vehicles, graph.edges()
    sources = graph.sources[listeners, slots]
    edges = np.linspace(0.5, m + 0.5, BINS + 1)
    links, _, _ = np.histogram2d(listeners + 1, sources, bins=(edges, edges))
    heard, _ = np.histogram(listeners[sources == 0] + 1, bins=edges)
    shade = float(GREYS[0]) + (float(GREYS[1]) - float(GREYS[0])) * links / max(1.0, links.max())
    shade[links == 0] = 1.0
    panel.imshow(
        shade, cmap="gray", vmin=0, vmax=1, extent=(0.5, m + 0.5, m + 0.5, 0.5), interpolation="nearest"
    )
    share = heard / np.histogram(np.arange(1, m + 1), bins=edges)[0]
    left = -(REST + STRIP) * m
    for top, bottom, each in zip(edges[:-1], edges[1:], share, strict=True):
        if each:
            box = {"color": style.BLUE, "alpha": 0.25 + 0.75 * each, "linewidth": 0}
            panel.fill_between([left, left + STRIP * m], top, bottom, **box)
    panel.plot(attacked, np.full(len(attacked), -0.03 * m), "v", color=style.RED, markersize=3, zorder=3)
    panel.set(xlim=(left, m + 0.5), ylim=(m + 0.5, -0.06 * m), xlabel="source", ylabel="listener")
    panel.locator_params(nbins=4)


def legend(attacked: bool) -> list[Patch | Line2D]:
    """What is what."""
    marks = {"linestyle": "", "marker": "v", "markersize": 4, "color": style.RED}
    return [
        Patch(color=GREYS[1], label="links, darker where more"),
        Patch(color=style.BLUE, label="who hears the navigator"),
        *[Line2D([], [], label="attacked vehicles", **marks)] * attacked,
    ]
