"""The share of lanes that defences do not save: its exact interval, and stopping once narrow."""

import functools

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import jaxnet
from experiments import stopping
from jaxnet.config import keys as config
from jaxnet.engine.methods.exact import Exact
from jaxnet.statistics import intervals, recovery, summary
from jaxnet.store.folder import Folder, FolderError
from tests import systems

pytestmark = pytest.mark.usefixtures("many_side_by_side")


def keys(**more):
    """A study in which a share of the lanes stays above its threshold, cheap to simulate."""
    return {
        "engine": "exact",
        "horizon": 2.0,
        "tail": 1.0,
        "output_step": 0.5,
        "defence": "none",
        "initial": {"position": {"uniform": [-50.0, 50.0]}},
        "sweep": {"attack.magnitude": [0, 30, 60]},
        "recovery": {"tau": 1.0},
        **more,
    }


def test_all_looks_together_err_no_more_than_one_may():
    """The errors of the first n looks sum to what is allowed, but for the n-th part."""
    errors = [1 - recovery.confidence_at(look, 0.95) for look in range(1, 1000)]
    assert sum(errors) == pytest.approx(0.05 * (1 - 1 / 1000))
    assert errors[0] == pytest.approx(0.025)


def test_counts():
    """By hand: over τ ā, and no share where nobody is attacked."""
    study = jaxnet.load({"sweep": {"attack.magnitude": [0, 2]}, "recovery": {"tau": 0.01}})
    lanes = pd.DataFrame({"tail_mean": [0.021, 0.02, 0.5]})
    unrecovered = summary.LANE_SHARES["unrecovered"]
    assert unrecovered.which(study.config, study.cells[0], lanes) is None
    counted = unrecovered.which(study.config, study.cells[1], lanes)
    assert counted.tolist() == [True, False, True]
    assert summary.share_estimate(counted, 0.95)[0] == pytest.approx(2 / 3)
    assert np.isnan(summary.share_estimate(counted[:0], 0.95)).all()


def test_only_shares_that_surely_fall_as_the_attack_grows_are_told(tmp_path, monkeypatch):
    """By hand: intervals that touch, a share that rises, and other defences tell nothing."""
    sweep = {"defence": ["none", "w_msr"], "attack.magnitude": [3, 0, 1]}
    results = jaxnet.run(systems.study(samples=1, **keys(sweep=sweep)), tmp_path / "out")

    def told(intervals):
        table = pd.DataFrame(intervals, columns=["unrecovered_low", "unrecovered_high"])
        table = table.assign(unrecovered=table.mean(axis=1))
        monkeypatch.setattr(recovery, "unrecovered_shares", lambda _: table.dropna())
        return recovery.lowered_words(results, results.study.cells)

    none = (np.nan, np.nan)
    for low, high in ((0.0, 0.5), (0.2, 0.6), (0.6, 1.0), none):
        other = (0.0, 0.1) if high != high else (low, high)
        assert told([(low, high), none, (0.1, 0.5), other, none, (0.0, 0.05)]) == ""
    rest = [(0.5, 0.6), none, (0.4, 0.5)]
    words = told([(0.0, 0.2), none, (0.5, 0.9), *rest])
    assert "falls as ā grows in cells 0, 2. The threshold" in words
    assert "The threshold of 1\N{NO-BREAK SPACE}ā grows with ā" in words
    monkeypatch.setattr(recovery, "mostly_failed", lambda _: [2])
    assert told([(0.0, 0.2), none, (0.5, 0.9), *rest]) == ""


def test_the_table_has_the_shares(tmp_path):
    """Counted from the rows, with the exact interval; nothing where nobody is attacked."""
    results = jaxnet.run(systems.study(samples=40, **keys()), tmp_path / "out")
    rows, cells = results.lanes, results.cells
    over = rows[rows["tail_mean"] > rows["attack.magnitude"]].groupby("cell").size()
    assert 0 < over[1] < 40
    assert cells["unrecovered"][1] == over[1] / 40
    exact = stats.binomtest(int(over[1]), 40).proportion_ci(0.95, method="exact")
    assert cells["unrecovered_low"][1] == pytest.approx(exact.low)
    assert cells["unrecovered_high"][1] == pytest.approx(exact.high)
    assert cells.filter(like="unrecovered").loc[0].isna().all()


