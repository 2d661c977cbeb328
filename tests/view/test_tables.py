"""The tables of a terminal: what they show, and what they say they leave out."""

from types import SimpleNamespace

import pandas as pd
import pytest
from upath import UPath

from jaxnet.statistics.groups import Group
from jaxnet.store.folder import FolderError
from jaxnet.store.results import Results
from jaxnet.view import columns
from jaxnet.view.text import formats, slopes, tables
from tests import systems

STATISTICS = ("mean", "low", "high", "median", "q05", "q95", "max")


def results_of(sweep: dict[str, list[object]], recovery: bool, cells: int = 1) -> Results:
    """Results of the first cells of a sweep, 0.1 or more for every statistic, 5 lanes a cell."""
    study = systems.study(sweep=sweep, recovery={"tau": 0.1} if recovery else None)
    names = [f"{metric}_{name}" for metric in ("tail_mean", "tail_max") for name in STATISTICS]
    names += ["unrecovered", "unrecovered_low", "unrecovered_high"] * recovery
    rows = [
        {
            **cell.labels,
            "lanes": 5,
            "ok": 5,
            "failed": 0,
            **dict.fromkeys(names, 0.123456 + cell.number),
        }
        for cell in study.cells[:cells]
    ]
    results = Results(UPath("nowhere"))
    known = SimpleNamespace(cells=study.cells[:cells], config=study.config)
    vars(results).update(cells=pd.DataFrame(rows), study=known)  # what else would be read there
    return results


@pytest.mark.parametrize("width", [60, 80, 160])
@pytest.mark.parametrize("recovery", [False, True])
@pytest.mark.parametrize("swept", [0, 1, 3])
def test_the_summary_fits_a_terminal_or_says_what_it_left_out(swept, recovery, width, monkeypatch):
    """What is shown and what is named as left out are all there is; what is asked for stays, the first."""
    monkeypatch.setenv("COLUMNS", str(width))
    keys = [("attack.magnitude", [1, 2]), ("attack.frequency", [0.5, 0.7]), ("tick", [0.05, 0.1])]
    results = results_of(dict(keys[:swept]), recovery, 2**swept)
    lines = tables.summary_text(results).splitlines()
    assert max(map(len, lines)) <= width
    wanted = ["unrecovered [%]"] * recovery + [
        "tail mean [m]",
        "tail mean, median [m]",
        "tail mean, q95 [m]",
        "worst [m]",
    ]
    titles = " ".join(" ".join(lines[:4]).split())
    bare = "left out: intervals of tail mean [m]" in " ".join(lines)
    _, _, left_out = " ".join(lines).partition("left out: ")
    assert wanted[0].split()[0] in titles
    for title in wanted[1:]:
        there = all(word in titles for word in title.replace(",", "").split()[-2:])
        assert there or title in left_out
    assert bare == (recovery and (width == 80 or (width == 60 and swept < 3)))
    assert bool(left_out) == (width == 60 or (width == 80 and (recovery or swept == 3)))


def test_what_is_the_same_in_all_cells_is_one_line():
    """Numbers of lanes, and a key that `where` leaves one value."""
    results = results_of({"attack.magnitude": [1, 2], "tick": [0.05, 0.1]}, True, 4)
    text = tables.summary_text(results, where={"tick": 0.1})
    assert "all cells: tick [s] 0.1, ok 5, failed 0" in text
    assert "tick" not in text.splitlines()[0]


def test_columns_are_chosen_and_cells_sorted():
    """By the names of cells.csv; a metric alone is its mean; another name is refused with those there are."""
    results = results_of({"attack.magnitude": [1, 2, 3]}, True, 3)
    shown = columns.summary_columns(results, ["tail_max", "unrecovered"], sort="-tail_mean_mean")
    assert [each.name for each in shown] == [
        "cell",
        "attack.magnitude",
        "tail_max_mean",
        "unrecovered",
    ]
    assert shown[0].values == [2, 1, 0]
    with pytest.raises(FolderError, match=r"no column speed \(there are attack.magnitude, "):
        columns.summary_columns(results, ["speed"])


