"""Theorem 6 of docs/guarantees.md: what no rule can tell if a liar announces what it likes."""

import numpy as np
import pytest

from jaxnet.engine.status import Status
from tests import systems
from tests.engine.test_defended import PAIR

MAGNITUDE = 5.0
RULES = [
    {"kind": "trusted_trim", "theta": {1: 1, 2: 1}, "trusted": {1: [2], 2: [1]}},
    {"kind": "trusted_trim", "score": "announced", "theta": {1: 1, 2: 1}, "filter": 1.0},
    {"kind": "w_msr"},
]


def world(defence, liar, sign, shift):
    """Errors of the vehicles over time where 3 or 4 lies by ±ā; vehicles 1 and 2 start this far
    along x.

    Returns the lanes' statuses and E (lanes, times, 4, 2).
    """
    attack = {"kind": "bias", "magnitude": MAGNITUDE, "vehicles": [liar], "announces": "honest"}
    attack["direction"] = 0.0 if sign > 0 else np.pi
    study = systems.study(
        **PAIR | {"attack": attack, "horizon": 30.0, "tail": 1.0}, defence=defence
    )
    job = systems.lanes(study, 8)
    initial = job.inputs.lane.initial.copy()
    initial[:, 0, :2] += shift
    lane = job.inputs.lane._replace(initial=initial)
    outcome = systems.simulate(job._replace(inputs=job.inputs._replace(lane=lane)))
    path = study.cells[0].scenario.navigator.jets(np.arange(301) * 0.1)[0].T
    return outcome.status, outcome.series["state"][..., :2] - path[None, :, None]


@pytest.mark.parametrize(
    "defence", [RULES[0], *(pytest.param(rule, marks=pytest.mark.long) for rule in RULES[1:])]
)
def test_no_rule_tells_two_worlds_apart(defence):
    """Theorem 6: 4 adds ā, or 3 takes ā away and the navigator is ā elsewhere; 1 and 2 hear the
    same.

    So their errors differ by ā at all times, and in one of the worlds they are off by ā/2 at least.
    """
    status, errors = world(defence, liar=4, sign=1, shift=0.0)
    again, others = world(defence, liar=3, sign=-1, shift=-MAGNITUDE)
    ok = status == Status.ok
    assert ok.any()
    assert (status == again).all()
    listeners, apart = slice(0, 2), np.array([MAGNITUDE, 0.0])
    assert np.allclose(errors[ok][:, :, listeners] - others[ok][:, :, listeners], apart, atol=1e-6)
    off = np.maximum(
        *(np.linalg.norm(each[ok][:, -1, listeners], axis=-1) for each in (errors, others))
    )
    assert (off >= MAGNITUDE / 2 - 1e-6).all()


OUTSIDE = [(1, 2), (1, 3), (2, 0), (3, 0), (2, 4), (4, 0)]
HEARS_I = [(1, 2), (1, 3), (2, 0), (2, 1), (3, 0), (3, 1)]
CASES = {  # edges, the link that lies in world A besides (1, 3), whether the theorem holds
    "as stated": (OUTSIDE, None, True),
    "one outside hears I": (HEARS_I, None, False),
    "a link outside I lies": ([*OUTSIDE, (2, 3)], (2, 3), False),
}


def heard_and_errors(edges, added, shift):
    """What vehicle 1 ends up receiving, and its error, on a line: `E = L⁻¹ d`, nobody dropped.

    `added` is what links carry besides, by (listener, source); `shift` is where the navigator is.
    """
    m = max(i for i, _ in edges)
    weights, attack = np.zeros((m, m + 1)), np.zeros((m, m + 1))
    for i, j in edges:
        weights[i - 1, j], attack[i - 1, j] = 1.0, added.get((i, j), 0.0)
    weights /= weights.sum(axis=1, keepdims=True)
    errors = np.linalg.solve(np.eye(m) - weights[:, 1:], (weights * attack).sum(axis=1))
    messages = shift + np.append(0.0, errors) + attack[0]
    return messages[weights[0] > 0], errors[0]


@pytest.mark.parametrize("case", CASES)
def test_theorem_6_needs_that_nobody_outside_hears_and_that_only_links_inwards_lie(case):
    """I is vehicle 1, ϑ = 1. As stated it sees equal worlds, whose errors differ by ā = 1."""
    edges, more, holds = CASES[case]
    messages, error = heard_and_errors(edges, dict.fromkeys([(1, 3), more], 1.0), 0.0)
    others, other = heard_and_errors(edges, {(1, 2): -1.0}, 1.0)
    assert np.allclose(messages, others) == holds
    assert np.isclose(error - other, 1.0) == holds
