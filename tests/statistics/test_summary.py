"""What `cells.csv` says of a cell's lanes."""

import numpy as np
import pytest

from jaxnet.statistics.summary import UNBOUNDED, metric_statistics


def test_an_end_without_a_bound_is_not_told():
    """Nothing holds for all distributions there; the other end stays what it is."""
    values = np.array([0.0, 0.1, 4.0])
    both, lower, none = (
        metric_statistics(values, within) for within in ((0.0, 9.0), (0.0, np.inf), UNBOUNDED)
    )
    assert 0 < both["low"] < both["mean"] < both["high"] < 9
    assert lower["low"] == both["low"]
    assert np.isnan([lower["high"], none["low"], none["high"]]).all()
    assert none["mean"] == both["mean"] == pytest.approx(4.1 / 3)


def test_no_lane_and_lanes_without_end():
    """Everything blank of no lane; of an infinite one the interval alone."""
    assert np.isnan(list(metric_statistics(np.array([]), (0.0, 9.0)).values())).all()
    found = metric_statistics(np.array([1.0, np.inf]), (0.0, 9.0))
    assert np.isnan([found["low"], found["high"]]).all()
    assert found["max"] == np.inf


def test_lanes_of_a_unit_count_as_one():
    """Units that repeat one number have the interval of as many lanes, whatever their size."""
    few = np.array([1.0, 2.0, 4.0, 8.0])
    known, found = (
        metric_statistics(few, (0.0, 9.0)),
        metric_statistics(np.repeat(few, 5), (0.0, 9.0), np.repeat(np.arange(4), 5)),
    )
    assert (found["low"], found["high"]) == pytest.approx((known["low"], known["high"]), rel=1e-9)
