"""Sobol's sequences as draws: the same points however they are asked for, intervals that hold."""

import jax
import numpy as np
import pytest
from scipy.stats import qmc

import jaxnet
from jaxnet.config.keys import RANDOMISATIONS
from jaxnet.lanes.jobs import job, source_of
from jaxnet.lanes.uniforms import Keyed, Place, Scrambled
from jaxnet.runs.replay import replay
from jaxnet.statistics import intervals
from jaxnet.statistics.summary import metric_statistics
from jaxnet.view.text import tables
from tests import systems

pytestmark = pytest.mark.usefixtures("many_side_by_side")

DIMENSIONS = 5
COLUMNS = {Place("x", vehicle): vehicle for vehicle in range(DIMENSIONS)}
ENTRIES = [(vehicle, 0) for vehicle in range(DIMENSIONS)]
KEYS = {
    "vehicles": 3,
    "topology": "complete",
    "attack": {"vehicles": [2]},
    "engine": "exact",
    "horizon": 1.0,
    "tail": 0.5,
    "samples": 64,
    "draws": "sobol",
}


def test_samples_are_points_of_sequences_however_they_are_asked_for():
    """In any order, those that SciPy makes at once; what has no column is random."""
    source = Scrambled(3, 8, COLUMNS)
    seeds = (np.random.default_rng([3, each]) for each in range(4))
    sequences = [qmc.Sobol(DIMENSIONS, bits=32, rng=seed).random(8) for seed in seeds]
    whole = np.concatenate(sequences) + 2.0**-33
    np.testing.assert_array_equal(source.uniforms("x", range(32), ENTRIES), whole)
    some = [31, 5, 6, 17, 3]
    np.testing.assert_array_equal(source.uniforms("x", some, ENTRIES[::-2]), whole[some][:, ::-2])
    random = Keyed(3).uniforms("y", some, ENTRIES)
    np.testing.assert_array_equal(source.uniforms("y", some, ENTRIES), random)


def integrand(u):
    """A smooth function of mean 1, between 0.85⁵ and 1.4⁵."""
    return np.prod(1 + 0.5 * (u - 0.5) + 0.3 * (3 * (u - 0.5) ** 2 - 0.25), axis=1)


@pytest.mark.long
def test_the_interval_of_a_mean_holds_it_as_often_as_it_says():
    """In 500 studies at least 95 % of the time, unbiased, with far less scatter than random."""
    samples = np.arange(RANDOMISATIONS * 16)
    held, means, random = [], [], []
    for seed in range(500):
        values = integrand(Scrambled(seed, 16, COLUMNS).uniforms("x", samples.tolist(), ENTRIES))
        found = metric_statistics(values, samples // 16)
        held.append(found["low"] <= 1 <= found["high"])
        means.append(found["mean"])
        independent = np.random.default_rng(seed).random((len(samples), DIMENSIONS))
        random.append(integrand(independent).mean())
    assert np.mean(held) > 0.95 - 0.02
    assert abs(np.mean(means) - 1) < 4 * np.std(means) / np.sqrt(500)
    assert np.var(means) < np.var(random) / 20


def test_what_matters_has_the_first_dimensions():
    """The attack on the attacked, then on others; starts, which are forgotten, come last."""
    study = systems.study(draws="sobol", samples=16)
    columns = source_of(study.config, study.cells[0].scenario).columns
    phases = [columns[Place("attack.phase", vehicle)] for vehicle in (2, 5, 8, 11, *range(1, 13))]
    assert phases[:4] == [0, 1, 2, 3]
    assert sorted({*phases}) == list(range(12))
    assert columns[Place("initial.position", 1)] == 12
    assert sorted(columns.values()) == list(range(len(columns)))  # each number has its own


def test_studies_are_compared_by_their_sequences():
    """Only those that are drawn alike."""
    changes = {}, {"attack": {"vehicles": [2], "magnitude": 6.0}}, {"draws": "random"}
    one, other, random = (jaxnet.simulate(KEYS | keys, progress=False) for keys in changes)
    apart = (other.lanes["tail_mean"] - one.lanes["tail_mean"]).to_numpy()
    low, _ = intervals.mean_interval(apart, 0.95, np.arange(64) // 4)
    found = jaxnet.compare(one, other).cells["tail_mean_low"][0]
    assert found == pytest.approx(low, rel=1e-9, nan_ok=True)
    with pytest.raises(jaxnet.FolderError, match="draws: sobol with 64 samples"):
        jaxnet.compare(one, random)


def test_lanes_are_the_same_however_they_are_loaded(tmp_path):
    """Alone, in any order, in shards and when they are replayed: to the last bit."""
    study = systems.study(**KEYS)
    scenario = study.cells[0].scenario
    source, some = source_of(study.config, scenario), [63, 0, 17]
    whole, few = (job(scenario, source, samples).inputs for samples in (range(64), some))
    for one, other in zip(jax.tree.leaves(whole), jax.tree.leaves(few), strict=True):
        np.testing.assert_array_equal(one[some], other)
    results = jaxnet.run(study, tmp_path / "whole", progress=False)
    for part in range(2):
        jaxnet.run_part(study, part, 2, tmp_path / "parts", progress=False)
    assert jaxnet.run(study, tmp_path / "parts", progress=False).lanes.equals(results.lanes)
    _, row = replay(results, 0, 17)
    assert row["tail_mean"] == results.lanes["tail_mean"][17]


def test_intervals_are_over_the_sequences(tmp_path):
    """In the table of cells, and in words; another number of samples is another study."""
    study = systems.study(**KEYS)
    results = jaxnet.run(study, tmp_path / "out", progress=False)
    lanes = results.lanes["tail_mean"].to_numpy()
    found = lanes.reshape(RANDOMISATIONS, -1).mean(axis=1)
    low, high = intervals.student_interval(lanes, found, np.ones(len(found)), 0.95)
    assert results.cells["tail_mean_low"][0] == pytest.approx(low, rel=1e-9)
    assert results.cells["tail_mean_high"][0] == pytest.approx(high, rel=1e-9)
    assert "scrambled sequences" in tables.summary_text(results)
    with pytest.raises(jaxnet.FolderError, match="samples is 64 there and 128 here"):
        jaxnet.run(systems.study(**KEYS | {"samples": 128}), tmp_path / "out", progress=False)
    assert results.fit()["low"].isna().all()
