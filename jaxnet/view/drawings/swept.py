"""A quantity against a swept key: a colour per value of a second key, panels for the others.

Numbers are on x. Other values have a named row each, and the quantity is across.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnet.config.cells import Cell, is_leaderless, judged_metric
from jaxnet.config.naming import key_name, quantity, value_alone
from jaxnet.config.sweep import is_joint
from jaxnet.statistics.amplitude import ROUNDING_ERROR
from jaxnet.statistics.axes import (
    Axes,
    by_hue,
    geometric,
    numeric,
    on_a_scale,
    ordered_values,
    panels_of,
)
from jaxnet.statistics.groups import Label
from jaxnet.statistics.quantities import VALUE_COLUMNS, Quantity, asked_quantity, quantity_of
from jaxnet.store.results import Results
from jaxnet.view.drawings import drawing
from jaxnet.view.drawings.drawing import LOOKS, MARKERS, Drawing, Look, Panel, Scale, Trace
from jaxnet.view.drawings.words import NO_LANE, NONE_ENDED

ROW_SHARE = 0.7  # of a named row, that its colours take


def answers(results: Results, cells: Sequence[Cell]) -> list[Quantity]:
    """What lanes are judged by, and what the study asks for, where lanes tell it.

    What is the same in all cells is left out, if something else differs.
    """
    names = [judged_metric(cells), asked_quantity(results.study.config)]
    names = ["in_hull", *names, "outside"] if is_leaderless(cells) else names
    every = (quantity_of(results, cells, name) for name in dict.fromkeys(names))
    known = [each for each in every if each.known.size]
    return [each for each in known if np.ptp(each.known) > ROUNDING_ERROR] or known[-1:]


def swept_drawing(found: Quantity, axes: Axes, cells: Sequence[Cell]) -> Drawing:
    x, values = axes.x, ordered_values(cells, axes.x)
    numbers = x is not None and on_a_scale(values)
    there = {*found.values["value"].dropna().index, *found.unended}
    if x is not None and numbers:  # an axis without the values of which nothing is known
        known = {cell.labels[x] for cell in cells if cell.number in there}
        values = [value for value in values if value in known]
        cells = [cell for cell in cells if cell.labels[x] in known]
    hues = ordered_values(cells, axes.hue)
    looks = hue_looks(hues)
    names = [value_alone(axes.hue, hue) for hue in hues] if axes.hue else [""]
    across = Scale(quantity(x) if x else "", log=numbers and geometric(values), ticks=values)
    labels = [{x: value} for value in values] if x else []
    rows = Scale("", names=[value_alone(x, value) for value in values] if x else [""],
                 labels=labels)  # fmt: skip
    shown = Scale(found.axis, found.ends, found.log, found.share).cut(found.known)
    if {cell.number for cell in cells} & {*found.unended}:
        shown = shown._replace(band=NONE_ENDED)

    def series(place: int, mine: Sequence[Cell]) -> list[Trace]:
        labels = [cell.labels[x] if x else 0 for cell in mine]
        at: list[Any] = labels if numbers or not x else [*map(values.index, labels)]
        order = np.argsort(at, kind="stable")
        about = [mine[n].number for n in order]
        table = found.values.reindex(about, columns=[*VALUE_COLUMNS, "size"])
        value, low, high, sizes = table.to_numpy(dtype=float).T
        where = np.array(at, dtype=float)[order]
        shift = ROW_SHARE * ((place + 0.5) / len(looks) - 0.5)
        points = (where, value, "both") if numbers else (value, where + shift, "points")
        seen = Trace(names[place], looks[place], *points, low, high, about, sizes=sizes)
        lost = np.isin(about, found.unended)
        where, none = where[lost], np.full(lost.sum(), np.nan)
        points = (where, none) if numbers else (none, where + shift)
        look = looks[place]._replace(marker="x", size=5)
        about = np.array(about)[lost].tolist()
        crosses = Trace(NO_LANE, look, *points, drawing.OUTSIDE, none, none, about)
        return [seen, *[crosses] * bool(lost.any())]

    panels = []
    for labels, mine in panels_of(cells, axes):
        numbers_of = [cell.number for cell in mine]
        drawn = [
            trace
            for place, each in enumerate(by_hue(mine, axes, hues))
            if there & {cell.number for cell in each}
            for trace in series(place, each)
        ]
        if numbers:
            drawn = drawing.moved_sideways(drawn, across)
        words = "" if drawn else "no value"
        panels.append(Panel(labels, numbers_of, drawn, words))
    x_scale, y_scale = (across, shown) if numbers else (shown, rows)
    key, notes = key_name(axes.hue) if axes.hue else "", [found.notes]
    on_axes = [*filter(None, (x, axes.hue)), *axes.panel]
    if x and not any(map(is_joint, on_axes)):
        with_x = (other for other in cells[0].labels if other not in on_axes)
        notes += [f"{key_name(other)} changes with {key_name(x)}" for other in with_x]
    return Drawing(panels, x_scale, y_scale, notes, key, len(looks))


def hue_looks(values: Sequence[Label]) -> list[Look]:
    """A look for each value of the hue: few have colours of their own, more numbers a scale."""
    looks = drawing.colours_of(values) if numeric(values) else LOOKS
    return [
        looks[place % len(looks)]._replace(marker=MARKERS[place % len(MARKERS)])
        for place in range(max(1, len(values)))
    ]
