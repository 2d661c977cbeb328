"""Tails that still fall: the engines' windows against stored errors, and the test on the falls."""

import shutil

import numpy as np
import pandas as pd
import pytest
import yaml

import jaxnet
from jaxnet.statistics.falling import falling_cells, falling_words, still_falls
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


def is_marked(errors):
    return still_falls(falls(errors), errors[:, -TAIL:].mean(axis=1), LEAST)


@pytest.mark.parametrize("engine", ["exact", pytest.param("nonlinear", marks=pytest.mark.long)])
@pytest.mark.parametrize("tail", [0.0, 1.0, 5.0])
def test_rows_have_the_fall_of_the_stored_errors(engine, tail):
    keys = {"engine": engine, "horizon": 12.0, "tail": tail, "attack": {"vehicles": [2, 7]}}
    outcome = systems.simulate(systems.lanes(systems.study(**keys), 3))
    known = falls(outcome.series["tracking"], round(10 * tail) + 1)
    np.testing.assert_allclose(outcome.tail_fall, known, rtol=1e-6, atol=1e-9)


def test_without_a_navigator_the_farthest_honest_vehicle_counts():
    keys = {"navigator": "none", "law": "local", "vehicle": "single_integrator", "tail": 2.0}
    keys |= {"engine": "exact", "horizon": 6.0, "defence": "none", "attack": {"vehicles": [2]}}
    outcome = systems.simulate(systems.lanes(systems.study(**keys), 3))
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
    random = np.random.default_rng(0)
    marked = sum(is_marked(SETTLED[name](random, lanes)) for _ in range(200))
    assert marked <= 10


@pytest.mark.parametrize("lanes", [1, 6, 7, 200])
@pytest.mark.parametrize("rate", [0.1, 1.0])
def test_a_decay_is_marked_until_it_is_below_what_counts(lanes, rate):
    errors = np.random.default_rng(0).uniform(1e6, 2e6, (lanes, 1)) * np.exp(-rate * TIME)
    assert is_marked(errors)
    assert not is_marked(1e-15 * errors)


def test_slow_lanes_among_many_settled_ones_mark_a_cell_and_a_few_do_not():
    """What counts are the lanes that are not down yet, seven at least."""
    decay = 1e3 * np.exp(-0.5 * TIME)[None]
    for slow, marked in ((6, False), (7, True), (30, True)):
        assert (
            is_marked(np.concatenate([np.zeros((200, OUTPUTS)), decay.repeat(slow, 0)])) is marked
        )


@pytest.mark.parametrize("lanes", [3, 30])
def test_what_grows_or_falls_by_little_is_not_marked(lanes):
    assert not is_marked(np.exp(0.3 * TIME)[None].repeat(lanes, 0))
    assert not is_marked(1.0 + np.exp(-0.5 * TIME)[None].repeat(lanes, 0))


# --- results -------------------------------------------------------------------------------------

SHORT = {"name": "short", "horizon": 15.0, "engine": "exact", "defence": "trusted_only"}
SHORT |= {"recovery": {"tau": 0.01}, "sweep": {"attack.magnitude": [0.1, 1.0, 100.0]}}
TOLD = "2 of 3 cells (cells 0, 1) still fall when the run ends: their errors are not ultimate."


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A fleet that is safe by trust, cut off while it settles."""
    return jaxnet.run(
        SHORT | {"samples": 20}, tmp_path_factory.mktemp("short") / "s", progress=False
    )


def one_line(text):
    return " ".join(text.split())


def test_a_transient_is_told_wherever_results_are(short):
    """Tables, fits, figures and the page; the last cell's errors are below its threshold."""
    assert short.cells["unrecovered"].tolist() == [1, 1, 0]
    assert [cell.number for cell in falling_cells(short, short.study.cells)] == [0, 1]
    assert f"{TOLD} Longer: horizon: 45" in one_line(summary_text(short))
    short.fit()
    assert TOLD in one_line(fit_text(short))
    for figure in (short.plot.curve(), short.plot.tails(), short.plot.ultimate()):
        assert "cells 0, 1" in one_line(figure.get_suptitle())
    page = short.report(replay=False).read_text()
    assert page.count("still fall when the run ends") >= 2


def test_a_run_that_is_long_enough_is_not_marked():
    results = jaxnet.simulate({**SHORT, "horizon": 40.0}, 20, progress=False)
    assert results.cells["unrecovered"].tolist() == [0, 0, 0]
    assert "still fall" not in summary_text(results)


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
