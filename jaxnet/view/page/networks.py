"""Summary of a study in words, and drawings of its networks."""

from collections.abc import Callable, Sequence
from html import escape

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.config.scenario import Situation, situation_of
from jaxnet.config.study import Study
from jaxnet.config.wording import value_text
from jaxnet.kinds.kind import Kind
from jaxnet.model.wording import count
from jaxnet.statistics.curves import magnitude_words
from jaxnet.view.figures.adjacency import too_large
from jaxnet.view.figures.panels import attacked_vehicles, topology_name
from jaxnet.view.figures.topology import graph_caption, link_names, most_attacked, source_positions

MOST_DRAWN = 6
MOST_ALTERNATIVES = 6
NODE_RADIUS = 11.0  # greatest radius, where vehicles stand on a circle of 100
ARROW_BEND = 0.15


def study_sentences(study: Study) -> str:
    """Return the study in a few sentences."""
    cells = study.cells

    def among(say: Callable[[Cell], str]) -> str:
        found = list(dict.fromkeys(map(say, cells)))
        others = [count(len(found) - MOST_ALTERNATIVES, "other")] if len(found) > MOST_ALTERNATIVES else []
        return " or ".join(found[:MOST_ALTERNATIVES] + others)

    held = any(cell.scenario.law.holds for cell in cells)
    law = f" Law: {among(lambda cell: str(cell.labels.get('law', cell.scenario.law.kind)))}." if held else ""
    sensing = among(lambda cell: kind_words(cell.scenario.sensing, cell.scenario.sensing.exact()))
    losses = among(lambda cell: kind_words(cell.scenario.channel.loss, cell.scenario.channel.loss.perfect()))
    world = {"Errors of sensors": sensing, "Lost messages": losses}
    told = "".join(f" {what}: {words}." for what, words in world.items() if words != "none")
    vehicles = among(lambda cell: count(cell.scenario.vehicles, f"{cell.scenario.vehicle.kind} vehicle"))
    return (
        f"{vehicles} follow a {among(lambda cell: cell.scenario.navigator.kind)} navigator"
        f" for {among(lambda cell: f'{cell.scenario.horizon:g} s')}, from random starts."
        f" Network: {among(topology_name)}. Attack: {among(attack_words)}; {among(magnitude_words)}."
        f" Defence: {among(defence_words)}.{law}{told}"
        f" The {among(lambda cell: cell.scenario.engine.reference())} engine follows them, with ticks"
        f" {among(lambda cell: f'{cell.scenario.tick:g} s')} apart. The last"
        f" {among(lambda cell: f'{cell.scenario.tail:g} s')} are the tail, from which errors are told."
    )


def attack_words(cell: Cell) -> str:
    """Return the attack, the attacked vehicles, and whether they hear or transmit falsified signals."""
    attack = cell.scenario.attack
    if not attack.number() or attack.amplitude() == 0:
        return "none"
    from_navigator = situation_of(cell.scenario).attacked[:, 0].any()
    where = "what they hear of the navigator" if from_navigator else "what they transmit"
    caveat = f" ({attack.caveat()})" if attack.caveat() else ""
    return f"{attack.describe()}{caveat} on {attack.whom()} in {where}"


def defence_words(cell: Cell) -> str:
    """Return the name of the defence and its parameter."""
    defence = cell.scenario.defence
    given = {"ϑ": getattr(defence, "theta", None), "F": getattr(defence, "F", None)}
    told = [f"{symbol} = {value}" for symbol, value in given.items() if value is not None]
    return ", ".join([str(cell.labels.get("defence", defence.label or defence.kind)), *told])


def kind_words(kind: Kind, absent: bool) -> str:
    """Return the name and the given keys of a sensor or a loss, or `none`."""
    given = kind.model_dump(exclude_defaults=True).items()
    told = [f"{key} = {value_text(value)}" for key, value in given if key not in ("kind", "label")]
    return "none" if absent else ", ".join([kind.label or kind.reference(), *told])


def networks_html(cells: Sequence[Cell]) -> str:
    """Return drawings of the first MOST_DRAWN networks with a legend, as HTML."""
    graphs = most_attacked(cells)
    known = [(cell, situation_of(cell.scenario)) for cell in graphs]
    shown = [each for each in known if not too_large(each[1].graph)][:MOST_DRAWN]
    if not shown:
        return "<p>Too large to be drawn here: as densities of links in figures/topologies.</p>"
    called = [
        "navigator",
        "vehicle",
        *["attacked vehicle"] * any(attacked_vehicles(cell) for cell, _ in shown),
    ]
    called += sorted({link for each in shown for link in link_names(*each).values()})
    key = "".join(f"<li>{legend_sample(each)}{each}</li>" for each in called)
    left = len(graphs) - len(shown)
    note = f"<p>{count(left, 'more network')}, as certificates below.</p>" if left else ""
    networks = "".join(network_svg(*each) for each in shown)
    return f'<ul class="key">{key}</ul><div class="networks">{networks}</div>{note}'


def legend_sample(called: str) -> str:
    """Return a sample of a node or link for the legend, as SVG."""
    link = called.endswith("link")
    drawn = f'<path d="M0 7H34" class="{called}"/>' if link else node_svg(called, np.array([17, 7]), 5.0)
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
    places = 100 * source_positions(situation.graph) * [1, -1]
    gaps = np.hypot(*(places[:, None] - places[None]).T) + np.diag(np.full(len(places), np.inf))
    radius = min(NODE_RADIUS, 0.4 * float(gaps.min()))
    drawn = []
    names = link_names(cell, situation)
    for (i, j), called in names.items():
        mutual = (j - 1, i + 1) in names
        drawn.append(arrow_path(places[j], places[i + 1], radius, ARROW_BEND * mutual, called))
    attacked = attacked_vehicles(cell)
    for source, place in enumerate(places):
        called = ("attacked vehicle" if source in attacked else "vehicle") if source else "navigator"
        number = f'x="{place[0]:.1f}" y="{place[1]:.1f}" font-size="{1.1 * radius:.1f}"'
        drawn += [node_svg(called, place, radius), f"<text {number}>{source}</text>"]
    (left, top), (width, height) = places.min(axis=0) - 20, np.ptp(places, axis=0) + 40
    title, box = escape(graph_caption(cell)), f"{left:.0f} {top:.0f} {width:.0f} {height:.0f}"
    return (
        f'<figure><svg class="network" viewBox="{box}" role="img" aria-label="network {title}">'
        f"{''.join(drawn)}</svg><figcaption>{title}</figcaption></figure>"
    )


def arrow_path(source: np.ndarray, listener: np.ndarray, radius: float, bend: float, called: str) -> str:
    """Return an arrow from rim to rim; `bend` times its length separates arrows of both directions."""
    length = np.hypot(*(listener - source))
    along = (listener - source) / length
    left = np.array([along[1], -along[0]])
    middle = 0.5 * (source + listener) + bend * length * left
    start, end = source + along * radius, listener - along * radius
    barbs = [end - 5 * along + side * left for side in (2.2, -2.2)]
    a, b, c, d, e = (f"{x:.1f} {y:.1f}" for x, y in (start, middle, end, *barbs))
    return f'<path d="M{a}Q{b} {c}M{d}L{c}L{e}" class="{called}"/>'
