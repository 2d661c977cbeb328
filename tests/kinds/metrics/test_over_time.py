"""Sums and integrals over time, and a metric of the inputs, against the stored trajectory."""

import numpy as np
import pytest

from jaxnet.kinds.metrics import Metric
from tests import systems

KEYS = {"horizon": 2.0, "tail": 0.5, "output_step": 0.1, "defence": "none"}


def two(seen):
    """The number 2 for each vehicle."""
    return 0.0 * seen.speed + 2.0


def effort(seen):
    """Magnitude of the first input."""
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
    whole, late = (np.trapezoid(each, dx=0.1, axis=1).max(axis=1) for each in (efforts, efforts[:, -6:]))
    assert found["effort"] == pytest.approx(whole)
    assert found["late_effort"] == pytest.approx(late)
    assert found["summed"] == pytest.approx(efforts.sum(axis=1).min(axis=1))
    assert found["hardest"] == pytest.approx(efforts.max(axis=(1, 2)))


def test_the_column_of_an_integral_has_seconds_in_its_unit():
    """A sum keeps the unit."""
    assert [each.column_unit for each in (TWO_IN_ALL, TWO_COUNTED, EFFORT)] == ["m·s", "m", "m/s³·s"]
    assert Metric("lasting", "", two, time="integral").column_unit == "s"
