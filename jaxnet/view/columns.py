"""Columns of the summary table: swept keys, what the study asks for, metrics, and numbers of lanes.

A column has a name (that of `cells.csv`), a title in words and one in LaTeX, and its values. A statistic also
carries both ends of its interval, where `cells.csv` has them.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from jaxnet.config.cells import Cell, is_leaderless
from jaxnet.config.keys import Config
from jaxnet.config.naming import (
    MAGNITUDE,
    is_kind,
    key_name,
    own_name,
    quantity,
    unit,
    value_alone,
    value_name,
)
from jaxnet.kinds.metrics import AGREEMENT, CONTRACT
from jaxnet.statistics.amplitude import magnitude_of, reduced_amplitudes
from jaxnet.statistics.choice import Where, select_cells
from jaxnet.statistics.curves import cell_magnitudes
from jaxnet.statistics.hull import HULL_WORDS
from jaxnet.statistics.quantities import asked_quantity, metric_and_statistic
from jaxnet.statistics.recovery import share_name
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results

COUNTS = ("ok", "failed", "lanes")
SHARE_NAMES = ("unrecovered", "in_hull")
ERROR_COLUMNS = ("tail_mean_mean", "tail_mean_median", "tail_mean_q95", "tail_max_max")
AGREEMENT_COLUMNS = (
    "spread_mean",
    "spread_median",
    "spread_q95",
    "spread_max",
    "in_hull",
    "outside_max",
)
STATISTIC_TITLES = {"mean": "mean", "median": "median", "q05": "q05", "q95": "q95", "max": "worst"}
TITLES = {"tail_mean_mean": "tail mean", "tail_max_max": "worst", "unrecovered": "unrecovered"}
LATEX_SYMBOLS = {
    "attack.magnitude": r"$\bar a$",
    "attack.frequency": r"$\omega$",
    "attack.phase": r"$\varphi$",
    "attack.vehicles.random": r"$|\mathcal A|$",
    "gain.0": "$k_0$",
    "gain.1": "$k_1$",
    "gain.2": "$k_2$",
    "tick": "$h$",
    "vehicles": "$m$",
    "tail_mean": r"$\tilde e$",
    "tail_max": r"$\hat\delta$",
}
# Of ā, or [m] where no ā is known. Doubles carry 1e-16 of positions of tens of metres through thousands of
# ticks, some 1e-12 m: smaller errors are rounding, and far below any error that a robot has.
ROUNDING_ERROR = 1e-9
UNITS = {"m/s²": "m/s$^2$", "m/s³": "m/s$^3$"}
LATEX_ESCAPES = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "\N{NO-BREAK SPACE}": "~",
        **{character: f"\\{character}" for character in "&%$#_{}"},
    }
)


class Column(NamedTuple):
    """One column: values by cell as in `cells.csv`, and the ends of their intervals where there are any."""

    name: str
    title: str
    latex: str
    values: list[Any]
    ends: tuple[list[float], list[float]] | None = None
    scale: float = 1.0  # by which text multiplies the values: 100 for shares
    key: str | None = None  # the swept key whose labels the values are
    sizes: Sequence[float] | None = None  # of the cells' attacks, where the values are errors
    across: str = ""  # in a pivoted table, the LaTeX title above the columns of one quantity

    def texts(self, intervals: bool = True) -> list[str]:
        """Return the values as text: numbers to four digits, intervals in brackets to three."""
        texts = [self.text(*each) for each in zip(self.values, self.scales, strict=True)]
        if not intervals:
            return texts
        pairs = zip(texts, self.intervals(), strict=True)
        return [f"{text} {interval}".rstrip() for text, interval in pairs]

    def intervals(self) -> list[str]:
        """Return the intervals as text, empty where no end is known."""
        if self.ends is None:
            return [""] * len(self.values)
        return [
            bracketed(*(without_rounding(self.scale * end, size) for end in ends))
            for *ends, size in zip(*self.ends, self.scales, strict=True)
        ]

    @property
    def scales(self) -> Sequence[float]:
        """The size of each cell's attack, 0 where the values are no errors."""
        return [0.0] * len(self.values) if self.sizes is None else self.sizes

    def scaled(self) -> list[Any]:
        """Return numbers in the unit of the title, and other values as text."""
        if not self.numeric:
            return self.texts(intervals=False)
        return self.values if self.scale == 1.0 else [self.scale * value for value in self.values]

    def text(self, value: Any, size: float = 0.0) -> str:
        """Return one value as text; an error that is rounding, beside an attack of this size, is 0."""
        if self.key is not None and not isinstance(value, int | float):
            return value_alone(self.key, value)
        if not isinstance(value, float):
            return digits_text(self.scale * value if self.scale != 1.0 else value, 4)
        return digits_text(without_rounding(self.scale * value, size), 4)

    @property
    def numeric(self) -> bool:
        """Whether the values are numbers."""
        return all(isinstance(value, int | float) for value in self.values)


