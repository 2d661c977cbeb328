"""Fits of δ̂(ā): against parameters that are known, linear programs and brute force."""

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import linprog

import jaxnet
from experiments import coverage
from jaxnet.statistics import fits as fit
from jaxnet.statistics import regression
from jaxnet.statistics.regression import ENVELOPE, MODELS, Errors, model_value
from jaxnet.store.folder import FolderError
from tests import systems

X = np.array([0.1, 0.5, 3.0, 20.0, 100.0])
S = 40
ONCE = np.ones((1, S), np.int16)
TRUE = {"proportional": (2.5,), "affine": (0.7, 3.0), "power": (2.0, 0.6)}
QUANTILES = (*fit.FITTED_QUANTILES, ENVELOPE)


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch):
    monkeypatch.setattr(fit, "RESAMPLES", 100)


def best(errors, counts=ONCE):
    """Parameters of each model, by quantile (None: least squares)."""
    found = {None: regression.least_squares(errors, counts)}
    found |= {quantile: regression.quantile_regression(errors, quantile) for quantile in QUANTILES}
    return {key: {model: each[0] for model, each in at.items()} for key, at in found.items()}


def noisy(seed=0, model="affine", spread=0.4):
    """Skewed errors about a curve, some lanes failed."""
    random = np.random.default_rng(seed)
    scatter = random.lognormal(sigma=spread, size=(1, S))
    scatter = scatter * random.lognormal(sigma=spread, size=(len(X), S))
    y = model_value(model, X, TRUE[model])[:, None] * scatter
    y[1, 3:9] = y[4, 0] = np.nan
    return Errors(X, y)


def pinball(errors, model, parameters, quantile):
    """The loss of y with weights 1/x, by its definition."""
    residual = (errors.y - model_value(model, errors.x, parameters)[:, None]) / errors.x[:, None]
    return np.nansum(np.where(residual >= 0, quantile, quantile - 1) * residual)


@pytest.mark.parametrize("model", MODELS)
def test_noiseless_data_give_their_parameters_back(model):
    y = np.repeat(model_value(model, X, TRUE[model])[:, None], S, axis=1)
    for at in best(Errors(X, y)).values():
        np.testing.assert_allclose(at[model], TRUE[model], rtol=1e-8)
        if model == "proportional":
            np.testing.assert_allclose(at["affine"], (0, 2.5), atol=1e-12)
            np.testing.assert_allclose(at["power"], (2.5, 1), rtol=1e-12)


@pytest.mark.parametrize("quantile", fit.FITTED_QUANTILES)
@pytest.mark.parametrize("model", ["proportional", "affine"])
def test_quantile_regression_solves_the_linear_program(model, quantile):
    """HiGHS finds no lower loss."""
    errors = noisy(1, "power")
    there = np.isfinite(errors.y).ravel()
    x, y = np.repeat(X, S)[there], errors.y.ravel()[there]
    design = np.stack([np.ones_like(x), x][-len(MODELS[model]) :], axis=1)
    width, eye = design.shape[1], np.eye(len(x))
    program = linprog(
        np.concatenate([np.zeros(width), quantile / x, (1 - quantile) / x]),
        A_eq=np.hstack([design, eye, -eye]),
        b_eq=y,
        bounds=[(None, None)] * width + [(0, None)] * (2 * len(x)),
    )
    ours = pinball(errors, model, best(errors)[quantile][model], quantile)
    assert ours == pytest.approx(program.fun, rel=1e-9)


def erratic(seed):
    """Errors about no curve at all: their losses have several minima."""
    random = np.random.default_rng(seed)
    slopes = np.exp(2 * random.normal(size=(len(X), 1)))
    return Errors(X, X[:, None] * slopes * random.lognormal(sigma=0.5, size=(len(X), S)))


