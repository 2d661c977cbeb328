"""The search finds the greatest lie that raises no alarm, where it is known (theorems.md O19)."""

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.search import largest
from jaxnet.engine.batch import Machine
from jaxnet.explore.box import Box, places_of
from jaxnet.explore.search import Trials, search_box
from jaxnet.kinds.noises import ChannelNoise
from jaxnet.lanes.uniforms import Keyed
from jaxnet.theory.case import Case
from jaxnet.theory.theorems import values
from tests import systems

SIGMA = 0.1
KEYS = {
    "engine": "exact",
    "vehicles": 4,
    "vehicle": "single_integrator",
    "gain": [2.0],
    "defence": "none",
    "horizon": 5.0,
    "tail": 1.0,
    "output_step": 0.5,
    "initial": {"position": 0.0},
    "attack": {"kind": "bias", "magnitude": {"uniform": [0.0, 0.5]}, "vehicles": [1]},
}


class Known(ChannelNoise):
    """Errors that the liar knows, and takes into account: what is left is the lie."""

    def deviations(self):
        return [jnp.full(1, SIGMA), None, None]

    def tells_deviations(self):
        return True

    def next_errors(self, last, time, interval, sources):
        return tuple(jnp.zeros_like(each) for each in last)


@pytest.mark.parametrize(
    ("detector", "size"), [({"kind": "chi_squared", "false_alarms": 0.01}, 3.034854)]
)
def test_the_greatest_lie_without_alarm_is_found(detector, size):
    """A steady one of a liar that knows the errors: to 1 %, and the effect that theory tells."""
    (cell,) = systems.study(**KEYS, channel={"noise": Known()}, detector=detector).cells
    scenario, source = cell.scenario, Keyed(0)

    def measure(outcome):
        return np.where(outcome.metrics["alarms"] <= 0, largest(outcome), -np.inf)

    (place,) = (one for one in places_of(scenario, source) if one.name == "attack.magnitude")
    box = Box(scenario, source, [place])
    trials = Trials(box, 1, measure, Machine(devices=1, chunk=64))
    assert [*search_box(trials, 400, 0)]
    exact = systems.study(**KEYS, channel={"noise": {"position": SIGMA}}, detector=detector)
    effect = values(Case(exact.cells[0].scenario))["unseen effect"]
    assert effect.steady == pytest.approx(trials.best, rel=0.01)
    assert box.number(place, trials.point[0]) == pytest.approx(size * SIGMA, rel=0.01)