def is_rounding(value: float, size: float) -> bool:
    """Return whether an error is rounding beside an attack of this size.

    An unknown size counts as 1 m. A size of 0 switches the test off.
    """
    return bool(0 < abs(value) < ROUNDING_ERROR * (1.0 if np.isnan(size) else size))


def without_rounding(value: float, size: float) -> float:
    """Return an error, or 0 if it is rounding."""
    return 0.0 if is_rounding(value, size) else value


def digits_text(value: object, digits: int) -> str:
    """Return a number to so many digits, a dash for not-a-number, other values as text."""
    if not isinstance(value, float):
        return str(value)
    return "-" if math.isnan(value) else f"{value:.{digits}g}"


def bracketed(low: float, high: float) -> str:
    """Return [low, high] to three digits, with a dash for an end that is not known; "" if neither is."""
    if math.isnan(low) and math.isnan(high):
        return ""
    return f"[{digits_text(low, 3)}, {digits_text(high, 3)}]"


def summary_columns(
    results: Results,
    names: Sequence[str] = (),
    where: Where | None = None,
    sort: str | None = None,
) -> list[Column]:
    """Return columns of the summary, a value for each cell.

    Parameters
    ----------
    results
        Results of a finished run.
    names
        Names of columns of `cells.csv`; none of them: what the study asks for first, then the tail errors,
        metrics of its own, and the numbers of lanes.
    where
        The wanted value or values of swept keys.
    sort
        Name of the column by which the cells are sorted; a minus before it reverses the order.

    Returns
    -------
    list[Column]
        The number of the cell and the swept keys first.

    Raises
    ------
    FolderError
        A column, a key or a value is unknown, or the run is unfinished.
    """
    table = results.cells
    cells = select_cells(results.study.cells, where or {})
    keys = list(results.study.cells[0].labels)
    rows: Any = table.iloc[[cell.number for cell in cells]]
    if sort:
        name = known_column(sort.removeprefix("-"), table, keys)
        values = [cell.labels[name] for cell in cells] if name in keys else rows[name].tolist()
        order = (
            pd.Series(values).sort_values(ascending=not sort.startswith("-"), kind="stable").index
        )
        cells, rows = [cells[place] for place in order], rows.iloc[list(order)]
    numbers = Column("cell", "cell", "cell", [cell.number for cell in cells])
    swept = [key_column(key, [cell.labels[key] for cell in cells]) for key in keys]
    study = results.study.config
    every = results.study.cells
    wanted = [known_column(name, table, keys) for name in names] or default_columns(
        study, table, every
    )
    if not names and (reduced := reduced_amplitudes(cells)):
        swept.append(amplitude_column(cells, reduced))
    found = [statistic_column(each, rows, study, every) for each in wanted if each not in keys]
    sizes = known_or(np.full(len(results.study.cells), np.nan), lambda: cell_magnitudes(results))
    sizes = sizes[numbers.values].tolist()
    return [
        numbers,
        *swept,
        *(each._replace(sizes=sizes) if each.title.endswith("[m]") else each for each in found),
    ]


def pivoted(columns: Sequence[Column], key: str) -> list[Column]:
    """Return columns of a summary with the values of one swept key across.

    The other swept keys stand first, a row for each combination of their values. Then come the columns of
    each quantity, one for each value of the key.

    Raises FolderError if the key is not swept.
    """
    swept = {each.name: each for each in columns if each.key == each.name}
    if key not in swept:
        raise FolderError(f"pivot: {key} is not swept (swept are {', '.join(swept) or 'no keys'})")
    rows = [each for name, each in swept.items() if name != key]
    quantities = [each for each in columns[1:] if each.key is None]
    count = len(columns[0].values)
    combinations = [tuple(each.values[place] for each in rows) for place in range(count)]
    first = {combination: place for place, combination in reversed(list(enumerate(combinations)))}
    order = sorted(first.values())
    places = {
        (combination, value): place
        for place, (combination, value) in enumerate(
            zip(combinations, swept[key].values, strict=True)
        )
    }
    across = [
        across_column(
            each, swept[key], value, [places[combinations[place], value] for place in order]
        )
        for each in quantities
        for value in dict.fromkeys(swept[key].values)
    ]
    return [
        *(each._replace(values=[each.values[place] for place in order]) for each in rows),
        *across,
    ]


def across_column(column: Column, key: Column, value: Any, places: Sequence[int]) -> Column:
    """Return the column of one quantity for one value of the key across, with the cells at these places."""

    def chosen(values: Sequence[Any]) -> list[Any]:
        return [values[place] for place in places]

    above = column.latex if is_kind(key.name) else f"{column.latex} by {key.latex}"
    return column._replace(
        name=f"{key.name}={value}:{column.name}",
        title=f"{column.title}, {value_name(key.key or key.name, value)}",
        latex=value_alone(key.key or key.name, value),
        values=chosen(column.values),
        ends=column.ends and (chosen(column.ends[0]), chosen(column.ends[1])),
        sizes=column.sizes and chosen(column.sizes),
        across=above,
    )


