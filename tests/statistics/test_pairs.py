"""Studies held against each other: differences of the same draws, counted as one by one would."""

import itertools
import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import jaxnet
from jaxnet.config.keys import Recovery
from jaxnet.model.wording import count
from jaxnet.statistics import pairs
from jaxnet.store.folder import FolderError
from jaxnet.view.page import comparison as page
from jaxnet.view.text import comparison
from tests import systems

KEYS = {
    "engine": "exact",
    "samples": 12,
    "horizon": 20.0,
    "tail": 2.0,
    "recovery": {"tau": 0.3},
    "sweep": {"topology": ["cyclic", "path"], "attack.magnitude": [1, 5]},
}

METRICS = ("tail_mean", "tail_max")


@pytest.fixture(scope="module")
def without():
    """No defence."""
    return jaxnet.simulate(systems.study(**KEYS, defence="none"))


@pytest.fixture(scope="module")
def trimmed():
    """Trimming, of fewer samples, and cells of which one is in no other study."""
    sweep = {"attack.magnitude": [5, 1, 2], "topology": ["path", "cyclic"]}
    return jaxnet.simulate(systems.study(**KEYS | {"samples": 10, "sweep": sweep}))


def test_differences_are_those_counted_lane_by_lane(without, trimmed):
    """Whatever the order of the cells; mean, sides and McNemar's p by hand."""
    found = jaxnet.compare(without, trimmed)
    a, b = without.lanes, trimmed.lanes
    assert len(found.cells) == 4
    sides = 0
    for row in found.cells.to_dict("records"):
        mine = [
            {
                lane["sample"]: lane
                for lane in lanes.to_dict("records")
                if lane["topology"] == row["topology"]
                and lane["attack.magnitude"] == row["attack.magnitude"]
            }
            for lanes in (a, b)
        ]
        common = sorted(set(mine[0]) & set(mine[1]))
        assert row["pairs"] == len(common) == 10
        for metric in ("tail_mean", "tail_max"):
            apart = [mine[1][s][metric] - mine[0][s][metric] for s in common]
            mean = math.fsum(apart) / 10
            assert row[f"{metric}_difference"] == pytest.approx(mean, rel=1e-9)
            assert np.isnan(row[f"{metric}_low"])  # ten pairs are too few
            assert row[f"{metric}_median"] == pytest.approx(np.median(apart))
            assert row[f"{metric}_median_low"] == sorted(apart)[1]
        limit = 0.3 * row["attack.magnitude"]
        bad = [[lanes[s]["tail_mean"] > limit for s in common] for lanes in mine]
        saved = sum(x and not y for x, y in zip(*bad, strict=True))
        lost = sum(y and not x for x, y in zip(*bad, strict=True))
        assert (row["saved"], row["lost"]) == (saved, lost)
        assert row["unrecovered"] == pytest.approx((sum(bad[1]) - sum(bad[0])) / 10)
        ways = itertools.product([0, 1], repeat=saved + lost)
        as_far = [abs(2 * sum(way) - saved - lost) >= abs(saved - lost) for way in ways]
        assert row["p"] == pytest.approx(sum(as_far) / len(as_far))
        sides += saved + lost
    assert sides > 3, "a study that tests nothing"
    assert len(found.changed) == sides
    assert (found.changed["unrecovered_A"] != found.changed["unrecovered_B"]).all()
    assert found.alone == ["cells 4, 5 (attack.magnitude=2) of B"]
    told = comparison.comparison_text(found)
    assert "defence.kind: none in A, trusted_trim in B" in told
    words = " ".join(told.split())
    alike = "(alike): all lanes of the cell have the same value; at most 25.9 % of all possible"
    every = comparison.comparison_columns(found)
    assert alike in comparison.comparison_legend(found, every)  # 1 - 0.05^(1/10)
    table, legend = words.partition(" Δ: ")[::2]
    legend, left_out = legend.partition("left out: ")[::2]
    for column, note in {"worst vehicle": "Worst vehicle (", "pairs": "McNemar"}.items():
        assert column in table or (column in left_out and note not in legend)
    assert all(len(line) <= 80 for line in told.splitlines())
    recovered = count(found.changed["unrecovered_A"].astype(bool).sum(), "lane")
    assert f"recovered only in B: {recovered}" in told
    html = page.comparison_page(found)
    assert "defence.kind" in html
    assert "unrecovered [%]" in html
    assert "McNemar" in html
    _, *quantities = (each for each in every if each.key is None)
    shares, p = quantities[:2]  # just behind the cell and its values, in 80 columns too
    assert (shares.name, p.name) == ("unrecovered", "p")
    assert shares.texts()[0] in table
    assert shares.scaled() == (100 * found.cells["unrecovered"]).tolist()


