"""Fits of δ̂(ā): against slopes that are known, by their definition, and coverage."""

import numpy as np
import pandas as pd
import pytest

import jaxnet
from experiments import coverage
from jaxnet.statistics import fits as fit
from jaxnet.statistics.fits import ENVELOPE, Errors
from jaxnet.statistics.regression import affine, model_value, power
from jaxnet.store.folder import FolderError
from tests import systems

X = np.array([0.1, 0.5, 3.0, 20.0, 100.0])
S = 40
QUANTILES = [*fit.FITTED_QUANTILES, ENVELOPE]


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch):
    monkeypatch.setattr(fit, "RESAMPLES", 100)


def noisy(seed=0):
    """Skewed errors about a line, some lanes failed."""
    random = np.random.default_rng(seed)
    scatter = random.lognormal(sigma=0.4, size=(1, S)) * random.lognormal(
        sigma=0.4, size=(len(X), S)
    )
    y = (0.7 + 3.0 * X)[:, None] * scatter
    y[1, 3:9] = y[4, 0] = np.nan
    return Errors(X, y)


def table(errors, **more):
    return pd.DataFrame(fit.fit_rows(errors, **more))


def slopes(errors):
    rows = table(errors)
    return rows[rows["model"] == "proportional"]["estimate"].to_numpy()


def test_slopes_are_statistics_of_errors_per_magnitude():
    """Mean, quantiles that minimise the pinball loss of y with weights 1/x, and the greatest."""
    errors = noisy()
    ratios = np.sort(errors.ratios[np.isfinite(errors.y)])
    mean, *quantiles, most = slopes(errors)
    assert (mean, most) == (pytest.approx(ratios.mean()), ratios[-1])
    for found, quantile in zip(quantiles, fit.FITTED_QUANTILES, strict=True):
        apart = ratios - ratios[:, None]
        loss = np.where(apart >= 0, quantile * apart, (quantile - 1) * apart).sum(axis=1)
        assert loss[np.searchsorted(ratios, found)] == pytest.approx(loss.min(), rel=1e-12)
    np.testing.assert_allclose(slopes(Errors(X, 2.5 * X[:, None] * np.ones((1, S)))), 2.5)


def test_the_constant_is_of_least_squares():
    errors = noisy()
    there = np.isfinite(errors.y)
    weights = (there / X[:, None])[there]
    level = np.linalg.lstsq(weights[:, None], errors.ratios[there])[0]
    row = table(errors).set_index("model").loc["constant"]
    assert row["estimate"] == pytest.approx(level[0])


def curves(errors, counts=None):
    """Parameters of affine and power by least squares."""
    moments = fit.means_of(errors, np.ones((1, errors.y.shape[1])) if counts is None else counts)
    return affine(errors.x, *moments)[0], power(errors.x, *moments)[0]


@pytest.mark.parametrize("exponent", [-1.5, 0.0, 0.6, 1.0, 2.5])
def test_noiseless_data_give_their_parameters_back(exponent):
    """An affine curve and a power; one magnitude may lack all lanes."""
    for y in (0.7 + 3.0 * X, 2.0 * X**exponent):
        y = np.repeat(y[:, None], S, axis=1)
        y[1] = np.nan
        (b, s), (c, p) = curves(Errors(X, y))
        known = (b, s, 0.7, 3.0) if y[0, 0] == 0.7 + 3.0 * X[0] else (c, p, 2.0, exponent)
        np.testing.assert_allclose(known[:2], known[2:], rtol=1e-6, atol=1e-8)


def test_curves_are_of_least_squares():
    """Affine by NumPy's least squares with weights 1/x²; no step of a power is lower."""
    errors = noisy(1)
    there, (line, bent) = np.isfinite(errors.y), curves(errors)
    design = np.stack([np.repeat(1 / X, S), np.ones(len(X) * S)], axis=1)[there.ravel()]
    np.testing.assert_allclose(line, np.linalg.lstsq(design, errors.ratios[there])[0], rtol=1e-9)

    def loss(parameters):
        curve = model_value("power", X, parameters)[:, None]
        return np.nansum(((errors.y - curve) / X[:, None]) ** 2)

    steps = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1))
    assert all(loss(bent * (1 + 1e-4 * np.array(step))) > loss(bent) for step in steps)


