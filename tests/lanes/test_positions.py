"""Positions at t = 0 that a config lists."""

import numpy as np
import pytest

import jaxnet

KEYS = {
    "vehicles": 3,
    "engine": "exact",
    "horizon": 0.1,
    "tail": 0.0,
    "attack": "none",
    "defence": "none",
}
KEYS |= {"save": {"trajectories": "all"}}


def starts(position, **keys):
    """Positions of two lanes at t = 0, (samples, vehicles, 2)."""
    results = jaxnet.simulate(
        KEYS | {"initial": {"position": position}} | keys, samples=2, progress=False
    )
    states = results.trajectories["states"].isel(time=0).transpose("cell", "sample", ...).values
    return states[..., :2]


def test_each_vehicle_starts_at_its_place():
    """A pair is a place, a number is a place on the line y = 0, and a distribution is drawn."""
    (found,) = starts([7.0, [2, -3], [{"uniform": [0, 1]}, 5.0]])
    np.testing.assert_array_equal(found[:, :2], [[[7.0, 0.0], [2.0, -3.0]]] * 2)
    np.testing.assert_array_equal(found[:, 2, 1], 5.0)
    assert ((found[:, 2, 0] > 0) & (found[:, 2, 0] < 1)).all()
    assert np.ptp(found[:, 2, 0]) > 0


def test_a_list_can_be_swept_beside_a_distribution():
    """One cell has the listed places, the other drawn ones."""
    sweep = {"initial.position": [[1.0, 2.0, 3.0], {"uniform": [10.0, 11.0]}]}
    listed, drawn = starts(0.0, sweep=sweep)
    np.testing.assert_array_equal(listed[..., 0], [[1.0, 2.0, 3.0]] * 2)
    assert (drawn >= 10.0).all()


@pytest.mark.parametrize(
    ("position", "words"),
    [
        ([1.0, [2, 3]], r"initial.position: must be 3 places, one for each vehicle \(got 2\)"),
        ([1.0, [2, 3, 4], 5.0], r"initial.position.1: must have at most 2 entries"),
        ([1.0, "here", 5.0], r"initial.position.1.0: must be a number"),
    ],
)
def test_other_lists_are_refused(position, words):
    """The error names the place and what was given."""
    with pytest.raises(jaxnet.ConfigError, match=words):
        jaxnet.load(KEYS | {"initial": {"position": position}})
