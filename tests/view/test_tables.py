"""The tables of a terminal: what they show, and what they say they leave out."""

import math
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest
from upath import UPath

from jaxnet.kinds.metrics import COLUMNS_OF_METRIC
from jaxnet.statistics.curves import Curve
from jaxnet.statistics.groups import Group
from jaxnet.statistics.summary import SUMMARISED
from jaxnet.store.folder import FolderError
from jaxnet.store.results import Results
from jaxnet.view import columns
from jaxnet.view.text import formats, printer, slopes, tables
from jaxnet.view.text.width import cell_title, numbered_words
from tests import systems

TAIL = ["tail_mean_median", "tail_max_max"]
LONG = {"attack.magnitude": [1, 2], "attack.frequency": [0.5, 0.7], "tick": [0.05, 0.1]}


def results_of(sweep: dict[str, list[object]], recovery: bool, cells: int = 1) -> Results:
    """Results of the first cells of a sweep, 0.12 or more for every statistic, 5 lanes a cell."""
    study = systems.study(sweep=sweep, recovery={"tau": 0.1} if recovery else None)
    names = [f"{each}_{name}" for each in ("tail_mean", "tail_max") for name in COLUMNS_OF_METRIC]
    names += ["unrecovered", "unrecovered_low", "unrecovered_high"] * recovery
    counts = {"lanes": 5, "ok": 5, "failed": 0}
    rows = [
        cell.labels | counts | dict.fromkeys(names, 0.123456 + cell.number)
        for cell in study.cells[:cells]
    ]
    results = Results(UPath("nowhere"))
    known = SimpleNamespace(cells=study.cells[:cells], config=study.config)
    table = pd.DataFrame(rows)
    most = [f"{each}_max" for each in ("tail_mean", "tail_max")]
    table[most] += 1.0  # lanes are not alike
    vars(results).update(cells=table, study=known)  # what else would be read there
    return results


@pytest.mark.parametrize("width", [60, 80, 160])
@pytest.mark.parametrize(("swept", "recovery"), [(0, True), (1, False), (3, True)])
def test_the_summary_fits_a_terminal_or_says_what_it_left_out(swept, recovery, width, monkeypatch):
    """What is shown and what is named as left out are all there is; the first quantity stays."""
    monkeypatch.setenv("COLUMNS", str(width))
    results = results_of(dict(list(LONG.items())[:swept]), recovery, 2**swept)
    lines = tables.summary_text(results).splitlines()
    assert max(map(len, lines)) <= width
    words, _, left_out = " ".join(" ".join(lines).split()).partition("left out: ")
    assert ("unrecovered" if recovery else "error, median") in words
    for title in ("error, mean [m]", "error, 95 % quantile [m]", "worst vehicle, max [m]"):
        assert title.split()[-2].strip(",") in words or title in left_out
    assert bool(left_out) == (width < 160)


def test_the_headline_is_the_median_with_its_interval():
    """Then the worst, and the mean, which five lanes give no interval."""
    results = results_of({"attack.magnitude": [1, 2]}, False, 2)
    results.cells[["tail_mean_low", "tail_mean_high"]] = float("nan")
    shown = columns.summary_columns(results)
    names = ["tail_mean_median", "tail_max_max", "tail_mean_mean"]
    assert [each.name for each in shown[2:5]] == names
    assert [each.texts()[0] for each in shown[2:5]] == ["0.123 [0.123, 0.123]", "1.12", "0.123"]
    notes = tables.summary_notes(results, shown)
    assert notes[0] == "[low, high] of error, median: 95 % intervals of order statistics"
    why = "fewer than 28 lanes, or too few for so skewed values"
    assert notes[1] == f"mean without interval: {why}: cells 0, 1"
    results.cells.loc[1, ["tail_mean_low", "tail_mean_high"]] = 1.0, 1.2
    shown = columns.summary_columns(results, ["tail_mean_mean"])
    assert shown[-1].texts() == ["0.123 [-]", "1.12 [1, 1.2]"]


