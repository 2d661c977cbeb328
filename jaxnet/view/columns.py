"""Columns of the summary table: swept keys, what the study asks for, metrics, and numbers of lanes.

A column has a name (that of `cells.csv`), a title in words and one in LaTeX, and a value for each
row. A statistic also carries both ends of its interval, where `cells.csv` has them.
"""

import math
from collections.abc import Sequence
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
from jaxnet.kinds.metrics import AGREEMENT, CONTRACT, DETECTION, LANE_STATISTICS
from jaxnet.kinds.refusals import suggestion
from jaxnet.model.wording import NAME_DIGITS, RESULT_DIGITS
from jaxnet.statistics.amplitude import (
    ROUNDING_ERROR,
    attack_size,
    is_rounding,
    reduced_amplitudes,
    without_rounding,
)
from jaxnet.statistics.choice import Where, select_cells, swept_key
from jaxnet.statistics.curves import cell_magnitudes
from jaxnet.statistics.intervals import ROUNDING_SPREAD
from jaxnet.statistics.quantities import (
    asked_quantity,
    metric_and_statistic,
    metric_title,
    share_failed,
    stored_values,
)
from jaxnet.statistics.recovery import share_name
from jaxnet.statistics.summary import lane_shares, share_names, unsettled_shares
from jaxnet.statistics.tiles import share_lost
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results
from jaxnet.view.text.width import digits_text

SHARE_FAILED, SHARE_LOST = "failed_share", "lost_share"
COUNTS = {"ok": "lanes ok", "failed": "lanes failed", "lanes": "lanes"}  # with their titles
# The first stand before a study's own metrics, the others after these
ERROR_COLUMNS = ("tail_mean_median", "tail_max_max"), ("tail_mean_mean", "tail_mean_q95")
AGREEMENT_COLUMNS = ("outside_max", "spread_median", "spread_max"), ("spread_q95", "spread_mean")
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
}
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
    """One column: by row a `value` as in `cells.csv`, and what text needs beside it.

    `entries` may have `low` and `high`, the ends of intervals; `alike`, whether all lanes of a cell
    agree; `size`, the ā beside which an error may be rounding.
    """

    name: str
    title: str
    latex: str
    entries: pd.DataFrame
    ends: tuple[str, str] | None = None  # names of the ends in a CSV table
    scale: float = 1.0  # by which text multiplies the values: 100 for shares
    key: str | None = None  # the swept key whose labels the values are
    across: str = ""  # in a pivoted table, the LaTeX title above the columns of one quantity
    endless: str = "inf"  # text of infinity

    @property
    def values(self) -> list[Any]:
        return self.entries["value"].tolist()

    @property
    def numeric(self) -> bool:
        return all(isinstance(value, int | float) for value in self.values)

    def at(self, places: Sequence[int] | slice) -> "Column":
        return self._replace(entries=self.entries.iloc[places])

    @property
    def whole(self) -> float:
        """The number of a share of all lanes, which no other share reads as."""
        return math.inf if self.scale == 1.0 else self.scale

    def bare(self) -> "Column":
        """The column without intervals."""
        left = self.entries.drop(columns=["low", "high", "alike"], errors="ignore")
        return self._replace(entries=left, ends=None)

    def texts(self) -> list[str]:
        """Values as text, intervals in brackets."""
        pairs = zip(self.numbers("value"), self.intervals(), strict=True)
        return [f"{self.text(number)} {interval}".rstrip() for number, interval in pairs]

    def text(self, value: Any) -> str:
        if self.key is not None and not isinstance(value, int | float):
            return value_alone(self.key, value)
        digits = RESULT_DIGITS if self.key is None else NAME_DIGITS
        return self.endless if value == math.inf else digits_text(value, digits, self.whole)

    def intervals(self) -> list[str]:
        """Intervals as text: a dash where there is none, empty where no cell has one."""
        found = [""] * len(self.entries)
        if self.ends is not None:
            ends = zip(self.values, self.numbers("low"), self.numbers("high"), strict=True)
            found = [
                "" if is_unknown(value) else bracketed(low, high, self.whole)
                for value, low, high in ends
            ]
        if "alike" not in self.entries:
            return found
        pairs = zip(found, self.entries["alike"], strict=True)
        return ["(alike)" if same else text for text, same in pairs]

    def has_rounding(self) -> bool:
        """Whether some value is rounding, and reads 0."""
        return "size" in self.entries and any(map(is_rounding, self.values, self.entries["size"]))

    def numbers(self, name: str) -> list[Any]:
        """Numbers in the unit of the title, of which rounding is 0, and labels."""
        values = self.entries[name].tolist()
        sizes = self.entries["size"] if "size" in self.entries else [0.0] * len(values)
        return [
            without_rounding(self.scale * value, size) if isinstance(value, float) else value
            for value, size in zip(values, sizes, strict=True)
        ]

    def scaled(self) -> list[Any]:
        """Numbers in the unit of the title, and other values as text."""
        if not self.numeric:
            return [self.text(value) for value in self.values]
        return self.values if self.scale == 1.0 else [self.scale * value for value in self.values]