@pytest.mark.parametrize("errors", [noisy(5, "affine"), erratic(2)], ids=["affine", "erratic"])
def test_no_power_of_a_fine_grid_is_better(errors):
    """Each exponent of the grid has its best scale: a ratio near their weighted quantile."""
    there = np.isfinite(errors.y).ravel()
    for quantile in fit.FITTED_QUANTILES:
        lowest = np.inf
        for exponent in np.linspace(-2, 5, 351):
            curve = np.repeat(X**exponent, S)[there]
            scales, weight = errors.y.ravel()[there] / curve, curve / np.repeat(X, S)[there]
            order = np.argsort(scales)
            middle = np.searchsorted(np.cumsum(weight[order]), quantile * weight.sum())
            for scale in scales[order][max(0, middle - 1) : middle + 2]:
                lowest = min(lowest, pinball(errors, "power", (scale, exponent), quantile))
        ours = pinball(errors, "power", best(errors)[quantile]["power"], quantile)
        assert lowest * (1 - 2e-2) < ours <= lowest * (1 + 1e-12)


def test_least_squares_weigh_all_magnitudes_alike():
    """The mean of y/x, and the normal equations with weights 1/x²; no step of a power is lower."""
    errors = noisy(1, "affine")
    there, ratios, found = np.isfinite(errors.y), errors.ratios, best(errors)[None]
    assert found["proportional"][0] == pytest.approx(np.mean(ratios[there]), rel=1e-12)
    design = np.stack([np.repeat(1 / X, S), np.ones(len(X) * S)], axis=1)[there.ravel()]
    np.testing.assert_allclose(
        found["affine"], np.linalg.lstsq(design, ratios[there])[0], rtol=1e-9
    )

    def loss(parameters):
        curve = model_value("power", X, parameters)[:, None]
        return np.nansum(((errors.y - curve) / X[:, None]) ** 2)

    steps = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1))
    around = [found["power"] * (1 + 1e-4 * np.array(step)) for step in steps]
    assert all(loss(parameters) > loss(found["power"]) for parameters in around)


def test_counts_stand_for_samples_drawn_more_than_once():
    """Fits with the counts of a resample are fits to its samples."""
    errors, counts = noisy(3), next(fit.draw_resamples(S, 1))
    drawn = best(Errors(X, np.repeat(errors.y, counts[0], axis=1)))
    for model, found in best(errors, counts)[None].items():
        np.testing.assert_allclose(found, drawn[None][model], rtol=1e-7)
    slopes = fit.drawn_slopes(errors, counts, list(fit.FITTED_QUANTILES))[0]
    assert slopes.tolist() == [drawn[each]["proportional"][0] for each in fit.FITTED_QUANTILES]


def test_neighbours_that_share_a_mean_change_little(monkeypatch):
    random = np.random.default_rng(0)
    errors = Errors(X, X[:, None] * random.lognormal(sigma=0.5, size=(len(X), 4000)))
    whole = best(errors, np.ones((1, 4000), np.int16))
    monkeypatch.setattr(regression, "MOST_BINS", 500)
    binned = best(errors, np.ones((1, 4000), np.int16))
    for quantile in fit.FITTED_QUANTILES:
        np.testing.assert_allclose(binned[quantile]["power"], whole[quantile]["power"], rtol=0.01)


def test_samples_are_resampled_and_not_rows():
    """Where all magnitudes share a sample's draw, observations are as many as samples."""
    shared = 1 + 0.3 * np.random.default_rng(0).normal(size=1000)
    rows = [*fit.fit_rows(Errors(X, X[:, None] * shared))]
    width = 2 * 1.96 * shared.std() / np.sqrt(1000)
    for model, parameter in (("proportional", "s"), ("power", "c")):
        row = next(row for row in rows if (row["model"], row["parameter"]) == (model, parameter))
        assert row["quantile"] is None
        assert row["high"] - row["low"] == pytest.approx(width, rel=0.2)


def test_order_and_unit_do_not_matter():
    """Errors in another unit scale b, s and c and leave p."""
    errors, random = noisy(6), np.random.default_rng(1)
    cells, samples = random.permutation(len(X)), random.permutation(S)
    mixed = best(Errors(X[cells], errors.y[cells][:, samples]))
    scaled = best(Errors(X, 1e3 * errors.y))
    for quantile, at in best(errors).items():
        for model, found in at.items():
            np.testing.assert_allclose(mixed[quantile][model], found, rtol=1e-7)
            unit = np.array([1e3, 1e3 if model == "affine" else 1.0])[: len(found)]
            np.testing.assert_allclose(scaled[quantile][model], unit * found, rtol=1e-7)


