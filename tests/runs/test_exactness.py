"""The distance from the exact solution is one, and would show a simulation that is off."""

import pytest

from experiments.exactness import deviations, lanes_at_ticks
from tests import systems


@pytest.mark.long
def test_it_is_small_for_a_sound_simulation_and_large_for_a_coarse_one():
    """With trimming under attack; a tolerance of 1e-3 is seen at once."""
    keys = {"horizon": 5.0, "tail": 1.0, "tick": 0.1}
    sound, coarse = (
        lanes_at_ticks(systems.study(engine=engine, **keys).cells[0].scenario, 0, range(3))
        for engine in ({}, {"rtol": 1e-3, "atol": 1e-3})
    )
    assert deviations(sound).max() < 1e-5
    assert deviations(coarse).max() > 1e-4


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


@pytest.mark.long
def test_drawn_numbers_are_each_lane_s_own():
    """The nonlinear engine's gains and weights, drawn lane by lane, are those of the solution."""
    keys = {"horizon": 5.0, "tail": 1.0, "tick": 0.1, "gain": [{"uniform": [0.5, 1.5]}, 3, 3]}
    topology = {"navigator_weight": {"uniform": [0.1, 0.4]}}
    (cell,) = systems.study(topology=topology, **keys).cells
    assert deviations(lanes_at_ticks(cell.scenario, 0, range(3))).max() < 1e-5
