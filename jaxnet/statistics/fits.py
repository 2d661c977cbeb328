"""δ̂(ā), the fleet's ultimate error against the size of the attack: `fit.csv`.

Each group of cells that differ in ā alone, and each of tail_mean and tail_max, is fitted with the curves of
`curves` by the estimators of `regression`; cells with ā = 0 and failed lanes take no part. The unit of all
intervals is the sample and not the row, for sample s is the same random draw in every cell. The slope of
least squares is a mean of errors per ā, and has the interval of `means`. Other intervals are the 2.5 and
97.5 % points of fits to samples drawn again with replacement, where `enough` samples make up the sum: few
lanes off among many that recovered give a bootstrap that covers too little. The envelope has none, as the
bootstrap fails for a maximum: `recovery.below_greatest` says what is known of it. Nor are there any of
Sobol's sequences, whose points are not independent and whose number is small.
"""

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import numpy as np
import pandas as pd
from scipy.sparse import csr_array

from jaxnet.engine.cores import cores
from jaxnet.statistics import means
from jaxnet.statistics.families import MODELS, model_value
from jaxnet.statistics.groups import Group, attacked_groups
from jaxnet.statistics.limits import ceilings
from jaxnet.statistics.recovery import CONFIDENCE
from jaxnet.statistics.regression import Data, Effort, least_squares, quantile_regression
from jaxnet.statistics.steps import Steps, no_progress
from jaxnet.statistics.summary import SUMMARISED
from jaxnet.store import rows
from jaxnet.store.folder import FolderError
from jaxnet.store.results import Results

FIT_COLUMNS = ("metric", "model", "quantile", "parameter", "estimate", "low", "high", "aicc")
FITTED_QUANTILES = (0.5, 0.95)
ENVELOPE = 1.0
RESAMPLES = 1000
SEED = 0
EXACT = Effort(stride=1, shapes=48, scales=48)  # to rounding
RESAMPLED = Effort(stride=8, shapes=12, scales=10)  # to hundredths of an interval where a model is wrong
MOST_BINS = 4096  # of lanes of one magnitude with a weight of their own; of more lanes, neighbours share one
RESAMPLES_TOGETHER = 25  # resamples fitted side by side
MOST_FIT_WEIGHTS = 2**22  # weights of theirs
FEWEST, FEWEST_BEYOND = 50, 10  # draws that make up the scatter of a mean; draws beyond a quantile
EXACT_FIT = 1e-9  # of the errors, or of ā: what the transient and rounding leave, which is no scatter
LEAST_RESIDUAL = 1e-12

NO_CURVE_INTERVAL = (
    "no interval: too few draws are off, or beyond the quantile; no upper end: theory does not bound the"
    " error"
)

Estimates = dict[float | None, dict[str, np.ndarray]]  # parameters by quantile and model: a row per resample