def plain_column(
    name: str, values: Sequence[Any], title: str = "", latex: str = "", key: str | None = None
) -> Column:
    """A column of values without intervals."""
    entries = pd.DataFrame({"value": pd.Series(list(values), dtype=object)})
    title = title or name
    return Column(name, title, latex or title.translate(LATEX_ESCAPES), entries, key=key)


def is_unknown(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)


def bracketed(low: float, high: float, whole: float) -> str:
    """[low, high], with a dash for an end that is not known."""
    if math.isnan(low) and math.isnan(high):
        return "[-]"
    return f"[{digits_text(low, whole=whole)}, {digits_text(high, whole=whole)}]"


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
    shares = {SHARE_FAILED: share_failed(table)} if "lanes" in table else {}
    shares |= {SHARE_LOST: share_lost(results)} if "unrecovered" in table else {}
    for name, share in shares.items():
        table = table.join(share.set_axis(share_names(name), axis="columns"))
    if sort:
        name = known_column(sort.removeprefix("-"), table, keys)
        values = [cell.labels[name] if name in keys else table[name][cell.number] for cell in cells]
        ordered = pd.Series(values).sort_values(ascending=not sort.startswith("-"), kind="stable")
        cells = [cells[place] for place in ordered.index]
    numbers = [cell.number for cell in cells]
    found = [plain_column("cell", numbers)]
    found += [key_column(key, [cell.labels[key] for cell in cells]) for key in keys]
    wanted = [known_column(name, table, keys) for name in names]
    if not names:
        wanted = default_columns(results.study.config, table.iloc[numbers], every)
        if reduced := reduced_amplitudes(cells):
            # by which attacks shift positions, below ā where they are fast
            sizes = [reduced.get(cell.number, attack_size(cell)) for cell in cells]
            title = "attack amplitude [m]"
            found.append(plain_column("amplitude", sizes, title, "amplitude [m]", MAGNITUDE))
    sizes = known_or(np.full(len(every), np.nan), lambda: cell_magnitudes(results))[numbers]
    for name in wanted:
        if name not in keys:
            rows = table.iloc[numbers].assign(size=sizes)
            found.append(statistic_column(name, rows, results.study.config, every))
    return found


def pivoted(columns: Sequence[Column], key: str) -> list[Column]:
    """Columns of a summary with the values of one swept key across.

    The other swept keys stand first, a row for each combination of their values. Then come the
    columns of each quantity, one for each value of the key.

    Raises FolderError if the key is not swept, or takes values together with other keys.
    """
    swept = {each.name: each for each in columns if each.key == each.name}
    key = swept_key("pivot", key, swept)
    rows, across = [each for name, each in swept.items() if name != key], swept[key]
    places: dict[tuple[Any, ...], dict[Any, int]] = {}
    combinations = zip(*(each.values for each in rows), strict=True) if rows else None
    for place, value in enumerate(across.values):
        combination = next(combinations) if combinations else ()
        places.setdefault(combination, {})[value] = place
    if any(len(mine) < len({*across.values}) for mine in places.values()):
        raise FolderError(f"pivot: {key} takes its values together with other keys")
    found = [each.at([min(mine.values()) for mine in places.values()]) for each in rows]
    for each in columns[1:]:
        if each.key is not None:
            continue
        above = each.latex if is_kind(across.name) else f"{each.latex} by {across.latex}"
        for value in dict.fromkeys(across.values):
            before = f"{across.name}={value}:"
            made = each._replace(
                name=f"{before}{each.name}",
                title=f"{each.title}, {value_name(across.name, value)}",
                latex=value_alone(across.name, value),
                ends=each.ends and (before + each.ends[0], before + each.ends[1]),
                across=above,
            )
            found.append(made.at([mine[value] for mine in places.values()]))
    return found


def known_column(name: str, table: pd.DataFrame, keys: Sequence[str]) -> str:
    """Column of `cells.csv` or swept key; a metric means its median. Else raises FolderError."""
    for each in (name, f"{name}_median"):
        if each in table or each in keys:
            return each
    known = [*keys, *table.columns.difference(list(keys), sort=False)]
    near = suggestion(name, [each.removesuffix("_median") for each in known], fallback=False)
    raise FolderError(f"no column {name}" + (near or f" (there are {', '.join(known)})"))


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
    own += unsettled_shares(study)
    first = asked if asked in table else f"{asked}_median"
    before, after = AGREEMENT_COLUMNS if alone else ERROR_COLUMNS
    hull = ["in_hull"] * alone  # beside agreement: liars may move the place
    fell = [SHARE_FAILED, first] * bool(table["failed"].any())
    lost = fell and study.recovery is not None and any(attack_size(cell) > 0 for cell in cells)
    head = [SHARE_LOST] if lost else [*fell, first]
    names = dict.fromkeys([*head, *hull, *before, *own, *after, *fell, "ok", "failed"])
    return [name for name in names if name in table]