@pytest.mark.parametrize("model", MODELS)
def test_the_envelope_is_above_all_data_and_touches_them(model):
    """As many data are touched as there are parameters."""
    errors = noisy(7, "affine")
    slack = model_value(model, X, best(errors)[ENVELOPE][model])[:, None] / errors.y - 1
    assert np.nanmin(slack) > -1e-9
    assert np.sum(slack < 1e-9) == len(MODELS[model])


@pytest.mark.parametrize(
    ("fewest", "quantile", "rest"), [(20, 0.5, 0), (200, 0.95, 0), (50, None, 1e-28), (50, None, 1)]
)
def test_no_interval_of_too_few_draws(fewest, quantile, rest):
    """For a mean those off count; np off of n have n / kurtosis = np (1 - p)/(1 - 3p (1 - p))."""
    for draws, told in ((int(0.9 * fewest), False), (int(1.12 * fewest), True)):
        y = np.ones((1, draws))
        if quantile is None:
            y = np.full((1, 20 * draws), float(rest))
            y[0, :draws] = 3.0
        assert fit.bootstrap_suffices(Errors(np.ones(1), y), quantile) is told


def test_nothing_is_resampled_where_all_is_rounding():
    """Draws that are off may be unseen, so curves have no intervals."""
    y = X[:, None] * 1e-28 * np.random.default_rng(0).random((1, 1000))
    rows = pd.DataFrame(fit.fit_rows(Errors(X, y)))
    curves = rows[rows["model"] != "proportional"]
    assert curves[["low", "high"]].isna().all(axis=None)


def test_aicc_finds_the_model_and_is_blank_without_residuals():
    for model in ("affine", "power"):
        rows = pd.DataFrame(fit.fit_rows(noisy(9, model, spread=0.03)))
        assert rows["quantile"].isna().sum() == rows["aicc"].notna().sum() == 6
        assert rows.loc[rows["aicc"].idxmin(), "model"] == model
    scatter = 1 + 1e-10 * np.random.default_rng(0).normal(size=(len(X), S))
    rows = pd.DataFrame(fit.fit_rows(Errors(X, 2.0 * X[:, None] * scatter)))
    assert rows.loc[rows["model"] != "constant", "aicc"].isna().all()
    few = Errors(X[:2], np.array([[0.1, 0.3], [0.5, 1.5]]))  # residuals per ā are 1: by hand
    assert fit.aicc(few, "proportional", np.array([2.0])) == pytest.approx(4 + 12)
    assert np.isnan(fit.aicc(few, "affine", np.array([0.0, 2.0])))


def scattered(curve, seed):
    """Errors about a curve, of scatter that cells share and that they do not."""
    random = np.random.default_rng(seed)
    scatter = 1 + 0.15 * (random.normal(size=(1, S)) + random.normal(size=(len(X), S)))
    return Errors(X, curve[:, None] * scatter)


@pytest.mark.parametrize(
    ("curve", "told"),
    [
        (2.5 * X, True),
        (np.full(len(X), 0.7), False),
        (4 * X / (1 + X / 8), True),
        (1e4 * X / (1 + 1e4 * X), False),  # constant from the least ā on
        (0.7 + 0.05 * X, True),  # a transient, and a rise that is small beside it at most ā
        (0.7 - 0.005 * X, False),
        (2 * X**0.6, True),
    ],
)
def test_a_slope_is_told_where_errors_rise(curve, told):
    """For 99 of 100 studies that rise and 94 of 100 that don't, as their scatter is drawn."""
    kept = np.mean([fit.has_slope(scattered(curve, seed)) for seed in range(100)])
    assert kept >= 0.99 if told else kept <= 0.06


def test_where_is_no_slope_no_quantile_has_one():
    """Estimates and intervals of s·ā are blank; the other models are there."""
    scatter = 1 + 0.2 * np.random.default_rng(0).random(S)
    flat = Errors(X, 0.7 * scatter * np.ones((len(X), 1)))
    rows = pd.DataFrame(fit.fit_rows(flat)).set_index("model")
    assert rows.loc["proportional", ["estimate", "low", "high"]].isna().all(axis=None)
    assert rows.loc["power", "estimate"].notna().all()
    scores = rows.loc[rows["quantile"].isna(), "aicc"]
    assert scores.loc["constant"] < scores.loc["proportional"] - 100
    assert rows.loc["constant", "estimate"] == pytest.approx(flat.y[0].mean())
    assert fit.has_slope(Errors(X, 1e-13 * (1 + flat.y)))  # rounding has the slope 0
    one = Errors(X, np.where(np.arange(S) == 3, X[:, None], 0.7))  # of forty lanes one is lost
    assert fit.has_slope(one)


