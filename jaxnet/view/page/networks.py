"""What was run, in words, and the networks drawn."""

from collections.abc import Callable, Sequence
from html import escape

import numpy as np

from jaxnet.config.cells import Cell
from jaxnet.config.scenario import situation_of
from jaxnet.config.study import Study
from jaxnet.model.wording import count, ranges
from jaxnet.statistics.curves import magnitude_words
from jaxnet.view.figures.panels import attacked_vehicles, name
from jaxnet.view.figures.topology import attacked_links, link_names, positions

MOST_DRAWN = 6
MOST_NAMED = 6
NODE = 11  # radius where neighbours stand 62 apart


def words(study: Study) -> str:
    """The study in a few sentences."""
    cells = study.cells

    def among(say: Callable[[Cell], str]) -> str:
        found = list(dict.fromkeys(map(say, cells)))
        return " or ".join(found[:MOST_NAMED]) + (
            f" or {len(found) - MOST_NAMED} others" * (len(found) > MOST_NAMED)
        )

    vehicles = among(lambda cell: count(cell.scenario.vehicles, f"{cell.scenario.vehicle.kind} vehicle"))
    return (
        f"{vehicles} follow a {among(lambda cell: cell.scenario.navigator.kind)} navigator"
        f" for {among(lambda cell: f'{cell.scenario.horizon:g} s')}, from random starts."
        f" Network: {among(name)}. Attack: {among(attack_words)}; {among(magnitude_words)}."
        f" Defence: {among(lambda cell: defence_words(cell))}."
        f" The {among(lambda cell: cell.scenario.engine.reference())} engine follows them, with ticks"
        f" {among(lambda cell: f'{cell.scenario.tick:g} s')} apart. The last"
        f" {among(lambda cell: f'{cell.scenario.tail:g} s')} are the tail, from which errors are told."
    )


def attack_words(cell: Cell) -> str:
    """Who is attacked, and where."""
    if not attacked_vehicles(cell):
        return "none"
    from_navigator = situation_of(cell.scenario).attacked[:, 0].any()
    where = "what they hear of the navigator" if from_navigator else "what they transmit"
    return f"{cell.scenario.attack.describe()} on {ranges(sorted(cell.scenario.attack.targets()))} in {where}"


def defence_words(cell: Cell) -> str:
    """The defence with its number."""
    defence = cell.scenario.defence
    given = {"ϑ": getattr(defence, "theta", None), "F": getattr(defence, "F", None)}
    told = [f"{symbol} = {value}" for symbol, value in given.items() if value is not None]
    return ", ".join([str(cell.labels.get("defence", defence.label or defence.kind)), *told])


def drawing(cells: Sequence[Cell]) -> str:
    """The first few networks as they are without trimming, each with the most attacked links it has."""
    graphs: dict[str, Cell] = {}
    for cell in cells:
        known = graphs.get(name(cell))
        if known is None or attacked_links(cell) > attacked_links(known):
            graphs[name(cell)] = cell
    shown = list(graphs.values())[:MOST_DRAWN]
    left = len(graphs) - len(shown)
    note = f"<p>{count(left, 'more network')} not drawn here.</p>" if left else ""
    links = {called for cell in shown for called in link_names(cell, situation_of(cell.scenario)).values()}
    attacked = any(map(attacked_vehicles, shown))
    entries = ["navigator", "vehicle", *["attacked vehicle"] * attacked]
    key = "".join(f"<li>{sample(each)}{each}</li>" for each in [*entries, *sorted(links)])
    return f'<ul class="key">{key}</ul><div class="networks">{"".join(map(network, shown))}</div>{note}'


def sample(called: str) -> str:
    """An entry of the key."""
    drawn = f'<path d="M0 7H34" class="{called}"/>' if called.endswith("link") else node(called, 17, 7, 5)
    return f'<svg class="network" viewBox="0 0 34 14" aria-hidden="true">{drawn}</svg>'


def node(called: str, x: float, y: float, radius: float) -> str:
    """The navigator is square."""
    if called == "navigator":
        return f'<rect x="{x - radius:.1f}" y="{y - radius:.1f}" width="{2 * radius:.1f}" height="{2 * radius:.1f}" class="{called}"/>'
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" class="{called}"/>'


def network(cell: Cell) -> str:
    """One network; arrows run from the source to the vehicle that hears it."""
    situation = situation_of(cell.scenario)
    places = 100 * positions(situation.weights) * [1, -1]
    gaps = np.hypot(*(places[:, None] - places[None]).T) + np.diag(np.full(len(places), np.inf))
    radius = min(NODE, 0.4 * float(gaps.min()))
    attacked = attacked_vehicles(cell)
    links = [
        link(places[j], places[i + 1], radius, called)
        for (i, j), called in link_names(cell, situation).items()
    ]
    nodes = []
    for source, (x, y) in enumerate(places):
        nodes.append(
            node(
                "navigator" if not source else "attacked vehicle" if source in attacked else "vehicle",
                x,
                y,
                radius,
            )
        )
        nodes.append(f'<text x="{x:.1f}" y="{y:.1f}" font-size="{1.1 * radius:.1f}">{source}</text>')
    (left, top), (width, height) = places.min(axis=0) - 20, np.ptp(places, axis=0) + 40
    title = escape(name(cell))
    return (
        f'<figure><svg class="network" viewBox="{left:.0f} {top:.0f} {width:.0f} {height:.0f}" role="img"'
        f' aria-label="network {title}">{"".join(links + nodes)}</svg><figcaption>{title}</figcaption></figure>'
    )


def link(source: np.ndarray, listener: np.ndarray, radius: float, called: str) -> str:
    """An arrow from rim to rim, bent a little to its left, so that two that run both ways stand apart."""
    along = (listener - source) / np.hypot(*(listener - source))
    aside = np.array([along[1], -along[0]])
    middle = 0.5 * (source + listener) + 0.1 * np.hypot(*(listener - source)) * aside
    start, end = source + along * radius, listener - along * radius
    left, right = end - 5 * along + 2.2 * aside, end - 5 * along - 2.2 * aside
    (a, b), (c, d), (e, f), (g, h), (k, m) = start, middle, end, left, right
    return f'<path d="M{a:.1f} {b:.1f}Q{c:.1f} {d:.1f} {e:.1f} {f:.1f}M{g:.1f} {h:.1f}L{e:.1f} {f:.1f}L{k:.1f} {m:.1f}" class="{called}"/>'
