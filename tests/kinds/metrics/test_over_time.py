"""Sums and integrals over time, and a metric of the inputs, against the stored trajectory."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from jaxnet.engine.metrics import all_defined
from jaxnet.kinds.metrics import Metric
from jaxnet.statistics.summary import metric_statistics
from tests import systems

KEYS = {"horizon": 2.0, "tail": 0.5, "output_step": 0.1, "defence": "none"}


def two(seen):
    return 0.0 * seen.speed + 2.0


def effort(seen):
    return abs(seen.inputs[0])


TWO_IN_ALL = Metric("two_in_all", "m", two, "run", "integral", "mean")
TWO_LATE = Metric("two_late", "m", two, "tail", "integral", "mean")
TWO_COUNTED = Metric("two_counted", "m", two, "run", "sum", "mean")
TWO_COUNTED_LATE = Metric("two_counted_late", "m", two, "tail", "sum", "mean")
EFFORT = Metric("effort", "m/s³", effort, "run", "integral", "max")
LATE_EFFORT = Metric("late_effort", "m/s³", effort, "tail", "integral", "max")
SUMMED = Metric("summed", "m/s³", effort, "run", "sum", "min")
HARDEST = Metric("hardest", "m/s³", effort, "run", "max", "max")
OWN = ("TWO_IN_ALL", "TWO_LATE", "TWO_COUNTED", "TWO_COUNTED_LATE")
OWN += ("EFFORT", "LATE_EFFORT", "SUMMED", "HARDEST")


def test_sums_and_integrals_are_those_of_the_trajectory():
    """The tail of 0.5 s has six output times. Lanes from a queue: tests/engine/test_batch.py."""
    study = systems.study(engine="exact", metrics=[f"{__name__}:{name}" for name in OWN], **KEYS)
    outcome = systems.simulate(systems.lanes(study, 3, ("inputs",)))
    found = outcome.metrics
    assert found["two_in_all"] == pytest.approx(2.0 * 2.0)
    assert found["two_late"] == pytest.approx(2.0 * 0.5)
    assert found["two_counted"] == pytest.approx(2.0 * 21)
    assert found["two_counted_late"] == pytest.approx(2.0 * 6)
    efforts = np.abs(outcome.series["inputs"][..., 0])  # (lanes, times, m)
    for name, each in (("effort", efforts), ("late_effort", efforts[:, -6:])):
        assert found[name] == pytest.approx(np.trapezoid(each, dx=0.1, axis=1).max(axis=1))
    assert found["summed"] == pytest.approx(efforts.sum(axis=1).min(axis=1))
    assert found["hardest"] == pytest.approx(efforts.max(axis=(1, 2)))


def root(seen):
    """A number that is none where a vehicle starts below the x-axis."""
    return seen.start[1] ** 0.5


def never(seen):
    """A number that is infinite where a vehicle starts above the x-axis."""
    return 1.0 / (abs(seen.start[1]) - seen.start[1])


ROOT = Metric("root", "", root, "run", "last", "max")
NEVER = Metric("never", "s", never, "run", "last", "max", undefined="infinite")


def test_a_number_that_is_none_is_no_metric_of_an_ok_lane():
    """What may be infinite is so in an ok lane and in its cell, where it has no mean."""
    keys = {"vehicles": 1, "topology": "star", "attack": "none", "engine": "exact", "horizon": 0.2}
    keys |= {"tail": 0.1, "output_step": 0.1}
    keys["metrics"] = [f"{__name__}:{name}" for name in ("ROOT", "NEVER")]
    results = jaxnet.simulate(keys, 6, progress=False)
    ok = results.lanes["status"] == "ok"
    assert {*results.lanes["status"]} == {"ok", "unmeasured"}
    assert results.lanes.loc[ok, "root"].gt(0).all()
    assert np.isinf(results.lanes.loc[ok, "never"]).all()
    assert results.lanes.loc[~ok, ["root", "never", "tail_mean"]].isna().all(axis=None)
    assert np.isinf(results.cells[["never_median", "never_max"]]).all(axis=None)
    assert np.isnan(results.cells["never_mean"]).all()


@pytest.mark.parametrize(
    ("undefined", "told"), [("error", [1, 0, 0]), ("infinite", [1, 1, 0]), ("blank", [1, 0, 1])]
)
def test_what_a_metric_may_be_it_declares(undefined, told):
    """A number, infinite or none; a metric that declares nothing is a number."""
    metric = Metric("any", "", never, undefined=undefined)
    assert all_defined([metric], {"any": jnp.array([2.0, jnp.inf, jnp.nan])}).tolist() == told


def test_a_quantile_of_infinite_values_is_one_of_them():
    """No number is between the last finite one and infinity."""
    found = metric_statistics(np.array([1.0, 2.0, np.inf]))
    assert (found["median"], found["q95"]) == (2.0, np.inf)
    assert np.isnan(found["mean"])


def test_the_column_of_an_integral_has_seconds_in_its_unit():
    units = [each.column_unit for each in (TWO_IN_ALL, TWO_COUNTED, EFFORT)]
    assert units == ["m·s", "m", "m/s³·s"]
    assert Metric("lasting", "", two, time="integral").column_unit == "s"