def test_lanes_that_agree_are_told_so():
    """With what their number says of all others: 1 - 0.05^(1/5)."""
    results = results_of({"attack.magnitude": [1, 2]}, False, 2)
    results.cells.loc[1, "tail_mean_max"] = results.cells.loc[1, "tail_mean_mean"]
    shown = columns.summary_columns(results, ["tail_mean"])
    assert shown[-1].texts() == ["0.123 [0.123, 0.123]", "1.12 (alike)"]
    told = "(alike): all lanes of the cell have the same value"
    most = "; at most 45.1 % of all possible lanes have another, with 95 % confidence"
    assert told + most in tables.summary_notes(results, shown)
    results.study.config = results.study.config.model_copy(update={"draws": "sobol"})
    assert told in tables.summary_notes(results, shown)
    rounding = [f"tail_mean_{end}" for end in COLUMNS_OF_METRIC]
    results.cells.loc[:, rounding] = np.linspace(1e-12, 1e-11, len(rounding))
    shown = columns.summary_columns(results, ["tail_mean", "tail_mean_mean"])
    assert [each.texts() for each in shown[-2:]] == [["0 (alike)"] * 2] * 2
    assert not any("[low, high]" in each for each in tables.summary_notes(results, shown))


def test_notes_are_of_the_metrics_that_are_shown():
    """A metric whose name begins as another's brings none of its notes; titles have its words."""
    keys = {"navigator": "none", "law": "local", "metrics": ["outside_arena"], "attack": "none"}
    made = systems.study(**keys)
    table = {f"outside_arena_{end}": [1.0] for end in COLUMNS_OF_METRIC}
    table |= {"ok": [5], "failed": [0], "lanes": [5]}
    results = Results(UPath("here"))
    vars(results).update(study=made, cells=pd.DataFrame(table | {"outside_max": [1.0]}))
    shown = columns.summary_columns(results, ["outside_arena"])
    assert shown[-1].latex == "outside arena, median"
    assert not any("outside: " in each for each in tables.summary_notes(results, shown))
    shown = columns.summary_columns(results, ["outside_max"])
    (note,) = [each for each in tables.summary_notes(results, shown) if "outside: " in each]
    assert "how far an honest vehicle leaves" in note


def test_lanes_that_failed_are_told_where_no_column_does():
    results = results_of({"attack.magnitude": [1, 2]}, True, 4)
    results.cells["failed"], results.cells["lanes"] = [2, 0], [5, 5]
    asked = columns.summary_columns(results, ["tail_mean"])
    told = "2 of 10 lanes failed; other columns are of lanes that ended"
    assert told in tables.summary_notes(results, asked)
    asked = columns.summary_columns(results, ["tail_mean", "failed"])
    assert told not in " ".join(tables.summary_notes(results, asked))


def test_a_share_of_lanes_that_ended_says_so_where_others_failed():
    results = results_of({"attack.magnitude": [1, 2]}, True, 2)
    results.cells["failed"], results.cells["lanes"] = [0, 3], [5, 8]
    shown = columns.summary_columns(results, ["unrecovered"])
    assert shown[-1].title == "unrecovered of lanes that ended [%]"
    shown = columns.summary_columns(results, ["unrecovered"], {"attack.magnitude": 1.0})
    assert shown[-1].title == "unrecovered [%]"


def one_line(lines):
    return " ".join(" ".join(lines).replace("\N{NO-BREAK SPACE}", " ").split())


def test_lanes_that_failed_count_as_lost_in_the_first_column():
    """3 of 8 failed and 2 of the other 5 did not recover: 5 of 8, and the exact interval of it."""
    results = results_of({"attack.magnitude": [1, 2]}, True, 2)
    results.cells["failed"], results.cells["lanes"] = [0, 3], [5, 8]
    results.cells[["unrecovered", "unrecovered_low", "unrecovered_high"]] = [0.4, 0.1, 0.9]
    shown = columns.summary_columns(results)
    assert [each.name for each in shown[2:5]] == ["lost_share", *TAIL]
    assert shown[2].title == "failed or unrecovered [%]"
    low, high = binomtest(5, 8).proportion_ci(0.95, "exact")
    found = shown[2].entries.to_numpy(float)
    np.testing.assert_allclose(found, [[0.4, 0.1, 0.9], [0.625, low, high]], rtol=1e-9)
    note = "unrecovered: mean error over the tail > 0.1\N{NO-BREAK SPACE}ā"
    assert note in tables.summary_notes(results, shown[:3])
    whole = columns.summary_columns(results, where={"attack.magnitude": 1.0})
    assert [each.name for each in whole[2:5]] == ["unrecovered", *TAIL]


