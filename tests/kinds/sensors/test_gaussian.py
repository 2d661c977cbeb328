"""Noise in what vehicles sense: the variance of the error, and studies whose noise is 0."""

import numpy as np
import pytest
from scipy import stats

from jaxnet.config.document import ConfigError
from tests import systems
from tests.reference import Powers

# Variance of E over the variance s² of the drive, for gains (1, 3, 3) and noise held 0.05 s.
RESPONSE = 0.00937435
SIZES = {"position": 0.1, "velocity": 0.05, "acceleration": 0.02}
GAIN = np.array([1.0, 3.0, 3.0])
QUIET = {"attack": "none", "defence": "none", "engine": "exact", "topology": "cyclic", "tail": 0.0}


def drive_variance(sizes):
    """`s² = Σ k_k² σ_k²`."""
    return (GAIN**2 * np.array([sizes.get(key, 0.0) for key in SIZES]) ** 2).sum()


def test_the_variance_of_the_error_is_that_of_the_theory():
    """Inside its 99 % interval. Vehicles tell what they sense, so their errors are independent."""
    study = systems.study(sensing=SIZES, horizon=20.0, output_step=20.0, **QUIET)
    outcome = systems.simulate(systems.lanes(study, 200))
    positions = outcome.series["state"][:, -1, :, :2]
    errors = positions - positions.mean(axis=(0, 1))
    number = errors.size - 2
    expected = RESPONSE * drive_variance(SIZES)
    low, high = stats.chi2.ppf([0.005, 0.995], number) * expected
    assert low <= (errors**2).sum() <= high
    correlations = np.corrcoef(errors.reshape(200, -1).T)
    assert np.abs(correlations[np.triu_indices(24, 1)]).max() < 0.35


def test_readings_that_drop_out_leave_vehicles_ahead():
    """Behind a navigator at v readings are old by h d / (1 - d): mean E = v h d / (1 - d)."""
    navigator = Powers(x=[0.0, 10.0], y=[0.0])
    keys = QUIET | {"navigator": navigator, "tick": 0.1, "horizon": 20.0, "output_step": 10.0}
    one = systems.lanes(systems.study(sensing={"dropout": 0.5}, **keys), 100)
    lanes = (systems.simulate(one).series["state"][:, -1, :, 0] - 200.0).mean(axis=1)
    assert abs(lanes.mean() - 1.0) <= 2.576 * lanes.std() / 10
    assert lanes.std() < 1.0
    with pytest.raises(ConfigError, match="tells no standard deviations"):
        systems.study(sensing={"dropout": 0.5}, detector="chi_squared")
