"""Runs, unseen lies and their effect in cells: against the static bound and a plain loop."""

import numpy as np
import pytest
from scipy import stats

from jaxnet.kinds.detectors import AlarmRule, Detector
from jaxnet.theory import alarms, bounds, spread
from jaxnet.theory.case import Case
from jaxnet.theory.theorems import values
from tests import systems

SIGMA = 0.1
KEYS = {
    "engine": "exact",
    "vehicles": 6,
    "defence": "none",
    "vehicle": "single_integrator",
    "channel": {"noise": {"position": SIGMA}},
    "attack": {"kind": "bias", "magnitude": 0.2, "vehicles": [1]},
    "detector": {"kind": "chi_squared", "false_alarms": 0.01},
}


PAGE = {"kind": "cusum", "drift": 4.0, "threshold": 8.0}


def case_of(**keys):
    (cell,) = systems.study(**KEYS | keys).cells
    return Case(cell.scenario)


def told(quantity, **keys):
    return values(case_of(**keys)).get(quantity)


def test_runs_of_a_cell():
    """The ring of six has 18 links, two of vehicle 1; a lie of two deviations."""
    found = told("runs")
    assert (found.number, found.of) == (16, "link")
    assert found.link.most == pytest.approx(100)
    assert found.fleet.most == pytest.approx(1 / (1 - 0.99**16))
    assert found.lie.most == pytest.approx(1 / 0.203948, rel=1e-5)
    of_page = told("runs", detector=PAGE)
    assert of_page.link.most == pytest.approx(245.0234, abs=5e-5)


@pytest.mark.parametrize(
    ("keys", "number", "of"),
    [
        ({"channel": {"noise": {"position": SIGMA, "of": "transmitter"}}}, 5, "vehicle"),
        ({"channel": {}, "sensing": {"position": SIGMA}}, 5, "vehicle"),
        ({"sensing": {"position": SIGMA}}, 0, "link"),
        ({"attack": {"kind": "bias", "vehicles": {"random": 2}}}, 14, "link"),
        ({"attack": "none"}, 18, "link"),
    ],
)
def test_residuals_of_links_depend_if_they_share_an_error(keys, number, of):
    """All who hear a vehicle hear its own error; the navigator's messages are then exact."""
    found = told("runs", **keys)
    assert (found.number, found.of) == (number, of)
    assert (found.fleet is None) == (number == 0)


@pytest.mark.parametrize(
    "keys",
    [
        {"channel": {"noise": {"position": SIGMA, "correlation": 1.0}}},
        {"channel": {"noise": {"position": SIGMA, "outliers": 0.1}}},
        {"channel": {"noise": {"position": {"uniform": [0.1, 0.2]}}}},
        {"detector": {"kind": "chi_squared", "false_alarms": {"uniform": [0.01, 0.1]}}},
        {"detector": {"kind": "chi_squared", "predicts": "kalman"}},
        {
            "channel": KEYS["channel"]
            | {"loss": {"kind": "bernoulli", "probability": 0.1}, "missing": "drop"}
        },
    ],
)
def test_without_premises_nothing_is_told(keys):
    found = values(case_of(**keys))
    assert not {"runs", "unseen lie", "unseen effect"} & {*found}


def test_of_a_detector_without_a_rule_nothing_is_told():
    class Never(Detector):
        def alarms(self, messages, memory):
            return messages.judged & False, memory

    assert told("runs", detector=Never()) is None
    assert told("unseen lie", detector=Never()) is None


def test_the_greatest_lie_that_is_not_seen():
    """√9.210340 σ by χ² at 1 %, at each tick; by the CUSUM 2 σ after one of √12 σ."""
    of_chi, of_page = told("unseen lie"), told("unseen lie", detector=PAGE)
    assert of_chi == pytest.approx([3.034854 * SIGMA] * 2, rel=1e-6)
    assert of_page == pytest.approx([np.sqrt(12) * SIGMA, 2 * SIGMA])
    sensed = told("unseen lie", sensing={"position": 2 * SIGMA})
    assert sensed.steady == pytest.approx(np.sqrt(9.210340 * 5) * SIGMA, rel=1e-6)


