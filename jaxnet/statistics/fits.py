"""Fits of δ̂(ā), the fleet's ultimate error against the magnitude of the attack: `fit.csv`.

A group contains the cells that differ only in ā. For each group, `regression` fits the models of `families`
to tail_mean and to tail_max. Cells with ā = 0 and failed lanes take no part.

Intervals resample samples, not rows: sample s is the same random draw in every cell.

- The slope of least squares is a mean of errors per ā. Its interval is that of `means`.
- Other intervals are the 2.5 and 97.5 % points of fits to samples drawn again with replacement. They need
  enough samples (`bootstrap_suffices`): with few large errors among many small ones a bootstrap covers too
  little.
- The envelope has no interval, because the bootstrap fails for a maximum (`recovery.below_greatest` instead).
- Sobol's sequences have no bootstrap: their points are not independent and the sequences are few.

A transient is as large at every ā. Its errors over ā have a mean and an interval, but no slope: `has_slope`.
"""

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import numpy as np
import pandas as pd
from scipy.sparse import csr_array

from jaxnet.config.cells import is_leaderless
from jaxnet.engine.cores import cores
from jaxnet.statistics import means
from jaxnet.statistics.families import MODELS, model_value
from jaxnet.statistics.groups import Group, Label, attacked_groups
from jaxnet.statistics.limits import ceilings
from jaxnet.statistics.recovery import CONFIDENCE
from jaxnet.statistics.regression import Data, Effort, least_squares, quantile_regression
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.statistics.summary import SUMMARISED
from jaxnet.store import rows
from jaxnet.store.folder import FolderError
from jaxnet.store.results import Results

NO_ULTIMATE_ERROR = "without a navigator there is no error to fit and no bound: `jaxnet figure curve` draws the spread"
FIT_COLUMNS = ("metric", "model", "quantile", "parameter", "estimate", "low", "high", "aicc")
FITTED_QUANTILES = (0.5, 0.95)
ENVELOPE = 1.0
RESAMPLES = 1000
SEED = 0
EXACT = Effort(stride=1, shapes=48, scales=48)  # precise to rounding
RESAMPLED = Effort(stride=8, shapes=12, scales=10)  # precise to hundredths of an interval
MOST_BINS = 4096  # of one magnitude; with more lanes, neighbours share a weight
RESAMPLES_TOGETHER = 25  # fitted side by side
MOST_FIT_WEIGHTS = 2**22  # of resamples fitted side by side
FEWEST, FEWEST_BEYOND = 50, 10  # draws that make up the variance of a mean; draws beyond a quantile
EXACT_FIT = 1e-9  # of the errors, or of ā: smaller residuals are transient or rounding, not scatter
LEAST_RESIDUAL = 1e-12  # smaller errors per ā are rounding
DECISIVE = 6.0  # of AICc: a model is 20 times as likely, exp(6/2)

NO_CURVE_INTERVAL = (
    "no interval: too few draws are off, or beyond the quantile; no upper end: theory does not bound the"
    " error"
)
Estimates = dict[
    float | None, dict[str, np.ndarray]
]  # parameters by quantile and model, a row per resample


