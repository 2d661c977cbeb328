"""How lanes spread: tail errors by cell, errors over time, errors by vehicle."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from jaxnet.config.cells import Cell, is_leaderless, judged_metric
from jaxnet.config.keys import Recovery
from jaxnet.config.naming import value_name
from jaxnet.model.wording import count_between
from jaxnet.statistics.axes import choose_axes, panels_of
from jaxnet.statistics.bands import Band
from jaxnet.statistics.curves import MOST_PANELS, log_ends, magnitude_words
from jaxnet.statistics.groups import Group, evenly, evenly_over
from jaxnet.statistics.quantities import SPREAD_WORDS, unended_words
from jaxnet.statistics.recovery import share_definition, threshold
from jaxnet.store import rows
from jaxnet.store.results import Results
from jaxnet.view.columns import ROUNDING_ERROR
from jaxnet.view.drawings.drawing import OUTSIDE, Drawing, Look, Panel, Scale, Trace, colours_of
from jaxnet.view.drawings.scene import attacked_vehicles
from jaxnet.view.drawings.words import NO_LANE, NONE_ENDED, distinct_titles
from jaxnet.view.figures import style

JUDGED_WORDS = {
    "tail_mean": "mean error over the tail and the vehicles [m]",
    "spread": "spread of honest vehicles over the tail [m]",
}
MOST_TAIL_ROWS = 40  # cells that one panel takes
MOST_DOTS = 1000  # lanes of a cell that it takes: more lie on top of each other
MOST_MAGNITUDES = 3  # of ā shown in one panel: the least, a middle one and the greatest
JITTER = 0.22  # of a row
OVER_TIME_WORDS = {
    "tracking": "mean error of the fleet [m]",
    "spread": "spread of honest vehicles [m]",
    "disagreement": "mean disagreement [m]",
}
QUANTILES_WORDS = "5 to 95 % of lanes"
GREATEST = Look(style.RED, (4, 2), width=0.9)
DOT, MIDDLE = Look(style.SKY, marker=".", size=3), Look(style.BLACK, marker="D", size=4)
VEHICLE = Look(style.BLACK, marker="o", size=3)
ATTACKED_VEHICLE = Look(style.ORANGE, marker="s", size=4)
VEHICLE_RANGE, VEHICLE_MAXIMUM = Look(style.SKY, width=3), Look(style.GREY, marker="_", size=5)
UNENDED = Look(style.BLACK, marker="x", size=5)
LIMIT = Look(style.RED, (4, 1.5), width=0.8)


def tails_drawing(results: Results, cells: Sequence[Cell]) -> Drawing:
    """The judged metric of the lanes that ended: a row per cell, a dot per lane.

    Panels are those of a curve if they have the same rows, else one. Of many rows and panels some
    are shown, evenly along each swept key.
    """
    metric, there, axes = judged_metric(cells), [cell.labels for cell in cells], choose_axes(cells)
    keys = tuple(key for key in axes.panel if len({each[key] for each in there}) > 1)
    groups = panels_of(cells, axes._replace(panel=keys))
    every = (cell.labels.items() for _, mine in groups for cell in mine)
    told = [{key: value for key, value in each if key not in keys} for each in every]
    labels = told[: len(groups[0][1])]
    if told != labels * len(groups):
        groups, labels = [({}, cells)], there
    groups = [groups[at] for at in evenly_over([told for told, _ in groups], MOST_PANELS)]
    shown = evenly_over(labels, MOST_TAIL_ROWS)
    labels = [labels[at] for at in shown]
    panels = [(told, [mine[at].number for at in shown], list[Trace]()) for told, mine in groups]
    places = {cell: (drawn, row) for *_, mine, drawn in panels for row, cell in enumerate(mine)}
    for cell, lanes in results.by_cell(metric, where=rows.OK, cells=places):
        values, (drawn, row) = lanes[metric].to_numpy(), places[cell]
        dots = thin_by_rank(values)
        jitter = np.random.default_rng(0).uniform(-JITTER, JITTER, len(dots))
        low, median, high = np.quantile(values, [[0.05], [0.5], [0.95]])
        drawn += [
            Trace("", DOT, dots, row + jitter, "points"),
            Trace("", MIDDLE, median, np.array([row]), "points", low, high),
        ]
    titles, common = distinct_titles(labels)
    many = max(results.samples) > MOST_DOTS
    dot = f"{MOST_DOTS:,} dots evenly by rank" if many else "one dot per lane"
    notes = [common, f"{dot}; median and 5 to 95 %", *[SPREAD_WORDS] * (metric == "spread")]
    notes.append(unended_words(results, cells))
    dots = [each.x for *_, drawn in panels for each in drawn] or [[]]
    x = Scale(JUDGED_WORDS[metric], log_ends(*dots), log=True).cut(*dots)
    ok = results.cells["ok"].to_numpy()
    for _, mine, drawn in panels:
        if (lost := np.flatnonzero(ok[mine] == 0)).size:
            drawn.append(Trace(NO_LANE, UNENDED, np.full(lost.size, np.nan), lost, OUTSIDE))
            x = x._replace(band=NONE_ENDED)
    panels = [Panel(*each) for each in panels]
    y = Scale("", names=titles, labels=labels)
    return Drawing(panels, x, y, notes, there=(there, "cells"), where="lanes/")


def thin_by_rank(values: Float[np.ndarray, " lanes"]) -> Float[np.ndarray, " dots"]:
    """At most MOST_DOTS sorted values, evenly spaced in rank, with minimum and maximum."""
    ranks = np.linspace(0, len(values) - 1, min(len(values), MOST_DOTS)).round().astype(int)
    return np.sort(values)[ranks]


def bands_drawing(
    groups: Sequence[Group],
    bands: Mapping[int, Band],
    variable: str,
    hue: str | None = None,
    there: Sequence[Group] = (),
) -> Drawing:
    """A series over time: a panel per group of cells, a colour per cell of a group.

    Cells of a group differ in `hue`, or else in ā, of which three are drawn. The median of a group
    of one cell is named so, without ā. `there` are the groups of which these are some.
    """
    sizes, panels, names = max(len(group.cells) for group in groups), [], dict[int, str]()
    most = sizes if hue else min(MOST_MAGNITUDES, sizes)
    for group in groups:
        for cell in evenly(group.cells, most):
            told = value_name(hue, cell.labels[hue]) if hue else magnitude_words(cell)
            names[cell.number] = f"median, {told}" if len(group.cells) > 1 else "median of lanes"
    different = list(dict.fromkeys(names.values()))
    looks = dict(zip(different, colours_of(different), strict=True))
    for group in groups:
        series: list[Trace] = []
        for cell in group.cells:
            if cell.number in bands and (name := names.get(cell.number)):
                thin = looks[name]._replace(dash=(), width=0.5) if sizes > 1 else GREATEST
                greatest = thin if most <= MOST_MAGNITUDES else None
                series += band_series(bands[cell.number], name, looks[name], greatest)
        words = "" if series else NO_LANE
        panels.append(Panel(group.labels, [cell.number for cell in group.cells], series, words))
    lanes = sorted({band.lanes for band in bands.values()})
    notes = [f"over {count_between(lanes, 'lane')} of a cell"] if lanes else []
    notes += [SPREAD_WORDS] * (variable == "spread")
    several = [cell.labels for cell in max(groups, key=lambda group: len(group.cells)).cells]
    left_out = [(evenly(several, most), several, "sizes ā")]
    words = OVER_TIME_WORDS.get(variable, variable)
    ends = log_ends(*(end for each in bands.values() for end in (each.low, each.greatest)), [])
    y = Scale(words, ends, log=True)
    total = [group.labels for group in there or groups], "groups"
    return Drawing(panels, Scale("t [s]"), y, notes, there=total, where="errors.zarr",
                   left_out=left_out)  # fmt: skip


def band_series(band: Band, name: str, look: Look, greatest: Look | None = None) -> list[Trace]:
    """Median, 5 to 95 % and maximum of one cell; one lane is a line."""
    middle = Trace(name, look, band.time, band.median)
    if band.lanes == 1:
        return [middle._replace(name=name.replace("median of lanes", "one lane"))]
    found = [Trace(QUANTILES_WORDS, look, band.time, None, "band", band.low, band.high)]
    if greatest is not None:
        found.append(Trace("maximum", greatest, band.time, band.greatest))
    return [*found, middle]


def vehicles_drawing(
    found: pd.DataFrame, cells: Sequence[Cell], recovery: Recovery | None
) -> Drawing:
    """The rows of `vehicle_table`, a panel per cell, with the threshold of a recovery.

    Attacked vehicles, where a study lists them, are squares.
    """
    panels, limits = [], [threshold(cell, recovery) for cell in cells]
    for cell, limit in zip(cells, limits, strict=True):
        mine: Any = found[found["cell"] == cell.number]
        columns = mine[["vehicle", "low", "median", "q95", "greatest"]].to_numpy(dtype=float)
        at, low, median, high, greatest = columns.T
        lied = np.isin(at, attacked_vehicles(cell))
        series = [
            Trace("5 to 95 %", VEHICLE_RANGE, at, median, "range", low, high),
            Trace("maximum", VEHICLE_MAXIMUM, at, greatest, "points"),
            Trace("median of lanes", VEHICLE, at[~lied], median[~lied], "points"),
            Trace("median, attacked vehicle", ATTACKED_VEHICLE, at[lied], median[lied], "points"),
        ]
        series = [each for each in series if len(each.x)]  # no liars that are not known
        if np.isfinite(limit):
            ends = np.array([0.5, cell.scenario.vehicles + 0.5])
            whose = "of the spread" if is_leaderless(cells) else "of the fleet's mean"
            named = f"threshold of recovery, {whose}"
            series.append(Trace(named, LIMIT, ends, np.full(2, limit), "level"))
        panels.append(Panel(cell.labels, [cell.number], series, "" if len(at) else NO_LANE))
    known = recovery is not None and np.isfinite(limits).any()
    notes = [share_definition(recovery, cells)] if recovery is not None and known else []
    words = "distance from the mean" if is_leaderless(cells) else "mean error"
    y = Scale(f"{words} over the tail [m]", log=True, floor=ROUNDING_ERROR)
    there = [cell.labels for cell in cells], "cells"
    return Drawing(
        panels, Scale("vehicle", whole=True), y, notes, there=there, where="vehicles.zarr"
    )
