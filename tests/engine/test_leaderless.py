"""Leaderless fleets: agreement and safety under W-MSR, by a plain program and published graphs."""

import json
from pathlib import Path

import numpy as np
import pytest

import jaxnet
from jaxnet.view.text.check import check_text
from tests import systems

PUBLISHED = Path(__file__).parents[1] / "theory" / "published_robustness.json"
GRAPHS = {each["name"]: each for each in json.loads(PUBLISHED.read_text())}
KEYS = {**systems.AGENTS, "gain": [8.0], "tick": 0.1}
KEYS |= {"engine": "exact", "output_step": 0.1, "metrics": ["spread", "outside"], "tail": 0.0}
KEYS |= {"save": {"trajectories": "all"}}


def edges_of(name):
    """The edges of a published graph."""
    return {"kind": "edges", "edges": [[i, j, 1.0] for i, j in GRAPHS[name]["hears"]]}


def simulated(**keys):
    """Results of a fleet without navigator."""
    return jaxnet.simulate(KEYS | keys, progress=False)


def honest_paths(results, liar, sample=0):
    """Positions of the vehicles that are not attacked, (times, vehicles, 2)."""
    states = results.trajectories["states"].sel(cell=0, sample=sample).values
    return np.delete(states, liar - 1, axis=1)


def test_the_way_outside_the_hull_is_measured_along_half_planes():
    """A liar that everybody believes draws the fleet out of the hull of its starts."""
    attack = {"kind": "bias", "magnitude": 500.0, "vehicles": [1]}
    results = simulated(
        topology=edges_of("oddi Test_6"), attack=attack, defence="none", horizon=20.0
    )
    honest = honest_paths(results, 1)
    angles = np.linspace(0, 2 * np.pi, 3601)
    along = honest @ np.stack([np.cos(angles), np.sin(angles)])
    exact = (along - along[0].max(axis=0)).max(axis=(0, 1)).max()
    assert exact > 100
    assert exact * (1 - 0.0013) <= results.lanes["outside"].iloc[0] <= exact + 1e-9


def test_rows_measure_agreement_where_some_cell_has_no_navigator():
    """Without being asked, behind the metrics of the study; a stored study has the same columns."""
    bare = {key: value for key, value in KEYS.items() if key != "metrics"}

    def own(**keys):
        config = jaxnet.load(bare | keys).config
        assert jaxnet.load(jaxnet.load(bare | keys)).config == config
        return [metric.name for metric in config.metrics]

    assert own() == ["spread", "outside"]
    assert own(metrics=["outside", "min_separation"]) == ["outside", "min_separation", "spread"]
    assert own(navigator="lissajous") == []
    assert own(sweep={"navigator": ["lissajous", "none"]}) == ["spread", "outside"]
    assert own(sweep={"navigator": ["lissajous"]}) == []
    search = {"over": {"attack.phase": "each"}}
    rotating = {"attack": {"kind": "rotating", "vehicles": [1]}}
    assert jaxnet.load(bare | rotating | {"search": search}).config.search.maximise == "spread"
    chosen = bare | rotating | {"search": search | {"maximise": "tail_max"}}
    assert jaxnet.load(chosen).config.search.maximise == "tail_max"


def test_a_law_that_asks_for_a_navigator_is_refused_and_check_says_what_is_known():
    """L is singular without a navigator; a lattice of six neighbours is 3-robust."""
    with pytest.raises(jaxnet.ConfigError, match="the law has no solution: give law: local"):
        jaxnet.load(KEYS | {"law": "exact"})
    lattice = {"topology": {"kind": "lattice", "neighbours": 6}, "vehicles": 9, "attack": "none"}
    text = " ".join(check_text(jaxnet.load(KEYS | lattice | {"defence": "w_msr"})).split())
    assert "9 vehicles, 54 links: 1-9 hear 6 sources" in text
    assert "law stable, deviations times" in text
    assert "guarantee honest vehicles agree, on each axis inside the range of" in text
    assert "the vehicles are (2, 2)-robust" in text
    assert "nothing is proved" not in text


def test_a_link_that_is_replaced_carries_the_signal_alone():
    """One step of a plain program, with a liar that is drawn."""
    attack = {"kind": "bias", "magnitude": 7.0, "threat": "replaces", "vehicles": {"random": 1}}
    results = simulated(
        topology=edges_of("jia 10 union"), attack=attack, defence="none", horizon=0.1
    )
    states, signal = (
        results.trajectories[name].sel(cell=0, sample=0).values for name in ("states", "attack")
    )
    hears = np.zeros((10, 10))
    for i, j in GRAPHS["jia 10 union"]["hears"]:
        hears[i - 1, j - 1] = 1.0
    sent = np.where(signal[0].any(axis=1)[:, None], signal[0], states[0])
    wanted = states[0] + 0.8 * (hears @ sent / hears.sum(axis=1, keepdims=True) - states[0])
    assert signal[0].any()
    np.testing.assert_allclose(states[1], wanted, rtol=0, atol=1e-12)
