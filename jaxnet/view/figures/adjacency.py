"""The adjacency matrix of a large fleet, drawn as a density of links."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba_array
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxnet.config.scenario import Situation
from jaxnet.model.graph import Digraph
from jaxnet.runs.watched import MOST_VEHICLES
from jaxnet.view.figures import style

MATRIX_BINS = 60  # of listeners, and of sources
STRIP_WIDTH = 0.05  # of the matrix's width, that the navigator's column takes
LINK_GREYS = (0.75, 0.15)  # of one link in a bin, and of as many as any bin has
STRIP_GAP = 0.04  # of the width, from the navigator's column to the matrix


def too_large(graph: Digraph) -> bool:
    """Return whether a graph has too many vehicles to draw one by one."""
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


def adjacency_legend(attacked: bool) -> list[Patch | Line2D]:
    """Return legend entries for a density of links."""
    marks = {"linestyle": "", "marker": "v", "markersize": 4, "color": style.RED}
    return [
        Patch(color=str(LINK_GREYS[1]), label="links, darker where more"),
        Patch(color=style.BLUE, label="who hears the navigator"),
        *[Line2D([], [], label="attacked vehicles", **marks)] * attacked,
    ]
