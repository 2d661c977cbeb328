"""Columns of the summary table: swept keys, what the study asks for, metrics, and numbers of lanes.

A column has a name (that of `cells.csv`), a title in words and one in LaTeX, and its values. A
statistic also carries both ends of its interval, where `cells.csv` has them.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

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
from jaxnet.kinds.metrics import AGREEMENT, CONTRACT, DETECTION
from jaxnet.statistics.amplitude import magnitude_of, reduced_amplitudes
from jaxnet.statistics.choice import Where, select_cells
from jaxnet.statistics.curves import cell_magnitudes
from jaxnet.statistics.groups import Label
from jaxnet.statistics.intervals import ROUNDING_SPREAD
from jaxnet.statistics.quantities import asked_quantity, metric_and_statistic
from jaxnet.statistics.shares import LANE_SHARES
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results

COUNTS = ("ok", "failed", "lanes")
ERROR_COLUMNS = ("tail_mean_median", "tail_mean_mean", "tail_mean_q95", "tail_max_max")
AGREEMENT_COLUMNS = (
    *("spread_median", "spread_mean", "spread_q95", "spread_max"),
    *("in_hull", "outside_max"),
)
TITLES = {"tail_max_max": "worst"}
STATISTIC_TITLES = {"max": "worst"}
ENDS_OF = {"mean": ("low", "high"), "median": ("median_low", "median_high")}
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
# Of ā, or [m] where no ā is known. Doubles carry 1e-16 of positions of tens of metres through
# thousands of ticks, some 1e-12 m: smaller errors are rounding, and far below what a robot has.
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
    """One column: values by cell as in `cells.csv`, and the ends of their intervals."""

    name: str
    title: str
    latex: str
    values: list[Any]
    ends: tuple[list[float], list[float]] | None = None
    scale: float = 1.0  # by which text multiplies the values: 100 for shares
    key: str | None = None  # the swept key whose labels the values are
    sizes: Sequence[float] | None = None  # of the cells' attacks, where the values are errors
    alike: Sequence[bool] | None = None  # whether all lanes of a cell agree
    across: str = ""  # in a pivoted table, the LaTeX title above the columns of one quantity

    def at(self, places: Sequence[int]) -> "Column":
        def chosen(values: Any) -> Any:
            return values and [values[place] for place in places]

        ends = self.ends and (chosen(self.ends[0]), chosen(self.ends[1]))
        return self._replace(
            values=[self.values[place] for place in places],
            ends=ends,
            sizes=chosen(self.sizes),
            alike=chosen(self.alike),
        )

    def texts(self, intervals: bool = True) -> list[str]:
        """Values as text: numbers to four digits, intervals in brackets to three."""
        sizes = self.sizes or [0.0] * len(self.values)
        texts = [self.text(value, size) for value, size in zip(self.values, sizes, strict=True)]
        if not intervals:
            return texts
        pairs = zip(texts, self.intervals(), strict=True)
        return [f"{text} {interval}".rstrip() for text, interval in pairs]

    def intervals(self) -> list[str]:
        """Intervals as text: a dash where there is none, empty where no cell has one."""
        found = [""] * len(self.values)
        if self.ends is not None:
            sizes = self.sizes or [0.0] * len(self.values)
            found = [
                bracketed(*(without_rounding(self.scale * end, size) for end in ends))
                for *ends, size in zip(*self.ends, sizes, strict=True)
            ]
            known = zip(found, self.values, strict=True)
            found = ["" if is_unknown(value) else text for text, value in known]
        if self.alike is None:
            return found
        return ["(alike)" if same else text for text, same in zip(found, self.alike, strict=True)]

    def scaled(self) -> list[Any]:
        """Numbers in the unit of the title, and other values as text."""
        if not self.numeric:
            return self.texts(intervals=False)
        return self.values if self.scale == 1.0 else [self.scale * value for value in self.values]

    def text(self, value: Any, size: float = 0.0) -> str:
        """One value as text; an error that is rounding, beside an attack of this size, is 0."""
        if self.key is not None and not isinstance(value, int | float):
            return value_alone(self.key, value)
        if not isinstance(value, float):
            return digits_text(self.scale * value if self.scale != 1.0 else value, 4)
        return digits_text(without_rounding(self.scale * value, size), 4)

    @property
    def numeric(self) -> bool:
        return all(isinstance(value, int | float) for value in self.values)


def is_rounding(value: float, size: float) -> bool:
    """Whether an error is rounding beside an attack of this size.

    An unknown size counts as 1 m. A size of 0 switches the test off.
    """
    return bool(0 < abs(value) < ROUNDING_ERROR * (1.0 if np.isnan(size) else size))


def without_rounding(value: float, size: float) -> float:
    return 0.0 if is_rounding(value, size) else value


def is_unknown(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)


def digits_text(value: object, digits: int) -> str:
    """A number to so many digits, a dash for not-a-number, other values as text."""
    if not isinstance(value, float):
        return str(value)
    return "-" if math.isnan(value) else f"{value:.{digits}g}"


def bracketed(low: float, high: float) -> str:
    """[low, high] to three digits, with a dash for an end that is not known."""
    if math.isnan(low) and math.isnan(high):
        return "[-]"
    return f"[{digits_text(low, 3)}, {digits_text(high, 3)}]"


def summary_columns(
    results: Results, names: Sequence[str] = (), where: Where | None = None, sort: str | None = None
) -> list[Column]:
    """Return columns of the summary, a value a cell; the number of the cell and swept keys first.

    `names` are columns of `cells.csv`, or metrics (their medians); without names these are what the
    study asks for, the tail errors, metrics of its own, and the numbers of lanes. `where` gives
    wanted values of swept keys. Cells are sorted by the column `sort`; a minus before it reverses
    the order. Raises FolderError if a column, key or value is unknown, or if the run is unfinished.
    """
    table, every = results.cells, results.study.cells
    cells, keys = select_cells(every, where or {}), list(every[0].labels)
    rows = table.iloc[[cell.number for cell in cells]]
    if sort:
        name = known_column(sort.removeprefix("-"), table, keys)
        values = [cell.labels[name] for cell in cells] if name in keys else rows[name].tolist()
        ordered = pd.Series(values).sort_values(ascending=not sort.startswith("-"), kind="stable")
        order = ordered.index.tolist()
        cells, rows = [cells[place] for place in order], rows.iloc[order]
    numbers = Column("cell", "cell", "cell", [cell.number for cell in cells])
    swept = [key_column(key, [cell.labels[key] for cell in cells]) for key in keys]
    study = results.study.config
    wanted = [known_column(name, table, keys) for name in names]
    if not names:
        wanted = default_columns(study, table, every)
        if reduced := reduced_amplitudes(cells):
            swept.append(amplitude_column(cells, reduced))
    sizes = known_or(np.full(len(every), np.nan), lambda: cell_magnitudes(results))
    of_cells = sizes[numbers.values].tolist()
    found = [statistic_column(each, rows, study, every) for each in wanted if each not in keys]
    found = [each._replace(sizes=of_cells) if "[m]" in each.title else each for each in found]
    return [numbers, *swept, *found]


def pivoted(columns: Sequence[Column], key: str) -> list[Column]:
    """Columns of a summary with the values of one swept key across.

    The other swept keys stand first, a row for each combination of their values. Then come the
    columns of each quantity, one for each value of the key.

    Raises FolderError if the key is not swept.
    """
    swept = {each.name: each for each in columns if each.key == each.name}
    if key not in swept:
        raise FolderError(f"pivot: {key} is not swept (swept are {', '.join(swept) or 'no keys'})")
    rows = [each for name, each in swept.items() if name != key]
    places: dict[tuple[Any, ...], dict[Any, int]] = {}
    for place, value in enumerate(swept[key].values):
        places.setdefault(tuple(each.values[place] for each in rows), {})[value] = place
    across = [
        across_column(each, swept[key], value).at([found[value] for found in places.values()])
        for each in columns[1:]
        if each.key is None
        for value in dict.fromkeys(swept[key].values)
    ]
    first = [min(found.values()) for found in places.values()]
    return [*(each.at(first) for each in rows), *across]


def across_column(column: Column, key: Column, value: Label) -> Column:
    above = column.latex if is_kind(key.name) else f"{column.latex} by {key.latex}"
    return column._replace(
        name=f"{key.name}={value}:{column.name}",
        title=f"{column.title}, {value_name(key.name, value)}",
        latex=value_alone(key.name, value),
        across=above,
    )


def known_column(name: str, table: pd.DataFrame, keys: Sequence[str]) -> str:
    """Column of `cells.csv` or swept key; a metric means its median. Else raises FolderError."""
    for each in (name, f"{name}_median"):
        if each in table or each in keys:
            return each
    known = ", ".join(map(str, [*keys, *table.columns.difference(list(keys), sort=False)]))
    raise FolderError(f"no column {name} (there are {known})")


def default_columns(study: Config, table: pd.DataFrame, cells: Sequence[Cell]) -> list[str]:
    """Names of the columns that are shown if nobody asks for others, the asked-for one first.

    Without a navigator they are about the agreement of vehicles, not about errors.
    """
    asked, alone = asked_quantity(study), is_leaderless(cells)
    names = [metric.name for metric in study.measured()[len(CONTRACT) :]]
    own = [
        f"{name}_{'mean' if name in DETECTION else 'median'}"
        for name in names
        if not (alone and name in AGREEMENT)
    ]
    first = asked if asked in table else f"{asked}_median"
    tail = AGREEMENT_COLUMNS if alone else ERROR_COLUMNS
    return [name for name in dict.fromkeys([first, *tail, *own, "ok", "failed"]) if name in table]


def key_column(key: str, labels: Iterable[Label]) -> Column:
    name = LATEX_SYMBOLS.get(key) if own_name(key) is None else None
    words = latex_title(name or key_name(key).translate(LATEX_ESCAPES), unit(key))
    return Column(key, quantity(key), words, list(labels), key=key)


def amplitude_column(cells: Sequence[Cell], reduced: Mapping[int, float]) -> Column:
    """Distance by which attacks shift positions, below ā where they are fast."""
    values = [reduced.get(cell.number, magnitude_of(cell)) for cell in cells]
    return Column("amplitude", "attack amplitude [m]", "amplitude [m]", values, key=MAGNITUDE)


def statistic_column(name: str, rows: pd.DataFrame, study: Config, cells: Sequence[Cell]) -> Column:
    """A column of `cells.csv` with its interval, if it has one."""
    values = rows[name].tolist()
    if name in COUNTS:
        return Column(name, name, name, values)
    share = name.removesuffix("_low").removesuffix("_high")
    if share in LANE_SHARES:
        end = name.removeprefix(share).lstrip("_")
        words = ", ".join(filter(None, [LANE_SHARES[share].words(cells), end]))
        ends = None if end else interval_ends(rows, f"{name}_low", f"{name}_high")
        return Column(name, f"{words} [%]", latex_title(words, "%"), values, ends, 100.0)
    metric, statistic = metric_and_statistic(study, name.removesuffix("_low").removesuffix("_high"))
    end = name.removeprefix(f"{metric.name}_")
    which = STATISTIC_TITLES.get(end, end.replace("_", " "))
    words = TITLES.get(name, f"{metric.name.replace('_', ' ')}, {which}")
    symbol = LATEX_SYMBOLS.get(metric.name, metric.name.translate(LATEX_ESCAPES))
    told = latex_title(symbol if name in TITLES else f"{symbol}, {which}", metric.column_unit)
    title = f"{words} [{metric.column_unit}]" if metric.column_unit else words
    found = Column(name, title, told, values)
    if end != statistic or end not in ENDS_OF:
        return found
    ends = interval_ends(rows, *(f"{metric.name}_{each}" for each in ENDS_OF[end]))
    return found._replace(ends=ends, alike=alike_cells(rows, metric.name))


def interval_ends(
    rows: pd.DataFrame, low: str, high: str
) -> tuple[list[float], list[float]] | None:
    if not {low, high} <= {*rows} or not all(is_numeric_dtype(rows[end]) for end in (low, high)):
        return None  # a folder of an earlier version
    known = rows[[low, high]].notna().to_numpy().any()
    return (rows[low].tolist(), rows[high].tolist()) if known else None


def alike_cells(rows: pd.DataFrame, metric: str) -> list[bool]:
    """Whether all lanes of each cell agree, but for rounding: their mean is their greatest."""
    mean, most = (rows[f"{metric}_{each}"].to_numpy(dtype=float) for each in ("mean", "max"))
    with np.errstate(invalid="ignore"):  # infinite ones
        apart = np.abs(most - mean)
    same = (apart <= ROUNDING_SPREAD * np.abs(most)) & (rows["ok"].to_numpy() > 1)
    return same.tolist()


def latex_title(words: str, of: str) -> str:
    return f"{words} [{UNITS.get(of, of.translate(LATEX_ESCAPES))}]" if of else words


def split_constant(columns: Sequence[Column]) -> tuple[list[Column], str]:
    """The columns that differ between cells, and one line with the others.

    The cell's number and the first quantity stay. A table of one cell keeps all its columns.
    """
    if len(columns[0].values) < 2:
        return list(columns), ""
    first = next((each.name for each in columns[1:] if each.key is None), "")
    kept, constant = [], []
    for each in columns:
        stays = each.across or each.name in ("cell", first) or len({*each.texts()}) > 1
        (kept if stays else constant).append(each)
    told = ", ".join(f"{each.title} {each.texts()[0]}" for each in constant)
    return kept, f"all cells: {told}" if told else ""


def as_frame(columns: Sequence[Column]) -> pd.DataFrame:
    """The columns as in `cells.csv`, the ends of intervals beside them."""
    found: dict[str, Any] = {}
    for each in columns:
        found[each.name] = each.values
        if each.ends is not None:
            stem = each.name.removesuffix("_mean")
            found[f"{stem}_low"], found[f"{stem}_high"] = each.ends
    return pd.DataFrame(found)
