"""What `cells.csv` says of a cell's lanes."""

import numpy as np
import pytest
from scipy import stats

from jaxnet.statistics.summary import spread


def test_the_interval_of_a_mean_that_cannot_be_negative_begins_at_zero():
    """Its other end stays where Student's t has it; where nothing is known of the mean both do."""
    values = np.array([0.0, 0.1, 4.0])
    low, high = stats.t.interval(0.95, 2, values.mean(), stats.sem(values))
    assert low < 0
    bounded, free = spread(values, 0.0), spread(values, -np.inf)
    assert (bounded["low"], bounded["high"]) == (0.0, pytest.approx(high))
    assert (free["low"], free["high"]) == (pytest.approx(low), pytest.approx(high))


def test_one_lane_has_no_interval():
    """And none at zero either."""
    assert np.isnan(spread(np.array([1.0]), 0.0)["low"])
