"""Metrics from outside, of the inputs over time, against the stored trajectory."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from jaxnet.engine.metrics import all_defined
from jaxnet.kinds.metrics import Metric
from jaxnet.statistics.summary import metric_statistics
from tests import systems

KEYS = {"horizon": 2.0, "tail": 0.5, "output_step": 0.1, "defence": "none"}


def effort(seen):
    return abs(seen.inputs[0])


WAYS = [("mean", "mean"), ("max", "min"), ("min", "max"), ("sum", "min"), ("integral", "max")]
OWN = {
    f"{time}_of_{over}".upper(): Metric(f"{time}_of_{over}", "m/s³", effort, over, time, vehicles)
    for time, vehicles in WAYS
    for over in ("run", "tail")
}
globals().update(OWN)  # a study names a metric by its module and name


def test_a_metric_of_one_s_own_is_reduced_as_it_says():
    """First over the output times of the run or of the tail, of 0.5 s, then over the vehicles.

    Lanes from a queue: tests/engine/test_batch.py.
    """
    study = systems.study(engine="exact", metrics=[f"{__name__}:{name}" for name in OWN], **KEYS)
    outcome = systems.simulate(systems.lanes(study, 3, ("inputs",)))
    efforts = np.abs(outcome.series["inputs"][..., 0])  # (lanes, times, m)
    for metric in OWN.values():
        each = efforts[:, -6:] if metric.over == "tail" else efforts
        if metric.time == "integral":
            by_vehicle = np.trapezoid(each, dx=0.1, axis=1)
        else:
            by_vehicle = getattr(np, metric.time)(each, axis=1)
        known = getattr(np, metric.vehicles)(by_vehicle, axis=1)
        assert outcome.metrics[metric.name] == pytest.approx(known, abs=1e-12)


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
    units = [OWN[name].column_unit for name in ("SUM_OF_RUN", "INTEGRAL_OF_RUN")]
    assert units == ["m/s³", "m/s³·s"]
    assert Metric("lasting", "", effort, time="integral").column_unit == "s"
