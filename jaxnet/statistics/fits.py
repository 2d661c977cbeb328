"""Fits of δ̂(ā), the fleet's ultimate error against the magnitude of the attack: `fit.csv`.

A group contains the cells that differ only in ā. For each group, `regression` fits its models to
tail_mean and to tail_max. Cells with ā = 0 and failed lanes take no part.

Intervals resample samples, not rows: sample s is the same random draw in every cell.

- The slope of least squares is a mean of errors per ā. Its interval is that of `intervals`.
- Those of a quantile's slope and of other curves by least squares are the 2.5 and 97.5 % points of
  fits to samples drawn again with replacement. They need enough samples (`bootstrap_suffices`):
  with few large errors among many small ones a bootstrap covers too little.
- The envelope has none, because the bootstrap fails for a maximum (`below_greatest` instead). Other
  curves at a quantile have none either.
- Sobol's sequences have no bootstrap: their points are not independent and the sequences are few.

A transient is as large at every ā. Its errors have a mean and an interval, but no slope:
`has_slope`.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
from jaxtyping import Int

from jaxnet.config.cells import is_leaderless
from jaxnet.engine.cores import cores
from jaxnet.statistics.groups import Group, Label, attacked_groups
from jaxnet.statistics.intervals import CONFIDENCE, UNKNOWN, Ends, is_near_normal, student_interval
from jaxnet.statistics.regression import (
    ENVELOPE,
    MODELS,
    Errors,
    least_squares,
    model_value,
    quantile_regression,
)
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.statistics.summary import SUMMARISED
from jaxnet.store import rows
from jaxnet.store.folder import FolderError
from jaxnet.store.results import Results

NO_ULTIMATE_ERROR = (
    "without a navigator there is no error to fit and no bound: `jaxnet figure curve` draws the"
    " spread"
)
FIT_COLUMNS = ("metric", "model", "quantile", "parameter", "estimate", "low", "high", "aicc")
FITTED_QUANTILES = (0.5, 0.95)
RESAMPLES = 1000
SEED = 0
RESAMPLES_TOGETHER = 100  # fitted side by side
MOST_FIT_WEIGHTS = 2**22  # of resamples fitted side by side
FEWEST, FEWEST_BEYOND = 50, 10  # draws that make up the variance of a mean; draws beyond a quantile
EXACT_FIT = 1e-9  # of the errors, or of ā: smaller residuals are transient or rounding, not scatter
LEAST_RESIDUAL = 1e-12  # smaller errors per ā are rounding
DECISIVE = 6.0  # of AICc: a model is 20 times as likely, exp(6/2)
NO_CURVE_INTERVAL = (
    "no interval: too few draws for their skewness, too few of them off, or too few beyond the"
    " quantile"
)

DrawCounts = Int[np.ndarray, "n samples"]  # how often each resample draws each sample
FitRow = dict[str, object]


def fit_table(results: Results, progress: Steps = no_progress) -> pd.DataFrame:
    """`fit.csv`: a row per group, metric, model, quantile (none: least squares) and parameter.

    Models with more parameters than a group has magnitudes are left out. Raises FolderError if no
    cell has an attack with ā > 0 that is fixed or swept.
    """
    groups = [(group, group.attacked) for group in fitted_groups(results)]
    tasks = [(group.labels, cells, metric) for group, cells in groups for metric in SUMMARISED]
    independent = results.study.config.draws == "random"

    def rows_of_task(task: tuple[dict[str, Label], dict[int, float], str]) -> list[FitRow]:
        labels, cells, metric = task
        found = fit_rows(read_errors(results, cells, metric), independent)
        return [labels | {"metric": metric} | row for row in found]

    found = []
    progress("curves fitted", 0, len(tasks))
    with ThreadPoolExecutor(cores()) as pool:
        for done, task_rows in enumerate(pool.map(rows_of_task, tasks), 1):
            found += task_rows
            progress("curves fitted", done, len(tasks))
    return pd.DataFrame(found, columns=pd.Index([*groups[0][0].labels, *FIT_COLUMNS]))


def fitted_groups(results: Results) -> list[Group]:
    """Groups with an ā > 0; raises FolderError if there is none, or no navigator."""
    if is_leaderless(results.study.cells):
        raise FolderError(f"{results.place}: {NO_ULTIMATE_ERROR}")
    groups = [group for group in attacked_groups(results.study.cells) if group.attacked]
    if not groups:
        raise FolderError(
            f"{results.place}: no cell has an attack with ā > 0 that is fixed or swept,"
            " nothing to fit"
        )
    return groups


def read_errors(results: Results, cells: dict[int, float], metric: str) -> Errors:
    place = {cell: row for row, cell in enumerate(cells)}
    y = np.full((len(cells), results.manifest["samples"]), np.nan)
    for cell, lanes in results.by_cell("sample", metric, where=rows.OK, cells=cells):
        y[place[cell], lanes["sample"]] = lanes[metric]
    return Errors(np.array(list(cells.values())), y)


def draw_resamples(samples: int, at_once: int) -> Iterator[DrawCounts]:
    """Yield how often each resample draws each sample, `at_once` resamples at a time."""
    random = np.random.default_rng(SEED)
    for first in range(0, RESAMPLES, at_once):
        drawn = (
            random.integers(samples, size=samples) for _ in range(min(at_once, RESAMPLES - first))
        )
        yield np.stack([np.bincount(each, minlength=samples).astype(np.int16) for each in drawn])


def fit_rows(errors: Errors, independent: bool = True) -> Iterator[FitRow]:
    """Yield the rows of one set of errors; without intervals unless samples are `independent`."""
    if not errors.models:
        return
    once = np.ones((1, errors.y.shape[1]), np.int16)
    points: dict[float | None, dict[str, np.ndarray]] = {None: least_squares(errors, once)}
    points |= {
        quantile: quantile_regression(errors, quantile)
        for quantile in (*FITTED_QUANTILES, ENVELOPE)
    }
    known = curve_intervals(errors) if independent else {}
    sloped = has_slope(errors)
    if len(errors.models) > 1:
        points[None]["constant"] = np.array([[constant_fit(errors)]])
    for quantile, estimated in points.items():
        for model, (estimate,) in estimated.items():
            low, high = known.get((quantile, model), np.full((2, len(estimate)), np.nan))
            score = aicc(errors, model, estimate) if quantile is None else np.nan
            if model == "proportional" and not sloped:
                estimate = low = high = np.full(1, np.nan)
            for name, *numbers in zip(MODELS.get(model, "c"), estimate, low, high, strict=True):
                row = (model, quantile, name, *numbers, score)
                yield dict(zip(FIT_COLUMNS[1:], row, strict=True))


def curve_intervals(errors: Errors) -> dict[tuple[float | None, str], np.ndarray]:
    """Intervals of the parameters of curves, by quantile (None: least squares) and model."""
    found: dict[tuple[float | None, str], np.ndarray] = {
        (None, "proportional"): np.array(mean_ratio(errors))[:, None]
    }
    quantiles = [each for each in FITTED_QUANTILES if bootstrap_suffices(errors, each)]
    squares = len(errors.models) > 1 and bootstrap_suffices(errors, None)
    at_once = max(1, min(RESAMPLES_TOGETHER, MOST_FIT_WEIGHTS // errors.y.size))
    resamples = [*draw_resamples(errors.y.shape[1], at_once)] if quantiles or squares else []
    if quantiles:
        drawn = np.concatenate([drawn_slopes(errors, each, quantiles) for each in resamples])
        for place, quantile in enumerate(quantiles):
            found[quantile, "proportional"] = percentile_interval(drawn[:, place : place + 1])
    if squares:
        fits = [least_squares(errors, each) for each in resamples]
        for model in errors.models[1:]:
            drawn = np.concatenate([each[model] for each in fits])
            found[None, model] = percentile_interval(drawn)
    return found


def drawn_slopes(errors: Errors, counts: DrawCounts, quantiles: list[float]) -> np.ndarray:
    ratios, finite = errors.ratios, np.isfinite(errors.y)
    order = np.argsort(ratios[finite])
    reached = np.cumsum(counts[:, np.nonzero(finite)[1][order]], axis=1, dtype=np.int32)
    first = [(reached < each * reached[:, -1:]).sum(axis=1) for each in quantiles]
    return ratios[finite][order][np.stack(first, axis=1)]


def constant_fit(errors: Errors) -> float:
    """Constant error of least squares, with weights 1/x²."""
    weights = np.isfinite(errors.y) * (errors.x.min() / errors.x[:, None]) ** 2
    return float(np.nansum(weights * errors.y) / weights.sum())


def has_slope(errors: Errors) -> bool:
    """Whether s·ā may describe the errors.

    It does not if a constant is decisively better by AICc and the errors do not rise with ā. The
    second condition keeps the slope of a rise that weights 1/x² hide behind a transient. Errors
    rise if the samples' mean slope over log ā is two standard errors above 0, or if one sample
    rises three times as steeply as any falls.
    """
    ratios = errors.ratios
    straight = aicc(errors, "proportional", np.array([np.nanmean(ratios)]))
    flat = aicc(errors, "constant", np.array([constant_fit(errors)]))
    if np.nanmax(ratios) < EXACT_FIT or not straight - np.nan_to_num(flat, nan=-np.inf) > DECISIVE:
        return True
    known = errors.y[np.isfinite(errors.y).any(axis=1)]
    whole = known[:, np.isfinite(known).all(axis=0)]
    logs = np.log(errors.x[np.isfinite(errors.y).any(axis=1)])
    rises = (logs - logs.mean()) @ whole / np.sum((logs - logs.mean()) ** 2)
    rises = np.where(np.abs(rises) > EXACT_FIT * np.nanmax(errors.y), rises, 0.0)
    error = rises.std() / np.sqrt(max(1, rises.size - 1))
    steepest = rises.max(initial=0.0)
    return bool(
        not rises.size or rises.mean() > 2 * error or steepest > -3 * rises.min(initial=0.0)
    )


def mean_ratio(errors: Errors) -> Ends:
    """Interval of the mean error per ā, which is the slope of least squares."""
    ratios = errors.ratios
    counts = np.isfinite(ratios).sum(axis=0).astype(float)
    sums, counts = np.nansum(ratios, axis=0)[counts > 0], counts[counts > 0]
    if not is_near_normal(sums / counts):
        return UNKNOWN
    return student_interval(sums, counts, CONFIDENCE)


def bootstrap_suffices(errors: Errors, quantile: float | None) -> bool:
    """Whether there are enough draws for a bootstrap; with fewer its interval covers too little.

    At a quantile, FEWEST_BEYOND draws must lie beyond it. For least squares, n over the kurtosis of
    the draws' mean errors per ā estimates the number of draws that make up the variance. This
    number is small if few draws have large errors. If all errors are rounding, nothing is known of
    large errors.
    """
    ratios = errors.ratios
    finite = np.isfinite(ratios)
    draws = finite.any(axis=0)
    if quantile is not None:
        return bool(draws.sum() * min(quantile, 1 - quantile) >= FEWEST_BEYOND)
    each = np.nansum(ratios, axis=0)[draws] / finite.sum(axis=0)[draws]
    size = each.max(initial=0.0)
    if size < EXACT_FIT:
        return False
    apart = each / size - (each / size).mean()
    squares = np.where(np.abs(apart) > EXACT_FIT, apart**2, 0.0)
    return bool(len(each) >= FEWEST and squares.sum() ** 2 >= FEWEST * np.square(squares).sum())


def percentile_interval(drawn: np.ndarray) -> np.ndarray:
    """Percentile interval of each parameter; resamples with only failed lanes are left out."""
    ordered, counted = np.sort(drawn, axis=0), np.isfinite(drawn[:, 0]).sum()
    outside = int((1 - CONFIDENCE) / 2 * counted)
    return ordered[[outside, counted - 1 - outside]]


def aicc(errors: Errors, model: str, parameters: np.ndarray) -> float:
    """Akaike's criterion with its small-sample correction, for (y − f)/x.

    The criterion is not-a-number if (y − f)/x is rounding. It is `n log(RSS/n) + 2k + 2k(k + 1)/(n
    − k − 1)`, where k includes the variance (Hurvich and Tsai 1989).
    """
    ratios = errors.ratios
    finite, k = np.isfinite(ratios), len(parameters) + 1
    n = finite.sum()
    size = np.nanmax(ratios)
    if n <= k + 1 or size < LEAST_RESIDUAL:
        return np.nan
    with np.errstate(over="ignore", invalid="ignore"):  # a curve may overflow
        residuals = (ratios - (model_value(model, errors.x, parameters) / errors.x)[:, None]) / size
        spread, scale = (np.sqrt(np.mean(each[finite] ** 2)) for each in (residuals, ratios / size))
    if not max(EXACT_FIT * scale, LEAST_RESIDUAL / size) <= spread < np.inf:
        return np.nan
    return float(2 * n * (np.log(spread) + np.log(size)) + 2 * k + 2 * k * (k + 1) / (n - k - 1))


def whole_draws(results: Results, group: Group) -> int:
    """Number of samples whose lanes are ok at every ā of a group."""
    errors = read_errors(results, group.attacked, SUMMARISED[0])
    return int(np.isfinite(errors.y).all(axis=0).sum())
