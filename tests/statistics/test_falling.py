"""Tails that still fall: the engines' windows against stored errors, and the test on the falls."""

import shutil

import numpy as np
import pandas as pd
import pytest
import yaml

import jaxnet
from jaxnet.statistics import fits
from jaxnet.statistics.falling import falling_words, longer_tail, still_falls, unseen_period
from jaxnet.view.text.slopes import fit_text
from jaxnet.view.text.tables import summary_text
from tests import systems

LEAST = 1e-8  # [m], of errors that count
OUTPUTS, TAIL = 301, 51  # with and without the tail, as by default
TIME = np.arange(OUTPUTS) * 0.1


def falls(errors, tail=TAIL):
    """How far the last half of a tail is below each window before it, from (lanes, times)."""
    size, last = max(1, tail // 2), errors.shape[1]
    starts = range(last % size, last, size)
    sums = np.stack([errors[:, start : start + size].sum(axis=1) for start in starts])
    least = sums[:-1].min(axis=0)
    most = np.maximum(least, sums[-1])
    return (least - sums[-1]) / np.where(most > 0, most, 1.0)


def mark(errors):
    return still_falls(falls(errors), errors[:, -TAIL:].mean(axis=1), LEAST)


@pytest.mark.parametrize("engine", ["exact", pytest.param("nonlinear", marks=pytest.mark.long)])
@pytest.mark.parametrize("tail", [0.0, 1.0, 5.0])
def test_rows_have_the_fall_of_the_stored_errors(engine, tail):
    keys = {"engine": engine, "horizon": 12.0, "tail": tail, "attack": {"vehicles": [2, 7]}}
    outcome = systems.outcome(3, **keys)
    known = falls(outcome.series["tracking"], round(10 * tail) + 1)
    np.testing.assert_allclose(outcome.tail_fall, known, rtol=1e-6, atol=1e-9)


def test_without_a_navigator_the_farthest_honest_vehicle_counts():
    keys = {"navigator": "none", "law": "local", "vehicle": "single_integrator", "tail": 2.0}
    keys |= {"engine": "exact", "horizon": 6.0, "defence": "none", "attack": {"vehicles": [2]}}
    outcome = systems.outcome(3, **keys)
    places, honest = outcome.series["state"][..., :2], np.arange(12) != 1
    apart = places[:, :, honest] - places[:, :, honest].mean(axis=2, keepdims=True)
    known = falls(np.linalg.norm(apart, axis=-1).max(axis=2), 21)
    np.testing.assert_allclose(outcome.tail_fall, known, rtol=1e-6)


def noise(random, lanes):
    return np.abs(1.0 + 0.5 * random.normal(size=(lanes, OUTPUTS)))


def slow_noise(random, lanes):
    """Sums of noise over two seconds: halves of a tail differ much."""
    each = random.normal(size=(lanes, OUTPUTS + 20)).cumsum(axis=1)
    return np.abs(each[:, 20:] - each[:, :-20])


def swinging(random, lanes, period, shared=False):
    """A sinusoid's size, by lane or with one phase for all: the period divides no tail."""
    phase = random.uniform(0, 2 * np.pi, (1 if shared else lanes, 1))
    return np.abs(np.sin(2 * np.pi * TIME / period + phase)) * random.uniform(1, 2, (lanes, 1))


def after_a_start(errors, random, lanes):
    """The same with an exponential start."""
    return errors(random, lanes) + 200.0 * np.exp(-TIME)


SETTLED = {
    "constant": lambda random, lanes: np.ones((lanes, OUTPUTS)),
    "zeros": lambda random, lanes: np.zeros((lanes, OUTPUTS)),
    "noise": noise,
    "slow noise": slow_noise,
    "noise after a start": lambda random, lanes: after_a_start(noise, random, lanes),
    "period of 3.1 s": lambda random, lanes: swinging(random, lanes, 3.1),
    "period of 9 s": lambda random, lanes: swinging(random, lanes, 9.0),
    "one phase, 3.1 s": lambda random, lanes: swinging(random, lanes, 3.1, shared=True),
    "one phase, 9 s": lambda random, lanes: swinging(random, lanes, 9.0, shared=True),
    "one phase, 20 s": lambda random, lanes: swinging(random, lanes, 20.0, shared=True),
}


@pytest.mark.parametrize("lanes", [1, 5, 20, 200])
@pytest.mark.parametrize("name", SETTLED)
def test_a_cell_that_has_settled_is_marked_once_in_twenty_times_at_most(name, lanes):
    """Cells of too few lanes to tell are among the marked ones."""
    random = np.random.default_rng(0)
    marked = sum(mark(SETTLED[name](random, lanes)) != 0 for _ in range(200))
    assert marked <= 10


@pytest.mark.parametrize("lanes", [1, 6, 7, 200])
@pytest.mark.parametrize("rate", [0.1, 1.0])
def test_a_decay_is_marked_until_it_is_below_what_counts(lanes, rate):
    """Six lanes at most are too few for a test at 1 %: 2⁻⁶ > 1 %."""
    errors = np.random.default_rng(0).uniform(1e6, 2e6, (lanes, 1)) * np.exp(-rate * TIME)
    np.testing.assert_equal(mark(errors), np.nan if lanes < 7 else 1.0)
    assert mark(1e-15 * errors) == 0


@pytest.mark.parametrize("stuck", [0, 3, 200])
def test_lanes_that_have_not_recovered_yet_mark_a_cell_beside_any_number_of_stuck_ones(stuck):
    """Stuck lanes, whose error the attack keeps up, change by less than a fifth."""
    random = np.random.default_rng(0)
    rest = random.uniform(1, 2, (stuck, 1)) * (1 + 0.02 * random.normal(size=(stuck, OUTPUTS)))
    decay = 1e3 * np.exp(-0.5 * TIME)[None]
    for slow, known in ((7, 1.0), (30, 1.0), (1, np.nan if stuck < 6 else 0.0)):
        errors = np.concatenate([np.zeros((200, OUTPUTS)), rest, decay.repeat(slow, 0)])
        np.testing.assert_equal(mark(errors), known)


@pytest.mark.parametrize("lanes", [3, 30])
def test_what_grows_or_falls_by_little_is_not_marked(lanes):
    assert mark(np.exp(0.3 * TIME)[None].repeat(lanes, 0)) == 0
    assert mark(1.0 + np.exp(-0.5 * TIME)[None].repeat(lanes, 0)) == 0


@pytest.mark.parametrize(
    ("attack", "tail", "period"),
    [
        ({"kind": "own_path", "frequency": 0.4}, 5.0, 5 * np.pi),
        ({"kind": "own_path", "frequency": 0.4}, 16.0, 0.0),  # the tail holds it
        ({"kind": "own_path", "frequency": {"uniform": [0.4, 0.8]}}, 5.0, 5 * np.pi),
        ({"kind": "own_path", "frequency": -0.4}, 5.0, 5 * np.pi),
        ({"kind": "own_path", "frequency": 0.0}, 5.0, 0.0),
        ({"kind": "sinusoid", "frequency": 0.4}, 5.0, 0.0),  # each lane has a phase
        ({"kind": "sinusoid", "frequency": 0.4, "phase": 1.0}, 5.0, 5 * np.pi),
        ({"kind": "sinusoid", "frequency": 0.4, "phase": [0.0, 1.0]}, 5.0, 5 * np.pi),
        ({"kind": "sinusoid", "frequency": [0.4, 0.2], "phase": 1.0}, 5.0, 10 * np.pi),
        ({"kind": "chirp", "phase": 0.0}, 5.0, 0.0),
        ({"kind": "bias"}, 5.0, 0.0),
    ],
)
def test_a_period_is_beyond_the_tail_if_lanes_share_the_phase(attack, tail, period):
    study = jaxnet.load({"name": "s", "tail": tail, "attack": {"vehicles": [2, 7], **attack}})
    assert unseen_period(study.cells[0].scenario) == pytest.approx(period)


# --- results -------------------------------------------------------------------------------------

SHORT = {"name": "short", "horizon": 15.0, "engine": "exact", "defence": "trusted_only"}
SHORT |= {"recovery": {"tau": 0.01}, "sweep": {"attack.magnitude": [0.1, 1.0, 100.0]}}
TOLD = "n cells 0, 1 of 3: errors still fall when the run ends. Try a longer run:"


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A fleet that is safe by trust, cut off while it settles."""
    return jaxnet.run(
        SHORT | {"samples": 20}, tmp_path_factory.mktemp("short") / "s", progress=False
    )


def one_line(text):
    return " ".join(text.split())


def test_a_transient_is_told_wherever_results_are(short, undrawn, monkeypatch):
    """Tables, fits, figures and the page; the last cell's errors are below its threshold."""
    assert short.cells["unrecovered"].tolist() == [1, 1, 0]
    assert short.cells["falling"].tolist() == [1, 1, 0]
    assert f"{TOLD} horizon: 45" in one_line(summary_text(short))
    monkeypatch.setattr(fits, "RESAMPLES", 2)  # the intervals are tested elsewhere
    short.fit()
    assert TOLD in one_line(fit_text(short))
    for figure in (short.plot.curve(), short.plot.tails(), short.plot.ultimate()):
        assert "in ā = 0.1 and 1 m: errors still fall" in one_line(figure.get_supxlabel())
    page = short.report(replay=False).read_text()
    assert page.count("still fall when the run ends") == 1  # in the findings, not again below


def test_a_share_that_falls_as_the_attack_grows_is_told_wherever_results_are(
    short, undrawn, monkeypatch
):
    """A transient is over τ ā at 0.1 m and 1 m, and not at 100 m, whatever the attack does."""
    told = "the share unrecovered falls as ā grows in cells 0-2"
    assert told in one_line(summary_text(short))
    monkeypatch.setattr(fits, "RESAMPLES", 2)
    short.fit()
    assert told in one_line(fit_text(short))
    assert told[1:] in short.report(replay=False).read_text()


SWINGS = {"name": "agree", "vehicles": 9, "vehicle": "single_integrator", "navigator": "none"}
SWINGS |= {"law": "local", "engine": "exact", "horizon": 60.0, "tail": 5.0, "output_step": 0.5}
SWINGS |= {"topology": {"kind": "random_regular", "degree": 6}, "defence": "none"}
SWINGS |= {"attack": {"kind": "own_path", "vehicles": [4], "swing": [3.0, 1.0], "frequency": 0.4}}
SWINGS["attack"] |= {"magnitude": 3.0, "moves": "as_told"}
SWINGS |= {"initial": {"position": {"uniform": [-5.0, 5.0]}}, "recovery": {"tau": 0.02}}


def test_a_swing_with_one_phase_is_not_told_to_fall():
    """Spreads of all lanes swing with the attack; a tail of a period sees that they do not fall."""
    short = jaxnet.simulate(SWINGS, 40, progress=False)
    told = one_line(falling_words(short, short.study.cells))
    assert np.isnan(short.cells["falling"]).all()
    assert told == (
        "in all cells: the tail (5 s) is shorter than the period of the attack (15.7 s), so spreads"
        " may fall or swing. Try tail: 20"
    )
    late = jaxnet.load(SWINGS | {"navigator": "lissajous", "channel": {"delay": 0.1}})
    short.cells["falling"] = 1.0
    told = falling_words(short, late.cells)  # the attack's period is beyond the tail
    assert "messages are late" not in told
    slow = jaxnet.load(SWINGS | {"navigator": "lissajous", "channel": {"delay": 0.1}, "tail": 20.0})
    told = one_line(falling_words(short, slow.cells))
    assert "errors still fall when the run ends, or follow the speed of the navigator, as" in told
    long = jaxnet.simulate(SWINGS | {"tail": 20.0}, 40, progress=False)
    assert (long.cells["falling"] == 0).all()
    assert falling_words(long, long.study.cells) == ""


def test_a_tail_that_the_run_cannot_hold_needs_a_longer_run():
    slow = SWINGS["attack"] | {"frequency": 0.1}
    (cell,) = jaxnet.load(SWINGS | {"attack": slow}).cells
    assert longer_tail(unseen_period(cell.scenario), [cell]) == "tail: 70, horizon: 210"


def test_a_run_that_is_long_enough_is_not_marked():
    results = jaxnet.simulate({**SHORT, "horizon": 40.0}, 20, progress=False)
    assert results.cells["unrecovered"].tolist() == [0, 0, 0]
    assert "still fall" not in summary_text(results)


LATE = {"defence": "trusted_trim", "attack": {"magnitude": 0.1}, "recovery": {"tau": 0.01}}


@pytest.mark.parametrize(
    ("horizon", "marks"), [(23.0, (1.0, 1.0)), (30.0, (np.nan, np.nan)), (90.0, (0.0, 0.0))]
)
def test_few_lanes_whose_defence_settles_late_are_marked(horizon, marks):
    """At 30 s four lanes of 10 or 20 are unrecovered, at 90 s one, whose error does not fall."""
    for samples, marked in zip((10, 20), marks, strict=True):
        keys = {**LATE, "engine": "exact", "horizon": horizon}
        results = jaxnet.simulate(keys, samples, progress=False)
        np.testing.assert_equal(results.cells["falling"].tolist(), [marked])
        told = "errors may still fall, with too few lanes to tell"
        assert (told in one_line(summary_text(results))) is bool(np.isnan(marked))


def test_a_folder_without_the_column_opens_and_says_nothing(short, tmp_path):
    """Folders of earlier versions: no column in rows and tables."""
    old = tmp_path / "old"
    shutil.copytree(short.path, old)
    table = pd.read_csv(old / "cells.csv").drop(columns="falling")
    table.to_csv(old / "cells.csv", index=False)
    results = jaxnet.open(old)
    assert falling_words(results, results.study.cells) == ""
    assert "still fall" not in summary_text(results)
    assert results.plot.curve().axes
    assert yaml.safe_load((old / "study.yaml").read_text())["horizon"] == 15.0
