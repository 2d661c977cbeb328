"""Fits of δ̂(ā): against parameters that are known, linear programs and brute force."""

import jax
import numpy as np
import pandas as pd
import pytest
from scipy.optimize import linprog

import jaxnet
from experiments import coverage
from jaxnet.statistics import fits as fit
from jaxnet.statistics import recovery
from jaxnet.statistics.families import MODELS, model_value
from jaxnet.store.folder import FolderError
from tests import systems

X = np.array([0.1, 0.5, 3.0, 20.0, 100.0])
S = 40  # with X the shape of all data here: one compiled program
ONCE = np.ones((1, S), np.int16)
TRUE = {"proportional": (2.5,), "affine": (0.7, 3.0), "power": (2.0, 0.6)}
QUANTILES = (*fit.FITTED_QUANTILES, fit.ENVELOPE)


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch):
    """As many as these tests need."""
    monkeypatch.setattr(fit, "RESAMPLES", 100)


def best(errors, counts=ONCE):
    """Parameters to rounding of each model, by quantile (None: least squares)."""
    found = fit.estimates(errors.ranked(), counts, QUANTILES, tuple(MODELS), fit.EXACT)
    return {
        quantile: {model: each[0] for model, each in at.items()} for quantile, at in found.items()
    }


def noisy(seed=0, model="affine", spread=0.4):
    """Skewed errors about a curve, some lanes failed."""
    random = np.random.default_rng(seed)
    scatter = random.lognormal(sigma=spread, size=(1, S)) * random.lognormal(
        sigma=spread, size=(len(X), S)
    )
    y = model_value(model, X, TRUE[model])[:, None] * scatter
    y[1, 3:9] = y[4, 0] = np.nan
    return fit.Errors(X, y)


def pinball(errors, model, parameters, quantile):
    """Its loss, of y with weights 1/x, as the definition has it."""
    residual = (errors.y - model_value(model, errors.x, parameters)[:, None]) / errors.x[:, None]
    return np.nansum(np.where(residual >= 0, quantile, quantile - 1) * residual)


@pytest.mark.parametrize("model", MODELS)
def test_noiseless_data_give_their_parameters_back(model):
    """By every estimator."""
    y = np.repeat(model_value(model, X, TRUE[model])[:, None], S, axis=1)
    for at in best(fit.Errors(X, y)).values():
        np.testing.assert_allclose(at[model], TRUE[model], rtol=1e-9)
        if model == "proportional":
            np.testing.assert_allclose(at["affine"], (0, 2.5), atol=1e-12)
            np.testing.assert_allclose(at["power"], (2.5, 1), rtol=1e-12)


@pytest.mark.parametrize("quantile", fit.FITTED_QUANTILES)
@pytest.mark.parametrize("model", ["proportional", "affine"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_quantile_regression_solves_the_linear_program(model, quantile, seed):
    """HiGHS finds no lower loss."""
    errors = noisy(seed, "power")
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
    return fit.Errors(X, X[:, None] * slopes * random.lognormal(sigma=0.5, size=(len(X), S)))


@pytest.mark.parametrize("quantile", fit.FITTED_QUANTILES)
@pytest.mark.parametrize("errors", [noisy(5, "affine"), erratic(2)], ids=["affine", "erratic"])
def test_no_power_of_a_fine_grid_is_better(errors, quantile):
    """Every exponent of the grid with its best scale, found by trying what may be it."""
    lowest = min(
        pinball(errors, "power", (scale, exponent), quantile)
        for exponent in np.linspace(-2, 5, 701)
        for scale in near(errors, "power", exponent, quantile)
    )
    ours = pinball(errors, "power", best(errors)[quantile]["power"], quantile)
    assert lowest * (1 - 1e-2) < ours <= lowest * (1 + 1e-12)


def near(errors, model, second, quantile):
    """The weighted quantile of y/f, one of which is the best scale, and its neighbours."""
    curve = model_value(model, X, (1.0, second))[:, None]
    there = np.isfinite(errors.y).ravel()
    scale, weight = (errors.y / curve).ravel()[there], np.repeat(curve[:, 0] / X, S)[there]
    order = np.argsort(scale)
    middle = np.searchsorted(np.cumsum(weight[order]), quantile * weight.sum())
    return scale[order][max(0, middle - 1) : middle + 2]


def test_least_squares_weigh_all_magnitudes_alike():
    """The mean of y/x and the normal equations with weights 1/x²; unweighted, the largest ā would decide."""
    errors = noisy(1, "affine")
    there = np.isfinite(errors.y)
    ratios = errors.y / X[:, None]
    found = best(errors)[None]
    assert found["proportional"][0] == pytest.approx(np.mean(ratios[there]), rel=1e-12)
    design = np.stack([np.repeat(1 / X, S), np.ones(len(X) * S)], axis=1)[there.ravel()]
    np.testing.assert_allclose(
        found["affine"], np.linalg.lstsq(design, ratios[there])[0], rtol=1e-9
    )
    steps = fit.Errors(X, X[:, None] * np.array([1, 1, 1, 1, 3.0])[:, None] * np.ones((1, S)))
    assert best(steps)[None]["proportional"][0] == pytest.approx(1.4)
    assert best(steps)[0.5]["proportional"][0] == pytest.approx(1.0)


def test_least_squares_have_no_slope_left():
    """Any small change of the parameters makes the sum of squares greater."""
    errors = noisy(2, "power")
    found = best(errors)[None]["power"]

    def loss(parameters):
        return np.nansum(
            ((errors.y - model_value("power", X, parameters)[:, None]) / X[:, None]) ** 2
        )

    around = [
        found * (1 + 1e-3 * np.array(step))
        for step in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1))
    ]
    assert all(loss(parameters) > loss(found) for parameters in around)


