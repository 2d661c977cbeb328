"""The warning that false alarms are far more often than a detector is asked for."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest
from upath import UPath

from jaxnet.statistics import nominal
from jaxnet.store.results import Results
from tests import systems

NOISE = {"channel": {"noise": {"position": 0.05}}, "tick": 0.1}


@pytest.mark.parametrize(
    ("alarms", "messages", "rate", "far"),
    [
        (200, 10_000, 1e-4, True),  # as with an observer that does not fit
        (106, 1_000_000, 1e-4, False),
        (3, 10_000, 1e-4, False),  # three times the rate, but few: 0.00006 to 0.0009
        (0, 10_000, 1e-4, False),
        (0, 1_000_000, 1e-4, False),  # fewer: a link that is cut raises one alarm alone
        (190, 10_000, 1e-2, False),  # surely more, but not twice as many
    ],
)
def test_a_rate_is_far_if_its_exact_interval_is_above_twice_the_nominal(
    alarms, messages, rate, far
):
    """By scipy's interval; blank is not far."""
    ends = binomtest(alarms, messages).proportion_ci(0.95, "exact")
    assert (ends.low > 2 * rate) == far
    assert nominal.is_far(alarms / messages, messages, rate) == far
    assert not nominal.is_far(np.nan, messages, rate)


def test_the_words_tell_rates_cells_and_what_does_not_fit():
    """By nominal rate; a distance has none, and a detector that knows the truth has no observer."""
    chi = {"kind": "chi_squared", "false_alarms": 1e-4}
    sweep = {
        "detector": [
            chi | {"predicts": "kalman", "label": "kalman"},
            chi | {"label": "truth"},
            {"kind": "distance", "threshold": 1.0},
        ],
        "attack.magnitude": [1, 2],
    }
    study = systems.study(samples=3, sweep=sweep, attack={"kind": "bias", "vehicles": [2]}, **NOISE)
    table = pd.DataFrame({"ok": [3, 3, 3, 0, 3, 3]})
    table["false_alarms_mean"] = [0.02, 0.48, 0.02, np.nan, 0.02, 0.02]
    results = Results(UPath("nowhere"))
    vars(results).update(cells=table, study=study)
    assert nominal.misfit_words(results, study.cells) == [
        "honest messages raise 2 to 48 % alarms, nominal 0.01 %: the observer does not fit"
        " (cells 0, 1)",
        "honest messages raise 2 % alarms, nominal 0.01 %: errors are not as the test supposes"
        " (cell 2)",
    ]
    table["false_alarms_mean"] = 1.1e-4
    assert nominal.misfit_words(results, study.cells) == []
