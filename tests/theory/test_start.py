"""How a start dies away: against closed forms, and never below what engines simulate."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import jaxnet
from jaxnet.statistics.horizon import Ending, ending
from jaxnet.theory import start
from jaxnet.theory.case import Case
from jaxnet.theory.start import start_decay
from tests import systems

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))
CORNER, SPEED = 200 * np.sqrt(2), np.hypot(20.0, 20.0) + 0.4  # of the default start [m, m/s]
AXES = {"gain": [[1, 3, 3], [8, 12, 6]]}
COUPLED = {"gain": [[[1, 0.3], [-0.3, 1]], [[3, 0], [0, 3]], [[3, 0], [0, 3]]]}
APART = {"gain": {"vehicles": [[1, 3, 3], [8, 12, 6]] * 6}}


def known(**keys):
    (cell,) = systems.study(**{"attack": "none", "defence": "none"} | keys).cells
    return start_decay(Case(cell.scenario))


def triple_pole(t):
    """`Σ_k Φ_0k ‖E^(k)‖` of (s + 1)³ for the default starts; the navigator begins without ÿ."""
    return np.exp(-t) * ((1 + t + t**2 / 2) * CORNER + (t + t**2) * SPEED)


def three_poles(t):
    """The same of (s + 1)(s + 2)(s + 3), by its modes."""
    modes = np.array([[1, 1, 1], [-1, -2, -3], [1, 4, 9]])
    flows = np.exp(-np.outer(t, [1, 2, 3])) @ np.linalg.inv(modes)
    return np.abs(flows[:, :2]) @ [CORNER, SPEED]


def test_cells_with_the_same_gains_share_what_takes_long(monkeypatch):
    """Other attacks and networks ask for no new flow, other gains do."""
    made = []
    monkeypatch.setattr(start, "expm", lambda each: made.append(each) or expm(each))
    for gain in ([2.25, 1.5, 3.25], [2.25, 1.5, 3.75]):
        for keys in ({}, {"topology": "complete"}, {"attack": "sinusoid"}):
            known(gain=gain, **keys)
    assert len(made) == 2


@pytest.mark.parametrize(("gain", "form"), [([1, 3, 3], triple_pole), ([6, 11, 6], three_poles)])
def test_what_is_left_of_a_start_is_that_of_the_poles(gain, form):
    found = known(gain=gain)
    assert found.distance == pytest.approx(CORNER)
    exact = form(found.times)
    envelope = np.maximum.accumulate(exact[::-1])[::-1]
    np.testing.assert_allclose(found.left, envelope, rtol=1e-3, atol=1e-12 * CORNER)


def test_a_start_283_m_away_is_within_a_millimetre_after_18_s():
    found = known()
    assert found.after(1e-3) == pytest.approx(17.9, abs=0.05)
    assert triple_pole(found.after(1e-3)) <= 1e-3 < triple_pole(found.after(1e-3) - 0.02)
    assert found.after(1e9) == 0
    assert np.isinf(found.after(1e-300))


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {"gain": [8, 5, 2.6]},  # oscillates
        {"vehicle": "single_integrator"},
        {"vehicle": "look_ahead", "engine": "exact"},
        {"initial": {"position": [[3 * i, -40] for i in range(12)], "speed": 1.0}},
        *[
            pytest.param(keys, marks=pytest.mark.long)
            for keys in (
                {"topology": "path", "vehicles": 5},
                {"vehicle": "car"},
                *({**keys, "engine": "nonlinear"} for keys in (AXES, COUPLED, APART)),
            )
        ],
    ],
)
def test_no_lane_is_ever_farther_off(keys):
    study = {"engine": "exact", "horizon": 12.0, "attack": "none", "defence": "none"} | keys
    (cell,) = systems.study(**study).cells
    outcome = systems.outcome(4, **study)
    found = start_decay(Case(cell.scenario))
    states, path = outcome.series["state"], cell.scenario.navigator.jets(np.arange(121) * 0.1)[0]
    errors = np.linalg.norm(states[..., :2] - path.T[None, :, None], axis=-1).max(axis=(0, 2))
    if cell.scenario.vehicle.kind == "look_ahead":  # its output is ahead of its place
        errors = outcome.series["tracking"].max(axis=0)
    limit = np.interp(np.arange(121) * 0.1, found.times, found.left)
    assert (errors <= 1.001 * limit + 1e-6).all()


@pytest.mark.parametrize(
    "keys",
    [
        {"gain": [1, 3, {"uniform": [3, 4]}]},
        {"initial": {"position": {"normal": [0, 10]}}},
        {**APART, "defence": "trusted_trim"},
    ],
)
def test_nothing_is_told_without_a_bound(keys):
    assert known(**keys) is None


# --- configs --------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_config_is_long_enough_or_says_why_not(path):
    """Its tail begins when a start has died away below what is asked for; without simulating.

    Nobody lies before a start has died away, so one attack of each network and defence does.
    """
    study = jaxnet.load(path)
    cells = {}
    for cell in study.cells:
        others = [f"{key}: {each}" for key, each in cell.labels.items() if "attack" not in key]
        cells.setdefault(tuple(others), cell)
    found = [ending(cell, study.config) for cell in cells.values()]
    early = [each for each in found if isinstance(each, Ending) and each.after > each.begins]
    told = [line for line in path.read_text().splitlines() if "too short" in line]
    assert bool(early) == bool(told), early[:1]