def test_a_verdict_names_the_worst_cells():
    """In two sentences, for the cells that are shown; none of one cell."""
    sweep = {"defence": ["none", "w_msr"], "attack.magnitude": [1, 2, 3]}
    results = results_of(sweep, True, 6)
    results.cells["unrecovered"] = [1.0, 1.0, 0.8, 0.0, 0.0, 0.0]
    results.cells["tail_max_max"] = [1.0, 2.0, 3.0, 1e-15, 0.5, 0.5]
    told = tables.held_lines(results, results.study.cells)
    assert [one_line([each]) for each in told] == [
        "In 2 of 6 cells all lanes ended unrecovered: cells 0, 1 (no defence, ā = 1 and 2 m)",
        "Worst vehicle: 0 m in cell 3 (W-MSR, ā = 1 m) to 3 m in cell 2 (no defence, ā = 3 m)",
    ]
    text = tables.summary_text(results, where={"attack.magnitude": 3.0})
    assert "At worst 80 % of lanes ended unrecovered: cell 2 (no defence)" in one_line([text])
    assert tables.held_lines(results, results.study.cells[:1]) == []
    results.cells["failed"], results.cells["lanes"] = 5, 10
    results.cells["unrecovered"] = 1.0
    (first, _) = tables.held_lines(results, results.study.cells)
    assert first == "In all 6 cells all lanes failed or ended unrecovered"


def test_the_worst_vehicle_is_of_cells_of_which_most_lanes_ended():
    results = results_of({"attack.magnitude": [1, 2, 3]}, False, 3)
    results.cells["tail_max_max"] = [0.0, 1.0, 2.0]
    results.cells["ok"], results.cells["failed"] = [1, 3, 5], [4, 2, 0]
    *_, told = tables.held_lines(results, results.study.cells)
    assert one_line([told]).startswith("Worst vehicle: 1 m in cell 1 (ā = 2 m) to 2 m in cell 2")


def test_shares_of_all_lanes_can_be_chosen():
    """With the names of a CSV table: failed lanes, and those that failed or are unrecovered."""
    results = results_of({"attack.magnitude": [1, 2]}, True, 2)
    results.cells["unrecovered"] = [0.25, 1.0]
    results.cells["ok"], results.cells["failed"], results.cells["lanes"] = [4, 5], [1, 0], 5
    names = ["lost_share", "lost_share_high", "failed_share", "unrecovered"]
    *_, lost, high, failed, ended = columns.summary_columns(results, names, sort="-lost_share")
    assert lost.values == [1.0, 0.4]
    assert failed.values == [0.0, 0.2]
    assert ended.values == [1.0, 0.25]
    assert high.values[1] == pytest.approx(binomtest(2, 5).proportion_ci(0.95).high)
    assert lost.title == "failed or unrecovered [%]"
    with pytest.raises(FolderError, match="no column lost_share"):
        columns.summary_columns(results_of({}, False), ["lost_share"])


def test_failed_lanes_are_counted_in_rows_that_are_not_printed_too():
    results = results_of({"attack.magnitude": [1, 2, 3]}, False, 3)
    results.cells["failed"], results.cells["lanes"] = [0, 1, 2], [5, 6, 7]
    text = one_line([tables.summary_text(results, ["tail_mean"], most=1)])
    assert "3 of 18 lanes failed" in text


def test_a_cell_without_attack_is_not_counted_among_those_that_hold():
    results = results_of({"attack.magnitude": [0, 1, 2]}, True, 3)
    results.cells["unrecovered"] = [math.nan, 0.0, 0.2]
    results.cells["unrecovered"] = [math.nan, 0.0, 1.0]
    first, _ = tables.held_lines(results, results.study.cells)
    assert one_line([first]) == (
        "In 1 of 2 attacked cells all lanes ended unrecovered: cell 2 (ā = 2 m)"
    )


def test_warnings_are_of_the_cells_that_are_shown():
    results = results_of({"attack.magnitude": [1, 2, 3]}, False, 3)
    results.cells["tail_mean_median"] = [1e9, 0.1, 1e9]
    assert "farthest start) in cells 0, 2" in one_line([tables.summary_text(results)])
    assert "fleet is lost" not in tables.summary_text(results, where={"attack.magnitude": 2.0})
    assert "farthest start) in cell 2" in tables.formatted(
        results, "latex", where={"attack.magnitude": 3.0}
    )