def test_extreme_errors_are_fitted_without_complaint():
    """Recovered fleets at 1e-28 beside lost ones, zeros, and a magnitude without a lane."""
    random = np.random.default_rng(0)
    y = X[:, None] * np.where(random.random((len(X), S)) < 0.8, 1e-28, 2.0)
    y *= random.random((len(X), S))
    y[2], y[3] = 0.0, np.nan
    rows = pd.DataFrame(fit.fit_rows(Errors(X, y)))
    assert rows["estimate"].notna().all()
    slope = rows[(rows["quantile"] == 0.5) & (rows["model"] == "proportional")]
    assert 0 <= slope["estimate"].item() < 1e-28
    nothing = pd.DataFrame(fit.fit_rows(Errors(X, np.zeros((len(X), S)))))
    assert (nothing.loc[nothing["parameter"].isin(["s", "b", "c"]), "estimate"] == 0).all()
    assert (nothing.loc[nothing["parameter"] == "p", "estimate"] == 1).all()
    for x in ([1e-300, 1e300], [1e290, 1e300]):
        y = np.array(x)[:, None] * 2.0 * np.ones((1, S))
        rows = pd.DataFrame(fit.fit_rows(Errors(np.array(x), y)))
        np.testing.assert_allclose(rows[rows["model"] == "proportional"]["estimate"], 2.0)


def results(lanes, **keys):
    """Results of a study whose lanes are these."""
    return systems.results_of(jaxnet.load({"samples": S, **keys}), lanes)


def test_table_holds_every_fit():
    """Failed lanes and ā = 0 take no part."""
    sweep = {"topology": ["star", "path"], "attack.magnitude": [100, 0, *X[:4].tolist()]}
    y, rows = {"star": noisy(10).y, "path": noisy(11).y}, []
    for cell in jaxnet.load({"sweep": sweep}).cells:
        place = np.flatnonzero(cell.labels["attack.magnitude"] == X)
        errors = y[cell.labels["topology"]][place[0]] if len(place) else np.full(S, 1e9)
        ok = np.isfinite(errors)
        lanes = {"sample": range(S), "status": np.where(ok, "ok", "max_steps")}
        lanes |= {"tail_mean": np.where(ok, errors, 1e9), "tail_max": 2 * errors}
        rows.append(pd.DataFrame({"cell": cell.number, **lanes}))
    table = fit.fit_table(results(pd.concat(rows), sweep=sweep, attack="replay"))
    assert list(table.columns) == ["topology", *fit.FIT_COLUMNS]
    assert len(table) == 2 * 2 * (4 * 5 + 1)
    assert set(table["model"]) == {*MODELS, "constant"}
    known = table[table["model"] == "proportional"].set_index(["topology", "metric"])["estimate"]
    for topology, number in (("star", 10), ("path", 11)):
        direct = pd.DataFrame(fit.fit_rows(noisy(number)))
        direct = direct[direct["model"] == "proportional"]["estimate"]
        for metric, unit in (("tail_mean", 1.0), ("tail_max", 2.0)):
            np.testing.assert_allclose(known.loc[topology, metric], unit * direct, rtol=1e-9)


def test_fewer_magnitudes_fewer_models():
    one = np.where(X[:, None] == 3.0, noisy().y, np.nan)
    assert {row["model"] for row in fit.fit_rows(Errors(X, one))} == {"proportional"}
    assert list(fit.fit_rows(Errors(X, np.full((len(X), S), np.nan)))) == []
    for keys in ({"attack": "none"}, {"attack": {"magnitude": 0}}):
        with pytest.raises(FolderError, match="no cell has an attack with ā > 0"):
            fit.fit_table(results(pd.DataFrame({"sample": [0]}), **keys))


def test_intervals_cover():
    """The slope of 200 known studies: 93 %, less three binomial deviations, is 88 %."""
    covered = coverage.coverage(200, coverage.SPREADS["both"], magnitudes=4)
    assert np.all(covered >= 0.93 - 3 * np.sqrt(0.93 * 0.07 / 200)), covered
