"""Agreement under W-MSR without a navigator: one answer, and lanes that keep to it."""

import numpy as np
import pytest

import jaxnet
from jaxnet.view.text.facts import facts
from tests import systems

LIARS = {"kind": "sinusoid", "magnitude": 50.0, "frequency": 0.7, "vehicles": [2]}
OWN_PATH = {"kind": "own_path", "vehicles": {"random": 1}, "moves": "as_told"}
ALL = {"vehicle": "single_integrator", "law": "local", "gain": [1.0], "navigator": "none"}
ALL |= {"engine": "exact", "vehicles": 7, "topology": "complete", "defence": "w_msr"}
ALL |= {"attack": LIARS}
AGREE = "honest vehicles agree, on each axis inside the range of their starts"
F2 = {"kind": "w_msr", "F": 2}


def guarantee(**keys):
    (cell,) = systems.study(**{**ALL, **keys}).cells
    found = facts(cell.scenario, 2.0)
    assert "safe" not in found  # one answer
    return found["guarantee"]


PROVED = [
    ({}, "1 attacked, at most 1 of them heard by one vehicle, and F = 1; the vehicles are (2, 2)"),
    pytest.param(
        {"attack": LIARS | {"vehicles": [2, 5, 7]}, "vehicles": 9, "defence": F2 | {"F": 3}},
        "(4, 4)",
        marks=pytest.mark.long,
    ),
    ({"attack": "none"}, "0 attacked"),
    pytest.param(
        {"attack": LIARS | {"threat": "replaces", "moves": "as_told"}},
        "(2, 2)",
        marks=pytest.mark.long,  # short: tests/kinds/attacks/test_moves.py
    ),
]
# Two liars with F = 1 that no vehicle hears both: a ring in which each vehicle hears six others
SPARSE = {"kind": "circulant", "offsets": [-3, -2, -1, 1, 2, 3]}
FAR = {"vehicles": 20, "topology": SPARSE, "attack": LIARS | {"vehicles": [1, 11]}}
PROVED += [pytest.param(FAR, "3-rob", marks=pytest.mark.long)]


@pytest.mark.parametrize(("keys", "words"), PROVED)
def test_all_premises_hold_and_lanes_agree_inside_the_range(keys, words):
    told = guarantee(**keys)
    assert told.startswith(AGREE)
    assert words in told
    study = systems.study(**{**ALL, **keys, "horizon": 60.0, "tail": 0.0})
    places = systems.simulate(systems.lanes(study, 5)).series["state"]
    places = np.delete(places, [n - 1 for n in study.config.attack.targets()], axis=2)
    low, high = places[:, :1].min(axis=2), places[:, :1].max(axis=2)
    assert (places >= low[:, :, None] - 1e-9).all()
    assert (places <= high[:, :, None] + 1e-9).all()
    assert np.ptp(places[:, -1], axis=1).max() < 1.0  # from some 300 m


def test_as_many_liars_as_are_drawn_count():
    told = guarantee(attack=LIARS | {"vehicles": {"random": 2}}, defence=F2)
    assert "2 attacked, whichever are drawn, at most 2 of them heard by one vehicle" in told


@pytest.mark.long  # short: liars that are listed, and drawn ones in tests/view/test_check.py
def test_liars_that_replace_what_they_send_may_be_drawn():
    """Proved for any of them, and so it is in each lane, whichever vehicle lies there."""
    keys = ALL | {"attack": OWN_PATH, "horizon": 60.0, "tail": 1.0, "samples": 10}
    assert guarantee(**keys).startswith(AGREE)
    found = jaxnet.simulate(keys, progress=False)
    assert found.lanes["outside"].max() < 1e-8
    assert found.lanes["spread"].max() < 1.0  # from some 300 m


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"law": {"kind": "local", "hold": False}}, "the law is not local with hold: true"),
        ({"vehicle": "double_integrator", "gain": [1.0, 2.0]}, "the order of the vehicles is 2"),
        ({"gain": [20.0]}, "is not below 1"),
        ({"gain": [{"uniform": [0.5, 1.0]}]}, "drawn for each lane"),
        ({"defence": {"kind": "w_msr", "trusted": {1: [3]}}}, "the defence trusts vehicles"),
        ({"defence": {"kind": "w_msr", "noise": 0.1}}, "or has noise"),
        ({"attack": LIARS | {"listeners": "each"}}, "does not send all listeners the same"),
        ({"attack": LIARS | {"sybils": 1}}, "several identities"),
        ({"channel": {"loss": {"kind": "bernoulli", "probability": 0.1}}}, "messages are lost"),
        ({"attack": LIARS | {"vehicles": [2, 5]}}, "2 attacked, at most 2 of them heard"),
        ({"topology": "cyclic"}, "the vehicles are neither ("),
        ({"defence": {"kind": "w_msr", "F": 4}}, "are neither (5, 5)-robust nor 9-robust"),
        ({"vehicles": 201, "topology": "cyclic"}, "was not examined"),
    ],
)
def test_a_premise_that_fails_is_named(keys, words):
    told = guarantee(**keys)
    assert told.startswith("none is proved; ")
    assert words in told


def test_the_published_network_is_robust_enough_whoever_lies():
    study = jaxnet.load("configs/published/leblanc_2013.yaml")
    told = {facts(cell.scenario, 2.0)["guarantee"] for cell in study.cells}
    assert len(told) <= 2  # where nobody hears the liar's lie twice
    assert all(each.startswith(AGREE) and "(2, 2)-robust" in each for each in told)


def test_with_a_navigator_or_another_defence_nothing_of_this_is_said():
    for keys in ({"defence": "centerpoint"}, {"navigator": "lissajous", "law": "exact"}):
        (cell,) = systems.study(**{**ALL, **keys}).cells
        assert AGREE not in facts(cell.scenario, 2.0)["guarantee"]