def test_counts_stand_for_samples_drawn_more_than_once():
    """Fits with the counts of a resample are fits to its samples."""
    errors = noisy(3)
    counts = next(fit.draw_resamples(S, 1))
    drawn = fit.Errors(X, np.repeat(errors.y, counts[0], axis=1))
    weighted, repeated = best(errors, counts), best(drawn)
    for quantile in (None, *fit.FITTED_QUANTILES):
        for model, found in weighted[quantile].items():
            np.testing.assert_allclose(found, repeated[quantile][model], rtol=1e-9)


def test_resamples_are_fitted_closely_enough(monkeypatch):
    """The few halvings spent on a resample move an interval's ends by less than 2 % of its width."""
    few = bootstrapped(noisy(4, "power"))
    monkeypatch.setattr(fit, "RESAMPLED", fit.EXACT)
    many = bootstrapped(noisy(4, "power"))
    for quantile, at in few.items():
        for model in ("proportional", "affine", "power"):
            ours, theirs = (
                np.array(fit.percentile_interval(each))
                for each in (at[model], many[quantile][model])
            )
            assert np.all(np.abs(ours - theirs) < 0.02 * (theirs[1] - theirs[0]))


def bootstrapped(errors):
    """Fits of the resamples."""
    return fit.bootstrap(
        errors.ranked(),
        fit.draw_resamples(errors.y.shape[1], fit.RESAMPLES_TOGETHER),
        errors.models,
    )


@pytest.mark.parametrize("shared", [0.5, 0.0, 0.9], ids=["both", "lanes", "samples"])
def test_neighbours_that_share_a_weight_leave_the_intervals(shared, monkeypatch):
    """Ends of the same resamples' intervals with bins of 16 lanes and without.

    They are nearer than two standard errors of an end that is found from 100 resamples, 0.07 of the width.
    One lane in ten is lost, the others recover: the curves' losses have several minima.
    """
    random = np.random.default_rng(0)
    own, common = random.normal(size=(len(X), 4000)), random.normal(size=4000)
    errors = fit.Errors(X, X[:, None] * np.exp(0.5 * (shared * common + (1 - shared) * own)))
    errors.y[:, random.random(4000) < 0.9] *= 1e-9
    errors.y[random.random(errors.y.shape) < 0.01] = np.nan
    whole = bootstrapped(errors)
    monkeypatch.setattr(fit, "MOST_BINS", 250)
    for quantile, at in bootstrapped(errors).items():
        for model in ("proportional", "affine", "power"):
            ours, theirs = (
                np.stack(fit.percentile_interval(each))
                for each in (at[model], whole[quantile][model])
            )
            noise = 0.0 if quantile is None else 0.14 * (theirs[1] - theirs[0])
            assert np.all(np.abs(ours - theirs) <= noise)