def test_notes_are_of_the_rows_that_are_shown():
    """Labels and failures of other cells are not explained."""
    kinds = [{"kind": "w_msr", "F": F, "label": f"F={F}"} for F in (1, 2)]
    results = results_of({"defence": kinds}, True, 2)
    results.cells["failed"], results.cells["lanes"] = [0, 3], [5, 8]
    text = tables.summary_text(results, ["tail_mean"], {"defence": "F=1"})
    assert "F=1: kind w_msr, F 1" in text
    assert "F=2" not in text
    assert "failed" not in text


def test_what_is_the_same_in_all_cells_is_one_line():
    """Numbers of lanes, and a key that `where` leaves one value."""
    results = results_of({"attack.magnitude": [1, 2], "tick": [0.05, 0.1]}, True, 4)
    text = tables.summary_text(results, where={"tick": 0.1})
    assert "each cell: tick [s] 0.1, lanes ok 5, lanes failed 0" in text
    assert "tick" not in text.splitlines()[0]


def test_columns_are_chosen_and_cells_sorted():
    """By the names of cells.csv; a metric alone is its median; another name is refused."""
    results = results_of({"attack.magnitude": [1, 2, 3]}, True, 3)
    shown = columns.summary_columns(results, ["tail_max", "unrecovered"], sort="-tail_mean_mean")
    names = ["cell", "attack.magnitude", "tail_max_median", "unrecovered"]
    assert [each.name for each in shown] == names
    assert shown[0].values == [2, 1, 0]
    with pytest.raises(FolderError, match=r"no column speed \(there are attack.magnitude, "):
        columns.summary_columns(results, ["speed"])
    with pytest.raises(FolderError, match=r"no column tail_men \(did you mean 'tail_mean'\?\)"):
        columns.summary_columns(results, ["tail_men"])


def test_long_labels_are_wrapped(monkeypatch):
    """A label of 90 letters takes some lines, and loses none."""
    monkeypatch.setenv("COLUMNS", "80")
    graphs = [{"kind": "star", "label": letter * 90} for letter in "qz"]
    results = results_of({"topology": graphs, "attack.magnitude": [1, 2]}, True, 4)
    text = tables.summary_text(results)
    assert max(map(len, text.splitlines())) <= 80
    assert text.count("z") == 3 * 90  # of two cells, and of the note


def test_numbers_stand_at_the_right_and_brackets_are_no_markup():
    table = {"name": ["[red]a", "b"], "size of it all": [1.5, float("nan")]}
    assert printer.table_text(table, ["name"]).splitlines() == [
        "        size of",
        "name     it all",
        "[red]a      1.5",
        "b             -",
    ]


def test_labels_give_way_to_numbers():
    """Down to a letter; words of letters twice as wide are broken where they are too long."""
    table = {"name": ["ab cd", "中文"], "n": [1, 22]}
    assert printer.table_text(table, ["name"], 7).splitlines() == [
        "nam   n",
        "e",
        "ab    1",
        "cd",
        "中   22",
        "文",
    ]
    assert printer.table_text(table, ["name"], 1).splitlines()[:2] == ["n   n", "a"]