def known_column(name: str, table: pd.DataFrame, keys: Sequence[str]) -> str:
    """Return the name of a column of `cells.csv` or a swept key; a metric means its mean.

    Raises FolderError for another name.
    """
    for each in (name, f"{name}_mean"):
        if each in table or each in keys:
            return each
    known = ", ".join(map(str, [*keys, *table.columns.difference(list(keys), sort=False)]))
    raise FolderError(f"no column {name} (there are {known})")


def default_columns(study: Config, table: pd.DataFrame, cells: Sequence[Cell]) -> list[str]:
    """Return the names of the columns that are shown if nobody asks for others, the asked-for one first.

    Without a navigator they are about the agreement of vehicles, not about errors.
    """
    asked, alone = asked_quantity(study), is_leaderless(cells)
    tail = AGREEMENT_COLUMNS if alone else ERROR_COLUMNS
    names = [metric.name for metric in study.measured()[len(CONTRACT) :]]
    own = [f"{name}_mean" for name in names if not (alone and name in AGREEMENT)]
    first = asked if asked in table else f"{asked}_mean"
    return [name for name in dict.fromkeys([first, *tail, *own, "ok", "failed"]) if name in table]


def key_column(key: str, labels: Iterable[Any]) -> Column:
    """Return the column of a swept key."""
    name = LATEX_SYMBOLS.get(key) if own_name(key) is None else None
    words = latex_title(name or key_name(key).translate(LATEX_ESCAPES), unit(key))
    return Column(key, quantity(key), words, list(labels), key=key)


def amplitude_column(cells: Sequence[Cell], reduced: Mapping[int, float]) -> Column:
    """Return the distance by which attacks shift positions, below ā where they are fast."""
    values = [reduced.get(cell.number, magnitude_of(cell)) for cell in cells]
    return Column("amplitude", "attack amplitude [m]", "amplitude [m]", values, key=MAGNITUDE)


def statistic_column(name: str, rows: pd.DataFrame, study: Config, cells: Sequence[Cell]) -> Column:
    """Return a column of `cells.csv` with its interval, if it has one."""
    if name in COUNTS:
        return Column(name, name, name, rows[name].tolist())
    share = name.removesuffix("_low").removesuffix("_high")
    if share in SHARE_NAMES:
        title = HULL_WORDS if share == "in_hull" else share_name(cells)
        words = ", ".join([title, *filter(None, [name.removeprefix(share).lstrip("_")])])
        ends = interval_ends(rows[f"{name}_low"], rows[f"{name}_high"]) if name == share else None
        return Column(
            name, f"{words} [%]", latex_title(words, "%"), rows[name].tolist(), ends, 100.0
        )
    stem, _, end = name.rpartition("_")
    metric, statistic = metric_and_statistic(study, stem if end in ("low", "high") else name)
    which = STATISTIC_TITLES.get(end, end)
    words = TITLES.get(name, f"{metric.name.replace('_', ' ')}, {which}")
    symbol = LATEX_SYMBOLS.get(metric.name, metric.name.translate(LATEX_ESCAPES))
    told = symbol if name in TITLES else f"{symbol}, {which}"
    ends = None
    if statistic == "mean" and end == "mean":
        ends = interval_ends(rows[f"{metric.name}_low"], rows[f"{metric.name}_high"])
    title = f"{words} [{metric.column_unit}]" if metric.column_unit else words
    return Column(name, title, latex_title(told, metric.column_unit), rows[name].tolist(), ends)


def interval_ends(low: Any, high: Any) -> tuple[list[float], list[float]] | None:
    """Return both ends of the intervals, None if no end is known."""
    return None if low.isna().all() and high.isna().all() else (low.tolist(), high.tolist())


def latex_title(words: str, of: str) -> str:
    """Return a title in LaTeX with its unit."""
    return f"{words} [{UNITS.get(of, of.translate(LATEX_ESCAPES))}]" if of else words


def split_constant(columns: Sequence[Column]) -> tuple[list[Column], str]:
    """Return the columns that differ between cells, and one line with the others.

    The cell's number and the first quantity stay. A table of one cell keeps all its columns.
    """
    if len(columns[0].values) < 2:
        return list(columns), ""
    quantities = [each.name for each in columns if each.ends is not None]
    kept, constant = [], []
    for each in columns:
        texts = each.texts()
        same = all(text == texts[0] for text in texts)
        stays = each.across or each.name in ("cell", *quantities[:1])
        (constant if same and not stays else kept).append(each)
    told = ", ".join(f"{each.title} {each.texts()[0]}" for each in constant)
    return kept, f"all cells: {told}" if told else ""


def as_frame(columns: Sequence[Column]) -> pd.DataFrame:
    """Return the columns as in `cells.csv`, the ends of intervals beside them."""
    found: dict[str, Any] = {}
    for each in columns:
        found[each.name] = each.values
        if each.ends is not None:
            stem = each.name.removesuffix("_mean")
            found[f"{stem}_low"], found[f"{stem}_high"] = each.ends
    return pd.DataFrame(found)