def test_curves_of_a_resample_are_those_of_its_samples():
    """Errors in another unit scale b, s and c and leave p; the order of cells is none."""
    errors, counts = noisy(3), next(fit.draw_resamples(S, 1))
    drawn = curves(Errors(X, np.repeat(errors.y, counts[0], axis=1)))
    np.testing.assert_allclose(curves(errors, counts), drawn, rtol=1e-7)
    cells = np.random.default_rng(1).permutation(len(X))
    mixed = curves(Errors(X[cells], 1e3 * errors.y[cells]))
    np.testing.assert_allclose(mixed, np.array([[1e3, 1e3], [1e3, 1]]) * curves(errors), rtol=1e-7)


def test_aicc_finds_the_model_and_is_blank_without_residuals():
    random = np.random.default_rng(9)
    for model, curve in (("affine", 0.7 + 3 * X), ("power", 2 * X**0.6)):
        y = curve[:, None] * random.lognormal(sigma=0.03, size=(len(X), S))
        rows = table(Errors(X, y))
        assert rows["quantile"].isna().sum() == rows["aicc"].notna().sum() == 6
        assert rows.loc[rows["aicc"].idxmin(), "model"] == model
    rows = table(Errors(X, 2.0 * X[:, None] * (1 + 1e-10 * random.normal(size=(len(X), S)))))
    assert rows.loc[rows["model"] != "constant", "aicc"].isna().all()
    few = Errors(X[:2], np.array([[0.1, 0.3], [0.5, 1.5]]))  # residuals per ā are 1: by hand
    assert fit.aicc(few, "proportional", [2.0]) == pytest.approx(4 + 12)
    assert np.isnan(fit.aicc(few, "affine", [0.0, 2.0]))


@pytest.mark.parametrize("rest", [1e-28, 1])
def test_no_interval_of_a_curve_where_few_lanes_are_off(rest):
    """Of n lanes np are off: n over the kurtosis is np (1 - p)/(1 - 3p (1 - p)); 50 are enough."""
    for draws, told in ((45, False), (56, True)):
        y = np.full((1, 20 * draws), float(rest))
        y[0, :draws] = 3.0
        assert fit.variance_is_of_many(Errors(np.ones(1), y)) is told
    assert not fit.variance_is_of_many(Errors(X, 1e-28 * X[:, None] * np.arange(1000)))


def test_counts_stand_for_samples_drawn_more_than_once():
    """Slopes with the counts of a resample are slopes of its samples; order and unit are none."""
    errors, counts = noisy(3), next(fit.draw_resamples(S, 1))
    drawn = slopes(Errors(X, np.repeat(errors.y, counts[0], axis=1)))
    assert fit.quantile_slopes(errors, counts, QUANTILES)[0].tolist() == drawn[1:].tolist()
    random = np.random.default_rng(1)
    cells, samples = random.permutation(len(X)), random.permutation(S)
    mixed = slopes(Errors(X[cells], 1e3 * errors.y[cells][:, samples]))
    np.testing.assert_allclose(mixed, 1e3 * slopes(errors))


def test_samples_are_resampled_and_not_rows():
    """Where all magnitudes share a sample's draw, observations are as many as samples."""
    shared = 1 + 0.3 * np.random.default_rng(0).normal(size=1000)
    rows = table(Errors(X, X[:, None] * shared))
    widths = (rows["high"] - rows["low"])[rows["model"] == "proportional"]
    mean = 2 * 1.96 * shared.std() / np.sqrt(1000)
    assert widths.iloc[0] == pytest.approx(mean, rel=0.2)
    assert widths.iloc[1] == pytest.approx(mean * np.sqrt(np.pi / 2), rel=0.2)  # of a median
    bent = rows[(rows["model"] == "power") & (rows["parameter"] == "c")].iloc[0]
    assert bent["high"] - bent["low"] == pytest.approx(mean, rel=0.2)