def test_samples_are_resampled_and_not_rows():
    """Where all magnitudes share a sample's draw there are S observations, not S times as many magnitudes."""
    shared = 1 + 0.3 * np.random.default_rng(0).normal(size=1000)
    rows = [*fit.fit_rows(fit.Errors(X, X[:, None] * shared), most=3.0)]
    width = 2 * 1.96 * shared.std() / np.sqrt(1000)
    for model, parameter in (("proportional", "s"), ("power", "c")):
        row = next(row for row in rows if (row["model"], row["parameter"]) == (model, parameter))
        assert row["quantile"] is None
        assert row["high"] - row["low"] == pytest.approx(width, rel=0.2)


def test_order_and_unit_do_not_matter():
    """Renumbered samples and cells; errors in another unit scale b, s and c and leave p."""
    errors, random = noisy(6), np.random.default_rng(1)
    cells, samples = random.permutation(len(X)), random.permutation(S)
    mixed = fit.Errors(X[cells], errors.y[cells][:, samples])
    same, scaled = best(mixed), best(fit.Errors(X, 1e3 * errors.y))
    for quantile, at in best(errors).items():
        for model, found in at.items():
            np.testing.assert_allclose(same[quantile][model], found, rtol=1e-8)
            unit = np.array([1e3, 1e3 if model == "affine" else 1.0])[: len(found)]
            np.testing.assert_allclose(scaled[quantile][model], unit * found, rtol=1e-8)


@pytest.mark.parametrize("model", MODELS)
def test_the_envelope_is_above_all_data_and_touches_them(model):
    """No other curve that does is lower: as many data are touched as there are parameters."""
    errors = noisy(7, "affine")
    slack = model_value(model, X, best(errors)[fit.ENVELOPE][model])[:, None] / errors.y - 1
    assert np.nanmin(slack) > -1e-9
    assert np.sum(slack < 1e-9) == len(MODELS[model])


def test_the_affine_envelope_solves_its_linear_program():
    """The least weighted sum above all data."""
    errors = noisy(8, "power")
    there = np.isfinite(errors.y)
    u = np.stack([1 / X, np.ones_like(X)], axis=1)
    greatest = np.nanmax(errors.y / X[:, None], axis=1)
    program = linprog(there.sum(axis=1) @ u, A_ub=-u, b_ub=-greatest, bounds=[(None, None)] * 2)
    np.testing.assert_allclose(best(errors)[fit.ENVELOPE]["affine"], program.x, rtol=1e-8)


def test_the_share_below_an_envelope():
    """Were less than that share of draws below it, all n would be with a probability of 5 % at most."""
    for draws in (1, 10, 256):
        assert recovery.below_greatest(draws) ** draws == pytest.approx(0.05)


def test_no_interval_of_too_few_draws():
    """Blank with 19 draws for a median, with 199 for the 0.95 quantile; with 49 draws off for a mean.

    Those off stand beside 19 times as many that are 0, or 1.
    """
    for quantile, fewest in ((0.5, 20), (0.95, 200)):
        for draws, told in ((fewest - 1, False), (fewest, True)):
            assert (
                fit.bootstrap_suffices(fit.Errors(np.ones(1), np.ones((1, draws))), quantile)
                is told
            )
    for rest in (1e-28, 1.0):
        for off, told in (
            (44, False),
            (56, True),
        ):  # np off of n have n / kurtosis = np (1 - p) / (1 - 3 p (1 - p))
            y = np.full((1, 20 * off), rest)
            y[0, :off] = 3.0
            assert fit.bootstrap_suffices(fit.Errors(np.ones(1), y), None) is told


def test_nothing_is_resampled_where_all_is_rounding():
    """Draws that are off may be unseen, so curves have no intervals; the slope has one, under its bound."""
    y = X[:, None] * 1e-28 * np.random.default_rng(0).random((1, 1000))
    rows = pd.DataFrame(fit.fit_rows(fit.Errors(X, y), most=7.0))
    squares = rows[rows["quantile"].isna()].set_index(["model", "parameter"]).sort_index()
    slope = squares.loc[("proportional", "s")]
    assert slope["low"] < 1e-28
    assert slope["high"] == pytest.approx(7 * (1 - 0.025 ** (1 / 1000)), rel=1e-2)
    assert squares.drop(index=[("proportional", "s")])[["low", "high"]].isna().all(axis=None)