def test_long_labels_are_cut_and_that_is_said(monkeypatch):
    """A label of 90 letters keeps as many as fit."""
    monkeypatch.setenv("COLUMNS", "80")
    graphs = [{"kind": "star", "label": letter * 90} for letter in "ab"]
    results = results_of({"topology": graphs, "attack.magnitude": [1, 2]}, True, 4)
    lines = tables.summary_text(results).splitlines()
    assert max(map(len, lines)) <= 80
    assert any("aaaaaaaaa…" in line for line in lines)
    assert "… stands where a label is cut short; all are in cells.csv" in " ".join(lines)


def test_a_table_for_a_paper():
    """booktabs, symbols, units and intervals; no column that is the same everywhere, no number of a cell."""
    results = results_of({"attack.magnitude": [1, 2], "defence": ["none", "w_msr"]}, False, 4)
    text = formats.in_format(
        columns.summary_columns(results, ["tail_mean", "tail_max_max", "ok"]), "latex"
    )
    assert text.splitlines() == [
        r"% \usepackage{booktabs}",
        "% all cells: ok 5",
        r"\begin{tabular}{rlrr}",
        r"\toprule",
        r"$\bar a$ [m] & defence & $\tilde e$ [m] & $\hat\delta$ [m] \\",
        r"\midrule",
        r"1 & no~defence & 0.1235 [0.123, 0.123] & 0.1235 \\",
        r" & W-MSR & 1.123 [1.12, 1.12] & 1.123 \\",
        r"\addlinespace",
        r"2 & no~defence & 2.123 [2.12, 2.12] & 2.123 \\",
        r" & W-MSR & 3.123 [3.12, 3.12] & 3.123 \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]
    small = columns.Column("x", "x", "x", [1e-7, 2.5e12])
    assert [formats.latex_text(text) for text in small.texts()] == [
        r"1$\cdot10^{-7}$",
        r"2.5$\cdot10^{12}$",
    ]


def test_what_attacks_leave_of_the_papers_is_said_with_the_cells():
    """Of those that ā does not bound and those whose derivatives are none; of the paper's own nothing."""
    attacks = ["rotating", "freeze", "spoof", {"kind": "bias", "orders": [0]}, "replay"]
    study = systems.study(sweep={"attack": attacks})
    assert tables.caveat_lines(study.cells) == [
        "attack not bounded by ā: cells 1, 4",
        "attack derivatives falsified each on its own: cells 2, 3",
    ]


def noted(results: Results, names: list[str]) -> list[str]:
    """Return the notes below the columns of these names."""
    return tables.summary_notes(results, columns.summary_columns(results, names))


def test_intervals_are_named_for_what_they_are():
    """Shares have the exact binomial interval, means that of means; what is not shown is not told."""
    results = results_of({"attack.magnitude": [1, 2]}, True, 2)
    shares = "[low, high] of unrecovered: exact binomial 95 % intervals (Clopper and Pearson)"
    means = "[low, high] of tail mean: 95 % intervals of a mean over lanes"
    assert [each for each in noted(results, ["unrecovered"]) if "[low" in each] == [shares]
    assert [each for each in noted(results, ["tail_mean"]) if "[low" in each] == [means]
    both = noted(results, ["unrecovered", "tail_mean"])
    assert [each for each in both if "[low" in each] == [shares, means]
    assert not any("[low" in each for each in noted(results, ["tail_mean_median"]))


@pytest.mark.parametrize("width", [80, 160])
def test_a_note_stands_where_what_it_explains_is_shown(width, monkeypatch):
    """A narrow table drops the intervals of the means: it says so, and says nothing of their ends."""
    monkeypatch.setenv("COLUMNS", str(width))
    results = results_of(
        {"attack.magnitude": [1, 2], "attack.frequency": [0.5, 0.7], "tick": [0.05, 0.1]}, True, 8
    )
    results.cells.loc[3, "tail_mean_high"] = float("nan")
    text = " ".join(tables.summary_text(results).split())
    assert ("an end is missing where theory gives none: cell 3" in text) == (width == 160)
    assert ("[low, high] of tail mean:" in text) == (width == 160)
    assert ("left out: intervals of tail mean [m]" in text) == (width == 80)
    chosen = tables.summary_text(results, ["tail_mean"], where={"tick": 0.05})
    assert "an end is missing" not in chosen


def test_rounding_and_missing_ends_in_a_paper():
    """Errors below 1e-9 of ā are 0, in a terminal too; a missing end is a dash, a minus is a minus."""
    results = results_of({"attack.magnitude": [1, 1000]}, False, 2)
    results.cells["tail_mean_mean"] = [5e-19, 5e-7]
    results.cells["tail_mean_low"] = [4e-19, 4e-7]
    results.cells["tail_mean_high"] = [0.3, float("nan")]
    found = columns.summary_columns(results, ["tail_mean"])
    assert found[-1].texts() == ["0 [0, 0.3]", "0 [0, -]"]
    assert r"1000 & 0 [0, --] \\" in formats.in_format(found, "latex").splitlines()
    assert formats.latex_number("-3.5 [-4, -]") == "$-$3.5 [$-$4, --]"
    assert formats.latex_number("-2e-07 [-, 1]") == r"$-$2$\cdot10^{-7}$ [--, 1]"


def test_a_table_for_a_paper_says_what_its_numbers_are():
    """Definition, intervals, samples and horizon are comments, so they travel with it."""
    results = results_of({"attack.magnitude": [1, 2]}, True, 2)
    vars(results)["manifest"] = {"samples": 5}
    found = columns.summary_columns(results, ["unrecovered"])
    notes = [*tables.summary_notes(results, found), tables.setting_note(results)]
    comments = [
        each for each in formats.in_format(found, "latex", notes).splitlines() if each[0] == "%"
    ]
    assert any("exact binomial" in each for each in comments)
    assert any("mean error over the tail > 0.1" in each for each in comments)
    assert any("5 lanes a cell; horizon" in each for each in comments)


def test_values_of_a_key_stand_across():
    """A row for each combination of the other keys, a column for each value, in every format."""
    sweep = {"attack.magnitude": [1, 2], "defence": ["none", "w_msr"], "tick": [0.05, 0.1]}
    results = results_of(sweep, True, 8)
    results.cells["unrecovered"] = [0.1 * number for number in range(8)]
    results.cells["unrecovered_low"], results.cells["unrecovered_high"] = 0.0, 1.0
    asked = columns.summary_columns(results, ["unrecovered"])
    found = columns.pivoted(asked, "defence")
    assert [each.name for each in found] == [
        *("attack.magnitude", "tick", "defence=none:unrecovered", "defence=w_msr:unrecovered")
    ]
    assert found[2].texts(intervals=False) == ["0", "10", "40", "50"]
    assert found[3].texts(intervals=False) == ["20", "30", "60", "70"]
    assert formats.in_format(found, "latex").splitlines()[1:8] == [
        r"\begin{tabular}{rrrr}",
        r"\toprule",
        r" &  & \multicolumn{2}{c}{unrecovered [\%]} \\",
        r"\cmidrule(lr){3-4}",
        r"$\bar a$ [m] & $h$ [s] & no~defence & W-MSR \\",
        r"\midrule",
        r"1 & 0.05 & 0 [0, 100] & 20 [0, 100] \\",
    ]
    text = tables.summary_text(results, ["unrecovered"], pivot="defence")
    assert "exact binomial" in text
    assert len([line for line in text.splitlines() if "[0, 100]" in line]) == 4
    with pytest.raises(FolderError, match="pivot: topology is not swept"):
        columns.pivoted(asked, "topology")


def test_a_long_table_is_cut_only_if_asked():
    """What is cut names the way to the rest."""
    results = results_of({"attack.magnitude": list(range(1, 73))}, False, 72)
    cut = tables.summary_text(results, ["tail_mean"])
    assert "… 12 more rows: `show --all` has all, `show --where KEY=VALUE` some" in cut
    whole = tables.summary_text(results, ["tail_mean"], most=None)
    assert len([line for line in whole.splitlines() if line.strip()[:1].isdigit()]) == 72


def test_fits_show_swept_values_as_the_summary_does():
    """Names of kinds, drawn vehicles and units; what is rounding is 0."""
    rows = {"attack.vehicles": ['{"random": 1}'], "defence": ["w_msr"], "mean": ["0.1"]}
    group = Group({"attack.vehicles": '{"random": 1}', "defence": "w_msr"}, ())
    text = slopes.group_table("slopes", pd.DataFrame(rows), group, (), "fit.csv")
    assert text.splitlines()[-1].split() == ["1", "drawn", "W-MSR", "0.1"]
    assert "attacked" in text.splitlines()[1]
    assert slopes.slope_interval_text((5e-20, 4e-20, 0.35)) == "0 (0 to 0.35)"
    assert slopes.slope_interval_text((0.4, 0.3, float("nan"))) == "0.4 (0.3 -)"
