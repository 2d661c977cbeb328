"""The distance that filtered vehicles keep (O18): when `check` tells it; crowds that keep it."""

import math

import numpy as np
import pytest

import jaxnet
from jaxnet.theory.case import Case
from jaxnet.theory.theorems import values
from jaxnet.view.text.facts import facts
from tests import systems

STEP = 0.033
CROWD = {
    "vehicles": 7,
    "topology": {"kind": "circulant", "offsets": [1, -1]},
    **systems.AGENTS,
    "gain": [1.0],
    **systems.QUIET,
    "engine": {"kind": "sampled", "move": "euler"},
    **systems.clock(STEP, 300 * STEP),
    "metrics": ["min_separation"],
}


def told(**keys):
    (cell,) = jaxnet.load({**CROWD, "filter": "barrier", **keys}).cells
    return values(Case(cell.scenario)).get("apart")


def line(**keys):
    """What `check` says."""
    (cell,) = jaxnet.load({**CROWD, "filter": "barrier", **keys}).cells
    return facts(cell.scenario).get("apart", "")


def test_check_tells_the_distance_where_it_is_proved():
    assert told() == 0.15
    assert told(engine={"kind": "nonlinear", "solver": "dopri5"}) == 0.15
    assert told(vehicle="look_ahead", engine={"kind": "nonlinear", "solver": "dopri5"}) == 0.15


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"attack": {"kind": "bias", "vehicles": [1]}}, "attacked vehicles tell false places"),
        ({"vehicle": "look_ahead"}, "filter barrier proves no distance for look_ahead at this"),
        (
            {"vehicle": {"kind": "single_integrator", "limits": {"input": 1.0}}},
            "single_integrator may not move as the law asks",
        ),
        ({"filter": {"kind": "barrier", "speed": None}}, "at this tick, gain and speed"),
        ({"filter": {"kind": "barrier", "gain": 1.9e6}}, "at this tick, gain and speed"),
    ],
)
def test_a_missing_premise_is_told_in_place_of_a_distance(keys, why):
    assert told(**keys) is None
    assert line(**keys).startswith("nothing is proved; ")
    assert why in line(**keys)


def test_nothing_is_said_without_a_filter():
    assert line(filter="none") == ""
    assert line() == "steered points that start 0.15 m apart or more stay so"


@pytest.mark.parametrize("form", ["joint", pytest.param("halves", marks=pytest.mark.long)])
def test_a_crowd_keeps_its_distance_up_to_the_greatest_gain(form):
    """All meet, with steps so long that a pair can almost pass the barrier in one of them."""
    safety = {"kind": "barrier", "form": form, "gain": 1.7e6}
    assert told(filter=safety) == 0.15
    angle = 2 * np.pi * np.arange(7) / 7 + 0.1 * np.arange(7)
    start = (0.6 * np.stack([np.cos(angle), np.sin(angle)], axis=1)).tolist()
    keys = {"initial": {"position": start}, "filter": safety, "samples": 1}
    row = jaxnet.simulate({**CROWD, **keys}, progress=False).lanes.iloc[0]
    assert 0.15 - 1e-9 < row["min_separation"] < 0.16
    assert row["infeasible"] == 0
    assert math.isclose(1.7e6 * STEP * ((0.15 + 0.4 * STEP) ** 2 - 0.0225) ** 2, 0.96, rel_tol=0.01)
