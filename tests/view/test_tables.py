"""The tables of a terminal: what they show, and what they say they leave out."""

from types import SimpleNamespace

import pandas as pd
import pytest
from upath import UPath

from jaxnet.store.folder import FolderError
from jaxnet.store.results import Results
from jaxnet.view import columns
from jaxnet.view.text import formats, tables
from tests import systems

STATISTICS = ("mean", "low", "high", "median", "q05", "q95", "max")


def results_of(sweep: dict[str, list[object]], recovery: bool, cells: int = 1) -> Results:
    """Results of the first cells of a sweep, 0.1 or more for every statistic, 5 lanes a cell."""
    study = systems.study(sweep=sweep, recovery={"tau": 0.1} if recovery else None)
    names = [f"{metric}_{name}" for metric in ("tail_mean", "tail_max") for name in STATISTICS]
    names += ["unrecovered", "unrecovered_low", "unrecovered_high"] * recovery
    rows = [
        {**cell.labels, "lanes": 5, "ok": 5, "failed": 0, **dict.fromkeys(names, 0.123456 + cell.number)}
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
    _, _, left_out = " ".join(lines).partition("left out: ")
    assert wanted[0].split()[0] in titles
    for title in wanted[1:]:
        there = all(word in titles for word in title.replace(",", "").split()[-2:])
        assert there or title in left_out
    assert bool(left_out) == (width == 60 or (width == 80 and swept == 3))


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
    assert [each.name for each in shown] == ["cell", "attack.magnitude", "tail_max_mean", "unrecovered"]
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
    text = formats.in_format(columns.summary_columns(results, ["tail_mean", "tail_max_max", "ok"]), "latex")
    assert text.splitlines() == [
        r"% \usepackage{booktabs}",
        "% all cells: ok 5",
        r"\begin{tabular}{rlrr}",
        r"\toprule",
        r"$\bar a$ [m] & defence & $\tilde e$ [m] & $\hat\delta$ [m] \\",
        r"\midrule",
        r"1 & no~defence & 0.1235 [0.123, 0.123] & 0.1235 \\",
        r"1 & W-MSR & 1.123 [1.12, 1.12] & 1.123 \\",
        r"2 & no~defence & 2.123 [2.12, 2.12] & 2.123 \\",
        r"2 & W-MSR & 3.123 [3.12, 3.12] & 3.123 \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]
    small = columns.Column("x", "x", "x", [1e-7, 2.5e12])
    assert [formats.latex_text(text) for text in small.texts()] == [r"1$\cdot10^{-7}$", r"2.5$\cdot10^{12}$"]


def test_what_attacks_leave_of_the_papers_is_said_with_the_cells():
    """Of those that ā does not bound and those whose derivatives are none; of the paper's own nothing."""
    attacks = ["rotating", "freeze", "spoof", {"kind": "bias", "orders": [0]}, "replay"]
    study = systems.study(sweep={"attack": attacks})
    assert tables.caveat_lines(study.cells) == [
        "attack not bounded by ā: cells 1, 4",
        "attack derivatives falsified each on its own: cells 2, 3",
    ]
