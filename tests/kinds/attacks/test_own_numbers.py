"""Numbers of each attacked vehicle's own, listed or drawn."""

import jax
import numpy as np

from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import signal
from tests import systems

PAIR = {"vehicles": [8, 2]}


def signals(attack, samples=40, **keys):
    """Signals of vehicles, or links, at some instants: (instants, 2, signals, lanes)."""
    study = systems.study(attack={"kind": "sinusoid", "magnitude": 2.0, **attack}, **keys)
    made = job(study.cells[0].scenario, Keyed(0), range(samples))
    lane = jax.tree.map(lambda leaf: np.moveaxis(leaf, 0, -1), made.inputs.lane)
    each = (lane.signal.basis(np.full(samples, time)) for time in (0.4, 2.3, 7.0))
    return np.stack([signal.jets(lane.vectors, basis)[0] for basis in each])


def test_ways_to_write_the_same_are_the_same():
    """A list of one distribution is one for each; a list of one number is that; to rounding."""
    band = {"uniform": [0.1, 4.0]}
    for one, other in (
        ({"frequency": [band] * 4}, {"frequency": {"each": band}}),
        ({"frequency": [0.8] * 4}, {"frequency": 0.8}),
        ({"frequency": {"shared": band}}, {"frequency": band}),
        ({"phase": {"each": band}}, {"phase": band}),
        ({"phase": [band] * 4}, {"phase": band}),
        ({"direction": [0.5, 0.5, 0.5, 0.5]}, {"direction": 0.5}),
        ({**PAIR, "frequency": [1.5, 0.2]}, {"vehicles": [2, 8], "frequency": [0.2, 1.5]}),
    ):
        np.testing.assert_allclose(signals(one), signals(other), rtol=0, atol=1e-12)


def test_each_attacker_has_a_number_of_its_own():
    """Drawn for each, and one for all if shared; how a fleet moves then: test_reference.py."""
    alike = {"phase": 0.2, "direction": 0.5}
    for way, apart in (("each", True), ("shared", False)):
        found = signals(alike | {"frequency": {way: {"uniform": [0.1, 4.0]}}})
        attacked = found[:, :, [1, 4, 7, 10]]
        assert ((np.ptp(attacked, axis=2) > 1e-6).any(axis=(0, 1)) == apart).all()
