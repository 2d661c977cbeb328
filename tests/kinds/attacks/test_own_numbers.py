"""Numbers of each attacked vehicle's own, listed or drawn: exact answers, the bound of each."""

import jax
import numpy as np

from jaxnet.kinds.fields import FULL_TURN, Uniform
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import signal
from tests import reference, systems
from tests.reference import navigator_at

ATTACKED = [2, 5, 8, 11]
PAIR = {"vehicles": [8, 2]}
KEYS = {"defence": "none", "horizon": 12.0, "tail": 1.0}


def of_vehicle(name, distribution, j, component=0, count=2):
    """The numbers that a vehicle has in the first lanes, drawn by themselves."""
    return Draw(Keyed(0), range(count), 12).placed([distribution], name, [(j, component)])[:, 0]


def jets_by_hand(w, phase, magnitude, times):
    """A rotating signal of any frequency with two derivatives, within ā: (3, times, 2)."""
    z = magnitude / max(1.0, abs(w) ** 3) * np.exp(1j * (w * times + phase))
    derivatives = np.stack([z, 1j * w * z, -(w**2) * z])
    return np.stack([derivatives.real, derivatives.imag], axis=-1)


def test_lanes_are_exact_with_frequencies_drawn_for_each():
    """As the plain program, whose attackers turn by numbers that belong to them."""
    frequency = Uniform(uniform=[-2.0, 2.0])
    attack = {"kind": "rotating", "magnitude": 3.0, "frequency": {"each": {"uniform": [-2, 2]}}}
    one = systems.lanes(systems.study(attack=attack, engine="exact", **KEYS), 2)
    outcome, times = systems.simulate(one), np.arange(121) * 0.1
    for number in range(2):
        lane = systems.lane(one, number)
        turning = {}
        for j in ATTACKED:
            w = of_vehicle("attack.frequency", frequency, j)[number]
            phase = of_vehicle("attack.phase", FULL_TURN, j)[number]
            turning[j] = jets_by_hand(w, phase, 3.0, times)

        def added(t, lane=lane, turning=turning):
            found = np.zeros((4, 12, 13, 2))
            for j in ATTACKED:
                found[:3, lane.weights[:, j] > 0, j] = turning[j][:, None, round(t / 0.1)]
            return found

        start = reference.flat_jets(lane.initial.T)
        navigator = navigator_at(one, number)
        known = reference.propagate(lane.weights, navigator, added, lane.gain, start, 0.1, 120)
        ours = outcome.series["state"][number, :, :, :2]
        assert np.abs(ours - known["positions"]).max() <= 1e-9


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