def key_column(key: str, labels: Sequence[Any]) -> Column:
    symbol = LATEX_SYMBOLS.get(key) if own_name(key) is None else None
    latex = latex_title(symbol or key_name(key).translate(LATEX_ESCAPES), unit(key))
    return plain_column(key, labels, quantity(key), latex, key)


def statistic_column(name: str, rows: pd.DataFrame, study: Config, cells: Sequence[Cell]) -> Column:
    """A column of `cells.csv` with its interval, if it has one; `rows` have the `size` too."""
    if name in COUNTS:
        return plain_column(name, rows[name].tolist(), COUNTS[name])
    stem = name.removesuffix("_low").removesuffix("_high")
    names, entries = [name], stored_values(rows, [name])
    ended = " of lanes that ended" * bool(rows["failed"].any())
    shares = {key: share.words(cells) + ended for key, share in lane_shares(study).items()}
    shares |= {SHARE_FAILED: "failed", SHARE_LOST: f"failed or {share_name(cells)}"}
    endless = "inf"
    if stem in shares:
        end = name.removeprefix(stem).lstrip("_")
        title = symbol = ", ".join(filter(None, [shares[stem], end]))
        of, scale, names = "%", 100.0, [name] if end else share_names(name)
    else:
        metric, statistic = metric_and_statistic(study, stem)
        end, of, scale = name.removeprefix(f"{metric.name}_"), metric.column_unit, 1.0
        entries["size"] = rows["size"] if of == "m" else 0.0
        if of == "s":
            endless = f"> {max(cell.scenario.horizon for cell in cells):g}"
        plain = LANE_STATISTICS[statistic].words.removesuffix(" of lanes")
        plain = plain.replace("greatest", "max")  # titles are narrow
        which = f", {plain if end == statistic else end.replace('_', ' ')}"
        title = f"{metric_title(metric)}{which}"
        symbol = title.translate(LATEX_ESCAPES)
        if end == statistic and len(LANE_STATISTICS[statistic].columns) > 1:
            names = [f"{metric.name}_{each}" for each in LANE_STATISTICS[statistic].columns]
            mean, most = (rows.loc[:, f"{metric.name}_{each}"] for each in ("mean", "max"))
            entries["alike"] = all_alike(mean, most, rows.loc[:, "ok"], entries.loc[:, "size"])
    entries[["low", "high"]] = stored_values(rows, names)[["low", "high"]]
    ends = (names[1], names[2]) if entries[["low", "high"]].notna().to_numpy().any() else None
    title = f"{title} [{of}]" if of else title
    return Column(name, title, latex_title(symbol, of), entries, ends, scale, endless=endless)


def all_alike(mean: pd.Series, most: pd.Series, lanes: pd.Series, size: pd.Series) -> pd.Series:
    """Whether all lanes of each cell agree, but for rounding: their mean is their greatest."""
    rounding = np.fmax(ROUNDING_SPREAD * most.abs(), ROUNDING_ERROR * size.fillna(1.0))
    return (lanes > 1) & ((most - mean).abs() <= rounding)


def latex_title(words: str, of: str) -> str:
    return f"{words} [{UNITS.get(of, of.translate(LATEX_ESCAPES))}]" if of else words


def split_constant(columns: Sequence[Column]) -> tuple[list[Column], str]:
    """The columns that differ between cells, and one line with the others.

    The cell's number and the first quantity stay. A table of one cell keeps all its columns.
    """
    if len(columns[0].entries) < 2:
        return list(columns), ""
    first = next((each.name for each in columns[1:] if each.key is None), "")
    kept, constant = [], []
    for each in columns:
        stays = each.across or each.name in ("cell", first) or len({*each.texts()}) > 1
        (kept if stays else constant).append(each)
    told = ", ".join(f"{each.title} {each.texts()[0]}" for each in constant)
    return kept, f"each cell: {told}" if told else ""


def as_frame(columns: Sequence[Column]) -> pd.DataFrame:
    """The columns as in `cells.csv`, the ends of intervals beside them."""
    found: dict[str, Any] = {}
    for each in columns:
        found[each.name] = each.values
        if each.ends is not None:
            found |= dict(zip(each.ends, each.entries[["low", "high"]].T.to_numpy(), strict=True))
    return pd.DataFrame(found)