class Errors(NamedTuple):
    """What is fitted: errors [m] at magnitudes x > 0, by sample; not-a-number where a lane failed."""

    x: np.ndarray
    y: np.ndarray

    @property
    def models(self) -> tuple[str, ...]:
        """Those that have no more parameters than there are magnitudes."""
        known = np.isfinite(self.y).any(axis=1).sum()
        return tuple(model for model, names in MODELS.items() if len(names) <= known)

    def ranked(self) -> "Ranked":
        """For the estimators."""
        ratios = self.y / self.x[:, None]
        there = np.isfinite(ratios)
        magnitudes, samples = ratios.shape
        width = -(-samples // MOST_BINS)
        bins = -(-samples // width)
        ratios = np.where(there, ratios, np.inf)
        order = np.argsort(ratios, axis=1, kind="stable")
        ordered = np.full((magnitudes, bins * width), np.inf)
        ordered[:, :samples] = np.take_along_axis(ratios, order, axis=1)
        ordered = ordered.reshape(magnitudes, bins, width)
        sums = np.zeros((magnitudes, bins, width + 1))
        np.cumsum(np.where(np.isfinite(ordered), ordered, 0.0), axis=2, out=sums[:, :, 1:])
        firsts = np.add.outer(np.arange(magnitudes) * samples, np.arange(bins) * width)
        members = (
            np.take_along_axis(there, order, axis=1).ravel().astype(np.int16),
            order.ravel(),
            np.append(firsts, there.size),
        )
        return Ranked(
            Data(self.x, ordered, sums),
            csr_array(members, shape=(magnitudes * bins, samples)),
            np.concatenate([there, np.where(there, ratios, 0.0)]).T,
        )


class Ranked(NamedTuple):
    """Errors as the estimators take them, and what makes of the samples' weights those that they need."""

    data: Data
    bins: csr_array  # of all magnitudes' bins, the samples in each
    lanes: np.ndarray  # by sample, of each magnitude whether there is a lane; then the error per ā of each


def fit_table(results: Results, told: Steps = no_progress) -> pd.DataFrame:
    """`fit.csv`: a row per group, metric, model, quantile (none: least squares) and parameter.

    Models with more parameters than a group has magnitudes are left out, and so are intervals of too few
    draws. Raises FolderError where no cell has an attack with ā > 0 that is fixed or swept.
    """
    groups = [(group, group.attacked) for group in fitted_groups(results)]
    asked = [(group.labels, cells, metric) for group, cells in groups for metric in SUMMARISED]
    alone = results.study.config.draws == "random"

    def of(one: tuple[dict[str, Any], dict[int, float], str]) -> list[dict[str, Any]]:
        labels, cells, metric = one
        errors = read_errors(results, cells, metric)
        most = greatest_slope(results, cells, metric)
        return [labels | {"metric": metric} | row for row in fit_rows(errors, alone, most)]

    found = []
    told("curves fitted", 0, len(asked))
    with ThreadPoolExecutor(cores()) as pool:
        for done, rows_of_one in enumerate(pool.map(of, asked), 1):
            found += rows_of_one
            told("curves fitted", done, len(asked))
    return pd.DataFrame(found, columns=pd.Index([*groups[0][0].labels, *FIT_COLUMNS]))


def fitted_groups(results: Results) -> list[Group]:
    """Groups with an ā > 0; raises FolderError if there is none."""
    groups = [group for group in attacked_groups(results.study.cells) if group.attacked]
    if not groups:
        raise FolderError(
            f"{results.path}: no cell has an attack with ā > 0 that is fixed or swept, nothing to fit"
        )
    return groups


def greatest_slope(results: Results, cells: dict[int, float], metric: str) -> float:
    """The greatest error per ā that theory allows in any lane of some cells; infinite where it allows all."""
    samples = range(results.manifest["samples"])
    slopes = [
        ceilings(results.study.config, results.study.cells[cell], samples)[metric] / size
        for cell, size in cells.items()
    ]
    return float(np.max(slopes))


def read_errors(results: Results, cells: dict[int, float], metric: str) -> Errors:
    """Errors of some cells' lanes."""
    place = {cell: row for row, cell in enumerate(cells)}
    y = np.full((len(cells), results.manifest["samples"]), np.nan)
    for cell, lanes in results.by_cell("sample", metric, where=rows.OK, cells=cells):
        y[place[cell], lanes["sample"]] = lanes[metric]
    return Errors(np.array(list(cells.values())), y)


def draw_resamples(samples: int, at_once: int) -> Iterator[np.ndarray]:
    """How often each sample is drawn in each resample, so many of these at once."""
    random = np.random.default_rng(SEED)
    for first in range(0, RESAMPLES, at_once):
        drawn = (random.integers(samples, size=samples) for _ in range(min(at_once, RESAMPLES - first)))
        yield np.stack([np.bincount(each, minlength=samples).astype(np.int16) for each in drawn])


def fit_rows(errors: Errors, alone: bool = True, most: float = np.inf) -> Iterator[dict[str, Any]]:
    """Rows on one set of errors of `most` per ā; without intervals if no sample is `alone`, independent of
    others.
    """
    if not errors.models:
        return
    samples, models, ranked = errors.y.shape[1], errors.models, errors.ranked()
    once = np.ones((1, samples), np.int16)
    points = estimates(ranked, once, (*FITTED_QUANTILES, ENVELOPE), models, EXACT)
    at_once = max(1, min(RESAMPLES_TOGETHER, MOST_FIT_WEIGHTS // ranked.data.ratios[:, :, 0].size))
    drawn = bootstrap(ranked, draw_resamples(samples, at_once), models) if alone else {}
    known = {quantile: bootstrap_suffices(errors, quantile) for quantile in drawn}
    for quantile, estimated in points.items():
        for model, (estimate,) in estimated.items():
            low, high = np.full((2, len(estimate)), np.nan)
            if alone and quantile is None and model == "proportional":
                low[:], high[:] = mean_ratio(errors, most)
            elif (
                quantile in drawn
                and known[quantile]
                and (model == "proportional" or not is_ambiguous(drawn[quantile]))
            ):
                low, high = percentile_interval(drawn[quantile][model])
                low, high = np.minimum(low, estimate), np.maximum(high, estimate)  # searched coarser
            score = aicc(errors, model, estimate) if quantile is None else np.nan
            for name, *numbers in zip(MODELS[model], estimate, low, high, strict=True):
                row = (model, quantile, name, *numbers, score)
                yield dict(zip(FIT_COLUMNS[1:], row, strict=True))


def bootstrap(ranked: Ranked, counts: Iterable[np.ndarray], models: tuple[str, ...]) -> Estimates:
    """Estimates of all resamples."""
    parts = [estimates(ranked, some, FITTED_QUANTILES, models, RESAMPLED) for some in counts]
    return {
        quantile: {model: np.concatenate([part[quantile][model] for part in parts]) for model in models}
        for quantile in parts[0]
    }


def estimates(
    ranked: Ranked, counts: np.ndarray, quantiles: tuple[float, ...], models: tuple[str, ...], effort: Effort
) -> Estimates:
    """Parameters of some models by row of counts, by least squares (None) and at quantiles.

    In double precision whatever the process's default is.
    """
    bins = (ranked.bins @ np.ascontiguousarray(counts.T)).T.reshape(-1, *ranked.data.ratios.shape[:2])
    weights, sums = np.split(counts.astype(float) @ ranked.lanes, 2, axis=1)
    with jax.enable_x64(True):
        means = least_squares(ranked.data.x, weights, sums / np.maximum(weights, 1.0), effort, models)
        rest = quantile_regression(ranked.data, bins.astype(float), np.array(quantiles), effort, models)
    found = {model: [np.asarray(means[model]), *np.asarray(rest[model])] for model in models}
    return {each: {model: found[model][n] for model in models} for n, each in enumerate((None, *quantiles))}


def mean_ratio(errors: Errors, most: float) -> tuple[float, float]:
    """The interval of the mean error per ā, which is the slope of least squares."""
    ratios = errors.y / errors.x[:, None]
    there = np.isfinite(ratios).sum(axis=0)
    sums = np.nansum(ratios, axis=0)[there > 0]
    return means.mean_interval(sums, 0.0, most, CONFIDENCE, there[there > 0].astype(float))


def bootstrap_suffices(errors: Errors, quantile: float | None) -> bool:
    """Whether the draws suffice for a bootstrap: with fewer its interval covers too little.

    Of a quantile, so many draws must lie beyond it. Of least squares, n over the kurtosis of the draws' mean
    errors per ā says how many draws make up the scatter: few where few are off. Where all errors are rounding
    nothing is known of the draws that are off.
    """
    ratios = errors.y / errors.x[:, None]
    there = np.isfinite(ratios)
    draws = there.any(axis=0)
    if quantile is not None:
        return bool(draws.sum() * min(quantile, 1 - quantile) >= FEWEST_BEYOND)
    each = np.nansum(ratios, axis=0)[draws] / there.sum(axis=0)[draws]
    size = each.max(initial=0.0)
    if size < EXACT_FIT:
        return False
    apart = each / size - (each / size).mean()
    squares = np.where(np.abs(apart) > EXACT_FIT, apart**2, 0.0)
    return bool(len(each) >= FEWEST and squares.sum() ** 2 >= FEWEST * np.square(squares).sum())


def is_ambiguous(drawn: dict[str, np.ndarray]) -> bool:
    """Whether draws leave open if a quantile is rounding or an error: its curve may then be either."""
    low, high = percentile_interval(drawn["proportional"])
    return bool(low[0] < EXACT_FIT <= high[0])


def percentile_interval(drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The percentile interval of each parameter; a resample of none but failed lanes counts for nothing."""
    ordered, counted = np.sort(drawn, axis=0), np.isfinite(drawn[:, 0]).sum()
    outside = int((1 - CONFIDENCE) / 2 * counted)
    return ordered[outside], ordered[counted - 1 - outside]


def aicc(errors: Errors, model: str, parameters: np.ndarray) -> float:
    """Akaike's criterion with its correction for few rows, of (y − f)/x; nan where that is rounding.

    `n log(RSS/n) + 2k + 2k(k + 1)/(n − k − 1)`, k counting the variance too (Hurvich and Tsai 1989).
    """
    ratios = errors.y / errors.x[:, None]
    there, k = np.isfinite(ratios), len(parameters) + 1
    n = there.sum()
    size = np.nanmax(ratios)
    if n <= k + 1 or size < LEAST_RESIDUAL:
        return np.nan
    with np.errstate(over="ignore", invalid="ignore"):  # a curve may leave all numbers, and is no model then
        residuals = (ratios - (model_value(model, errors.x, parameters) / errors.x)[:, None]) / size
        spread, scale = (np.sqrt(np.mean(each[there] ** 2)) for each in (residuals, ratios / size))
    if not max(EXACT_FIT * scale, LEAST_RESIDUAL / size) <= spread < np.inf:
        return np.nan
    return float(2 * n * (np.log(spread) + np.log(size)) + 2 * k + 2 * k * (k + 1) / (n - k - 1))


def whole_draws(results: Results, group: Group) -> int:
    """Samples whose lanes ended at every ā of a group."""
    errors = read_errors(results, group.attacked, SUMMARISED[0])
    return int(np.isfinite(errors.y).all(axis=0).sum())