def test_lists_of_choices_differ_by_what_the_other_lacks():
    ring, trim = {"kind": "circulant", "offsets": [1, 2]}, {"kind": "w_msr", "F": 2}
    assert pairs.values_apart(["none", ring, trim], ["none", ring]) == (str(trim), "-")
    assert pairs.values_apart([ring], [ring | {"offsets": [1]}])[0] == str(ring)
    assert pairs.values_apart([ring, trim], [trim, ring])[0] == str([ring, trim])
    assert pairs.values_apart([0.5, 5], [0.5]) == ("[0.5, 5]", "[0.5]")
    assert pairs.values_apart("-", [ring]) == ("-", str([ring]))


def test_a_study_differs_from_itself_by_nothing(without):
    """Exactly, and nobody changed sides."""
    found = jaxnet.compare(without, without)
    for metric in ("tail_mean", "tail_max"):
        assert (found.cells[f"{metric}_difference"] == 0).all()
        assert (found.cells[[f"{metric}_median_low", f"{metric}_median_high"]] == 0).all(axis=None)
    assert (found.cells[["saved", "lost", "unrecovered"]] == 0).all(axis=None)
    assert (found.cells["p"] == 1).all()
    assert found.changed.empty
    assert found.settings.empty
    told = " ".join(comparison.comparison_text(found).split())
    assert "they are the same study" in told
    shown = comparison.comparison_columns(found)
    assert {*next(each for each in shown if each.name == "p").texts()} == {"-"}
    measured = [each for each in shown if "[m]" in each.title]
    assert {text for each in measured[1:] for text in each.texts()} == {"0 (alike)"}
    assert "of the cell have the same value; at most 22.1 % of all possible lanes have" in told


def test_a_failed_lane_counts_in_shares_alone_and_is_named(without, trimmed):
    """In whichever study it failed; it is unrecovered there."""
    whole = jaxnet.compare(without, trimmed)
    pair = pairs.paired_cells(without, trimmed)[0]
    lanes = pairs.join_lanes((without, trimmed), pair, METRICS)
    lanes.loc[3, ["status_B", "tail_mean_B", "tail_max_B"]] = ["max_steps", np.nan, np.nan]
    judged = pairs.mark_unrecovered(lanes, pair, [Recovery(tau=0.3)] * 2)
    row = pairs.comparison_row(judged, METRICS, without.study.config)
    assert (row["pairs"], row["failed"]) == (9, 1)
    kept = (lanes["tail_mean_B"] - lanes["tail_mean_A"]).drop(3)
    assert row["tail_mean_difference"] == pytest.approx(kept.mean())
    level = 0.3 * pair[0].labels["attack.magnitude"]
    over = [lanes[f"tail_mean{side}"] > level for side in pairs.SIDES]
    over[1][3] = True
    assert row["saved"] == (over[0] & ~over[1]).sum()
    assert row["lost"] == (over[1] & ~over[0]).sum()
    assert row["unrecovered"] == pytest.approx((over[1].sum() - over[0].sum()) / 10)
    named = judged[~judged["ok"]].assign(cell=0)
    assert "Δ failed or unrecovered [%]" in [
        each.title for each in comparison.comparison_columns(whole._replace(failed=named))
    ]
    said = comparison.comparison_text(whole._replace(failed=named))
    assert "failed: 1 lane: cell 0 sample 3 (ok in A, max_steps in B)" in said