def test_curves_of_a_quantile_at_a_jump_have_no_interval():
    """One draw in twenty is off: resamples leave open on which side its 0.95 quantile lies."""
    y = X[:, None] * np.where(np.arange(1000) < 50, 2.0, 1e-28)
    rows = pd.DataFrame(fit.fit_rows(fit.Errors(X, y + X[:, None] * 1e-29 * np.arange(1000))))
    known = rows[rows["low"].notna() & (rows["quantile"] == 0.95)]
    assert known["model"].tolist() == ["proportional"]
    assert known["low"].item() < 1e-20 < known["high"].item()


def test_aicc_finds_the_model_and_is_blank_without_residuals(monkeypatch):
    """Least squares alone have it."""
    monkeypatch.setattr(fit, "FEWEST_BEYOND", 1)
    for model in ("affine", "power"):
        rows = pd.DataFrame(fit.fit_rows(noisy(9, model, spread=0.03)))
        assert rows["quantile"].isna().sum() == rows["aicc"].notna().sum() == 6
        assert rows.loc[rows["aicc"].idxmin(), "model"] == model
    exact = fit.Errors(
        X, 2.0 * X[:, None] * (1 + 1e-10 * np.random.default_rng(0).normal(size=(len(X), S)))
    )
    rows = pd.DataFrame(fit.fit_rows(exact))
    own = rows[(rows["model"] == "proportional") & (rows["quantile"] != fit.ENVELOPE)]
    assert rows.loc[rows["model"] != "constant", "aicc"].isna().all()
    np.testing.assert_allclose(own["estimate"], 2.0, rtol=1e-9)


def scattered(curve, seed=0, spread=0.3):
    """Errors about a curve, of scatter that cells share and that they do not."""
    random = np.random.default_rng(seed)
    scatter = 1 + spread * (random.normal(size=(1, S)) + random.normal(size=(len(X), S))) / 2
    return fit.Errors(X, curve[:, None] * scatter)


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


def test_where_is_no_slope_no_quantile_has_one(monkeypatch):
    """Estimates and intervals of s·ā are blank, the criterion is there, and so are the other models."""
    monkeypatch.setattr(fit, "FEWEST_BEYOND", 1)
    flat = fit.Errors(
        X, 0.7 * (1 + 0.2 * np.random.default_rng(0).random(S)) * np.ones((len(X), 1))
    )
    rows = pd.DataFrame(fit.fit_rows(flat)).set_index("model")
    assert rows.loc["proportional", ["estimate", "low", "high"]].isna().all(axis=None)
    assert rows.loc["power", "estimate"].notna().all()
    scores = rows.loc[rows["quantile"].isna(), "aicc"]
    assert scores.loc["constant"] < scores.loc["proportional"] - 100
    assert rows.loc["constant", "estimate"] == pytest.approx(flat.y[0].mean())
    assert fit.has_slope(fit.Errors(X, 1e-13 * (1 + flat.y)))  # rounding has the slope 0
    assert not fit.has_slope(fit.Errors(X, np.full((len(X), 1), 0.7)))  # without any scatter
    one = fit.Errors(X, np.where(np.arange(S) == 3, X[:, None], 0.7))  # of forty lanes one is lost
    assert fit.has_slope(one)


def test_the_fewer_rows_the_dearer_a_parameter():
    """The formula by hand; blank where n ≤ k + 1."""
    few = fit.Errors(X[:2], np.array([[0.1, 0.3], [0.5, 1.5]]))
    spread = np.log(np.mean([1.0, 1.0, 1.0, 1.0]))
    assert fit.aicc(few, "proportional", np.array([2.0])) == pytest.approx(4 * spread + 4 + 12)
    assert np.isnan(fit.aicc(few, "affine", np.array([0.0, 2.0])))


