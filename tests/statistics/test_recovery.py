"""The share of lanes that the defence does not save: its exact interval, and stopping when it is narrow."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import jaxnet
from experiments import stopping
from jaxnet.config import keys as config
from jaxnet.engine.methods.exact import Exact
from jaxnet.statistics import recovery
from jaxnet.store.folder import Folder, FolderError
from tests import systems


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


@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.999])
def test_the_interval_is_the_exact_one(confidence):
    """As SciPy's binomial test gives it, for every count of small numbers of trials."""
    for trials in (1, 2, 7, 30):
        successes = np.arange(trials + 1)
        low, high = recovery.clopper_pearson(successes, np.full(trials + 1, trials), confidence)
        for k in successes:
            exact = stats.binomtest(int(k), trials).proportion_ci(confidence, method="exact")
            assert (low[k], high[k]) == (pytest.approx(exact.low), pytest.approx(exact.high))
    low, high = recovery.clopper_pearson(np.zeros(1, int), np.zeros(1, int), confidence)
    assert (low[0], high[0]) == (0.0, 1.0)


def test_all_looks_together_err_no_more_than_one_may():
    """The errors of the first n looks sum to what is allowed, but for the n-th part."""
    errors = [1 - recovery.confidence_at(look, 0.95) for look in range(1, 1000)]
    assert sum(errors) == pytest.approx(0.05 * (1 - 1 / 1000))
    assert errors[0] == pytest.approx(0.025)


def test_counts():
    """By hand: over τ ā, failed lanes in neither number, no share where nobody is attacked."""
    cells = jaxnet.load({"sweep": {"attack.magnitude": [0, 2]}}).cells
    rows = pd.DataFrame(
        {
            "cell": [0, 1, 1, 1, 1],
            "sample": [0, 0, 1, 2, 3],
            "status": ["ok", "ok", "ok", "ok", "singular"],
            "tail_mean": [1.0, 0.021, 0.02, 0.5, np.nan],
        }
    )
    ok, counts = rows[rows["status"] == "ok"], recovery.nobody(cells)
    for number, errors in ok.groupby("cell")["tail_mean"]:
        counts.add(cells[number], errors.to_numpy(), 0.01)
    assert (counts.unrecovered.tolist(), counts.ended.tolist()) == ([0, 2], [1, 3])
    table = recovery.shares(counts, cells, 0.95)
    assert table.loc[0].isna().all()
    assert table["unrecovered"][1] == pytest.approx(2 / 3)
    assert recovery.worst(ok, cells, 2) == [(1, 2), (1, 0)]
    assert recovery.worst(ok, cells, 9) == [(1, 2), (1, 0), (1, 1)]


def test_the_table_has_the_shares(tmp_path):
    """Counted from the rows, with the exact interval; nothing for the cell in which nobody is attacked."""
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
    """The worst for its ā of each group first, the greater ratio before; then the second of each."""
    cells = jaxnet.load({"sweep": {"topology": ["star", "path"], "attack.magnitude": [1, 10]}}).cells
    rows = pd.DataFrame(
        {
            "cell": [0, 0, 1, 1, 2, 3],
            "sample": [0, 1, 0, 1, 0, 0],
            "tail_mean": [0.7, 0.8, 9.0, 1.0, 0.1, 2.0],
        }
    )
    assert recovery.worst(rows, cells, 3) == [(1, 0), (3, 0), (0, 1)]
    assert recovery.worst(rows, cells, 9) == [(1, 0), (3, 0), (0, 1), (2, 0), (0, 0), (1, 1)]


@pytest.fixture
def small_shards(monkeypatch):
    """Shards of 50 lanes, so that there are several looks."""
    monkeypatch.setattr(Exact, "shard", 50)


def until(half_width, at_most=1000):
    """A criterion as a config has it."""
    return {"until": {"half_width": half_width, "of": "unrecovered", "at_most": at_most}}


