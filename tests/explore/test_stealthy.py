"""The search finds the greatest lie that raises no alarm, where it is known (theorems.md O19)."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from experiments.search import largest
from jaxnet.engine.batch import Machine
from jaxnet.explore.box import Box, places_of
from jaxnet.explore.search import Trials, search_box
from jaxnet.kinds.noises import ChannelNoise
from jaxnet.lanes.uniforms import Keyed
from jaxnet.theory.case import Case
from jaxnet.theory.theorems import values
from tests import systems

pytestmark = pytest.mark.long
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


CHI = {"kind": "chi_squared", "false_alarms": 0.01}
PAGE = {"kind": "cusum", "drift": 4.0, "threshold": 8.0}
WINDOW = CHI | {"window": 5}
TICKS = 101


def searched(detector, most_alarms, noise=None, starts=1, budget=300, may_exceed=0.0, **keys):
    """The greatest tail error of all steady lies with few alarms [m], and its lie [σ]."""
    given = {**KEYS, **keys, "channel": {"noise": noise or Known()}, "detector": detector}
    (cell,) = systems.study(**given).cells
    scenario, source = cell.scenario, Keyed(0)

    def measure(outcome):
        return np.where(outcome.metrics["alarms"] <= most_alarms, largest(outcome), -np.inf)

    (place,) = (one for one in places_of(scenario, source) if one.name == "attack.magnitude")
    box = Box(scenario, source, [place])
    machine = Machine(devices=1, chunk=64 * starts)
    trials = Trials(box, starts, measure, machine, may_exceed=may_exceed)
    assert [*search_box(trials, budget, 0)]
    return trials.best, box.number(place, trials.point[0]) / SIGMA


@pytest.mark.parametrize(
    ("detector", "size"),
    [(CHI, 3.034854), (WINDOW, np.sqrt(23.209251 / 5)), (PAGE, np.sqrt(4 + 8 / TICKS))],
)
def test_the_greatest_lie_without_alarm_is_found(detector, size):
    """A steady one of a liar that knows the errors: to 1 %, and the effect that theory tells.

    In so few ticks a CUSUM allows its threshold beside its drift.
    """
    effect, found = searched(detector, 0.0)
    exact = systems.study(**KEYS, channel={"noise": {"position": SIGMA}}, detector=detector)
    told = values(Case(exact.cells[0].scenario))["unseen effect"]
    assert effect <= told.most
    assert effect == pytest.approx(told.steady, rel=0.01 if detector is not PAGE else 0.02)
    assert found == pytest.approx(size, rel=0.01)


def test_the_search_sees_that_an_alarm_cuts():
    """A lie that is seen is cut at once: without a limit of alarms the greatest unseen one wins."""
    _, free = searched(CHI, 1.0)
    effect, found = searched(CHI | {"cuts": "link"}, 1.0)
    assert free > 4.9
    assert found == pytest.approx(3.034854, rel=0.01)
    assert effect == pytest.approx(searched(CHI, 0.0)[0], rel=0.01)


@pytest.mark.parametrize("part", [0.1, 0.4])
def test_a_share_of_the_starts_may_raise_alarms(part):
    """The lie that a test sees in so many lanes, by the law of its squared residual.

    Of N messages with errors one at least is seen in a lane with probability `1 - (1 - p)^N`.
    """
    alpha, starts = 1e-3, 500
    detector, noise = CHI | {"false_alarms": alpha}, {"position": SIGMA}
    short = {"horizon": 4.0, "tick": 0.5, "topology": "path"}
    _, found = searched(detector, 0.0, noise, starts, 100 * starts, part, **short)
    seen = stats.ncx2.sf(stats.chi2.isf(alpha, 2), 2, found**2)
    messages = 9  # of nine ticks; one vehicle hears the liar
    width = 2.576 * np.sqrt(part * (1 - part) / starts)
    assert 1 - (1 - seen) ** messages == pytest.approx(part, abs=width)