class Errors(NamedTuple):
    """Errors [m] at magnitudes x > 0, by sample; not-a-number where a lane failed."""

    x: np.ndarray
    y: np.ndarray

    @property
    def models(self) -> tuple[str, ...]:
        """Models with at most as many parameters as there are magnitudes."""
        known = np.isfinite(self.y).any(axis=1).sum()
        return tuple(model for model, names in MODELS.items() if len(names) <= known)

    def ranked(self) -> "Ranked":
        """Return the errors in the form that the estimators take."""
        ratios = self.y / self.x[:, None]
        finite = np.isfinite(ratios)
        magnitudes, samples = ratios.shape
        width = -(-samples // MOST_BINS)
        bins = -(-samples // width)
        ratios = np.where(finite, ratios, np.inf)
        order = np.argsort(ratios, axis=1, kind="stable")
        ordered = np.full((magnitudes, bins * width), np.inf)
        ordered[:, :samples] = np.take_along_axis(ratios, order, axis=1)
        ordered = ordered.reshape(magnitudes, bins, width)
        sums = np.zeros((magnitudes, bins, width + 1))
        np.cumsum(np.where(np.isfinite(ordered), ordered, 0.0), axis=2, out=sums[:, :, 1:])
        firsts = np.add.outer(np.arange(magnitudes) * samples, np.arange(bins) * width)
        members = (
            np.take_along_axis(finite, order, axis=1).ravel().astype(np.int16),
            order.ravel(),
            np.append(firsts, finite.size),
        )
        return Ranked(
            Data(self.x, ordered, sums),
            csr_array(members, shape=(magnitudes * bins, samples)),
            np.concatenate([finite, np.where(finite, ratios, 0.0)]).T,
        )


class Ranked(NamedTuple):
    """Errors in the estimators' form, and matrices from the samples' counts to the estimators' weights."""

    data: Data
    bins: csr_array  # the samples in each bin, the bins of all magnitudes
    lanes: np.ndarray  # by sample: whether each magnitude has an ok lane, then the errors per ā


def fit_table(results: Results, progress: Steps = no_progress) -> pd.DataFrame:
    """Return `fit.csv`: a row per group, metric, model, quantile (none: least squares) and parameter.

    Models with more parameters than a group has magnitudes are left out. Intervals are blank for too few
    draws. Raises FolderError if no cell has an attack with ā > 0 that is fixed or swept.
    """
    groups = [(group, group.attacked) for group in fitted_groups(results)]
    tasks = [(group.labels, cells, metric) for group, cells in groups for metric in SUMMARISED]
    independent = results.study.config.draws == "random"

    def rows_of_task(
        task: tuple[dict[str, Label], dict[int, float], str],
    ) -> list[dict[str, object]]:
        labels, cells, metric = task
        errors = read_errors(results, cells, metric)
        most = greatest_slope(results, cells, metric)
        return [labels | {"metric": metric} | row for row in fit_rows(errors, independent, most)]

    found = []
    progress("curves fitted", 0, len(tasks))
    with ThreadPoolExecutor(cores()) as pool:
        for done, task_rows in enumerate(pool.map(rows_of_task, tasks), 1):
            found += task_rows
            progress("curves fitted", done, len(tasks))
    return pd.DataFrame(found, columns=pd.Index([*groups[0][0].labels, *FIT_COLUMNS]))


def fitted_groups(results: Results) -> list[Group]:
    """Return the groups with an ā > 0; raises FolderError if there is none, or no navigator."""
    if is_leaderless(results.study.cells):
        raise FolderError(f"{results.place}: {NO_ULTIMATE_ERROR}")
    groups = [group for group in attacked_groups(results.study.cells) if group.attacked]
    if not groups:
        raise FolderError(
            f"{results.place}: no cell has an attack with ā > 0 that is fixed or swept, nothing to fit"
        )
    return groups


def greatest_slope(results: Results, cells: dict[int, float], metric: str) -> float:
    """Return the greatest error per ā that theory allows in any lane of some cells.

    The slope is infinite where theory gives no bound.
    """
    slopes = [
        ceilings(results.study.config, results.study.cells[cell], range(results.samples[cell]))[
            metric
        ]
        / size
        for cell, size in cells.items()
    ]
    return float(np.max(slopes))


def read_errors(results: Results, cells: dict[int, float], metric: str) -> Errors:
    """Return the errors of the lanes of some cells."""
    place = {cell: row for row, cell in enumerate(cells)}
    y = np.full((len(cells), results.manifest["samples"]), np.nan)
    for cell, lanes in results.by_cell("sample", metric, where=rows.OK, cells=cells):
        y[place[cell], lanes["sample"]] = lanes[metric]
    return Errors(np.array(list(cells.values())), y)


def draw_resamples(samples: int, at_once: int) -> Iterator[np.ndarray]:
    """Yield how often each resample draws each sample, `at_once` resamples at a time."""
    random = np.random.default_rng(SEED)
    for first in range(0, RESAMPLES, at_once):
        drawn = (
            random.integers(samples, size=samples) for _ in range(min(at_once, RESAMPLES - first))
        )
        yield np.stack([np.bincount(each, minlength=samples).astype(np.int16) for each in drawn])


def fit_rows(
    errors: Errors, independent: bool = True, most: float = np.inf
) -> Iterator[dict[str, object]]:
    """Yield the rows of one set of errors; `most` bounds the errors per ā.

    The rows have no intervals if samples are not independent (`independent` is False).
    """
    if not errors.models:
        return
    samples, models, ranked = errors.y.shape[1], errors.models, errors.ranked()
    once = np.ones((1, samples), np.int16)
    points = estimates(ranked, once, (*FITTED_QUANTILES, ENVELOPE), models, EXACT)
    at_once = max(1, min(RESAMPLES_TOGETHER, MOST_FIT_WEIGHTS // ranked.data.ratios[:, :, 0].size))
    drawn = bootstrap(ranked, draw_resamples(samples, at_once), models) if independent else {}
    known = {quantile: bootstrap_suffices(errors, quantile) for quantile in drawn}
    sloped = has_slope(errors)
    if len(models) > 1:
        points[None]["constant"] = np.array([[constant_fit(errors)]])
    for quantile, estimated in points.items():
        for model, (estimate,) in estimated.items():
            low, high = np.full((2, len(estimate)), np.nan)
            if independent and quantile is None and model == "proportional":
                low[:], high[:] = mean_ratio(errors, most)
            elif (
                model in drawn.get(quantile, ())
                and known[quantile]
                and (model == "proportional" or not is_ambiguous(drawn[quantile]))
            ):
                low, high = percentile_interval(drawn[quantile][model])
                low, high = (
                    np.minimum(low, estimate),
                    np.maximum(high, estimate),
                )  # resamples are coarse
            score = aicc(errors, model, estimate) if quantile is None else np.nan
            if model == "proportional" and not sloped:
                estimate = low = high = np.full(1, np.nan)
            for name, *numbers in zip(MODELS.get(model, "c"), estimate, low, high, strict=True):
                row = (model, quantile, name, *numbers, score)
                yield dict(zip(FIT_COLUMNS[1:], row, strict=True))


def constant_fit(errors: Errors) -> float:
    """Return the constant error of least squares, with weights 1/x²."""
    weights = np.isfinite(errors.y) * (errors.x.min() / errors.x[:, None]) ** 2
    return float(np.nansum(weights * errors.y) / weights.sum())


def has_slope(errors: Errors) -> bool:
    """Return whether s·ā may describe the errors.

    It does not if a constant is decisively better by AICc and the errors do not rise with ā. The second
    condition keeps the slope of a rise that weights 1/x² hide behind a transient. Errors rise if the samples'
    mean slope over log ā is two standard errors above 0, or if one sample rises three times as steeply as any
    falls.
    """
    ratios = errors.y / errors.x[:, None]
    straight = aicc(errors, "proportional", np.array([np.nanmean(ratios)]))
    flat = aicc(errors, "constant", np.array([constant_fit(errors)]))
    if np.nanmax(ratios) < EXACT_FIT or not straight - np.nan_to_num(flat, nan=-np.inf) > DECISIVE:
        return True
    known = np.isfinite(errors.y).any(axis=1)
    whole = errors.y[known][:, np.isfinite(errors.y[known]).all(axis=0)]
    logs = np.log(errors.x[known])
    rises = (logs - logs.mean()) @ whole / np.sum((logs - logs.mean()) ** 2)
    rises = np.where(np.abs(rises) > EXACT_FIT * np.nanmax(errors.y), rises, 0.0)
    error = rises.std() / np.sqrt(max(1, rises.size - 1))
    steepest = rises.max(initial=0.0)
    return bool(
        not rises.size or rises.mean() > 2 * error or steepest > -3 * rises.min(initial=0.0)
    )


def bootstrap(ranked: Ranked, counts: Iterable[np.ndarray], models: tuple[str, ...]) -> Estimates:
    """Return the estimates of all resamples."""
    parts = [estimates(ranked, some, FITTED_QUANTILES, models, RESAMPLED) for some in counts]
    return {
        quantile: {
            model: np.concatenate([part[quantile][model] for part in parts]) for model in models
        }
        for quantile in parts[0]
    }


def estimates(
    ranked: Ranked,
    counts: np.ndarray,
    quantiles: tuple[float, ...],
    models: tuple[str, ...],
    effort: Effort,
) -> Estimates:
    """Return the parameters of some models per row of counts, by least squares (None) and at quantiles.

    The computation uses double precision in every process.
    """
    bins = (ranked.bins @ np.ascontiguousarray(counts.T)).T.reshape(
        -1, *ranked.data.ratios.shape[:2]
    )
    weights, sums = np.split(counts.astype(float) @ ranked.lanes, 2, axis=1)
    with jax.enable_x64(True):
        means = least_squares(
            ranked.data.x, weights, sums / np.maximum(weights, 1.0), effort, models
        )
        rest = quantile_regression(
            ranked.data, bins.astype(float), np.array(quantiles), effort, models
        )
    found = {model: [np.asarray(means[model]), *np.asarray(rest[model])] for model in models}
    return {
        each: {model: found[model][n] for model in models}
        for n, each in enumerate((None, *quantiles))
    }


def mean_ratio(errors: Errors, most: float) -> tuple[float, float]:
    """Return the interval of the mean error per ā, which is the slope of least squares."""
    ratios = errors.y / errors.x[:, None]
    counts = np.isfinite(ratios).sum(axis=0)
    sums = np.nansum(ratios, axis=0)[counts > 0]
    return means.mean_interval(sums, 0.0, most, CONFIDENCE, counts[counts > 0].astype(float))


def bootstrap_suffices(errors: Errors, quantile: float | None) -> bool:
    """Return whether there are enough draws for a bootstrap; with fewer its interval covers too little.

    At a quantile, FEWEST_BEYOND draws must lie beyond it. For least squares, n over the kurtosis of the
    draws' mean errors per ā estimates the number of draws that make up the variance. This number is small if
    few draws have large errors. If all errors are rounding, nothing is known of large errors.
    """
    ratios = errors.y / errors.x[:, None]
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


def is_ambiguous(drawn: dict[str, np.ndarray]) -> bool:
    """Return whether the resamples leave open if a quantile is rounding or an error.

    A curve at such a quantile may be either.
    """
    low, high = percentile_interval(drawn["proportional"])
    return bool(low[0] < EXACT_FIT <= high[0])


def percentile_interval(drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the percentile interval of each parameter; resamples with only failed lanes are left out."""
    ordered, counted = np.sort(drawn, axis=0), np.isfinite(drawn[:, 0]).sum()
    outside = int((1 - CONFIDENCE) / 2 * counted)
    return ordered[outside], ordered[counted - 1 - outside]


def aicc(errors: Errors, model: str, parameters: np.ndarray) -> float:
    """Return Akaike's criterion with its small-sample correction, for (y − f)/x.

    The criterion is not-a-number if (y − f)/x is rounding. It is `n log(RSS/n) + 2k + 2k(k + 1)/(n − k − 1)`,
    where k includes the variance (Hurvich and Tsai 1989).
    """
    ratios = errors.y / errors.x[:, None]
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
    """Return the number of samples whose lanes are ok at every ā of a group."""
    errors = read_errors(results, group.attacked, SUMMARISED[0])
    return int(np.isfinite(errors.y).all(axis=0).sum())