@pytest.mark.parametrize(("fewest", "quantile"), [(20, 0.5), (200, 0.95)])
def test_no_interval_of_too_few_draws(fewest, quantile):
    """Ten must lie beyond a quantile; a maximum and dependent samples have none."""
    for draws, told in ((fewest - 1, False), (fewest, True)):
        errors = Errors(np.ones(1), np.linspace(1, 2, draws)[None])
        rows = table(errors).set_index("quantile")
        assert np.isfinite(rows.loc[quantile, ["low", "high"]].astype(float)).all() == told
        assert rows.loc[ENVELOPE, ["low", "high"]].isna().all()
        assert table(errors, independent=False)[["low", "high"]].isna().all(axis=None)


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
    """Estimates and intervals of s·ā are blank; the constant is there."""
    scatter = 1 + 0.2 * np.random.default_rng(0).random(S)
    flat = Errors(X, 0.7 * scatter * np.ones((len(X), 1)))
    rows = table(flat).set_index("model")
    assert rows.loc["proportional", ["estimate", "low", "high"]].isna().all(axis=None)
    assert rows.loc["constant", "estimate"] == pytest.approx(flat.y[0].mean())
    assert fit.has_slope(Errors(X, 1e-13 * (1 + flat.y)))  # rounding has the slope 0
    one = Errors(X, np.where(np.arange(S) == 3, X[:, None], 0.7))  # of forty lanes one is lost
    assert fit.has_slope(one)


def test_extreme_errors_are_fitted_without_complaint():
    """Recovered fleets at 1e-28 beside lost ones, zeros, a magnitude without a lane, any ā."""
    random = np.random.default_rng(0)
    y = X[:, None] * np.where(random.random((len(X), S)) < 0.8, 1e-28, 2.0)
    y *= random.random((len(X), S))
    y[2], y[3] = 0.0, np.nan
    found = slopes(Errors(X, y))
    assert np.isfinite(found).all()
    assert 0 <= found[1] < 1e-28
    assert table(Errors(X, y))["estimate"].notna().all()
    nothing = table(Errors(X, np.zeros((len(X), S))))
    assert (nothing["estimate"] == (nothing["parameter"] == "p")).all()
    for x in ([1e-300, 1e300], [1e290, 1e300]):
        np.testing.assert_allclose(
            slopes(Errors(np.array(x), np.array(x)[:, None] * np.full((1, S), 2.0))), 2.0
        )


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
    found = fit.fit_table(results(pd.concat(rows), sweep=sweep, attack="replay"))
    assert list(found.columns) == ["topology", *fit.FIT_COLUMNS]
    assert len(found) == 2 * 2 * (4 + 1 + 4)
    known = found[found["model"] == "proportional"].set_index(["topology", "metric"])["estimate"]
    for topology, number in (("star", 10), ("path", 11)):
        for metric, unit in (("tail_mean", 1.0), ("tail_max", 2.0)):
            direct = unit * slopes(noisy(number))
            np.testing.assert_allclose(known.loc[topology, metric], direct, rtol=1e-9)


def test_one_magnitude_has_no_constant():
    one = np.where(X[:, None] == 3.0, noisy().y, np.nan)
    assert {row["model"] for row in fit.fit_rows(Errors(X, one))} == {"proportional"}
    assert list(fit.fit_rows(Errors(X, np.full((len(X), S), np.nan)))) == []
    for keys in ({"attack": "none"}, {"attack": {"magnitude": 0}}):
        with pytest.raises(FolderError, match="no cell has an attack with ā > 0"):
            fit.fit_table(results(pd.DataFrame({"sample": [0]}), **keys))


def test_intervals_cover():
    """The slope of 200 known studies: 93 %, less three binomial deviations, is 88 %."""
    covered = coverage.coverage(200, coverage.SPREADS["both"], magnitudes=4)
    assert (covered >= 0.88).all(), covered
