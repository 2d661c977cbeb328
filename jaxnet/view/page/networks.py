"""Drawings of the networks of a study."""

from collections.abc import Sequence
from html import escape
from textwrap import shorten

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.config.scenario import Situation, situation_of
from jaxnet.model.wording import count
from jaxnet.view.figures.panels import attacked_vehicles
from jaxnet.view.figures.topology import (
    MOST_NAME,
    graph_caption,
    is_bent,
    is_upper,
    link_names,
    link_word,
    most_attacked,
    source_positions,
    too_large,
)

MOST_DRAWN = 6
NODE_RADIUS = 11.0  # greatest radius, where vehicles stand on a circle of 100
ARROW_BEND = 0.15
MARGIN = 20.0  # around the outermost nodes
NAME_MARGIN = 40.0  # the same, with names of vehicles


def networks_html(cells: Sequence[Cell]) -> str:
    """Return drawings of the first MOST_DRAWN networks with a legend, as HTML."""
    graphs = most_attacked(cells)
    known = [(cell, situation_of(cell.scenario)) for cell in graphs]
    shown = [each for each in known if not too_large(each[1].graph)][:MOST_DRAWN]
    if not shown:
        return "<p>Too large to be drawn here: as densities of links in figures/topologies.</p>"
    called = [
        *["navigator"] * any(cell.scenario.navigator.present for cell, _ in shown),
        "vehicle",
        *["attacked vehicle"] * any(attacked_vehicles(cell) for cell, _ in shown),
    ]
    links = sorted({link for each in shown for link in link_names(*each).values()})
    words = {"other link": link_word([cell for cell, _ in shown], links)}
    key = "".join(
        f"<li>{legend_sample(each)}{words.get(each, each)}</li>" for each in [*called, *links]
    )
    left = len(graphs) - len(shown)
    note = f"<p>{count(left, 'more network')}, as certificates below.</p>" if left else ""
    networks = "".join(network_svg(*each) for each in shown)
    return f'<ul class="key">{key}</ul><div class="networks">{networks}</div>{note}'


def legend_sample(called: str) -> str:
    """Return a sample of a node or link for the legend, as SVG."""
    link = called.endswith("link")
    drawn = (
        f'<path d="M0 7H34" class="{called}"/>'
        if link
        else node_svg(called, np.array([17, 7]), 5.0)
    )
    return f'<svg class="network" viewBox="0 0 34 14" aria-hidden="true">{drawn}</svg>'


def node_svg(called: str, place: np.ndarray, radius: float) -> str:
    """Return a node as SVG: a square for the navigator, a circle for a vehicle."""
    (x, y), across = place, 2 * radius
    if called == "navigator":
        corner = f'x="{x - radius:.1f}" y="{y - radius:.1f}"'
        return f'<rect {corner} width="{across:.1f}" height="{across:.1f}" class="{called}"/>'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" class="{called}"/>'


def network_svg(cell: Cell, situation: Situation) -> str:
    """Return the drawing of a network; arrows point from the source to the vehicle that hears it."""
    unit = source_positions(situation.graph)
    places = 100 * unit * [1, -1]
    gaps = np.hypot(*(places[:, None] - places[None]).T) + np.diag(np.full(len(places), np.inf))
    radius = min(NODE_RADIUS, 0.4 * float(gaps.min()))
    drawn = []
    names = link_names(cell, situation)
    for (i, j), called in names.items():
        bend = ARROW_BEND * is_bent(i, j, names, unit)
        drawn.append(arrow_path(places[j], places[i + 1], radius, bend, called))
    attacked, vehicles = attacked_vehicles(cell), ["", *cell.scenario.topology.vehicle_names()]
    first = 0 if cell.scenario.navigator.present else 1
    for source, place in enumerate(places[first:], start=first):
        called = (
            ("attacked vehicle" if source in attacked else "vehicle") if source else "navigator"
        )
        number = f'x="{place[0]:.1f}" y="{place[1]:.1f}" font-size="{1.1 * radius:.1f}"'
        drawn += [node_svg(called, place, radius), f"<text {number}>{source}</text>"]
        if source < len(vehicles) and vehicles[source]:
            away = np.array([0.0, -1.7 if is_upper(unit[source][1]) else 1.7])
            drawn.append(name_svg(vehicles[source], place + away * radius, radius))
    margin = NAME_MARGIN if any(vehicles) else MARGIN
    (left, top), (width, height) = places.min(axis=0) - margin, np.ptp(places, axis=0) + 2 * margin
    title, box = escape(graph_caption(cell)), f"{left:.0f} {top:.0f} {width:.0f} {height:.0f}"
    return (
        f'<figure><svg class="network" viewBox="{box}" role="img" aria-label="network {title}">'
        f"{''.join(drawn)}</svg><figcaption>{title}</figcaption></figure>"
    )


def name_svg(name: str, place: np.ndarray, radius: float) -> str:
    """Return the name of a vehicle at a place, as SVG."""
    short, at = (
        escape(shorten(name, MOST_NAME, placeholder="…")),
        f'x="{place[0]:.1f}" y="{place[1]:.1f}"',
    )
    return f'<text class="name" {at} font-size="{0.9 * radius:.1f}">{short}</text>'


def arrow_path(
    source: np.ndarray, listener: np.ndarray, radius: float, bend: float, called: str
) -> str:
    """Return an arrow from rim to rim; `bend` times its length separates arrows of both directions."""
    length = np.hypot(*(listener - source))
    along = (listener - source) / length
    left = np.array([along[1], -along[0]])
    middle = 0.5 * (source + listener) + bend * length * left
    start, end = source + along * radius, listener - along * radius
    barbs = [end - 5 * along + side * left for side in (2.2, -2.2)]
    a, b, c, d, e = (f"{x:.1f} {y:.1f}" for x, y in (start, middle, end, *barbs))
    return f'<path d="M{a}Q{b} {c}M{d}L{c}L{e}" class="{called}"/>'
