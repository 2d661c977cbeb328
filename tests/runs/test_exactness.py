"""The distance from the exact solution: what it would show, and what has no such solution."""

import pytest

from experiments.exactness import deviations, lanes_at_ticks
from tests import systems


@pytest.mark.long
def test_a_coarse_simulation_is_seen_to_be_off():
    """With trimming under attack, at a tolerance of 1e-3. Sound ones: tests/engine."""
    keys = {"horizon": 5.0, "tail": 1.0, "tick": 0.1, "engine": {"rtol": 1e-3, "atol": 1e-3}}
    (cell,) = systems.study(**keys).cells
    assert deviations(lanes_at_ticks(cell.scenario, 0, range(3))).max() > 1e-4


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"tick": 0}, "there are no ticks"),
        ({"law": "rounds"}, r"the law \(rounds\) is not solved"),
        ({"sensing": {"position": 0.1}}, "sensors err"),
        ({"channel": {"loss": {"kind": "bernoulli", "probability": 0.5}}}, "messages are lost"),
        ({"channel": {"delay": 0.1}}, "messages are late"),
        ({"attack": {"kind": "rotating", "threat": "replaces"}}, "no given path"),
    ],
)
def test_what_has_no_such_solution(keys, why):
    """It is refused, not compared with something else."""
    with pytest.raises(ValueError, match=why):
        lanes_at_ticks(systems.study(**keys).cells[0].scenario, 0, [0])
