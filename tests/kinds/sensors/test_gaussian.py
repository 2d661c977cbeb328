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
    """Inside its 99 % interval. Vehicles tell what they sense, so that their errors are independent."""
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


def test_noise_does_not_depend_on_the_weights():
    """Rings of other weights draw the same noise, and end at the same places."""
    ends = []
    for weight in (0.1, 0.9):
        topology = {"kind": "cyclic", "navigator_weight": weight}
        keys = QUIET | {"topology": topology, "vehicles": 4, "horizon": 3.0, "tail": 1.0}
        ends.append(
            systems.simulate(systems.lanes(systems.study(sensing=SIZES, **keys), 2)).series["state"]
        )
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-9)


def test_a_lane_is_the_same_alone_and_among_others():
    """To the last bit; the noise is drawn for each lane by itself."""
    study = systems.study(
        sensing={"position": {"uniform": [0.0, 0.2]}},
        horizon=2.0,
        tail=1.0,
        engine="exact",
        defence="none",
    )
    few, many = (systems.simulate(systems.lanes(study, number)) for number in (2, 6))
    np.testing.assert_array_equal(few.series["state"], many.series["state"][:2])
    assert np.abs(many.series["state"][0] - many.series["state"][1]).max() > 0.0


def test_exact_sensing_is_the_default():
    """Sizes of 0 give the very program that runs without the key."""
    plain, zero = (
        systems.lanes(systems.study(engine="exact", **keys), 1)
        for keys in ({}, {"sensing": {"position": 0.0}})
    )
    assert plain.inputs.lane.sensor is zero.inputs.lane.sensor is None


def test_readings_that_drop_out_leave_vehicles_ahead():
    """Behind a navigator at v a reading is old by h d / (1 - d) on average: mean E = v h d / (1 - d)."""
    navigator = Powers(x=[0.0, 10.0], y=[0.0])
    keys = QUIET | {"navigator": navigator, "tick": 0.1, "horizon": 20.0, "output_step": 10.0}
    one = systems.lanes(systems.study(sensing={"dropout": 0.5}, **keys), 100)
    lanes = (systems.simulate(one).series["state"][:, -1, :, 0] - 200.0).mean(axis=1)
    assert abs(lanes.mean() - 1.0) <= 2.576 * lanes.std() / 10
    assert lanes.std() < 1.0
    with pytest.raises(ConfigError, match="tells no standard deviations"):
        systems.study(sensing={"dropout": 0.5}, detector="chi_squared")