def test_the_worst_lanes_are_of_all_groups():
    """The worst per ā of each group first, the greater before; then the second of each."""
    cells = jaxnet.load(
        {"sweep": {"topology": ["star", "path"], "attack.magnitude": [1, 10]}}
    ).cells
    rows = pd.DataFrame(
        {
            "cell": [0, 0, 1, 1, 2, 3],
            "sample": [0, 1, 0, 1, 0, 0],
            "tail_mean": [0.7, 0.8, 9.0, 1.0, 0.1, 2.0],
        }
    )
    assert recovery.worst_lanes(rows, cells, 3) == [(1, 0), (3, 0), (0, 1)]
    assert recovery.worst_lanes(rows, cells, 9) == [(1, 0), (3, 0), (0, 1), (2, 0), (0, 0), (1, 1)]


def test_of_equal_lanes_the_lowest_sample_is_the_worst():
    """Rounding does not choose: 2e-16 more is not worse; 1e-3 is."""
    errors = [0.1, 1.0, np.nextafter(1.0, 2.0), 0.999]
    lanes = pd.DataFrame({"sample": [0, 1, 2, 3], "error": errors})
    assert recovery.worst_first(lanes, "error")["sample"].tolist() == [1, 2, 3, 0]
    zeros = lanes.assign(error=[0.0, 1e-13, 3e-12, 0.0])
    assert recovery.worst_first(zeros, "error")["sample"].tolist() == [0, 1, 2, 3]
    assert recovery.worst_first(lanes.iloc[:0], "error").empty


@pytest.fixture
def small_shards(monkeypatch):
    """Shards of 60 lanes and looks from 50 on, so that some end within a shard."""
    monkeypatch.setattr(Exact, "shard", 60)
    monkeypatch.setattr(recovery, "FIRST_LOOK", 50)


def until(half_width, at_most=1000):
    """A criterion as a config has it."""
    return {"until": {"half_width": half_width, "of": "unrecovered", "at_most": at_most}}


LOOKS = [50, 75, 113, 169, 254, 380, 570]  # each half as many more


def test_a_cell_stops_when_its_interval_is_narrow_enough(tmp_path, small_shards):
    """Each cell at the first look that meets the criterion; rows are those of any run."""
    given = {**keys(), "sweep": {"attack.magnitude": [0.0, 60.0, 40.0]}, "save": {"errors": True}}
    results = jaxnet.run(systems.study(samples=until(0.1), **given), tmp_path / "until")
    samples = results.samples
    assert results.cells["lanes"].tolist() == samples == results.manifest["cell_samples"]
    assert results.manifest["samples"] == max(samples)
    assert samples[0] == 50  # nothing is asked of a cell without an attack
    assert len({*samples}) == 3
    fixed = jaxnet.run(systems.study(samples=max(samples), **given), tmp_path / "fixed")
    assert fixed.samples == [max(samples)] * 3
    kept = fixed.lanes[fixed.lanes["sample"] < np.array(samples)[fixed.lanes["cell"]]]
    pd.testing.assert_frame_equal(results.lanes, kept.reset_index(drop=True), check_exact=True)
    for cell in (1, 2):
        rows, looks = fixed.lanes[fixed.lanes["cell"] == cell], LOOKS.index(samples[cell]) + 1
        over = (rows["tail_mean"] > rows["attack.magnitude"]).to_numpy()
        ends = [
            stats.binomtest(int(over[:first].sum()), first).proportion_ci(
                1 - 0.05 / (look * (look + 1))
            )
            for look, first in enumerate(LOOKS[:looks], 1)
        ]
        assert [(end.high - end.low) / 2 <= 0.1 for end in ends] == [False] * (looks - 1) + [True]
        told = results.cells.loc[cell, ["unrecovered_low", "unrecovered_high"]].tolist()
        assert told == pytest.approx([*ends[-1]])
    stored, there = results.errors["tracking"], np.array(samples)[:, None] > np.arange(max(samples))
    assert np.array_equal(~np.isnan(stored.values).any(axis=2), there)
    assert jaxnet.open(results.path).row(0, samples[0]) is None
    with pytest.raises(FolderError, match=f"samples 0 to {samples[0] - 1} "):
        results.replay(0, samples[0])