def test_the_interval_leaves_out_no_change_where_mcnemars_test_does():
    """For every number of lanes saved and lost up to 12, of 50."""
    for saved, lost in itertools.product(range(13), repeat=2):
        sides = np.repeat(
            [[True, False], [False, True], [False, False]], [saved, lost, 50 - saved - lost], 0
        )
        found = pairs.share_shift(*sides.T)
        assert (found.p < 0.05) == (not found.unrecovered_low <= 0 <= found.unrecovered_high), (
            saved,
            lost,
        )


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"seed": 1}, "seed: 0 in .*, 1 in "),
        (
            {"sweep": {"topology": ["star"], "attack.magnitude": [5]}},
            "topology is cyclic, path in .*, star in ",
        ),
        ({"sweep": {"topology": ["cyclic"]}}, "sweep: attack.magnitude is swept in .* and not in "),
    ],
)
def test_what_cannot_be_paired_is_refused(without, keys, words):
    """Another seed, no cell in common, several cells for one."""
    other = jaxnet.simulate(
        systems.study(**KEYS | {"horizon": 1.0, "tail": 0.5, "samples": 1} | keys)
    )
    with pytest.raises(FolderError, match=words):
        jaxnet.compare(without, other)


def test_lanes_without_recovery_have_no_sides(without):
    """Blank where one study does not say when a lane has recovered."""
    pair = (without.study.cells[0],) * 2
    lanes = pairs.join_lanes((without, without), pair, METRICS)
    judged = pairs.mark_unrecovered(lanes, pair, [None, Recovery(tau=0.3)])
    assert pd.isna(pairs.comparison_row(judged, METRICS, without.study.config)["p"])


def worse_pairs(values, settings) -> tuple[set[tuple[int, int]], int]:
    """Pairs of cells of which the first is found worse, and the number of tests that can tell."""
    found = pairs.compared_cells(values, settings)
    return {(t.worse, t.better) for t in found if t.found}, sum(t.can_tell for t in found)


def test_cells_are_compared_lane_by_lane_and_all_at_once():
    """Signs counted by hand: 10 of 10, 9 of 10 and ties; Holm's levels are 0.05/3, 0.05/2, 0.05."""
    base = np.arange(1.0, 11.0)
    nine = base + np.where(np.arange(10) < 9, 0.5, -0.5)
    lanes = {0: base, 1: base + 1e-12, 2: base + 0.1, 3: nine}
    values = {cell: pd.Series(each, range(10)) for cell, each in lanes.items()}
    assert worse_pairs(values, [[0, 1]]) == (set(), 0)  # rounding
    assert worse_pairs(values, [[0, 3]]) == ({(3, 0)}, 1)  # p = 22/1024 < 0.05
    # two comparisons of lanes that do not differ cost nothing; two that do take it over 0.05/3
    assert worse_pairs(values, [[0, 3], [0, 1], [0, 1]]) == ({(3, 0)}, 1)
    values[4] = pd.Series(base + np.tile([0.5, -0.5], 5), range(10))
    assert worse_pairs(values, [[0, 3], [0, 4], [0, 4]]) == (set(), 3)
    assert worse_pairs(values, [[0, 2], [0, 2], [0, 3]]) == ({(2, 0), (3, 0)}, 3)  # 0.05/1
    short = values | {2: values[2].iloc[:5]}  # five pairs: p = 2/32
    assert worse_pairs(short, [[0, 2]]) == (set(), 0)
    told = pairs.compared_cells(values, [[0, 2], [0, 3]])
    assert [each.p for each in told] == pytest.approx(
        [2 * 2 / 1024, 22 / 1024]
    )  # Holm: twice, once
    assert {each.lanes for each in told} == {10}


@pytest.mark.parametrize(("up", "down"), [(0, 0), (3, 3), (9, 1), (0, 12)])
def test_the_sign_test_is_the_binomial_one(up, down):
    wanted = stats.binomtest(up, up + down).pvalue if up + down else 1.0
    assert pairs.sign_test(up, down) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("ends", "told"),
    [
        ({"status_A": "singular", "status_B": "singular"}, " (singular in both)"),
        ({"status_A": "ok", "status_B": "singular"}, " (ok in A, singular in B)"),
        ({}, ""),
    ],
)
def test_how_a_lane_ended_is_told_once(ends, told):
    lanes = pd.DataFrame([{"cell": 0, "sample": 3} | ends])
    assert comparison.named_lanes("failed", lanes) == f"failed: 1 lane: cell 0 sample 3{told}"
