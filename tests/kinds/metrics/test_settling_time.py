"""Settling times against closed forms and stored errors; lanes that never settle."""

import pickle

import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.metrics.settling_time import SETTLING_TIME
from jaxnet.model.plane import length
from jaxnet.view.columns import default_columns
from jaxnet.view.text.tables import summary_text
from tests import systems

KEYS = {"horizon": 20.0, "tail": 2.0, "defence": "none", "attack": "none"}
SWINGING = {"kind": "sinusoid", "magnitude": 10.0, "vehicles": [2, 7]}
ON_THE_PATH = {"position": 0.0, "heading": np.pi / 4, "speed": float(np.hypot(20.0, 20.0))}


def asked(**keys):
    return {"kind": "settling_time", **keys}


def settled(errors, limit, step=0.1):
    """The time of the sample after the last one above the limit, from errors over time."""
    above = np.flatnonzero(errors > limit)
    return step * (above[-1] + 1) if above.size else 0.0


def decayed(lane, time):
    """`e⁻ᵗ ((1 + t + t²/2) E + (t + t²) Ė + t²/2 Ë)` of a lane's start: (times, m)."""
    x, y, heading, speed, *_ = lane.initial
    place, velocity = np.array([x, y]), speed * np.array([np.cos(heading), np.sin(heading)])
    velocity = velocity - np.array([[20.0], [20.0]])  # of the navigator, which begins at 0
    t = time[:, None, None]
    found = np.exp(-t) * ((1 + t + t**2 / 2) * place + (t + t**2) * velocity)
    return np.linalg.norm(found, axis=1)


