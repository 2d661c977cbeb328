"""W-MSR: the rule of the paper in plain loops, and no bound told."""

import numpy as np
import pandas as pd
import pytest

import jaxnet
from jaxnet.kinds.defences import Neighbourhood
from jaxnet.kinds.defences.w_msr import WMSR
from jaxnet.statistics import limits
from jaxnet.view.text import check
from tests import systems


def retained(own, values, candidates, f):
    """Which values of one vehicle on one axis it retains, by LeBlanc et al. (2013), section IV.A.

    "If there are less than F values strictly larger than its own, the node removes all values that
    are strictly larger than its own. Otherwise, it removes precisely the largest F values in the
    sorted list"; so for the smaller ones. Of equal ones those that come first.
    """
    keep = [True] * len(values)
    for side in (1, -1):
        beyond = sorted((-side * values[k], k) for k in candidates if side * (values[k] - own) > 0)
        for _, k in beyond[: min(f, len(beyond))]:
            keep[k] = False
    return keep


@pytest.mark.parametrize("f", [0, 1, 2, 3, 9])
def test_it_is_the_rule_of_the_paper(f):
    """On 10,000 neighbourhoods of whole numbers, most of them with ties, some of a few sources."""
    slots, m, lanes = 7, 4, 2500
    rng = np.random.default_rng(f)
    own = rng.integers(-3, 4, (2, m, lanes)).astype(float)
    received = rng.integers(-3, 4, (2, slots, m, lanes)).astype(float)
    weights = rng.random((slots, m, lanes)) * (rng.random((slots, m, lanes)) < 0.8)
    trusted = np.zeros((slots, m), bool)
    trusted[0] = True
    around = Neighbourhood(None, weights, trusted, None, None, ())
    last = np.ones(weights.shape, bool)
    decision, _ = WMSR(F=f).decide((own,) * 3, (received,) * 3, last, (), around)
    assert decision.shape == received.shape
    for i in range(m):
        for lane in range(lanes):
            candidates = [k for k in range(1, slots) if weights[k, i, lane] > 0]
            for axis in (0, 1):
                values = received[axis, :, i, lane].tolist()
                known = retained(own[axis, i, lane], values, candidates, f)
                assert decision[axis, :, i, lane].tolist() == known


def test_no_bound_is_told():
    """Not in the table of bounds, of violations, nor by `check`, which says so."""
    study = jaxnet.load({"defence": "w_msr", "engine": "exact", "name": "test"})
    table = limits.slopes_table(study.cells)
    assert len(table) == 6 * 14
    assert table["slope"].isna().all()
    assert limits.unchecked_words(study.cells) == "cell 0: the defence may retain any neighbour"
    assert "so no bound is told" in " ".join(check.check_text(study).split())
    rows = pd.DataFrame({"cell": [0], "sample": [0], "status": ["ok"], "tail_max": [1e9]})
    assert limits.violations_table(systems.results_of(study, rows)).empty