def test_it_goes_on_where_it_was_and_ends_at_the_most_allowed(tmp_path, small_shards):
    """A narrower interval extends the run; one that is too narrow ends at the most allowed."""
    first = jaxnet.run(systems.study(samples=until(0.2), **keys()), tmp_path / "out")
    few, before = first.samples, first.lanes
    again = jaxnet.run(systems.study(samples=until(0.2), **keys()), tmp_path / "out")
    assert again.samples == few
    more = jaxnet.run(systems.study(samples=until(0.01, at_most=340), **keys()), tmp_path / "out")
    assert more.samples[1:] == [340, 340] > few[1:]
    rows = more.lanes
    kept = rows[rows["sample"] < np.array(few)[rows["cell"]]].reset_index(drop=True)
    pd.testing.assert_frame_equal(kept, before, check_exact=True)
    wider = jaxnet.run(systems.study(samples=until(0.2), **keys()), tmp_path / "out")
    assert (wider.samples, len(wider.lanes)) == (more.samples, sum(more.samples))
    with pytest.warns(UserWarning, match="begun with samples: 340, and keeps them"):
        fixed = jaxnet.run(systems.study(samples=10, **keys()), tmp_path / "out")
    assert fixed.samples == [340] * 3


def test_a_run_cut_off_in_the_midst_of_a_look_ends_like_any_other(tmp_path, small_shards):
    """Also where only some cells have their shard of the last look."""
    whole = jaxnet.run(systems.study(samples=until(0.1), **keys()), tmp_path / "out")
    rows, samples = whole.lanes, whole.samples
    sorted((whole.path / "lanes").glob("*.parquet"))[-1].unlink()
    Folder(whole.path).write_manifest(finished=False)
    (whole.path / "cells.csv").unlink()
    with pytest.raises(FolderError, match="unfinished run"):
        _ = jaxnet.open(whole.path).cells
    again = jaxnet.run(systems.study(samples=until(0.1), **keys()), tmp_path / "out")
    assert again.samples == samples
    pd.testing.assert_frame_equal(again.lanes, rows, check_exact=True)


def test_no_two_looks_share_their_part_of_the_error():
    """Whatever runs follow in a folder, each allowing more: parts sum to at most the error."""
    assert list(recovery.looks(0, 2000)) == [256, 384, 576, 864, 1296, 1944, 2000]
    assert list(recovery.looks(384, 800)) == [384, 576, 800]
    assert list(recovery.looks(0, 100)) == [100]
    assert list(recovery.looks(1000, 900)) == [1000]
    random = np.random.default_rng(0)
    for _ in range(200):
        there, looked = 0, set[int]()
        for at_most in np.cumsum(random.integers(1, 700, 12)).tolist():
            planned = list(recovery.looks(there, at_most))
            there = planned[random.integers(len(planned))]  # it was narrow enough there
            looked.update(each for each in planned if each <= there)
        parts = [1 - recovery.confidence_at(recovery.look_of(samples), 0.95) for samples in looked]
        assert len({recovery.look_of(samples) for samples in looked}) == len(looked)
        assert sum(parts) <= 0.05


@pytest.mark.parametrize(
    "share", [0.03, *(pytest.param(p, marks=pytest.mark.long) for p in (0.001, 0.5))]
)
def test_the_last_interval_of_a_run_covers(share):
    """1,000 runs, one after another as in `Run`, on lanes of a known failure probability."""
    random, half_width = np.random.default_rng(1), 0.3 * share if share < 0.5 else 0.02
    cells, held = jaxnet.load({}).cells, 0
    criterion = config.Criterion(half_width=half_width)

    @functools.cache  # for few counts are ever new
    def widest(failed, ended):
        counts = recovery.RecoveryCounts(np.array([failed]), np.array([ended]))
        return recovery.half_intervals(counts, cells, [ended], criterion)[0]

    for _ in range(1000):
        failed = ended = 0
        for samples in recovery.looks(0, 100_000):
            failed += random.binomial(samples - ended, share)
            ended = samples
            if widest(failed, ended) <= half_width:
                break
        confidence = recovery.confidence_of(config.Sequential(until=criterion), ended)
        low, high = intervals.clopper_pearson(np.array([failed]), np.array([ended]), confidence)
        held += bool(low[0] <= share <= high[0])
    assert held >= 0.95 * 1000


@pytest.mark.long
def test_intervals_for_one_look_do_not_survive_many():
    """Of 1,000 runs, every interval that is looked at on the way has to hold."""
    honest, naive = (
        stopping.coverage(0.05, 1000, at) for at in (recovery.confidence_at, stopping.plain)
    )
    assert min(honest.last, honest.every) >= 0.95
    assert naive.every < 0.9
