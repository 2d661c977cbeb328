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

    def measure(outcome):
        return np.where(outcome.metrics["alarms"] <= most_alarms, largest(outcome), -np.inf)

    given = {**KEYS, **keys, "channel": {"noise": noise or Known()}, "detector": detector}
    trials, chosen = search(given, measure, budget, starts, may_exceed)
    return trials.best, chosen["attack.magnitude"] / SIGMA


def search(keys, measure, budget, starts=1, may_exceed=0.0):
    """The end of a search over the drawn numbers of the attack, and those chosen."""
    (cell,) = systems.study(**keys).cells
    scenario, source = cell.scenario, Keyed(0)
    drawn = [one for one in places_of(scenario, source) if one.name.startswith("attack.")]
    box = Box(scenario, source, drawn)
    machine = Machine(devices=1, chunk=64 * starts)
    trials = Trials(box, starts, measure, machine, may_exceed=may_exceed)
    assert [*search_box(trials, budget, 0)]
    points = zip(drawn, trials.point, strict=True)
    return trials, {place.name: box.number(place, at) for place, at in points}


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


TAU, DRIFT = 8.0, 4.0
RATE, TICK = 2.0, 0.05  # of the follower's error, 1/s, and [s]
PATH = {"vehicles": 2, "topology": "path", "gain": [RATE], "tick": TICK, "horizon": 2.0}


def struck(first, later):
    """Error and share of alarms of a liar that sends these numbers of deviations."""
    attack = {"kind": "sleeper", "vehicles": [1], "burst": TICK, "magnitude": SIGMA * first}
    attack |= {"share": later / first}
    keys = {**KEYS, **PATH, "attack": attack, "channel": {"noise": Known()}, "tail": 0.0}
    detector = {"kind": "cusum", "drift": DRIFT, "threshold": TAU}
    outcome = systems.simulate(systems.lanes(systems.study(**keys, detector=detector), 1))
    return outcome.metrics["tail_max"][0], outcome.metrics["alarms"][0]


def test_the_greatest_lie_that_a_cusum_never_sees():
    """√(τ + b) deviations once, then √b for ever: no alarm, and any greater number raises one.

    The follower's error falls by φ in a tick, and moves by 1 - φ of what it hears.
    """
    less, more = 1 - 1e-12, 1 + 1e-9
    first, later = np.sqrt(TAU + DRIFT), np.sqrt(DRIFT)
    error, alarms = struck(first * less, later * less)
    ticks, keeps = round(PATH["horizon"] / TICK), np.exp(-RATE * TICK)
    sent = np.array([first] + [later] * (ticks - 1))
    exact = SIGMA * (1 - keeps) * sent @ keeps ** np.arange(ticks)[::-1]
    assert alarms == 0
    assert error == pytest.approx(exact, rel=1e-11)
    assert struck(first * more, later)[1] > 0
    assert struck(first * less, later * more)[1] > 0


WEIGHED = {"kind": "edges", "edges": [[1, 0, 1.0], [2, 0, 0.5], [2, 1, 0.5]]}


def test_who_was_honest_may_lie_as_far_as_it_likes():
    """Trust by deviation: the search finds when to strike, and how far, to 0.1 %.

    n ticks of the truth earn n / 2, a lie of ā costs c = 1/2 - R / (R + ā) a tick. So it is
    believed for n / 2c ticks, and to the end if it sleeps (ā - R) / 2ā of the time.
    """
    ticks, rate, radius, most = 100, 0.2, 1.0, 10.0
    sleeper = {"kind": "sleeper", "vehicles": [1], "burst": 100.0}
    sleeper |= {"magnitude": {"uniform": [0.0, most]}, "start": {"uniform": [0.0, 5.0]}}
    keys = {**KEYS, **PATH, "topology": WEIGHED, "gain": [rate], "horizon": ticks * TICK}
    keys |= {"tail": 0.0, "attack": sleeper, "defence": {"kind": "trust", "radius": radius}}
    trials, chosen = search(keys, largest, 2000)
    slept, far = np.meshgrid(np.arange(ticks + 1), np.linspace(radius * 1.001, most, 2000))
    cost = 0.5 - radius / (radius + far)
    believed = np.minimum(ticks - slept, np.floor(slept / (2 * cost) + 1e-9))
    keeps = np.exp(-rate * TICK)
    effect = 0.5 * far * (1 - keeps**believed) * keeps ** (ticks - slept - believed)
    assert trials.best == pytest.approx(effect.max(), rel=1e-3)
    assert chosen["attack.magnitude"] == pytest.approx(most, rel=1e-3)
    assert np.ceil(chosen["attack.start"] / TICK) == np.ceil(ticks * (most - radius) / (2 * most))


OWN = 8.0  # weight of the listener itself


def expected(right, ticks, wait, scale, rate):
    """The mean place of one who hears an honest source at 0 and a liar at 1, itself from 0.

    By the numbers of observations for the liar: their probability, and the mean place there.
    """
    chance, mean = np.zeros(ticks + 1), np.zeros(ticks + 1)
    chance[0] = 1.0
    for tick in range(ticks):
        chance, mean = (
            right * np.append(each[:-1], 0.0) + (1 - right) * np.append(0.0, each[:-1])
            for each in (chance, mean)
        )
        trusts = 2 * np.arange(ticks + 1) >= tick + 1
        share = 1.0 if tick < wait else scale * np.exp(-rate * tick)
        moved = np.where(trusts, (OWN * mean + chance) / (OWN + 2), OWN * mean / (OWN + 1))
        mean = (1 - share) * moved
    return mean.sum()


@pytest.mark.parametrize(("wait", "scale", "rate"), [(0, 0.0, 0.0), (3, 0.0, 0.0), (2, 0.9, 1.0)])
def test_who_is_observed_at_random_lies_always_and_as_far_as_it_may(wait, scale, rate):
    """What a liar does changes no observation, so its effect is a sum of its lies.

    The search finds the greatest lie from the tick on from which vehicles move. Its mean is the
    exact one, in the 99.9 % interval of its starts.
    """
    ticks, right, starts = 12, 0.7, 400
    sleeper = {"kind": "sleeper", "vehicles": [3], "burst": 100.0}
    sleeper |= {"magnitude": {"uniform": [0.0, 1.0]}, "start": {"uniform": [-4.0, 12.0]}}
    observed = {"honest": 1.0, "liar": 1 - right}
    trust = {"kind": "trust", "trusted": "none", "observation": "random", "observed": observed}
    trust |= {"wait": float(wait), "anchor": {"scale": scale, "rate": rate}}
    edges = [[1, 1, OWN], [1, 2, 1.0], [1, 3, 1.0]]
    keys = {**KEYS, "vehicles": 3, "topology": {"kind": "edges", "edges": edges}, "gain": [1.0]}
    keys |= {"navigator": "none", "law": "local", "tick": 1.0, "output_step": 1.0, "tail": 0.0}
    keys |= {"horizon": float(ticks), "attack": sleeper, "defence": trust}
    trials, chosen = search(keys, lambda outcome: outcome.metrics["spread"], 300 * starts, starts)
    (lanes,) = trials.simulate(trials.point[None])
    width = 3.29 * lanes.std() / np.sqrt(starts)
    assert chosen["attack.magnitude"] > 0.99
    assert chosen["attack.start"] <= wait
    assert trials.best / chosen["attack.magnitude"] == pytest.approx(
        expected(right, ticks, wait, scale, rate), abs=width
    )
