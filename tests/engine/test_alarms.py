"""Alarms that act, in every engine and law, against the plain fleet (tests/reference.py)."""

import numpy as np
import pytest

from tests import systems
from tests.engine.test_reference import (
    BY_MESSAGE,
    ERRS,
    EXACT,
    HELD,
    LATE,
    LOCAL,
    LOSS,
    ROUNDS,
    TRIM,
    W_MSR,
    H,
    agree,
    cell,
)
from tests.reference import Humming

NOISE = {"noise": Humming(size=2.5, pace=4.0, orders="all")}
OF_JETS = {"noise": Humming(size=2.5, pace=4.0, orders="lower")}


def cutting(what, threshold=3.0, **keys):
    """Keys of a test of distances [m] whose alarms cut."""
    return {"detector": {"kind": "distance", "threshold": threshold, "cuts": what, **keys}}


SOON = cutting("link", return_after=0.3)

# engine, law, order of the vehicles, channel, other keys
CELLS = {
    "messages that are also lost": ("exact", EXACT, 3, LOSS | NOISE, cutting("message") | ERRS),
    "messages, the last held": ("exact", EXACT, 2, NOISE | {"missing": "hold"}, cutting("message")),
    "links that return": ("exact", EXACT, 3, LOSS | NOISE | {"missing": "hold"}, SOON | W_MSR),
    "both ways, for ever": ("exact", EXACT, 3, {}, cutting("both_ways", 4.0) | W_MSR),
    "links, until a vehicle is cut off": ("exact", EXACT, 2, NOISE, cutting("link")),
    "late": ("exact", EXACT, 3, LATE | NOISE, cutting("message") | ERRS | W_MSR),
    "late by message": ("exact", EXACT, 3, BY_MESSAGE | NOISE | LOSS, SOON | ERRS | W_MSR),
    "local": ("exact", LOCAL, 2, OF_JETS, cutting("both_ways", return_after=0.3) | ERRS),
    "rounds": ("exact", ROUNDS, 3, LOSS | NOISE | {"quantisation": 0.2}, SOON | TRIM),
    "nonlinear": ("nonlinear", EXACT, 3, LOSS | NOISE, SOON | ERRS | W_MSR),
    "sampled": ({"kind": "sampled"}, HELD, 1, LOSS | OF_JETS, SOON | ERRS),
}
KALMAN = {"predicts": {"kind": "kalman", "unknown": 3.0}, "return_after": 0.4}
SUM = {"kind": "cusum", "drift": 4.5, "threshold": 4.0}
WINDOW = {"kind": "chi_squared", "false_alarms": 0.3, "window": 4}
WITH_MEMORY = {
    "window": ("exact", EXACT, 3, LOSS | NOISE, WINDOW | {"cuts": "message"}, ERRS),
    "sum": ("nonlinear", LOCAL, 2, LOSS | OF_JETS, SUM | {"cuts": "link", "return_after": 0.4}, {}),
    "filter": ("exact", EXACT, 2, LOSS | NOISE, SUM | KALMAN | {"cuts": "both_ways"}, ERRS | W_MSR),
    "filter, late": ("exact", ROUNDS, 3, LATE | NOISE, WINDOW | KALMAN | {"cuts": "link"}, TRIM),
}
CELLS |= {name: (*c[:4], {"detector": c[4]} | c[5]) for name, c in WITH_MEMORY.items()}
SHORT = {"filter", "messages that are also lost"}


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=[pytest.mark.long] * (each not in SHORT)) for each in CELLS]
)
def test_alarms_act_as_in_the_plain_fleet(name):
    """Places to 1e-7 m; in the exact engine all jets."""
    fleet = agree(cell(*CELLS[name]), CELLS[name][0], H)
    assert fleet.alarms > 1
    assert (fleet.fails_at is not None) == ("cut off" in name)


RING = {
    "engine": "exact",
    "vehicles": 6,
    "defence": "none",
    "attack": {"kind": "bias", "magnitude": 5.0, "vehicles": [3]},
    "detector": {"kind": "distance", "threshold": 1.0},
    "horizon": 5.0,
    "tail": 1.0,
}


def outcome(**keys):
    return systems.outcome(2, **{**RING, **keys})


EDGES = [[i, i - 1, 1.0 + i] for i in range(1, 7)] + [[i, i % 6 + 1, 2.0] for i in range(1, 7)]


ITSELF = [[i, i, 0.5 * i] for i in range(1, 7)]
NETWORKS = {
    "exact": ("exact", {"edges": EDGES}),
    "a weight on itself": ("local", {"edges": EDGES + ITSELF}),
    "weights as they are": ("local", {"edges": EDGES, "normalised": False}),
}


@pytest.mark.parametrize(
    "name", ["exact", *[pytest.param(each, marks=pytest.mark.long) for each in [*NETWORKS][1:]]]
)
def test_a_cut_link_leaves_the_network_without_it(name):
    """The bias is seen at 0 s. The strength of local rows changes, too."""
    law, network = NETWORKS[name]
    keys = {"law": law, "vehicle": "single_integrator"}
    cut = {"detector": RING["detector"] | {"cuts": "link"}}
    less = [each for each in network["edges"] if each[:2] not in ([2, 3], [4, 3])]
    found, expected, never = (
        outcome(**keys, **one, topology={"kind": "edges", **network, **edges}).series["state"]
        for one, edges in ((cut, {}), (cut, {"edges": less}), ({}, {}))
    )
    np.testing.assert_allclose(found, expected, atol=1e-11)
    assert abs(never - found).max() > 1