@pytest.mark.parametrize("engine", ["exact", pytest.param("nonlinear", marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("keys", "over", "limit"),
    [({"below": 0.1}, "mean", 0.1), ({"fraction": 0.01, "of": "greatest"}, "max", None)],
)
def test_without_attack_the_time_is_that_of_the_exact_decay(engine, keys, over, limit):
    study = systems.study(engine=engine, metrics=[asked(**keys)], **KEYS)
    one = systems.lanes(study, 3)
    found = systems.simulate(one).metrics["settling_time"]
    time = np.arange(201) * 0.1
    for number in range(3):
        errors = getattr(np, over)(decayed(systems.lane(one, number), time), axis=1)
        limit_here = 0.01 * errors[0] if limit is None else limit
        assert 5 < found[number] < 18
        assert found[number] == pytest.approx(settled(errors, limit_here), abs=1e-9)


def test_a_lane_that_leaves_again_counts_by_its_last_crossing_or_never():
    """A sinusoid swings through the limit to the end: each lane ends above or below it."""
    swinging = KEYS | {"attack": SWINGING, "metrics": [asked(below=6.0)]}
    one = systems.lanes(systems.study(engine="exact", **swinging), 12)
    outcome = systems.simulate(one)
    found, errors = outcome.metrics["settling_time"], outcome.series["tracking"]
    crossings = np.diff(errors > 6.0, axis=1).sum(axis=1)
    assert crossings.max() > 2
    expected = [settled(each, 6.0) for each in errors]
    expected = np.where(errors[:, -1] > 6.0, np.inf, expected)
    assert np.isinf(expected).any()
    assert np.isfinite(expected).any()
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_fleet_that_starts_on_the_path_has_settled_at_0_s():
    """What is left there is rounding, of the start too."""
    lanes = KEYS | {"initial": ON_THE_PATH, "metrics": [asked(fraction=0.5)], "engine": "exact"}
    found = jaxnet.simulate(lanes, 2, progress=False)
    assert found.lanes["settling_time"].tolist() == [0.0, 0.0]
    assert found.cells["unsettled"].tolist() == [0.0]


def test_without_a_navigator_the_spread_settles():
    keys = {"navigator": "none", "law": "local", "vehicle": "single_integrator", "attack": "none"}
    keys |= {"engine": "exact", "defence": "none", "horizon": 30.0, "topology": "complete"}
    study = systems.study(metrics=[asked(below=1.0)], **keys)
    outcome = systems.simulate(systems.lanes(study, 3))
    expected = [settled(each, 1.0) for each in outcome.series["spread"]]
    assert min(expected) > 1
    np.testing.assert_allclose(outcome.metrics["settling_time"], expected, atol=1e-9)


@pytest.fixture(scope="module")
def swinging():
    """A cell of which some lanes never settle, and one of which none does."""
    keys = {**KEYS, "engine": "exact", "horizon": 19.0, "attack": SWINGING}
    keys |= {"metrics": [asked(below=7.5)], "sweep": {"attack.magnitude": [10, 100]}}
    return jaxnet.simulate(keys, 12, progress=False)


def test_lanes_that_never_settle_are_counted_and_enter_no_mean(swinging):
    """Their share has an interval; the median is that of order statistics, maybe infinite."""
    cells = swinging.cells
    times = [lanes["settling_time"].to_numpy() for _, lanes in swinging.by_cell()]
    never = [np.isinf(each).mean() for each in times]
    assert 0 < never[0] < 1 == never[1]
    assert cells["unsettled"].tolist() == pytest.approx(never)
    assert (cells["unsettled_low"] < cells["unsettled_high"]).all()
    assert cells["settling_time_mean"].isna().all()
    assert np.isinf(cells["settling_time_median"][1])
    assert np.isinf(cells["settling_time_max"]).all()


def of_study(results):
    return results.study.config, results.cells, results.study.cells


def test_tables_and_figures_have_the_time_and_the_share(swinging):
    text = summary_text(swinging, ["settling_time", "unsettled"])
    assert "settling time," in text
    assert "never settled" in text
    assert "> 19" in text
    assert "above the limit at the last output time" in text
    assert {"settling_time_median", "unsettled"} <= {*default_columns(*of_study(swinging))}
    assert "not drawn, in 1 cell" in swinging.plot.curve(y="settling_time").get_supxlabel()
    assert swinging.plot.curve(y="unsettled").axes


def test_the_stored_study_has_the_keys_of_the_metric():
    study = systems.study(metrics=["min_separation", asked(fraction=0.05, of="greatest")])
    again = jaxnet.load(study, {"samples": 2})
    told = {"kind": "settling_time", "below": None, "fraction": 0.05, "of": "greatest"}
    assert study.config.model_dump(mode="json")["metrics"] == ["min_separation", told]
    assert again.config.metrics == study.config.metrics
    assert systems.study(metrics=["settling_time"]).config.metrics == [SETTLING_TIME]


def test_another_process_has_the_same_metric():
    metric = SETTLING_TIME.with_keys(below=0.2, of="greatest")
    assert (
        pickle.loads(pickle.dumps(metric))
        == metric
        != SETTLING_TIME.with_keys(below=0.3, of="greatest")
    )
    assert {metric} == {SETTLING_TIME.with_keys(below=0.2, of="greatest")}


def late(seen):
    """Distance [m] from the navigator from 10 s on."""
    return jnp.where((seen.time >= 10.0)[None], seen.errors(), 0.0)


def farther(seen):
    """How much farther than at the start [m]."""
    return seen.errors() - length(seen.errors_at_start())


LATE, FARTHER = (Metric(of.__name__, "m", of, "run", "max", "max") for of in (late, farther))


def test_a_metric_of_one_s_own_knows_the_time_and_the_start():
    keys = {**KEYS, "engine": "exact", "metrics": [f"{__name__}:LATE", f"{__name__}:FARTHER"]}
    outcome = systems.outcome(2, **keys)
    path = np.stack([100 * np.sin(0.02 * np.arange(201)), 50 * np.sin(0.04 * np.arange(201))])
    places = outcome.series["state"][..., :2]
    errors = np.linalg.norm(places - path.T[None, :, None], axis=-1)
    found = outcome.metrics
    np.testing.assert_allclose(found["late"], errors[:, 100:].max(axis=(1, 2)), rtol=1e-9)
    gained = (errors - errors[:, :1]).max(axis=(1, 2))
    np.testing.assert_allclose(found["farther"], gained, rtol=1e-9, atol=1e-9)
