"""Fits of δ̂(ā), the fleet's ultimate error against the magnitude of the attack: `fit.csv`.

A group contains the cells that differ only in ā. In each group s·ā is fitted to tail_mean and to
tail_max. The slope s is the mean of errors per ā (least squares of weights 1/ā²), a quantile of
them (weights 1/ā), or the greatest (the envelope, "quantile 1"). The other curves of `regression`
and a constant are fitted by least squares. Cells with ā = 0 and failed lanes take no part.

Intervals are over samples, not rows: sample s is the same random draw in every cell.

- The mean has the interval of `intervals`.
- A quantile, and the other curves, have the 2.5 and 97.5 % points of fits to samples drawn again
  with replacement. They need enough samples beyond it, or enough that make up the variance: with
  few large errors among many small ones a bootstrap covers too little.
- The envelope has none, because the bootstrap fails for a maximum (`below_greatest` instead).
- Sobol's sequences have no bootstrap: their points are not independent and the sequences are few.

A transient is as large at every ā. Its errors have a mean and an interval, but no slope:
`has_slope`.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float, Shaped
from upath import UPath

from jaxnet.config.cells import is_leaderless
from jaxnet.engine.cores import cores
from jaxnet.statistics import limits
from jaxnet.statistics.groups import Group, Label, attacked_groups
from jaxnet.statistics.intervals import CONFIDENCE, UNKNOWN, Ends, student_interval
from jaxnet.statistics.regression import MODELS, affine, model_value, power
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.statistics.summary import SUMMARISED
from jaxnet.store import rows
from jaxnet.store.folder import FolderError
from jaxnet.store.looking import known_or
from jaxnet.store.results import Results
from jaxnet.store.tables import csv_text

NO_ULTIMATE_ERROR = (
    "without a navigator there is no error to fit and no bound: `jaxnet figure curve` draws the"
    " spread"
)
FIT_COLUMNS = ("metric", "model", "quantile", "parameter", "estimate", "low", "high", "aicc")
FITTED_QUANTILES = (0.5, 0.95)
ENVELOPE = 1.0
RESAMPLES = 1000
SEED = 0
RESAMPLES_TOGETHER = 100  # fitted side by side
MOST_FIT_WEIGHTS = 2**22  # of resamples fitted side by side
FEWEST, FEWEST_BEYOND = 50, 10  # draws that make up the variance of a mean; beyond a quantile
LEAST_RESIDUAL = 1e-12  # smaller errors per ā are rounding
EXACT_FIT = 1e-9  # of the greatest error, or of ā; smaller ones are rounding

DrawCounts = Shaped[np.ndarray, "n samples"]  # how often each resample draws each sample
FitRow = dict[str, object]


class Errors(NamedTuple):
    """Errors [m] at magnitudes x > 0, by sample; not-a-number where a lane failed."""

    x: Float[np.ndarray, " j"]
    y: Float[np.ndarray, "j samples"]

    @property
    def ratios(self) -> Float[np.ndarray, "j samples"]:
        return self.y / self.x[:, None]


def fit_table(results: Results, progress: Steps = no_progress) -> pd.DataFrame:
    """`fit.csv`: a row per group, metric, model and quantile (none: least squares).

    Raises FolderError if no cell has an attack with ā > 0 that is fixed or swept.
    """
    groups = fitted_groups(results)
    tasks = [
        (group.labels | {"metric": metric}, errors)
        for group in groups
        for metric, errors in read_errors(results, group.attacked).items()
    ]
    independent = results.study.config.draws == "random"

    def rows_of_task(task: tuple[dict[str, Label], Errors]) -> list[FitRow]:
        labels, errors = task
        return [labels | row for row in fit_rows(errors, independent)]

    found = []
    progress("curves fitted", 0, len(tasks))
    with ThreadPoolExecutor(cores()) as pool:
        for done, task_rows in enumerate(pool.map(rows_of_task, tasks), 1):
            found += task_rows
            progress("curves fitted", done, len(tasks))
    return pd.DataFrame(found, columns=pd.Index([*groups[0].labels, *FIT_COLUMNS]))


def write_ultimate_error(results: Results, progress: Steps = no_progress) -> Iterator[UPath]:
    """Write `bounds.csv`, `violations.csv` and `fit.csv`, and yield each file when it is written.

    `fit.csv` takes longest. A table that needs the code of a missing kind is left out. Raises
    FolderError for an unfinished run, and if no ā is fixed or swept.
    """
    fitted_groups(results)
    _ = results.cells
    tables: dict[str, Callable[[], pd.DataFrame]] = {
        "bounds.csv": lambda: limits.slopes_table(results.study.cells),
        "violations.csv": lambda: limits.violations_table(results),
        "fit.csv": lambda: fit_table(results, progress),
    }
    for name, table in tables.items():
        frame = known_or(None, table)
        if frame is not None:
            yield results.folder.put(name, csv_text(frame).encode())


def has_fixed_magnitude(results: Results) -> bool:
    """Whether lanes follow a navigator, attacked with an ā > 0 that is fixed or swept."""
    groups = attacked_groups(results.study.cells)
    return not is_leaderless(results.study.cells) and any(each.attacked for each in groups)


def fitted_groups(results: Results) -> list[Group]:
    """Groups with an ā > 0; raises FolderError if there is none, or no navigator."""
    if is_leaderless(results.study.cells):
        raise FolderError(f"{results.place}: {NO_ULTIMATE_ERROR}")
    if not has_fixed_magnitude(results):
        why = "no cell has an attack with ā > 0 that is fixed or swept, nothing to fit"
        raise FolderError(f"{results.place}: {why}")
    return [group for group in attacked_groups(results.study.cells) if group.attacked]


def read_errors(results: Results, cells: dict[int, float]) -> dict[str, Errors]:
    """Errors at the magnitudes of some cells, by metric."""
    place, x = {cell: row for row, cell in enumerate(cells)}, np.array(list(cells.values()))
    y = np.full((len(SUMMARISED), len(cells), results.manifest["samples"]), np.nan)
    for cell, lanes in results.by_cell("sample", *SUMMARISED, where=rows.OK, cells=cells):
        y[:, place[cell], lanes["sample"]] = lanes[[*SUMMARISED]].to_numpy().T
    return {metric: Errors(x, each) for metric, each in zip(SUMMARISED, y, strict=True)}


def fit_rows(errors: Errors, independent: bool = True) -> Iterator[FitRow]:
    """Yield the rows of one set of errors; without intervals unless samples are `independent`."""
    known = np.isfinite(errors.y)
    if not known.any():
        return
    slopes: dict[float | None, float] = {None: float(np.nanmean(errors.ratios))}
    quantiles = [*FITTED_QUANTILES, ENVELOPE]
    once = np.ones((1, errors.y.shape[1]), np.int16)
    slopes |= dict(zip(quantiles, quantile_slopes(errors, once, quantiles)[0], strict=True))
    ends = slope_intervals(errors) if independent else {}
    sloped = has_slope(errors)
    found = []
    for quantile, slope in slopes.items():
        told = (slope, *ends.get(quantile, UNKNOWN)) if sloped else (np.nan, *UNKNOWN)
        score = aicc(errors, "proportional", [slope]) if quantile is None else np.nan
        found.append(("proportional", quantile, "s", *told, score))
    found[1:1] = curve_rows(errors, independent) if known.any(axis=1).sum() > 1 else []
    for row in found:
        yield dict(zip(FIT_COLUMNS[1:], row, strict=True))


def curve_rows(errors: Errors, independent: bool) -> Iterator[tuple[object, ...]]:
    """Yield the rows of curves with two parameters, and of the constant."""
    once = np.ones((1, errors.y.shape[1]), np.int16)
    enough = independent and variance_is_of_many(errors)
    resamples = [*resamples_of(errors)] if enough else []
    for model, fitted in (("affine", affine), ("power", power)):
        (estimate,) = fitted(errors.x, *means_of(errors, once))
        ends = np.full((2, 2), np.nan)
        if enough:
            drawn = [fitted(errors.x, *means_of(errors, each)) for each in resamples]
            ends = percentile_interval(np.concatenate(drawn))
        score = aicc(errors, model, estimate)
        for name, *numbers in zip(MODELS[model], estimate, *ends, strict=True):
            yield model, None, name, *numbers, score
    weights = np.isfinite(errors.y) * (errors.x.min() / errors.x[:, None]) ** 2
    level = float(np.nansum(weights * errors.y) / weights.sum())
    yield "constant", None, "c", level, *UNKNOWN, aicc(errors, "constant", [level])


def means_of(errors: Errors, counts: DrawCounts) -> tuple[np.ndarray, np.ndarray]:
    """Mean error per ā, and number of lanes, of each resample at each magnitude: (n, j) each."""
    finite = np.isfinite(errors.y)
    weights = counts @ finite.T.astype(float)
    return counts @ np.where(finite, errors.ratios, 0.0).T / np.maximum(1, weights), weights


def variance_is_of_many(errors: Errors) -> bool:
    """Whether enough draws make up the variance of their mean errors per ā: n over the kurtosis.

    If all errors are rounding, nothing is known of large errors.
    """
    finite = np.isfinite(errors.y)
    draws = finite.any(axis=0)
    each = np.nansum(errors.ratios, axis=0)[draws] / finite.sum(axis=0)[draws]
    size = each.max(initial=0.0)
    if size < EXACT_FIT:
        return False
    apart = each / size - (each / size).mean()
    squares = np.where(np.abs(apart) > EXACT_FIT, apart**2, 0.0)
    return bool(len(each) >= FEWEST and squares.sum() ** 2 >= FEWEST * np.square(squares).sum())


def aicc(errors: Errors, model: str, parameters: Sequence[float] | np.ndarray) -> float:
    """Akaike's criterion with its small-sample correction, for (y − f)/x; NaN if this is rounding.

    It is `n log(RSS/n) + 2k + 2k(k + 1)/(n − k − 1)`, where k includes the variance (Hurvich and
    Tsai 1989).
    """
    ratios = errors.ratios
    finite, k, size = np.isfinite(ratios), len(parameters) + 1, np.nanmax(ratios)
    n = finite.sum()
    if n <= k + 1 or size < LEAST_RESIDUAL:
        return np.nan
    curve = model_value(model, errors.x, parameters) / errors.x
    residuals = (ratios - curve[:, None]) / size
    spread, scale = (np.sqrt(np.mean(each[finite] ** 2)) for each in (residuals, ratios / size))
    if not max(EXACT_FIT * scale, LEAST_RESIDUAL / size) <= spread < np.inf:
        return np.nan
    return float(2 * n * (np.log(spread) + np.log(size)) + 2 * k + 2 * k * (k + 1) / (n - k - 1))


def quantile_slopes(
    errors: Errors, counts: DrawCounts, quantiles: list[float]
) -> Float[np.ndarray, "n quantiles"]:
    """Quantiles of errors per ā of each resample: the least value that a share of rows reaches."""
    finite = np.isfinite(errors.y)
    ratios = errors.ratios[finite]
    order = np.argsort(ratios, kind="stable")
    reached = np.cumsum(counts[:, np.nonzero(finite)[1][order]], axis=1, dtype=np.int32)
    wanted = [each * reached[:, -1:] * (1 - 1e-15) for each in quantiles]
    first = [(reached < each).sum(axis=1) for each in wanted]
    return ratios[order][np.stack(first, axis=1)]


def slope_intervals(errors: Errors) -> dict[float | None, Ends]:
    """Intervals of slopes by quantile (None: least squares), where they are known."""
    found: dict[float | None, Ends] = {None: mean_ratio(errors)}
    draws = np.isfinite(errors.y).any(axis=0).sum()
    enough = [each for each in FITTED_QUANTILES if draws * min(each, 1 - each) >= FEWEST_BEYOND]
    if enough:
        drawn = [quantile_slopes(errors, each, enough) for each in resamples_of(errors)]
        ends = percentile_interval(np.concatenate(drawn)).T.tolist()
        found |= {quantile: (low, high) for quantile, (low, high) in zip(enough, ends, strict=True)}
    return found


def mean_ratio(errors: Errors) -> Ends:
    """Interval of the mean error per ā, which is the slope of least squares."""
    ratios = errors.ratios
    counts = np.isfinite(ratios).sum(axis=0).astype(float)
    sums, counts = np.nansum(ratios, axis=0)[counts > 0], counts[counts > 0]
    return student_interval(sums / counts, sums, counts, CONFIDENCE)


def resamples_of(errors: Errors) -> Iterator[DrawCounts]:
    at_once = max(1, min(RESAMPLES_TOGETHER, MOST_FIT_WEIGHTS // errors.y.size))
    return draw_resamples(errors.y.shape[1], at_once)


def draw_resamples(samples: int, at_once: int) -> Iterator[DrawCounts]:
    """Yield how often each resample draws each sample, `at_once` resamples at a time."""
    random = np.random.default_rng(SEED)
    for first in range(0, RESAMPLES, at_once):
        drawn = (
            random.integers(samples, size=samples) for _ in range(min(at_once, RESAMPLES - first))
        )
        yield np.stack([np.bincount(each, minlength=samples).astype(np.int16) for each in drawn])


def percentile_interval(drawn: np.ndarray) -> np.ndarray:
    """Percentile interval of each parameter; resamples with only failed lanes are left out."""
    ordered, counted = np.sort(drawn, axis=0), np.isfinite(drawn[:, 0]).sum()
    outside = int((1 - CONFIDENCE) / 2 * counted)
    return ordered[[outside, counted - 1 - outside]]


def has_slope(errors: Errors) -> bool:
    """Whether errors rise with ā, as s·ā does: the samples' slopes over log ā tell.

    Errors rise if the mean of these slopes is two standard errors above 0, or if one sample rises
    three times as steeply as any falls. Rounding, and errors at one ā, have the slope s.
    """
    there = np.isfinite(errors.y).any(axis=1)
    if there.sum() < 2 or np.nanmax(errors.ratios) < EXACT_FIT:
        return True
    known, logs = errors.y[there] / np.nanmax(errors.y), np.log(errors.x[there])
    logs -= logs.mean()
    rises = logs @ known[:, np.isfinite(known).all(axis=0)] / np.sum(logs**2)
    rises = np.where(np.abs(rises) > EXACT_FIT, rises, 0.0)
    if not rises.size:
        return True
    error = rises.std() / np.sqrt(max(1, rises.size - 1))
    return bool(rises.mean() > 2 * error or max(rises.max(), 0) > -3 * min(rises.min(), 0))


def whole_draws(results: Results, group: Group) -> int:
    """Number of samples whose lanes are ok at every ā of a group."""
    errors = read_errors(results, group.attacked)[SUMMARISED[0]]
    return int(np.isfinite(errors.y).all(axis=0).sum())
