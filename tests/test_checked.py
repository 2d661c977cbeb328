"""Annotations hold while tests run: shapes and types of arrays, and plain types."""

import numpy as np
import pytest

from jaxnet.statistics import intervals
from jaxnet.view.figures import multiples

WRONG = {
    "shapes that differ": lambda: intervals.clopper_pearson(
        np.array([1, 2]), np.array([3, 4, 5]), 0.95
    ),
    "numbers of another type": lambda: intervals.clopper_pearson(
        np.array([1.5]), np.array([3]), 0.95
    ),
    "no array": lambda: intervals.clopper_pearson([1], [3], 0.95),
    "text": lambda: multiples.panels_across("7.16"),
}


@pytest.mark.long  # with JAXNET_CHECK_SHAPES alone
@pytest.mark.parametrize("wrong", WRONG)
def test_what_an_annotation_rules_out_is_refused(wrong):
    """By functions with arrays and without."""
    with pytest.raises(Exception, match="violates type hint"):
        WRONG[wrong]()