def test_extreme_errors_are_fitted_without_complaint(monkeypatch):
    """Recovered fleets at 1e-28 beside lost ones, errors of exactly 0, a magnitude without a lane, and
    numbers as small and as great as there are.
    """
    monkeypatch.setattr(fit, "FEWEST_BEYOND", 1)
    random = np.random.default_rng(0)
    y = (
        X[:, None]
        * np.where(random.random((len(X), S)) < 0.8, 1e-28, 2.0)
        * random.random((len(X), S))
    )
    y[2], y[3] = 0.0, np.nan
    rows = pd.DataFrame(fit.fit_rows(fit.Errors(X, y)))
    assert rows["estimate"].notna().all()
    slope = rows[(rows["quantile"] == 0.5) & (rows["model"] == "proportional")]
    assert 0 <= slope["estimate"].item() < 1e-28
    nothing = pd.DataFrame(fit.fit_rows(fit.Errors(X, np.zeros((len(X), S)))))
    assert (nothing.loc[nothing["parameter"].isin(["s", "b", "c"]), "estimate"] == 0).all()
    assert (nothing.loc[nothing["parameter"] == "p", "estimate"] == 1).all()
    for x in ([1e-300, 1e300], [1e290, 1e300]):
        y = np.array(x)[:, None] * 2.0 * np.ones((1, S))
        rows = pd.DataFrame(fit.fit_rows(fit.Errors(np.array(x), y), most=2.0))
        known = rows[rows["model"] == "proportional"]
        np.testing.assert_allclose(known["estimate"], 2.0)
        assert rows.loc[rows["model"] != "constant", "aicc"].isna().all()


def test_double_precision_needs_no_switch():
    """A script that has not asked for it gets the same numbers."""
    with jax.enable_x64(False):
        single = best(noisy())
    np.testing.assert_array_equal(single[0.95]["power"], best(noisy())[0.95]["power"])


def results(lanes, **keys):
    """Results of a study whose lanes are these."""
    return systems.results_of(jaxnet.load({"samples": S, **keys}), lanes)


def test_table_holds_every_fit(monkeypatch):
    """Columns to the letter; failed lanes and ā = 0 take no part; too few magnitudes, fewer models."""
    sweep = {"topology": ["star", "path"], "attack.magnitude": [100, 0, *X[:4].tolist()]}
    y = {"star": noisy(10).y, "path": noisy(11).y}
    rows = []
    for cell in jaxnet.load({"sweep": sweep}).cells:
        place = np.flatnonzero(cell.labels["attack.magnitude"] == X)
        errors = y[cell.labels["topology"]][place[0]] if len(place) else np.full(S, 1e9)
        ok = np.isfinite(errors)
        rows.append(
            pd.DataFrame(
                {
                    "cell": cell.number,
                    "sample": range(S),
                    "status": np.where(ok, "ok", "max_steps"),
                    "tail_mean": np.where(ok, errors, 1e9),
                    "tail_max": 2 * errors,
                }
            )
        )
    table = fit.fit_table(results(pd.concat(rows), sweep=sweep, attack="replay"))
    names = [
        "topology",
        "metric",
        "model",
        "quantile",
        "parameter",
        "estimate",
        "low",
        "high",
        "aicc",
    ]
    assert list(table.columns) == names
    assert len(table) == 2 * 2 * (4 * 5 + 1)
    assert table["quantile"].dtype == float
    assert set(table["model"]) == {*MODELS, "constant"}
    assert (table.loc[table["quantile"] == 1.0, ["low", "high"]].isna()).all(axis=None)
    for topology, number in (("star", 10), ("path", 11)):
        direct = pd.DataFrame(fit.fit_rows(noisy(number)))
        for metric, unit in (("tail_mean", 1.0), ("tail_max", 2.0)):
            ours = table[(table["topology"] == topology) & (table["metric"] == metric)]
            slopes = (
                ours[ours["model"] == "proportional"],
                direct[direct["model"] == "proportional"],
            )
            values = [each[["estimate", "low", "high"]].to_numpy(float) for each in slopes]
            np.testing.assert_allclose(values[0], unit * values[1], rtol=1e-9)


def test_fewer_magnitudes_fewer_models():
    """One magnitude tells a slope alone; none is said."""
    one = np.where(X[:, None] == 3.0, noisy().y, np.nan)
    rows = list(fit.fit_rows(fit.Errors(X, one)))
    assert {row["model"] for row in rows} == {"proportional"}
    assert list(fit.fit_rows(fit.Errors(X, np.full((len(X), S), np.nan)))) == []
    for keys in ({"attack": "none"}, {"attack": {"magnitude": 0}}):
        with pytest.raises(FolderError, match="no cell has an attack with ā > 0"):
            fit.fit_table(results(pd.DataFrame({"sample": [0]}), **keys))


def test_intervals_cover():
    """The slope of 200 known studies: 93 % of them, less three binomial deviations, which is 88 %."""
    covered = coverage.coverage(200, coverage.SPREADS["both"], magnitudes=4)
    assert np.all(covered >= 0.93 - 3 * np.sqrt(0.93 * 0.07 / 200)), covered
