"""What the lanes of a study are judged by: errors and shares of cells, and what is compared."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float

from jaxnet.config.cells import is_leaderless, judged_metric
from jaxnet.kinds.metrics import LANE_STATISTICS
from jaxnet.kinds.metrics.min_separation import MIN_SEPARATION
from jaxnet.model.wording import number_text
from jaxnet.statistics import curves
from jaxnet.statistics.amplitude import ROUNDING_ERROR
from jaxnet.statistics.horizon import lost_limits
from jaxnet.statistics.isolation import isolation_columns
from jaxnet.statistics.quantities import VALUE_COLUMNS, stored_values
from jaxnet.statistics.recovery import criterion_words, threshold
from jaxnet.statistics.tiles import share_lost
from jaxnet.store.results import Results
from jaxnet.view.page.where import joined_names

NEGLIGIBLE = 1e-3  # of what a study asks for


JudgedLanes = Mapping[int, Any]  # from `judged_lanes`


class CellErrors(NamedTuple):
    """Median errors of cells with intervals, per ā where they all rise in proportion to it.

    Attributes
    ----------
    values
        Columns value, low and high, by number of the cell; cells whose lanes failed have none.
    unit
        "ā" or "m".
    among
        The cells with errors, also where these still fall.
    """

    values: pd.DataFrame
    unit: str
    among: list[int]


def judged_errors(results: Results) -> CellErrors:
    """What the fleet's error is judged by."""
    metric = judged_metric(results.study.cells)
    names = [f"{metric}_{name}" for name in LANE_STATISTICS["median"].columns]
    errors: Any = stored_values(results.cells.reset_index(drop=True), names)
    errors = errors.drop(index=curves.mostly_failed(results)).dropna(subset="value")
    known, unit = curves.cell_magnitudes(results), "m"
    if metric != "spread" and not np.isnan(known).all():
        errors = errors[~np.isnan(known[errors.index])]
        errors, unit = errors.div(known[errors.index], axis="index"), "ā"
    return CellErrors(settled(results, errors), unit, errors.index.tolist())


def falling_cells(results: Results) -> list[int]:
    """Cells whose errors still fall, if others do not; these are not ultimate."""
    falls: Any = results.cells.reindex(columns=["falling"]).reset_index(drop=True)["falling"] == 1
    return [] if falls.all() else falls.index[falls].tolist()


def settled(results: Results, values: pd.DataFrame) -> pd.DataFrame:
    """The values of cells whose errors do not fall any more; all where every one falls."""
    left: Any = values.drop(index=falling_cells(results), errors="ignore")
    return values if left.empty else left


def judged_lanes(results: Results, cells: Iterable[int]) -> dict[int, Any]:
    """What lanes are judged by: a frame by sample of each cell.

    - `failed`; `lost`: far beyond ā and the starts; `gone`: either
    - `unrecovered`: failed, or above what the study asks for
    - `out`: outside the hull of the starts, without a navigator; `way` [m]: how far
    - `near`: two vehicles came nearer than a filter asks for
    - `fallen`: unrecovered or out; the others hold
    - `stopped`, `cut_off_vehicles`, if rows have them: whether any vehicle was
    - `error` [m]: the mean error, or the spread; 0 where the study asks for no less
    """
    judged, asked = judged_metric(results.study.cells), results.study.config.recovery
    alone, limits = is_leaderless(results.study.cells), lost_limits(results)
    columns, found = ["sample", "status", judged, *["outside"] * alone], dict[int, Any]()
    name, least = separation_asked(results) or ("", 0.0)
    isolated = isolation_columns(results)
    columns += [*[name] * bool(name), *isolated]
    for cell, lanes in results.by_cell(*columns, cells={*cells}):
        mine, error, failed = results.study.cells[cell], lanes[judged], lanes["status"] != "ok"
        way = lanes["outside"] if alone else 0.0 * error
        size, lost = threshold(mine, asked), error > limits[cell]
        found[cell] = pd.DataFrame(
            {
                "failed": failed,
                "lost": lost,
                "gone": failed | lost,
                "unrecovered": failed | (error > size),
                "out": way > mine.scenario.engine.accuracy,
                "near": lanes[name] < least if name else False,
                "way": way.mask(way <= mine.scenario.engine.accuracy, 0.0),
                "error": error.mask(error <= np.fmax(size, ROUNDING_ERROR), 0.0),
            }
            | {column: lanes[column] > 0 for column in isolated}
        ).set_axis(lanes["sample"])
        found[cell]["fallen"] = found[cell]["unrecovered"] | found[cell]["out"]
    return found


def separation_asked(results: Results) -> tuple[str, float] | None:
    """The metric of least distances, and the distance D [m] that filters keep; None without."""
    metrics = results.study.config.metrics
    name = next((each.name for each in metrics if each.base == MIN_SEPARATION.name), None)
    asked = (cell.scenario.filter.asks() for cell in results.study.cells)
    limits = [each for each in asked if each is not None]
    return (name, max(limits)) if name is not None and limits else None


def held_word(results: Results) -> str:
    """What a lane does that holds."""
    return "agree" if is_leaderless(results.study.cells) else "recover"


def criterion_text(results: Results) -> str:
    """What a lane that does not recover has, in brackets."""
    asked = results.study.config.recovery
    return "" if asked is None else f" ({criterion_words(asked, results.study.cells)})"


def fallen_words(results: Results) -> str:
    """What a lane does that does not hold; "" if the study cannot tell."""
    ways = ["fail"] * bool(results.manifest["lanes"]["failed"])
    ways += ["leave the hull of the starts"] * is_leaderless(results.study.cells)
    ways += [f"do not {held_word(results)}"] * (results.study.config.recovery is not None)
    return joined_names(ways, "or")


def known_shares(results: Results) -> pd.DataFrame:
    """Shares of lanes failed or unrecovered [%] with intervals, by number of the cell."""
    found: Any = share_lost(results).set_axis(VALUE_COLUMNS, axis="columns")
    return 100 * found.reset_index(drop=True).dropna()


def negligible_errors(results: Results) -> Float[np.ndarray, " cells"]:
    """Errors [m] that are far below what a study asks for, by cell; 0 if it asks for nothing."""
    asked = results.study.config.recovery
    limits = [threshold(cell, asked) for cell in results.study.cells]
    return NEGLIGIBLE * np.nan_to_num(limits)


def is_negligible(results: Results, errors: CellErrors) -> bool:
    """Whether all errors are far below what the study asks for."""
    least = negligible_errors(results)
    most = errors.values["value"].to_numpy().max()
    return errors.unit == "m" and bool(most < least[least > 0].min(initial=np.inf) < np.inf)


def judged_word(results: Results) -> str:
    """The word for what lanes are judged by."""
    return "spread" if is_leaderless(results.study.cells) else "error"


def percent_text(share: float) -> str:
    return number_text(share, whole=100.0)
