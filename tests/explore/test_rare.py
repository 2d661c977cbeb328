"""Small shares are found as small as they are."""

import numpy as np
import pytest
from scipy import stats

import jaxnet
from jaxnet.explore import rare
from tests import systems


@pytest.mark.parametrize(("level", "coordinates"), [(2.0, 2), (4.5, 40)])
def test_a_plane_far_out(level, coordinates):
    """Σ x / √n is over β with the probability Φ(-β): 2.3e-2, and 3.4e-6."""

    def height(where, chains):
        assert len(where) == len(chains)
        return where.sum(axis=1) / np.sqrt(coordinates)

    found = rare.estimate(height, coordinates, level, 1000, 20, np.random.default_rng(0))
    assert found.low < stats.norm.sf(level) < found.high
    assert found.high < 2 * found.low
    assert found.lanes < 130_000


@pytest.mark.long
def test_intervals_hold_the_share_nearly_as_often_as_they_say():
    """Of 100 estimates of Φ(-3) from ten repeats of 200 points, whose shares are skewed."""
    held = 0
    for seed in range(100):
        found = rare.estimate(lambda x, _: x[:, 0], 3, 3.0, 200, 10, np.random.default_rng(seed))
        held += found.low < stats.norm.sf(3.0) < found.high
    assert held >= 85


def test_what_failed_is_over_nothing():
    """A height of minus infinity goes on nowhere, and counts."""

    def height(where, _):
        return np.where(where[:, 1] > 0, where[:, 0], -np.inf)

    found = rare.estimate(height, 2, 3.0, 1000, 10, np.random.default_rng(1))
    assert found.low < stats.norm.sf(3.0) / 2 < found.high


def test_a_share_is_kept_in_its_table(tmp_path, monkeypatch):
    """A second is too short to recover; the table is not written again for as many points."""
    keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5, "recovery": {"tau": 0.01}}
    given = systems.study(**keys, vehicles=3, attack={"vehicles": [2]})
    table = jaxnet.rare(given, points=20, out=tmp_path / "s")
    assert table[["cell", "share", "levels", "lanes"]].to_numpy().tolist() == [[0, 1.0, 1, 200]]
    stamp = (tmp_path / "s" / "rare.csv").stat().st_mtime_ns
    assert jaxnet.rare(given, points=20, out=tmp_path / "s").equals(table)
    assert (tmp_path / "s" / "rare.csv").stat().st_mtime_ns == stamp
    monkeypatch.setattr(rare, "estimate", lambda *_: rare.Estimate(0.1, 0.08, 0.12, 2, 100))
    plain = rare.rare_row(given, given.cells[0], 20)["plain_lanes"]
    assert plain == pytest.approx(1.96**2 * 0.1 * 0.9 / 0.02**2)


@pytest.mark.long
def test_lanes_as_counted(tmp_path):
    """The share of a trimmed ring that does not recover, as plain lanes have it."""
    keys = {"attack": {"kind": "rotating", "magnitude": 10.0, "frequency": 0.7}, "engine": "exact"}
    keys |= {
        "horizon": 30.0,
        "tail": 2.0,
        "output_step": 0.5,
        "tick": 0.25,
        "recovery": {"tau": 0.3},
    }
    given = systems.study(samples=2000, **keys)
    plain = jaxnet.simulate(given, progress=False).cells["unrecovered"].iloc[0]
    table = jaxnet.rare(given, points=100, out=tmp_path / "s")
    (row,) = table.to_dict("records")
    low, high = stats.binomtest(round(2000 * plain), 2000).proportion_ci()
    assert row["low"] < high
    assert row["high"] > low
    assert row["failed"] == 0
    assert row["lanes"] < 4000