def test_a_run_stops_when_the_widest_interval_is_narrow_enough(tmp_path, small_shards):
    """After whole shards, all cells alike, at the first look that meets it; rows are those of any run."""
    results = jaxnet.run(systems.study(samples=until(0.1), **keys()), tmp_path / "until")
    samples = results.manifest["samples"]
    assert samples % 50 == 0
    assert results.cells["lanes"].tolist() == [samples] * 3
    fixed = jaxnet.run(systems.study(samples=samples, **keys()), tmp_path / "fixed")
    pd.testing.assert_frame_equal(results.lanes, fixed.lanes, check_exact=True)

    def widest(first, look):
        rows = fixed.lanes[fixed.lanes["sample"] < first]
        over = rows["tail_mean"] > rows["attack.magnitude"]
        counts = [over.groupby(rows["cell"]).sum().to_numpy(), rows.groupby("cell").size().to_numpy()]
        low, high = recovery.clopper_pearson(*counts, recovery.confidence_at(look, 0.95))
        return (high - low)[1:].max() / 2

    looks = samples // 50
    assert looks > 1
    assert [widest(50 * look, look) <= 0.1 for look in range(1, looks + 1)] == [False] * (looks - 1) + [True]
    told = results.cells["unrecovered_high"] - results.cells["unrecovered_low"]
    assert told.max() / 2 == pytest.approx(widest(samples, looks))


def made_by_fixed(tmp_path):
    """A folder of shards of 50 samples, with three in it."""
    return jaxnet.run(systems.study(samples=3, **{**keys(), "seed": 1}), tmp_path / "fixed").path


def test_it_goes_on_where_it_was_and_ends_at_the_most_allowed(tmp_path, small_shards):
    """A narrower interval extends the run; one that is too narrow ends at the last whole shard allowed."""
    first = jaxnet.run(systems.study(samples=until(0.2), **keys()), tmp_path / "out")
    few, before = first.manifest["samples"], first.lanes
    again = jaxnet.run(systems.study(samples=until(0.2), **keys()), tmp_path / "out")
    assert again.manifest["samples"] == few
    more = jaxnet.run(systems.study(samples=until(0.01, at_most=340), **keys()), tmp_path / "out")
    assert more.manifest["samples"] == 300 > few
    rows = more.lanes
    kept = rows[rows["sample"] < few].reset_index(drop=True)
    pd.testing.assert_frame_equal(kept, before, check_exact=True)
    with pytest.raises(FolderError, match="shards hold 50 samples, so at least 50"):
        jaxnet.run(
            systems.study(samples=until(0.2, at_most=40), **{**keys(), "seed": 1}), made_by_fixed(tmp_path)
        )
    wider = jaxnet.run(systems.study(samples=until(0.2), **keys()), tmp_path / "out")
    assert (wider.manifest["samples"], len(wider.lanes)) == (300, 900)


def test_a_run_cut_off_in_the_midst_of_a_look_ends_like_any_other(tmp_path, small_shards):
    """Also where only some cells have their shard of the last look."""
    whole = jaxnet.run(systems.study(samples=until(0.1), **keys()), tmp_path / "out")
    rows, samples = whole.lanes, whole.manifest["samples"]
    sorted((whole.path / "lanes").glob("*.parquet"))[-1].unlink()
    Folder(whole.path).write_manifest(finished=False)
    (whole.path / "cells.csv").unlink()
    with pytest.raises(FolderError, match="unfinished run"):
        _ = jaxnet.open(whole.path).cells
    again = jaxnet.run(systems.study(samples=until(0.1), **keys()), tmp_path / "out")
    assert again.manifest["samples"] == samples
    pd.testing.assert_frame_equal(again.lanes, rows, check_exact=True)


def test_the_interval_covers_under_repeated_looks():
    """Of 200 runs, by the functions that a run uses; intervals for one look do not survive many."""
    honest, naive = (stopping.coverage(0.05, 200, at) for at in (recovery.confidence_at, stopping.plain))
    assert min(honest.last, honest.every) >= 0.94
    assert naive.every < 0.9


def test_one_half_width_is_half_a_width():
    """The criterion is on half the interval's width: met at exactly that, not before."""
    cells = jaxnet.load({}).cells
    counts = recovery.Counts(np.array([50]), np.array([1000]))
    low, high = recovery.clopper_pearson(*counts, recovery.confidence_at(1, 0.95))
    half = float(high[0] - low[0]) / 2
    for factor, enough in ((1.001, True), (0.999, False)):
        criterion = config.Criterion(half_width=half * factor)
        assert recovery.settled(counts, cells, 1, criterion) is enough