def test_a_steady_lie_moves_as_the_static_bound_says():
    """Which a study without errors has; of drawn vehicles the worst set counts."""
    exact = case_of(channel={}, detector="none").scenario
    static = bounds.static(spread.scenario_gain(exact)).worst
    assert told("unseen effect", detector=PAGE).steady == pytest.approx(static * 2 * SIGMA)
    each = [
        told("unseen effect", attack={"kind": "bias", "vehicles": [one, other]}).steady
        for one in range(1, 7)
        for other in range(one + 1, 7)
    ]
    drawn = told("unseen effect", attack={"kind": "bias", "vehicles": {"random": 2}})
    assert drawn.steady == pytest.approx(max(each))


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"defence": "w_msr"}, "decides"),
        ({"topology": "star"}, "is not tested"),
        ({"engine": {"kind": "sampled"}}, "holds inputs"),
    ],
)
def test_no_effect_is_told_where_it_is_not_known(keys, why):
    assert told("unseen effect", **keys) is None, why


def test_the_effect_of_a_held_lie():
    """Order 1: each tick leaves 1 - e^{-kh}, all together 1; order 3: its hump counts twice."""
    first, total = alarms.held_effect(np.array([2.0]), 0.05)
    assert (first, total) == pytest.approx((1 - np.exp(-0.1), 1.0))
    first, total = alarms.held_effect(np.array([1.0, 3.0, 3.0]), 0.001)
    # h = t² e^{-t} / 2 rises to 2 e^{-2} at t = 2, and 5 e^{-2} of its integral is left then
    assert first == pytest.approx(2e-3 * np.exp(-2), rel=1e-3)
    assert total == pytest.approx(4 * np.exp(-2) + 5 * np.exp(-2), rel=1e-3)
    assert alarms.held_effect(np.array([1e-6]), 0.05) is None


@pytest.mark.parametrize("detector", [KEYS["detector"], PAGE])
@pytest.mark.parametrize(
    ("vehicle", "gain"), [("single_integrator", [2.0]), ("double_integrator", [4.0, 0.8])]
)
def test_no_unseen_lie_moves_a_vehicle_by_more(detector, vehicle, gain):
    """A plain loop of the ring: steady lies and late bursts, whose residuals raise no alarm.

    The best of them reaches 80 % of what is allowed, where the law does not swing.
    """
    case = case_of(detector=detector, vehicle=vehicle, gain=gain, tick=0.1)
    found, rule = values(case)["unseen effect"], case.scenario.detector.rule(1)
    weights = case.weights
    heard = np.linalg.solve(np.eye(6) - weights[:, 1:], weights[:, 2 - 1])  # from vehicle 1
    order, ticks, greatest = len(gain), 600, 0.0
    motion = np.eye(order, k=1)
    motion[-1] = -np.array(gain)
    fine = 400
    flow = np.linalg.matrix_power(np.eye(order) + motion * 0.1 / fine, fine)
    pushed = np.linalg.solve(motion, (flow - np.eye(order)) @ np.eye(order)[-1]) * gain[0]
    for burst in range(1, 40):
        squares = np.full(ticks, rule.limit if rule.drift is None else rule.drift)
        if rule.drift is not None:  # the memory is empty until the last ticks share the limit
            squares[-burst:] += rule.limit / burst
            level = 0.0
            for z in squares:
                level = max(0.0, level + z - rule.drift)
                assert level <= rule.limit + 1e-9
        state = np.zeros(order)
        for z in squares:
            state = flow @ state + pushed * SIGMA * np.sqrt(z)
        greatest = max(greatest, state[0] * heard.max())
    assert greatest <= found.most * (1 + 1e-9)
    assert greatest > 0.8 * found.most or order > 1


def test_the_rule_of_chi_squared():
    """Two degrees for each order."""
    rule = case_of().scenario.detector.rule(3)
    assert rule == AlarmRule(pytest.approx(stats.chi2.isf(0.01, 6)))