def test_a_table_for_a_paper():
    """booktabs, symbols, units and intervals; no column that is the same everywhere."""
    results = results_of({"attack.magnitude": [1, 2], "defence": ["none", "w_msr"]}, False, 4)
    text = formats.in_format(
        columns.summary_columns(results, ["tail_mean", "tail_max_max", "ok"]), "latex"
    )
    assert text.splitlines() == [
        r"% \usepackage{booktabs}",
        "% each cell: lanes ok 5",
        r"\begin{tabular}{rlrr}",
        r"\toprule",
        r"$\bar a$ [m] & defence & error, median [m] & worst vehicle, max [m] \\",
        r"\midrule",
        r"1 & no~defence & 0.123 [0.123, 0.123] & 1.12 \\",
        r" & W-MSR & 1.12 [1.12, 1.12] & 2.12 \\",
        r"\addlinespace",
        r"2 & no~defence & 2.12 [2.12, 2.12] & 3.12 \\",
        r" & W-MSR & 3.12 [3.12, 3.12] & 4.12 \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]
    small = columns.plain_column("x", [1e-7, 2.5e12])
    typeset = [r"1$\cdot10^{-7}$", r"2.5$\cdot10^{12}$"]
    assert [formats.latex_text(text) for text in small.texts()] == typeset
    assert formats.latex_number("-3.5 [-4, -]") == "$-$3.5 [$-$4, --]"
    assert formats.latex_number("-2e-07 [-, 1]") == r"$-$2$\cdot10^{-7}$ [--, 1]"


def test_what_attacks_leave_of_the_papers_is_said_with_the_cells():
    """Of those that ā does not bound and those whose derivatives are none; of others nothing."""
    attacks = ["rotating", "freeze", "spoof", {"kind": "bias", "orders": [0]}, "replay"]
    study = systems.study(sweep={"attack": attacks})
    assert tables.caveat_lines(study.cells) == [
        "attack not bounded by ā: cells 1, 4",
        "attack derivatives falsified each on its own: cells 2, 3",
    ]


@pytest.mark.parametrize("width", [40, 80, 120])
@pytest.mark.parametrize("last", [["tail_mean_median"], ["outside_max", "spread_median"]])
def test_the_asked_share_and_the_median_error_go_last(last, width, monkeypatch):
    """Metrics that stand before the error go first."""
    monkeypatch.setenv("COLUMNS", str(width))
    pair = pd.DataFrame({"value": [1.0, 2.0], "low": [0.1234, 1.234], "high": [1.234, 2.345]})
    first = ["lost_share"]
    names = [*first, *(f"alarms_{each}" for each in range(20)), *last, "tail_mean_q95"]
    whole = [columns.Column(name, name, name, pair, ("low", "high")) for name in names]
    left = [each.name for each in printer.narrow_columns(whole)[0]]
    assert [each.name for each in printer.narrow_columns(whole[:1])[0]] == first[:1]
    assert left[:1] == first
    assert {*last} <= {*left} or {*left} <= {*first, *last}
    assert width == 40 or {*last} <= {*left} != {*names}


@pytest.mark.parametrize("names", [(), ["tail_mean", "tail_max", "unrecovered"]])
def test_a_pivoted_table_keeps_to_the_width_and_has_every_column(names, monkeypatch):
    """As several tables, each with the other keys."""
    sweep = {"defence": ["none", "w_msr"], "attack.magnitude": range(1, 13)}
    monkeypatch.setenv("COLUMNS", "80")
    text = tables.summary_text(results_of(sweep, True, 24), names, pivot="attack.magnitude")
    assert max(map(len, text.splitlines())) <= 80
    rows = [line for line in text.splitlines() if line.startswith(("no\xa0defence", "W-MSR"))]
    numbers = sum(len(row.replace("no\xa0", "").split()) - 1 for row in rows)
    assert numbers == 24 * max(1, len(names))


def test_a_narrow_table_drops_intervals_and_says_so(monkeypatch):
    """And says nothing of ends that it does not show."""
    results = results_of(LONG, True, 8)
    for width, shown in ((80, False), (200, True)):
        monkeypatch.setenv("COLUMNS", str(width))
        text = " ".join(tables.summary_text(results).split())
        assert ("[low, high] of error, median:" in text) == shown
        assert ("left out: some intervals" in text) == (not shown)


def test_rounding_is_zero():
    """Errors below 1e-9 of ā."""
    results = results_of({"attack.magnitude": [1, 1000]}, False, 2)
    results.cells["tail_mean_median"] = [5e-19, 5e-7]
    results.cells["tail_mean_median_low"] = [4e-19, 4e-7]
    results.cells["tail_mean_median_high"] = [0.3, float("nan")]
    found = columns.summary_columns(results, ["tail_mean"])
    assert found[-1].texts() == ["0 [0, 0.3]", "0 [0, -]"]
    assert r"1000 & 0 [0, --] \\" in formats.in_format(found, "latex").splitlines()


def test_a_table_for_a_paper_says_what_its_numbers_are():
    """Definition, intervals, samples and horizon are comments, so they travel with it."""
    results = results_of({"attack.magnitude": [1, 2]}, True, 2)
    vars(results)["manifest"] = {"samples": 5}
    found = columns.summary_columns(results, ["unrecovered"])
    notes = [*tables.summary_notes(results, found), tables.setting_note(results)]
    lines = formats.in_format(found, "latex", notes).splitlines()
    comments = " ".join(each for each in lines if each[0] == "%")
    share = "[low, high] of unrecovered: exact binomial 95 % intervals (Clopper and Pearson)"
    for words in (share, "mean error over the tail > 0.1", "5 lanes a cell; horizon"):
        assert words in comments


def test_values_of_a_key_stand_across():
    """A row for each combination of the other keys, a column for each value, in every format."""
    sweep = {"attack.magnitude": [1, 2], "defence": ["none", "w_msr"], "tick": [0.05, 0.1]}
    results = results_of(sweep, True, 8)
    results.cells["unrecovered"] = [0.1 * number for number in range(8)]
    results.cells["unrecovered_low"], results.cells["unrecovered_high"] = 0.0, 1.0
    asked = columns.summary_columns(results, ["unrecovered"])
    found = columns.pivoted(asked, "defence")
    across = ["defence=none:unrecovered", "defence=w_msr:unrecovered"]
    assert [each.name for each in found] == ["attack.magnitude", "tick", *across]
    assert found[2].bare().texts() == ["0", "10", "40", "50"]
    assert found[3].bare().texts() == ["20", "30", "60", "70"]
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
    results = results_of({"attack.magnitude": list(range(1, 73))}, False, 72)
    cut = tables.summary_text(results, ["tail_mean"])
    assert "… 12 more rows: `show --all` has all, `show --where KEY=VALUE` some" in cut
    whole = tables.summary_text(results, ["tail_mean"], most=None)
    assert len([line for line in whole.splitlines() if line.strip()[:1].isdigit()]) == 72


def curve_of(
    ended: int, fits: dict, greater: float = 1.0, width: float = math.nan, median: float = 1.0
) -> Curve:
    """A curve of two magnitudes, with lanes that ended at the first `ended` of them.

    Errors per ā have the mean 1, then `greater`, with intervals of this width to each side, and the
    median 1, then `median`, with intervals of 0.3.
    """
    sizes, there = np.array([1.0, 2.0]), np.where(np.arange(2) < ended, 1.0, math.nan)
    counts = {"ok": 40 * (there == 1), "failed": 40 * (there != 1)}
    cells = dict.fromkeys(("tail_max_max", "tail_mean_max"), sizes * there)
    for metric in SUMMARISED:
        for name, last, each in (("", greater, width), ("_median", median, 0.3)):
            value, half = sizes * there * [1.0, last], sizes * each
            cells[f"{metric}{name or '_mean'}"] = value
            cells |= {f"{metric}{name}_low": value - half, f"{metric}{name}_high": value + half}
    exponents = {"tail_mean": (1.0, math.nan, math.nan)}
    return Curve(Group({}, ()), pd.DataFrame(counts | cells, sizes), {}, fits, exponents)


@pytest.mark.parametrize(
    ("fit", "errors", "words"),
    [
        ((2.2, 2.1, 2.3), (2, {}), "2.2 ā [2.1, 2.3]"),
        # means that differ by less than their intervals, by little, by more
        ((2.2, 2.1, 2.3), (2, {"greater": 0.5, "width": 0.3}), "2.2 ā [2.1, 2.3]"),
        ((2.2, 2.1, 2.3), (2, {"greater": 0.9, "width": 0.01}), "2.2 ā [2.1, 2.3]"),
        ((2.2, 2.1, 2.3), (2, {"greater": 0.5, "width": 0.2}), "bent -"),
        # of means without intervals nothing is said, so the medians decide
        ((2.2, math.nan, math.nan), (2, {"greater": 0.3}), "2.2 ā [-]"),
        ((2.2, math.nan, math.nan), (2, {"median": 0.3}), "bent -"),
        ((2.2, 2.1, 2.3), (2, {"median": 0.3, "width": 0.1}), "2.2 ā [2.1, 2.3]"),
        ((2.2, 2.1, 2.3), (1, {"greater": 0.3}), "one ā: 2.2 ā [2.1, 2.3]"),
        ((math.nan,) * 3, (2, {}), "flat -"),
        ((5e-20, 4e-20, 0.35), (2, {}), "0 ā [0, 0.35]"),
        (None, (2, {}), "- -"),
        (None, (0, {}), "all failed -"),
    ],
)
def test_a_slope_is_told_or_why_there_is_none(fit, errors, words):
    fits = {} if fit is None else {("tail_mean", None): fit}
    curve = curve_of(errors[0], fits, **errors[1])
    assert " ".join(slopes.slope_texts(curve)) == words


def test_a_lost_fleet_is_told_as_lost():
    """Whatever its errors are by."""
    curve = curve_of(2, {("tail_mean", None): (2.2, 2.1, 2.3)}, greater=0.5, width=0.2)
    swept = systems.study(attack="bias", sweep={"attack.magnitude": [1, 2]}).cells
    curve = curve._replace(group=Group({}, (*swept,)))
    text = one_line([slopes.errors_text([curve], [1])])
    assert "lost - " in text
    assert "lost: the median error is over 1,000 times the sum of ā and the farthest start" in text
    assert "bent" not in text
    assert "bent -" in one_line([slopes.errors_text([curve], [2])])


def test_the_share_the_median_and_the_worst_vehicle_stay_in_a_narrow_terminal(monkeypatch):
    """What a study measures besides goes first; titles take three lines at most."""
    monkeypatch.setenv("COLUMNS", "80")
    sweep = {"topology": ["cyclic"], "defence": ["trusted_trim"], "attack.magnitude": [1, 2]}
    results = results_of(sweep, True, 2)
    own = [{"kind": "settling_time", "below": 0.5}, "alarms", "false_alarms"]
    detector = {"kind": "distance", "threshold": 0.1}
    keys = {"recovery": {"tau": 0.1}, "metrics": own, "detector": detector}
    results.study.config = systems.study(**keys).config
    names = ["settling_time", "alarms", "false_alarms"]
    for name in (f"{each}_{end}" for each in names for end in COLUMNS_OF_METRIC):
        results.cells[name] = [0.25, 0.5]
    results.cells["unsettled"] = 0.1
    lines = tables.summary_text(results).splitlines()
    head = lines[: next(n for n, line in enumerate(lines) if line.startswith("   0"))]
    assert len(head) == 3
    assert {"unrecovered", "median", "worst", "vehicle,"} <= {*" ".join(head).split()}
    assert "alarms, mean" in " ".join(" ".join(lines).partition("left out: ")[2].split())


@pytest.mark.parametrize(
    ("most", "lanes", "shown"),
    [(0.158, 20, "[-]"), (0.139, 20, "(alike)"), (0.139, 1, "[-]")],
)
def test_a_slope_without_an_interval_says_why(most, lanes, shown, monkeypatch):
    """One lane is not alike others."""
    monkeypatch.setenv("COLUMNS", "120")
    sizes = {None: 0.139, 1.0: most}
    fits = {("tail_mean", each): (size, math.nan, math.nan) for each, size in sizes.items()}
    curve = curve_of(2, fits)
    curve.cells["ok"] = lanes
    text = one_line([slopes.errors_text([curve])])
    assert f"0.139 ā {shown} 1 ā" in text
    assert ("[-]: too few independent lanes for an interval" in text) is (shown == "[-]")
    assert ("(alike): all lanes have the same error per ā" in text) is (shown == "(alike)")


def test_a_worst_lane_comes_with_the_number_of_lanes():
    """Of how many it is the greatest, and what this number says of all others."""
    results = results_of({"attack.magnitude": [1, 2]}, False, 2)
    results.cells["ok"] = [3, 5]
    note = tables.summary_notes(results, columns.summary_columns(results))[-1]
    assert note == (
        "max: greatest of 3 to 5 lanes of a cell; at most 63.2 % of all possible lanes are above,"
        " with 95 % confidence"
    )
    results.cells["ok"], results.cells["failed"], results.cells["lanes"] = [1, 5], [4, 0], 5
    note = tables.summary_notes(results, columns.summary_columns(results))[-1]
    assert (
        "greatest of 1 to 5 lanes of a cell; at most 95 % of all lanes that end are above" in note
    )


@pytest.mark.parametrize(
    ("slope", "error", "told"),
    [(0.0, 1e-12, "0 ā"), (7.0, 1e-12, "7 ā"), (2.0, 0.5, "2 ā"), (math.nan, 1e-12, None)],
)
def test_a_bound_stands_in_multiples_of_the_attack(slope, error, told):
    """Whatever the worst error beside it is, 0 too; a bound that no group has has no column."""
    curve = curve_of(2, {("tail_mean", None): (error, math.nan, math.nan)})
    curve.cells["tail_max_max"] = error * curve.sizes
    curve = curve._replace(bounds={("static", "worst"): slope, ("lyapunov_printed", "worst"): 9.0})
    table = slopes.curve_texts(curve)
    assert table["worst error"] == f"{0 if error < 1e-9 else error:g} ā"
    text = slopes.errors_text([curve])
    assert table["static"] == (told or "-")
    assert ("static: bounds of theory" in text) is (told is not None)
    assert "9 ā" not in text  # false in general


def test_a_worst_error_that_is_no_multiple_is_in_metres():
    """Of two magnitudes, 1 m and 2 m, the second has errors of 3 m; with a bound it is compared."""
    curve = curve_of(2, {}, median=0.3)
    curve.cells["tail_max_max"] = [1.0, 3.0]
    assert slopes.curve_texts(curve)["worst error"] == "3 m"
    bounded = curve._replace(bounds={("peak_gain", "worst"): 8.0})
    assert slopes.curve_texts(bounded)["worst error"] == "1.5 ā"


def test_fits_show_swept_values_as_the_summary_does():
    """Names of kinds, drawn vehicles and units; what is rounding is 0."""
    group = Group({"attack.vehicles": '{"random": 1}', "defence": "w_msr"}, ())
    curve = Curve(group, pd.DataFrame(), {}, {}, {})
    table, labels = slopes.group_columns([(curve, {"mean": "0.1"})])
    assert [*map(str, table)] == [*labels, "mean"]
    assert [str(each) for (each,) in table.values()] == ["1 drawn", "W-MSR", "0.1"]
    assert "attacked" in labels[0]


def test_where_lanes_failed_their_share_comes_first_with_its_interval(monkeypatch):
    """Clopper and Pearson, and it stays in a narrow terminal."""
    results = results_of({"attack.magnitude": [1, 2]}, False, 2)
    results.cells["failed"], results.cells["lanes"] = [0, 3], [30, 30]
    monkeypatch.setenv("COLUMNS", "60")
    text = tables.summary_text(results)
    shown = columns.summary_columns(results)
    ends = [binomtest(many, 30).proportion_ci(0.95) for many in (0, 3)]
    told = [f"[{100 * low:.1f}, {100 * high:.1f}]".replace(".0,", ",") for low, high in ends]
    assert shown[2].texts() == [f"0 {told[0]}", f"10 {told[1]}"]
    assert "failed" in text.partition("left out")[0]


def test_a_column_that_is_asked_for_is_shown_however_narrow(monkeypatch):
    results = results_of(LONG, True, 8)
    names = ["tail_mean", "tail_mean_mean", "tail_mean_q95", "tail_max_max"]
    monkeypatch.setenv("COLUMNS", "40")
    text = tables.summary_text(results, names)
    assert "left out: some intervals; all" in " ".join(text.split())
    assert len(text.splitlines()[-6].split()) >= len(names)


def test_failures_are_told_by_cell_and_reason(monkeypatch):
    """Cells that failed wholly apart from others, and one command for the first lane."""
    results = results_of({"attack.magnitude": [1, 2, 3, 4]}, False, 4)
    results.cells["lanes"] = [5, 5, 5, 5]
    rows = [(cell, sample, "disconnected", 2, 0.5) for cell in (1, 2) for sample in range(5)]
    rows.append((3, 4, "diverged", 0, np.nan))
    named = pd.DataFrame(rows, columns=["cell", "sample", "status", "cut_off", "cut_off_at"])
    vars(results).update(
        manifest={"lanes": {"failed": 11}}, by_cell=lambda *_, **__: named.groupby("cell")
    )
    monkeypatch.setenv("COLUMNS", "120")
    lines = tables.failures_text(results).replace("\N{NO-BREAK SPACE}", " ").splitlines()
    assert lines[:2] == [
        "failed: 10 disconnected of 10 lanes in cells 1, 2 (ā = 2 and 3 m)",
        "failed: 1 diverged of 5 lanes in cell 3 (ā = 4 m)",
    ]
    assert lines[4].startswith("the first: cell 1: ā = 2 m, sample 0")
    assert "sample 0: disconnected, vehicle 2 since 0.5 s" in lines[4]
    assert len([line for line in lines if "replay" in line]) == 1


def test_a_failed_cell_is_named_in_words_and_whole(monkeypatch):
    """As its row of the table is, at 80 columns too: W-MSR for w_msr, no label cut off."""
    label = "a lattice with three leaders and four neighbours"
    topology = [{"kind": "lattice", "neighbours": 4, "label": label}, "cyclic"]
    sweep = {"topology": topology, "defence": ["none", "w_msr"]}
    cell = systems.study(vehicles=9, sweep=sweep).cells[1]
    monkeypatch.setenv("COLUMNS", "80")
    assert cell_title(cell) == f"cell 1: {label}, W-MSR"
    assert cell_title(cell, 20) == "cell 1: a lattice w…"
    assert numbered_words([1], [cell]) == "cell 1"
