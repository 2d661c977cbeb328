"""Run lengths of CUSUM through the engine, and thresholds of windows."""

import numpy as np
import pytest

from jaxnet.kinds.detectors.chi_squared import p_value
from tests import systems

TICKS, LANES, SOURCES = 2001, 4, 12
PAGE = {"kind": "cusum", "drift": 0.5, "direction": [3.0, 4.0]}
KEYS = {
    "engine": "exact",
    "vehicles": 12,
    "topology": "complete",
    "law": {"kind": "local", "hold": True},
    "vehicle": "single_integrator",
    "defence": "none",
    "attack": {
        "kind": "bias",
        "magnitude": 0.1,
        "vehicles": [1, 2, 3, 4, 5, 6],
        "direction": float(np.arctan2(4.0, 3.0)),
    },
    "tick": 0.05,
    "horizon": 100.0,
    "output_step": 10.0,
    "tail": 10.0,
    "channel": {"noise": {"position": 0.1}},
}
ATTACKED = 6 * 11  # links; the other 78 are honest


@pytest.mark.parametrize(
    ("detector", "honest", "lied_to"),
    [
        (PAGE | {"threshold": 4.0}, 335.3676, 8.3832),
        (PAGE | {"threshold": 5.0}, 930.8870, 10.3760),
        ({"kind": "cusum", "drift": 4.0, "threshold": 8.0}, 245.0234, None),
    ],
)
def test_alarms_come_as_often_as_the_integral_equation_says(detector, honest, lied_to):
    """Each run starts at 0. Half of the vehicles lie by a deviation along the direction.

    N messages have N / L alarms. The deviation of a run is at most its mean, so that of the count
    is at most its root.
    """
    study = systems.study(**KEYS, detector=detector)
    outcome = systems.simulate(systems.lanes(study, LANES, save=()))
    for metric, links, known in (("false_alarms", 78, honest), ("alarms", ATTACKED, lied_to)):
        if known is not None:
            number = links * TICKS * LANES
            alarms = outcome.metrics[metric].mean() * number
            assert abs(alarms - number / known) <= 2.576 * np.sqrt(number / known)


@pytest.mark.parametrize(
    ("window", "threshold"), [(1, 9.210340), (2, 13.276704), (5, 23.209251), (10, 37.566235)]
)
def test_the_thresholds_of_windows_are_those_of_chi_squared(window, threshold):
    """Two degrees for each message."""
    found = p_value(np.array([threshold]), np.array([window]), window)
    assert float(found[0]) == pytest.approx(0.01, rel=3e-7)
    study = systems.study(**KEYS, detector={"kind": "chi_squared", "window": window})
    assert study.config.detector.rule(1).limit == pytest.approx(threshold, abs=5e-7)


def test_huge_residuals_raise_alarms_in_windows():
    assert float(p_value(np.array([1e200]), np.array([100]), 100)[0]) < 1e-100
