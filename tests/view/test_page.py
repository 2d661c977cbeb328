"""The report page: the folder's numbers, nothing fetched, every plot drawn, in any light."""

import base64
import io
import json
import re
import shutil
from dataclasses import replace
from html import unescape
from operator import attrgetter

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
import xarray as xr
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from upath import UPath

import jaxnet
from jaxnet.api import writing
from jaxnet.lanes import jobs
from jaxnet.model.graph import dense
from jaxnet.model.wording import number_text
from jaxnet.runs import replay as rerun
from jaxnet.runs import watched
from jaxnet.runs.replay import replay
from jaxnet.statistics import curves, pairs
from jaxnet.statistics.separation import start_separations
from jaxnet.store.results import Results
from jaxnet.view import page
from jaxnet.view.drawings.drawing import Drawing, Look, Panel, Scale, Trace
from jaxnet.view.drawings.heat import PALETTE
from jaxnet.view.drawings.scene import headings
from jaxnet.view.drawings.ultimate import ultimate_drawing
from jaxnet.view.figures import every
from jaxnet.view.figures.printed import printed
from jaxnet.view.page import (
    best,
    elements,
    findings,
    grid,
    proved,
    sections,
    setting,
    trajectories,
    where,
)
from jaxnet.view.page.comparison import comparison_page
from jaxnet.view.page.judged import judged_lanes
from jaxnet.view.page.plots import axis, plotted
from jaxnet.view.text import check, comparison, tables, worst
from jaxnet.view.text.slopes import errors_text
from tests import systems

HOSTILE = "<script>alert('ring')</script> & <b>more $x$"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two topologies, one with a hostile label, by three ā, with all that other commands write."""
    topologies = ["star", {"kind": "cyclic", "label": HOSTILE}]
    keys = {"samples": 3, "horizon": 1.0, "tail": 0.5, "recovery": {"tau": 0.01}}
    keys["sweep"] = {"topology": topologies, "attack.magnitude": [0, 1, 10]}
    keys["save"] = {"errors": True, "trajectories": "all"}
    study = systems.study(engine="exact", **keys)
    results = jaxnet.run(study, tmp_path_factory.mktemp("page") / "out")
    replay(results, 5, 2)
    share = pd.read_csv(results.path / "cells.csv")
    share["unrecovered"] = [np.nan, 0.25, 0.5, np.nan, 0.75, 1.0]
    share["unrecovered_low"] = share["unrecovered"] - 0.1
    share["unrecovered_high"] = share["unrecovered"]
    for name in ("median", "mean", "q95"):  # a column that reads alike everywhere is one line
        share[f"tail_mean_{name}"] *= 1 + 0.1 * np.arange(6)
    share.loc[[2, 5], "tail_max_median"] = 10 * share["tail_max_median"][[1, 4]].to_numpy()
    share.to_csv(results.path / "cells.csv", index=False)
    slopes, fits = [], []
    for place, topology in enumerate(("star", HOSTILE), 1):
        for vehicle in (*range(1, 13), "worst", "fleet"):
            gain = place * (vehicle if vehicle in range(13) else 12)
            printed, static = (np.inf, "") if place == 2 else (40, 7.25)
            bounds = {"static": static, "peak_gain": gain, "lyapunov_printed": printed}
            slopes += [[topology, bound, vehicle, slope] for bound, slope in bounds.items()]
        fits += [
            [topology, "tail_max", "proportional", "", "s", 3.5 * place, 3, 4, -8.0],
            [topology, "tail_max", "proportional", 0.95, "s", 6.5, 6, 7, ""],
            [topology, "tail_max", "affine", "", "s", 99, 98, 100, -7.0],
            [topology, "tail_mean", "proportional", "", "s", *[""] * 3, 9.0],
        ]
    columns = ["topology", "bound", "vehicle", "slope"]
    pd.DataFrame(slopes, columns=columns).to_csv(results.path / "bounds.csv", index=False)
    columns = ["topology", "metric", "model", "quantile", "parameter"]
    columns += ["estimate", "low", "high", "aicc"]
    pd.DataFrame(fits, columns=columns).to_csv(results.path / "fit.csv", index=False)
    violation = [[4, 1, "peak_gain", 30.0, 20.0, "jaxnet replay out --cell 4 --sample 1"]]
    columns = ["cell", "sample", "bound", "tail_max", "limit", "command"]
    pd.DataFrame(violation, columns=columns).to_csv(results.path / "violations.csv", index=False)
    return results.path


@pytest.fixture(scope="module")
def html(folder):
    """The page's text."""
    path = page.write_page(jaxnet.open(folder))
    assert path == folder / "report.html"
    return path.read_text()


def section(html: str, name: str) -> str:
    """One section of the page."""
    return re.search(rf'<section id="{name}">.*?</section>', html, re.DOTALL)[0]


def rows_of(text: str) -> list[list[float]]:
    """Numbers in a table's rows as they are for sorting, NaN where there is none."""
    rows = re.findall(r"<tr data-cells=.*?>(<td.*?)</tr>", text)
    cells = [re.findall(r'<td class="number"(?: data-value="(.*?)")?>', row) for row in rows]
    return [[float(value) if value else np.nan for value in row] for row in cells]


def test_the_summary_has_the_numbers_of_cells_csv(folder, html):
    """All cells, in full precision."""
    stored = pd.read_csv(folder / "cells.csv")
    stored["unrecovered"] *= 100
    columns = ["attack.magnitude", "unrecovered", "tail_mean_median", "tail_max_max"]
    columns += ["tail_mean_mean", "tail_mean_q95"]
    text = section(html, "summary")
    shown = np.array(rows_of(text))
    np.testing.assert_array_equal(shown[:, 0], range(6))
    np.testing.assert_array_equal(shown[:, 1:], stored[columns])
    low, high = 100 * stored.loc[1, ["unrecovered_low", "unrecovered_high"]]
    assert f"<small>[{low:.3g}, {high:.3g}]</small>" in text
    assert "Each cell: lanes ok 3, lanes failed 0." in text


def told(tmp_path, errors, failed=(), cells=(), bounds=None, hulls=3, **keys) -> str:
    """Findings of a study of three samples whose cells have these mean tail errors."""
    made, errors = systems.study(samples=3, **keys), np.array(errors)
    statuses = [*failed, *["ok"] * (3 - len(failed))]
    rows = pd.DataFrame({"cell": 0, "sample": range(3), "status": statuses})
    rows = rows[rows["status"] != "ok"] if failed else rows
    results = Results(UPath(tmp_path))
    table = {"ok": np.where(np.isnan(errors), 0, 3), "tail_mean_median": errors}
    table |= {"tail_max_max": 2 * errors, "tail_mean_median_low": 0.5 * errors}
    table |= {"tail_mean_median_high": 1.5 * errors, "tail_mean_max": errors, **dict(cells)}
    table.setdefault("spread_max", errors)
    table["failed"] = np.where(np.isnan(errors), 3, 0)

    def by_cell(*columns, where=None, cells=None):
        if cells is None and "outside" not in columns:
            yield from rows.groupby("cell")
            return
        for cell in sorted(cells or range(len(errors))):  # all lanes of a cell are alike
            lanes = {"sample": range(hulls if "outside" in columns else 12), "status": "ok"}
            lanes[made.cells[0].scenario.judged] = errors[cell]
            lanes["outside"] = table.get("outside_median", errors)[cell]
            yield cell, pd.DataFrame(lanes)

    lanes = {"ok": 3 * len(errors) - len(failed), "failed": len(failed), "total": 3 * len(errors)}
    vars(results).update(
        study=made,
        cells=pd.DataFrame(table),
        manifest={"samples": 3, "lanes": lanes},
        by_cell=by_cell,
    )
    if bounds is not None:
        slopes = [[name, "worst", slope] for name, slope in bounds.items()]
        pd.DataFrame(slopes, columns=["bound", "vehicle", "slope"]).to_csv(tmp_path / "bounds.csv")
    theory = check.networks(made.cells)
    return findings.findings_section(results, curves.curves(results), "jaxnet fit x", theory).body


def test_cells_that_are_not_all_of_a_value_are_told_with_it():
    """Cells 0 and 1 of those without a defence; all of them; and some of each defence."""
    sweep = {"defence": ["none", "w_msr"], "attack.magnitude": [1, 2, 3]}
    results = Results(UPath("nowhere"))
    vars(results).update(study=systems.study(sweep=sweep, **ROTATING))
    for numbers, words in (
        ([0, 1], "with no\xa0defence, ā\xa0=\xa01 or 2\xa0m (2 cells)"),
        ([0, 1, 2], "with no\xa0defence (3 cells)"),
        (
            [0, 2, 4],
            "with no\xa0defence, ā\xa0=\xa01 and 3\xa0m; or with W-MSR, ā\xa0=\xa02\xa0m (3 cells)",
        ),
        (
            [0, 1, 3],
            "with no\xa0defence, ā\xa0=\xa01 and 2\xa0m; or with W-MSR, ā\xa0=\xa01\xa0m (3 cells)",
        ),
    ):
        assert where.where_words(results, numbers) == words


def test_the_page_begins_with_what_was_found(html):
    """Before all else, in words; names of cells are text."""
    assert re.findall(r'<section id="(.*?)"', html)[:3] == ["findings", "answer", "run"]
    text = unescape(re.sub("<.*?>", "", section(html, "findings").replace(HOSTILE, "ring")))
    text = text.replace("\xa0%", " %")
    for words in (
        "Lanes that do not recover (mean error over the tail > 0.01\xa0ā), and error of the median",
        "(least bound: peak gain 24 ā, once the transient is over). ",
        "1 lane above a bound: see below.",
    ):
        assert words in text


LATTICE = {"kind": "lattice", "neighbours": 4}
ROTATING = {"attack": {"kind": "rotating", "magnitude": 10}}
SIZES = {"sweep": {"attack.magnitude": [0, 1, 10]}}
DEFENCES = {"sweep": {"defence": ["none", "w_msr"], "attack.magnitude": [1, 10]}}
SHARES = {key: [0.5, 0.75, 1.0, 1.0] for key in curves.SHARE_COLUMNS}
BLANK = {key: [np.nan] for key in ("tail_mean_median_high", *curves.SHARE_COLUMNS)}
SOUND = {"static": 8.0, "peak_gain": 12.0, "lyapunov_printed": 1.0, "star_norm": np.inf}
ALONE = ROTATING | {"cells": BLANK, "bounds": SOUND, "recovery": {"tau": 0.1}}
LOST = ROTATING | {"failed": ["singular", "stuck", "singular"], "bounds": {"static": 1.0}}


SEVERAL = {"sweep": {"defence": ["none", "w_msr", "centerpoint"]}} | ROTATING
WIDE = {"unrecovered": [0.1, 0.2, 0.3], "unrecovered_low": 0.0, "unrecovered_high": 0.5}
MANY, FOUR = [9.0, 2.0, 5.0], [4.0, 20.0, 1.0, 20.0]
JUDGED = DEFENCES | {"cells": SHARES, "recovery": {"tau": 0.1}}
FALLING = SEVERAL | {"cells": {"falling": [0.0, 1.0, 0.0]}}
HULL = {"navigator": "none", "vehicle": "single_integrator", "gain": [1], "law": "local"}
HULL |= ROTATING | {
    "recovery": {"tau": 0.1},
    "sweep": {"attack.magnitude": [0, 10], "defence": ["none", "w_msr"]},
}
ENDS = {"": 0.25, "_low": 0.125, "_high": 0.5}
OUTSIDE = {"outside_median": [1e-3, 0.0, 2.0, 0.01], "outside_max": [1e-3, 0.02, 3.0, 0.1]}
OUTSIDE |= {f"in_hull{end}": [1.0, 0.9, each, 0.95] for end, each in ENDS.items()}
OUTSIDE |= {
    "spread_median": [0.01] * 4,
    **{key: [np.nan] * 2 + [0.0] * 2 for key in curves.SHARE_COLUMNS},
}
HULL |= {"cells": OUTSIDE}
CALM = HULL | {"cells": OUTSIDE | {"outside_median": [1.0, 0.0, 2.0, 0.01]}}
UNATTACKED, ROUNDED = {"attack": "none"}, LOST | {"failed": ()}
CUTS = {"detector.cuts": ["never", "message", "link", "both_ways"]}
CUTS = {"sweep": CUTS, "detector": "chi_squared", "channel": {"noise": {"position": 0.1}}}
CUTS |= ROTATING | {"tick": 0.1}
TOLD = [
    (
        FOUR,
        CUTS,
        "<p><b>Best alarms cut: link</b>. There the error of the cell's median lane is <b>1 m</b>",
    ),
    (
        FOUR,
        CUTS,
        "<li><b>Detectors know the true motion</b> in every cell: an ideal observer",
    ),
    (
        MANY,
        SIZES,
        '<tr><th scope="row">1</th><td>error 2\xa0m</td></tr><tr><th scope="row">10</th>',
    ),
    (MANY, SIZES, "<li>Cells without an attack are not in this table.</li>"),
    (MANY, SIZES, "<b>Without an attack</b> the error of the median lane is <b>9 m</b>.</li>"),
    (
        MANY,
        SIZES | {"recovery": {"tau": 1.0}},
        "is <b>9 m</b>: with ā\xa0=\xa01\xa0m (cell 1) this alone is above what recovery allows,",
    ),
    (
        [2.0, 2.1, 20.0, 200.0],
        {"sweep": {"defence": ["w_msr", "none"], "attack.magnitude": [10, 100]}},
        "error 2.1\xa0m<br>vs none: smaller error</td></tr>",
    ),
    (
        [1e-12, 1e-11, 1e-12],
        {"sweep": {"attack.magnitude": [1, 10, 100]}},
        "<td>error ≈ 0\xa0m</td>",
    ),
    (MANY, SIZES, "Bounds are not fitted yet: <code>jaxnet fit x</code>"),
    (
        [2.0, 1.0, 2.0],
        SEVERAL,
        'smaller error</td></tr><tr><th scope="row">centerpoint</th><td>error 2\xa0m<br>vs none: no'
        " difference found</td>",
    ),
    ([2.0, 1.0, 9.0], SEVERAL, "error 9\xa0m<br>vs none: greater error</td>"),
    (
        [2.0, 1.0, 9.0],
        SEVERAL,
        "<p><b>Best defence: W-MSR</b>. There the error of the cell's median lane is <b>1 m</b>"
        " and that of the worst vehicle <b>2 m</b>. A vehicle may drop all of its",
    ),
    (FOUR, DEFENCES, "error 20\xa0m<br>vs none: no difference found</td></tr></tbody>"),
    (MANY, FALLING, "error 2\xa0m<br>error still falls<br>vs none: smaller error</td>"),
    (MANY, FALLING, "<b>Warning:</b> in cell 1 of 3: errors still fall when the run ends."),
    (
        FOUR,
        JUDGED | {"recovery": {"tau": 2.0}},
        '<td style="--lost: 0"><b>0 %</b><br>error 1\xa0m<br>vs none: more hold</td>',
    ),
    (
        MANY,
        SEVERAL | {"cells": WIDE, "recovery": {"tau": 0.7}},
        "no difference that counts is found: W-MSR; centerpoint</b>. There <b>0 of 12 lanes</b> in",
    ),
    (
        [20.0],
        ALONE,
        "In the median lane the error (a mean over vehicles and the tail) is <b>2 ā</b>.",
    ),
    ([20.0], ALONE, "No share unrecovered: no attacked cell has enough lanes that ended."),
    (
        [20.0],
        ALONE,
        "a vehicle is <b>40 m</b>. Per ā the worst error is <b>4 ā</b> (least bound: static",
    ),
    ([1e-12], UNATTACKED, "a mean over vehicles and the tail) is <b>0 m</b>."),
    ([1e-12], UNATTACKED, "<li>Errors have no bound beside them: no cell has an attack of a fixed"),
    ([np.nan], LOST, "No error: no lane came to its end."),
    ([np.nan], LOST, "<b>3 lanes of 3 failed</b>: 2 singular, 1 stuck."),
    (
        [1e-9],
        ROUNDED,
        "Per ā the worst error is <b>0 ā</b> (least bound: static 1 ā).",
    ),
    (
        [1e-9, 20.0],
        ROTATING | {"sweep": {"attack.vehicles": [[1], [2]]}},
        '<tr><th scope="row">2</th><td>error 20\xa0m</td></tr>',
    ),
    (
        [0.01] * 4,
        HULL,
        "<b>Honest vehicles agree, but on a place that liars move out of the hull</b> with"
        " ā\xa0=\xa010\xa0m, no\xa0defence (cell 2) within 30 s. In a longer run they may go",
    ),
    ([0.01] * 4, HULL, "<li>No test on the same draws finds a field better or worse than no"),
    (
        [1e9, 1e5],
        {"sweep": {"defence": ["none", "w_msr"]}} | ROTATING,
        "1,000 times the sum of ā and the farthest start) in cell 0 (no\xa0defence).</li>",
    ),
    (
        [0.01],
        HULL | {"sweep": {}, "cells": {key: values[2:3] for key, values in OUTSIDE.items()}},
        "hull of their starts within 30 s, in 75 % of lanes (95 % interval 50 to 87.5 %), in the"
        " median lane by <b>2 m</b> and in the worst lane by <b>3 m</b>. In a longer run they may",
    ),
    ([0.01] * 4, CALM, "Honest vehicles leave the convex hull of their starts in every cell"),
    (
        [4.0, 20.0, 1.0, 20.0, 4.0, 20.0],
        {"sweep": {"defence": ["none", "w_msr", "centerpoint"], "attack.magnitude": [1, 10]}},
        "<td>W-MSR</td><td>centerpoint</td><td>ā\xa0=\xa01\xa0m</td><td>first: smaller error</td>",
    ),
]


@pytest.mark.parametrize(("errors", "given", "sentence"), TOLD)
def test_findings(tmp_path, errors, given, sentence):
    """Errors per ā, kinds compared, bounds, failures; no number that is not there."""
    found = told(tmp_path, errors, **given).replace("\xa0%", " %")
    assert sentence in found
    assert "nan" not in found


def test_groups_without_a_bound_are_not_listed(tmp_path):
    assert "least bound" in told(tmp_path, [20.0], **ALONE)
    found = told(tmp_path, [20.0], **ALONE | {"bounds": {"lyapunov_printed": 1.0}})
    assert "least bound" not in found


def test_a_search_names_its_bounds_and_kinds(tmp_path):
    """As in all other tables; errors below rounding are 0."""
    numbers = dict.fromkeys(worst.LENGTHS, 20.0) | {"fresh_low": 1e-9, "until": 100.0, "lanes": 8}
    numbers |= {"magnitude": 10.0, "attacked": "2 5", "bound_name": ["static", "harmonic"]}
    results = Results(UPath(tmp_path))
    search = {"over": {"attack.phase": "each"}, "budget": 100}
    made = systems.study(sweep={"defence": ["none", "trusted_trim"]}, search=search, **ROTATING)
    vars(results).update(study=made, manifest={"finished": False})
    table = pd.DataFrame({"cell": [0, 1], **numbers})
    table.to_csv(tmp_path / "worst.csv", index=False)
    rows = worst.worst_rows(results)
    assert rows["defence"].tolist() == ["no\xa0defence", "trusted trimming"]
    assert rows["other draws, 5 %"].tolist() == [0, 0]
    assert worst.bounds_told(results) == (
        "bound of theory after transients, the least for the attack: harmonic (trusted"
        " trimming), static (no\xa0defence)"
    )
    table.drop(columns="bound_name").to_csv(tmp_path / "worst.csv", index=False)  # an older one
    assert worst.bounds_told(results) == ""


def test_who_hears_more_liars_than_the_defence_is_set_for_is_named_first(tmp_path):
    """By a count of neighbours one and two places away on a ring of twelve."""
    liars, cells = {2, 5, 8, 11}, {"sweep": {"topology": ["cyclic", LATTICE]}}
    ring = {i: {(i + step - 1) % 12 + 1 for step in (-2, -1, 1, 2)} for i in range(1, 13)}
    both = [i for i, heard in ring.items() if len(heard & liars) == 2]
    attack = {"attack": {"kind": "rotating", "vehicles": sorted(liars)}}
    for defence in ("trusted_trim", "w_msr"):
        first = told(tmp_path, [1.0, 2.0], **cells, **attack, defence=defence)
        named = f"vehicles {', '.join(map(str, both))} with lattice (cell 1): up to 2 attacked"
        assert f"defence</b>:<ul><li>{named} sources, more than it can drop</li>" in first
    assert "assumptions" not in told(tmp_path, [1.0, 2.0], **cells, **attack, defence="none")


def test_networks_that_are_not_robust_enough_are_named(tmp_path):
    """W-MSR asks (F + 1, F + 1)- or (2F + 1)-robustness; a complete graph of 10 is 5-robust."""
    alone = {"navigator": "none", "vehicle": "single_integrator", "gain": [1], "engine": "exact"}
    alone |= {"law": {"kind": "local", "hold": True}, "vehicles": 10}
    alone |= {"defence": {"kind": "w_msr", "F": 2}, "sweep": {"topology": [LATTICE, "complete"]}}
    alone |= {"attack": {"kind": "own_path", "vehicles": [3, 8], "moves": "as_told"}}
    nobody = {"outside_median": [0.0] * 2, "outside_max": [0.0] * 2, "spread_median": [1.0] * 2}
    found = told(tmp_path, [1.0, 1.0], **alone, cells=nobody)
    assert (
        "<li>No agreement is proved (2 attacked, at most 1 of them heard by one vehicle, and F = 2:"
        " the vehicles are neither (3, 3)-robust nor 5-robust): with lattice (cell 0).</li>"
    ) in found


def test_a_verdict_table_tells_where_the_fleet_holds(tmp_path):
    """A row a topology, a column a defence, and in a field both magnitudes; 12 lanes a cell."""
    sweep = {"topology": ["cyclic", "star"], "defence": ["none", "w_msr"]}
    keys = {"sweep": sweep | {"attack.magnitude": [10, 20]}, "recovery": {"tau": 0.1}} | ROTATING
    found = told(tmp_path, [9.0, 9.0, 0.5, 1.5, 9.0, 9.0, 9.5, 9.0], **keys)
    table = re.search(r"<table class=.verdict.*?</table>", found)[0].replace("\xa0", " ")
    assert re.findall("<th scope.*?>(.*?)</th>", table) == [
        *("topology", "no defence", "W-MSR", "cyclic", "star")
    ]
    assert re.findall(r'<td style="--lost: (\d+)">(.*?)</td>', table) == [
        ("100", "<b>100 %</b><br>error 9 m"),
        ("0", "<b>0 %</b><br>error 0.5, 1.5 m<br>vs none: more hold"),
        ("100", "<b>100 %</b><br>error 9 m"),
        ("100", "<b>100 %</b><br>error 9.5, 9 m<br>vs none: greater error in 1 of 2 cells"),
    ]
    assert (
        "<p>Lanes that do not recover (mean error over the tail &gt; 0.1 ā), and error of the"
        " median lane, for ā = 10 and 20 m in this order. 12 lanes a cell:</p>"
    ) in found.replace("\xa0", " ")
    assert "95\xa0% intervals of these shares reach at most 26.5 percentage points" in found
    found = told(tmp_path, [9.0, 8.0, 9.0, 8.0], **DEFENCES)
    assert "No test on the same draws finds a field better" in found
    found = told(tmp_path, [9.0, 9.0, 1e9, 9.0, 9.0, 9.0, 9.0, 9.0], **keys)
    assert (
        "<br>error 1e+09, 9\xa0m<br>lost 100, 0\xa0%<br>vs none: more fail or are lost in" in found
    )
    assert "<li>Lost: an error over 1,000\xa0times the sum of ā and the farthest start." in found
    found = told(tmp_path, FOUR, **DEFENCES)  # a single choice: magnitudes make the columns
    assert '<tr><th scope="col">defence</th><th scope="col">ā\xa0=\xa01\xa0m</th>' in found
    assert "<p>Error of the median lane. 12\xa0lanes a cell:</p>" in found
    assert "<td>error 4\xa0m</td>" in found  # nothing tells whether a lane holds
    assert "verdict" not in told(tmp_path, [9.0], **ROTATING)  # a single cell


def test_lanes_whose_own_graph_is_robust_enough_agree(tmp_path):
    """LeBlanc et al. 2013: on a (2, 2)- or 3-robust graph W-MSR bears one liar, whoever it is."""
    graph = {"kind": "erdos_renyi", "probability": 0.5, "redraw": True}
    keys = {"topology": graph, "navigator": "none", "vehicles": 8, "vehicle": "single_integrator"}
    keys |= {"gain": [1.0], "law": {"kind": "local", "hold": True}, "tick": 0.2, "samples": 30}
    keys |= {"horizon": 300.0, "tail": 10.0, "output_step": 1.0, "engine": "exact"}
    keys |= {"attack": {"kind": "own_path", "vehicles": {"random": 1}, "moves": "as_told"}}
    study = systems.study(**keys, recovery={"tau": 0.1}, sweep={"defence": ["none", "w_msr"]})
    results = jaxnet.run(study, tmp_path / "out", progress=False)
    lanes = judged_lanes(results, range(2))
    drawn = proved.outside_by_draw(results, lanes)
    assert not drawn[0].any()  # without a defence nothing is assumed
    unrecovered = lanes[1]["unrecovered"]
    assert 0 < drawn[1].sum() < 30
    assert not unrecovered[~drawn[1]].any()
    assert unrecovered[drawn[1]].any()
    given = results.study.config, results.study.cells[1].scenario, [3, 17]
    for sample, graph in zip(given[-1], jobs.lane_graphs(*given), strict=True):
        _, used = rerun.trajectory_of(results, 1, sample)
        np.testing.assert_allclose(dense(graph), dense(used), atol=1e-15)
    words = " ".join(check.check_text(results.study).split())
    assert "graph 8 vehicles; each lane has links of its own" in words
    assert "[W-MSR] none is proved; each lane has links of its own" in words
    assert not re.search("robust|links:|on [0-9]+ links", words)


def test_a_verdict_tells_up_to_which_magnitude_it_holds(tmp_path):
    """An error of 1 m is above 0.1 ā up to ā = 10 m, one of 3 ā / 20 always, 1e-3 ā never."""
    sizes = [5, 50, 1, 20, 2, 100]  # in any order
    sweep = {"topology": ["cyclic", "star"], "defence": ["none", "w_msr"]}
    keys = {"sweep": sweep | {"attack.magnitude": sizes}, "recovery": {"tau": 0.1}} | ROTATING
    rising, falls = [0.15 * size for size in sizes], [1e-3 * size for size in sizes]
    turns = [min(0.05, size / 200) * size for size in sizes]  # above never, as 0.1 ā is greater
    found = told(tmp_path, rising + [1.0] * 6 + falls + turns, **keys).replace("\xa0", " ")
    assert "<b>100 %</b><br>error 0.15 to 15 m" in found
    assert "<b>100 % up to ā = 5 m, 0 % from ā = 20 m</b><br>error 1 m" in found
    assert "<b>0 %</b><br>error 0.001 to 0.1 m" in found
    assert "over all values of attack magnitude. 12 lanes a cell:" in found
    keys["sweep"] = {"defence": ["none", "w_msr"], "attack.vehicles": [[1], [1, 4], [1, 4, 7]]}
    keys["sweep"] |= {"attack.magnitude": [10, 20], "topology": ["cyclic", "star"]}
    decided = [0.1] * 4 + [9.0] * 8  # by the vehicles
    mixed = [9.0, 9.0, 0.1, 0.1, 0.1, 0.1, 9.0, 9.0, 9.0, 9.0, 0.1, 0.1]  # by both settings
    found = told(tmp_path, decided + mixed, **keys).replace("\xa0", " ")
    assert "<b>0 to 100 %</b>" in found
    assert "<b>0, 100, 100 % for attacked vehicles = 1; 1, 4; 1, 4, 7</b>" in found


def test_failed_lanes_of_the_sampled_engine_come_with_what_may_help(tmp_path):
    """As `run` prints it; other engines have other reasons."""
    for engine in ("sampled", "nonlinear"):
        keys = ROTATING | {"engine": engine, "output_step": 0.5}
        found = told(tmp_path, [1.0], failed=["singular"], **keys)
        assert "<b>1 lane of 3 failed</b>: 1 singular" in found
        assert ("try vehicle.standstill: stop" in found) is (engine == "sampled")


def test_the_lead_names_what_an_envelope_holds():
    envelope = {"kind": "envelope", "of": {"kind": "bias"}, "start": 5.0}
    scenario = jaxnet.load({"attack": envelope}).cells[0].scenario
    assert setting.nested_name(scenario.attack) == "envelope of bias"


def test_a_field_counts_lanes_that_do_not_hold_as_a_vehicle_came_to_rest():
    """Of four lanes two do not hold; a vehicle stopped in one of them, and in one that holds."""
    lanes = pd.DataFrame({"fallen": [1, 1, 0, 0], "stopped": [1, 0, 1, 0]}, dtype=bool)
    assert grid.isolated_texts(lanes) == ["in 1 of these 2 lanes a vehicle came to rest"]
    assert grid.isolated_texts(lanes[["fallen"]]) == []
    assert grid.isolated_texts(lanes.iloc[1:]) == []


def test_lanes_outside_the_assumptions_of_a_defence_are_told_apart(tmp_path):
    """A vehicle of a ring hears two places to each side, so two liars within four places of one
    another have a common listener; W-MSR with F = 1 is set for one liar.
    """
    attack = {"kind": "bias", "vehicles": {"random": 2}, "magnitude": 5}
    keys = {"attack": attack, "topology": LATTICE, "samples": 20, "horizon": 20.0, "tail": 10.0}
    keys |= {"vehicle": "single_integrator", "gain": [1.0], "engine": "exact"}
    keys |= {"law": "local", "sweep": {"defence": ["none", "w_msr"]}, "recovery": {"tau": 0.01}}
    keys |= {"save": {"trajectories": "all"}}
    results = jaxnet.run(systems.study(**keys), tmp_path / "out", progress=False)
    shares, lanes = dict[bool, list[bool]](), results.lanes.set_index(["cell", "sample"])
    lies = results.trajectories["attack"].fillna(0.0)
    for sample in range(20):
        one, other = np.flatnonzero(lies.sel(cell=1, sample=sample).any(["time", "axis"]))
        beyond = min(other - one, 12 - (other - one)) <= 4
        shares.setdefault(beyond, []).append(lanes.loc[(1, sample), "tail_mean"] > 0.05)
    told_of = "{} of {} lanes outside the assumptions, {} of {} within".format(
        *(number for each in (True, False) for number in (sum(shares[each]), len(shares[each])))
    )
    body = findings.findings_section(results, [], "jaxnet fit x", []).body
    assert body.count(told_of) == 1
    assert body.count("outside the assumptions") == 1  # nothing is assumed without a defence
    assert "Outside the assumptions: lanes in which a vehicle hears more" in body


def test_of_combinations_that_none_beats_those_with_the_fewest_lanes_are_best():
    """By all cells of each: 3 lanes of a, 1 of b, 1 of c."""
    fallen = [[True, True], [True, False], [False, False], [True, False], [False, True]]
    lanes = {cell: pd.DataFrame({"fallen": each}) for cell, each in enumerate(fallen)}
    combined = pd.Series(["a", "a", "b", "b", "c"])
    assert best.fewest_fallen(combined, lanes).to_dict() == {2: "b", 3: "b", 4: "c"}


def test_the_best_combination_holds_against_every_other(tmp_path):
    """By errors: the last on the star has the least; on the ring all lanes are over 0.1 ā."""
    sweep = {"topology": ["cyclic", "star"], "defence": ["none", "w_msr"]}
    keys = {"sweep": sweep, "recovery": {"tau": 0.1}} | ROTATING
    found = told(tmp_path, [9.0, 9.0, 5.0, 0.5], **keys)
    assert (
        "<p><b>Best combination of topology and defence: star, W-MSR</b>. There <b>0 of 12"
        " lanes</b> do not recover, the error of the cell's median lane is <b>0.5 m</b> and that of"
        " the worst vehicle <b>1 m</b>.</p>"
    ) in found
    found = told(tmp_path, [9.0, 9.0, 9.0, 5.0], **keys)
    assert "star, W-MSR</b>. Even there <b>12 of 12 lanes</b> do not recover, " in found
    others = "cyclic, no\xa0defence; cyclic, W-MSR; star, no\xa0defence"
    assert f"Numbers of lanes do not tell {others} from it, only lengths do." in found
    assert "<b>Best" not in told(tmp_path, [9.0, 9.0, 9.0, 9.0], **keys)
    found = told(tmp_path, [9.0, 1e-5, 5.0, 1e-9], **keys)  # both are 0 beside 1 m
    assert "no difference that counts is found: cyclic, W-MSR; star, W-MSR</b>" in found
    sizes = {"sweep": sweep | {"attack.magnitude": [10, 20]}, "recovery": {"tau": 0.1}} | ROTATING
    found = told(tmp_path, [9.0, 9.0, 0.5, 9.0, 9.0, 9.0, 9.0, 9.0], **sizes)
    counts = "of 12 lanes a cell <b>0</b> (ā\xa0=\xa010\xa0m) and <b>12</b> (ā\xa0=\xa020\xa0m) do"
    assert f"Best combination of topology and defence: cyclic, W-MSR</b>. There {counts}" in found
    keys["sweep"] = {"topology": ["cyclic", LATTICE], "defence": ["none", "vote"]}
    found = told(tmp_path, [9.0, 0.5, 9.0, 0.6], **keys)  # all hear the navigator
    assert "Every vehicle drops all of its neighbours there, and hears the navigator alone" in found
    lossy = {"kind": "bernoulli", "probability": 0.1}
    keys["sweep"] = {
        "channel.loss": ["none", lossy],
        "defence": ["none", {"kind": "w_msr", "F": 2}],
    }
    found = told(tmp_path, [9.0, 0.5, 9.5, 0.6], **keys)  # whose choice is the loss?
    assert "<b>Best defence: W-MSR</b>. There <b>0 of 12 lanes</b> in each cell do" in found
    assert (
        "A vehicle may drop all of its neighbours there, and hears the navigator alone.</p>"
        in found
    )


def test_who_left_the_hull_does_not_come_back(tmp_path):
    """So cells whose spread still falls count; with a navigator they do not."""
    sweep = {"sweep": {"defence": ["none", "w_msr"], "attack.vehicles": [[1], [2]]}}
    cells = {"falling": [0.0, 0.0, 0.0, 1.0], "outside_median": [1.0, 1.0, 0.0, 0.0]}
    cells |= {"outside_max": [1.0, 1.0, 0.0, 0.0], "spread_median": [0.01] * 4}
    found = told(tmp_path, [0.01] * 4, hulls=12, **HULL | sweep | {"cells": cells})
    assert "<b>Best defence: W-MSR</b>. There <b>0 of 12 lanes</b> in each cell leave" in found
    assert "out 0 %<br>spread still falls<br>vs none: fewer leave the hull" in found.replace(
        "\xa0%", " %"
    )
    cells = {"falling": [0.0, 0.0, 0.0, 1.0]}
    found = told(tmp_path, [9.0, 9.0, 1.0, 1.0], **ROTATING | sweep | {"cells": cells})
    assert "<b>Best defence, where errors have settled: W-MSR</b>" in found


def test_lanes_whose_vehicles_coast_are_counted(tmp_path):
    """On a path W-MSR cuts off all vehicles but the first, in each lane, and they come to rest."""
    keys = {"vehicles": 3, "topology": "path", "engine": "exact", "samples": 2, "horizon": 1.0}
    keys |= {"attack": {"kind": "bias", "vehicles": [2]}, "vehicle": "single_integrator"}
    defence = {"kind": "w_msr", "isolated": "coast"}
    keys |= {"gain": [1.0], "tail": 0.5, "sweep": {"defence": ["none", defence]}}
    results = jaxnet.run(systems.study(**keys), tmp_path / "out", progress=False)
    assert findings.isolated_sentence(results) == (
        "A vehicle was cut off from all its sources in <b>2 of 4 lanes</b> that ended, with W-MSR"
        " (cell 1)."
    )


def test_why_nothing_is_dropped_is_told(tmp_path):
    """On a star nobody may trim; on a ring a vehicle needs all of its three sources, 0.9³."""
    cells = {"sweep": {"topology": ["star", "cyclic"]}, "defence": "trusted_trim"}
    lossy = {"channel": {"loss": {"kind": "bernoulli", "probability": 0.1}}}
    few, starved = told(tmp_path, [1.0, 2.0], **cells, **lossy).split("Outside the")[1:]
    assert "it drops nobody: the rule asks 2ϑ + 1 sources, of which ϑ are trusted</li>" in few
    assert "of the defence</b> at some ticks: in up to 27.1\xa0% of ticks" in starved
    assert "cyclic" in starved
    assert "at some ticks" not in told(tmp_path, [1.0, 2.0], **cells)


def test_the_best_and_the_worst_vehicle_of_each_cell_stand_first(folder, tmp_path, monkeypatch):
    """By their medians; all vehicles are folded."""
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("*.zarr"))
    (copy / "vehicles.zarr").mkdir()
    results = jaxnet.open(copy)
    rows = [(cell, vehicle) for cell in (0, 1) for vehicle in (1, 2, 3)]
    table = pd.DataFrame(rows, columns=["cell", "vehicle"]).assign(median=[2.0, 9, 5, 4, 1, 3])
    monkeypatch.setattr(sections, "vehicle_table", lambda *_: table)
    whole, folded = sections.vehicles_section(results).body.split("<details>")
    assert [row[:2] for row in rows_of(whole)] == [[0, 2], [0, 1], [1, 1], [1, 2]]
    assert [row[1] for row in rows_of(folded)] == [2, 3, 1, 3, 1, 2]
    table.loc[:2, "median"] = [1e-12, 3e-12, 2e-12]  # rounding has no order
    whole = sections.vehicles_section(results).body
    assert {row[0] for row in rows_of(whole)} == {1}
    assert "In cell 0 the errors of all vehicles are rounding: no ranks." in whole


def test_lanes_in_which_a_pair_comes_too_near_are_counted():
    keys = {"vehicle": "single_integrator", "gain": [1], "engine": "sampled", "horizon": 2.0}
    settled = {"kind": "settling_time", "below": 0.3}  # but for one lane without the filter
    keys |= {"tail": 1.0, "samples": 40, "metrics": ["min_separation", settled], "attack": "none"}
    keys |= {"initial": {"position": {"uniform": [-2.0, 2.0]}}, "vehicles": 4}
    results = jaxnet.simulate(keys | {"sweep": {"filter": ["none", "barrier"]}}, progress=False)
    text = findings.separation_sentence(results)
    for name, (_, lanes) in zip(
        ("no\xa0filter", "barrier"), results.lanes.groupby("cell"), strict=True
    ):
        near = lanes["min_separation"]
        told = f"in <b>{(near < 0.15).sum()}</b> of 40 lanes with {name} (least distance"
        assert f"{told} {near.min():.3g}" in text
    body = findings.findings_section(results, [], "jaxnet fit x", []).body
    assert "vs none: fewer come too near</td>" in body
    assert "smaller error" not in body  # filters are for distances
    share = 100 * (results.lanes.query("cell == 0")["min_separation"] < 0.15).mean()
    assert f"too near {share:g}\xa0%<" in body
    alone = [
        jaxnet.simulate(keys | {"filter": name}, progress=False) for name in ("none", "barrier")
    ]
    found = pairs.compare_studies(*alone)
    np.testing.assert_allclose(
        found.cells["min_separation_difference"],
        np.mean(np.subtract(*(each.lanes["min_separation"] for each in alone[::-1]))),
    )
    assert "tail_mean_difference" not in found.cells
    titles = [each.title for each in comparison.comparison_columns(found)]
    assert {"Δ least distance [m]", "Δ least distance median [m]"} <= {*titles}
    starts = jaxnet.simulate(
        keys | {"horizon": 0.05, "tail": 0.05, "output_step": 0.05}, progress=False
    )
    apart = start_separations(results.study.config, results.study.cells[1].scenario, range(40))
    assert (starts.lanes["min_separation"] <= apart + 1e-12).all()
    listed = findings.metrics_list(results, "min_separation")
    settled = r"Settling time to 0.3 m is <b>1.\d* s</b>.*; is infinite .never reached. with bar"
    assert re.search(settled, listed), listed


def test_ticks_stand_at_the_swept_values():
    """As in the PNG; decades where there is no room for them."""
    values = [0.05, 0.2, 1.0, 5.0]
    for ticks, log, texts in (
        (values, True, ["0.05", "0.2", "1", "5"]),
        ([1.0, 2.0, 3.0], False, ["1", "2", "3"]),
        ([1.0, 1.01, 1.02, 100.0], True, None),
    ):
        x, y = Scale("x", log=log, ticks=ticks), Scale("y")
        line = Trace("", Look(), np.array(ticks), np.array(ticks))
        found = axis(Drawing([Panel({}, [], [line])], x, y), "x")
        if texts is None:
            assert found["ticktext"][:2] != ["1", "1.01"]
        else:
            assert (found["tickvals"], found["ticktext"]) == (ticks, texts)


def test_rounding_is_shown_as_such(folder, tmp_path):
    """Below 1e-9 of ā, not above; slopes too; what sorts keeps its number."""
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("*.zarr"))
    cells = pd.read_csv(copy / "cells.csv")
    cells["tail_mean_mean"] = [2e-10, 2e-9, 2e-9, 2e-9, 0.9e-9, 1.1e-8]
    cells["tail_mean_low"] = -1e-12
    cells.loc[:2, "tail_max_max"] = 1e-26
    cells["unrecovered_low"] = 1e-12
    cells.to_csv(copy / "cells.csv", index=False)
    fits = pd.read_csv(copy / "fit.csv").astype({"low": float, "high": float})
    fits.loc[:2, ["estimate", "low", "high"]] = [1.38e-26, -1e-27, 2e-26]
    fits.to_csv(copy / "fit.csv", index=False)
    text = page.write_page(jaxnet.open(copy)).read_text()
    shown = cells_of(section(text, "summary"))
    zero = "0 (rounding)"
    told_each = [zero, "2e-09", zero, "2e-09", zero, "1.1e-08"]
    assert [row[6].split(" <")[0] for row in shown] == told_each
    told = re.sub("<[^>]*>", "", section(text, "summary")).replace("\N{NO-BREAK SPACE}", " ")
    assert "Errors below 1e-9 ā (1e-9 m without an attack) are shown as 0." in told
    assert [row[5] for row in shown][:3] == [zero] * 3
    assert rows_of(section(text, "summary"))[0][5] == 2e-10
    star, ring = cells_of(section(text, "ultimate"))
    assert star[1:7] == [zero, "0", *[zero] * 4]
    assert ring[3] == "7"
    assert "<b>0 ā</b> with star (" in section(text, "findings")


def cells_of(text: str) -> list[list[str]]:
    """What stands in a table's rows."""
    rows = re.findall(r"<tr data-cells=.*?>(<td.*?)</tr>", text)
    return [re.findall(r"<td.*?>(.*?)</td>", row) for row in rows]


def figures_of(html: str, within: str = "") -> list[dict]:
    """The figures of a section, or of all."""
    text = section(html, within) if within else html
    found = re.findall(r'<script type="application/json">(.*?)</script>', text, re.DOTALL)
    return [json.loads(each) for each in found]


def lanes_of(html: str) -> list[dict]:
    found = re.findall(
        r'<script type="application/json" id="lane-.*?>(.*?)</script>', html, re.DOTALL
    )
    return [json.loads(each) for each in found]


def test_what_is_alike_everywhere_is_not_drawn_first(folder):
    """Where no lane recovers, the errors are drawn, and the heat map begins with them."""
    results = jaxnet.open(folder)
    for share in curves.SHARE_COLUMNS:
        results.cells[share] = np.where(results.cells["attack.magnitude"] > 0, 1.0, np.nan)
    title = sections.answer_section(results).title
    assert title == "Error, median of lanes against attack magnitude"
    heats = re.findall("<option>(.*?)</option>", sections.heat_section(results).body)
    assert heats == ["greatest tail error / ā", "lanes unrecovered [%]"]


def test_what_is_first_on_the_page_is_drawn_in_print(folder):
    """The errors, beside the share that `curve` draws."""
    results = jaxnet.open(folder)
    drawn = results.plot.answer()
    first = figures_of(sections.answer_section(results).body)[0]
    axes = drawn.axes[0]
    assert " ".join(axes.get_ylabel().split()) == "error, median of lanes [m]"
    lines = [line.get_ydata() for line in axes.lines if line.get_linestyle() != "None"]
    known = [trace["y"] for trace in first["data"] if trace.get("mode") == "lines+markers"]
    np.testing.assert_allclose(lines, known, rtol=1e-6)


def test_what_a_config_says_is_text(html):
    """A label never becomes markup, neither on the page nor in the data nor in a plot."""
    assert "<script>alert" not in html
    assert HOSTILE in unescape(section(html, "summary"))
    assert HOSTILE in lanes_of(html)[-1]["label"]
    assert "alert" in json.dumps(figures_of(html, "answer"))
    assert HOSTILE not in json.dumps([each["data"] for each in figures_of(html)])


def test_nothing_is_fetched(html):
    """By the page's own rule, and by no address in it."""
    assert "Content-Security-Policy\" content=\"default-src 'none'" in html
    without_plotly = re.sub(r"<script>/\*\*.*?</script>", "", html, flags=re.DOTALL)
    assert len(without_plotly) < 1e6
    assert not re.search(r"(src|href)=\"(?!#|data:)|@import|url\((?!#)|fetch\(", without_plotly)


def test_plotly_accepts_every_figure(html):
    """In one colour, for those of the page are the style sheet's."""
    whole = [*figures_of(html), *(lane["errors"] for lane in lanes_of(html))]
    whole += [lane["raster"] for lane in lanes_of(html) if lane["raster"]]
    assert len(whole) > 20
    for figure in whole:
        plain = json.loads(re.sub(r'"--\w+"', '"#123456"', json.dumps(figure)))
        go.Figure(data=plain["data"], layout=plain["layout"])


def test_the_figures_have_the_numbers_of_cells_csv(folder, html):
    """A point a cell with its share and interval; the errors to the last digit."""
    stored = pd.read_csv(folder / "cells.csv")
    error, answer = figures_of(html, "answer")
    assert [*error["columns"]][:2] == ["topology", "attack magnitude ā [m]"]
    assert answer["layout"]["xaxis"]["title"]["text"] == "attack magnitude ā [m]"
    assert answer["data"][0]["name"] == "star"
    points = pd.DataFrame(answer["columns"]).set_index("cell").sort_index()
    known = stored.dropna(subset="unrecovered")  # an axis has no place for ā = 0
    assert points["lanes unrecovered [%]"].to_dict() == (100 * known["unrecovered"]).to_dict()
    assert points["low"].to_dict() == (100 * known["unrecovered_low"]).to_dict()
    for figure, rows in zip(figures_of(html, "ultimate"), (slice(1, 3), slice(4, 6)), strict=False):
        table = pd.DataFrame(figure["columns"]).set_index("series")["greatest tail error / ā"]
        for series, name in (("median, 5 to 95 % of lanes", "median"), ("maximum", "max")):
            assert table[series].tolist() == (stored[f"tail_max_{name}"][rows] / [1, 10]).tolist()
    first = pd.DataFrame(figures_of(html, "ultimate")[0]["columns"]).set_index("series")
    assert first.loc["peak gain", "greatest tail error / ā"].tolist() == [12, 12]


def test_violations_and_failures_have_their_commands(folder, html):
    """What is listed, and that there is nothing to list."""
    assert "jaxnet replay out --cell 4 --sample 1" in section(html, "violations")
    assert 'id="failed"' not in html
    results = jaxnet.open(folder)
    results.manifest["lanes"]["failed"] = 5
    rows = [(1, each, "singular") for each in range(3)] + [(3, 2, "singular"), (3, 0, "diverged")]
    failed = pd.DataFrame(rows, columns=["cell", "sample", "status"])

    def by_cell(*_, where, cells=(1, 3)):
        return ((cell, failed[failed["cell"] == cell]) for cell in cells)

    vars(results)["by_cell"] = by_cell
    listed = unescape(sections.failed_section(results).body)
    assert [re.sub("<.*?>", "|", row) for row in re.findall(r"<tr data.*?</tr>", listed)] == [
        f"||cell 1||3 singular||3||jaxnet replay {folder} --cell 1 --sample 0||",
        f"||cell 3||1 singular, 1 diverged||3||jaxnet replay {folder} --cell 3 --sample 2||",
    ]


def test_certificates_say_once_what_all_cells_share(html):
    """The common part, then a table of each fact that differs between the graphs."""
    (told,) = re.findall(r"<summary>Certificates</summary>(.*?)</details>", html, re.DOTALL)
    assert told.count("Assumption 1") == told.count("in all cells") == 1
    assert "<h4>by topology</h4><dl><dt>graph</dt><dd>[star] 12 vehicles, 12 links: 1" in told
    assert "\n" not in told  # the browser wraps


def test_curves_have_the_groups_own_bounds_and_fits(folder):
    """ā = 0 is left out; blank and infinite bounds are none; other models are not taken."""
    star, ring = curves.curves(jaxnet.open(folder))
    assert star.sizes.tolist() == [1, 10]
    assert star.limits("tail_max") == {"static": 7.25, "peak_gain": 12, "lyapunov_printed": 40}
    assert star.limits("tail_mean")["peak_gain"] == pytest.approx(6.5)  # mean of 1 to 12
    assert ring.limits("tail_max") == {"peak_gain": 24}
    assert np.isinf(ring.slope("lyapunov_printed", "fleet"))
    assert (star.fit("tail_max"), ring.fit("tail_max")) == ((3.5, 3, 4), (7, 3, 4))
    assert ring.fit("tail_max", 0.95) == (6.5, 6, 7)
    assert star.fit("tail_mean") is None


def test_text_figure_and_page_say_that_there_is_no_slope(folder):
    """A blank slope is no line, no number, and words; the words stand nowhere else."""
    results = jaxnet.open(folder)
    found = curves.curves(results)
    text = " ".join(errors_text(found).split())
    assert re.search("star flat .* flat: errors of greater ā are not greater", text)
    for metric, told in (("tail_max", False), ("tail_mean", True)):
        drawing = ultimate_drawing(found, metric)
        drawn, shown = printed(drawing), unescape(plotted(drawing))
        words = "rrors do not rise with ā: no line is fitted (all)"
        assert (words in drawn.get_supxlabel().replace("\n", " ")) is told
        assert (words in shown) is told
        assert ("rey lines" in shown) is not told
        legend = [each.get_text() for each in drawn.legends[0].get_texts()]
        assert ("fit of the means" in legend) is not told
        assert {*legend} == {*re.findall('data-name="(.*?)"', shown)}  # as the page


def test_one_magnitude_is_no_fit(folder):
    """Text, figure and page say that it is the error over ā."""
    results = jaxnet.open(folder)
    star, ring = curves.curves(results)
    group = star.group._replace(cells=star.group.cells[:2])
    alone = star._replace(cells=star.cells.iloc[:1], group=group)
    mean = {("tail_mean", None): star.fits["tail_max", None]}
    text = " ".join(errors_text([alone._replace(fits=mean), ring]).split())
    assert "one ā: 3.5 ā [3, 4]" in text
    drawing = ultimate_drawing([alone, ring], "tail_max")
    for said in (printed(drawing).get_supxlabel(), plotted(drawing)):
        assert "anes ended at one ā alone: no line is fitted (star)" in said.replace("\n", " ")


def test_a_slope_stays_within_magnitudes_that_have_lanes(folder):
    """Two at least, though the table of fits has a number; a bound of theory reaches all."""
    star, ring = curves.curves(jaxnet.open(folder))
    cells = ring.cells.loc[[1.0, 10.0, 10.0, 10.0]].set_axis([1.0, 10.0, 100.0, 1000.0])
    lanes = [name for name in cells if name.startswith(("tail_max", "tail_mean"))]
    for known in (1, 2):
        lost = cells.astype(dict.fromkeys(lanes, float))
        lost.iloc[known:, [cells.columns.get_loc(name) for name in lanes]] = np.nan
        panels = ultimate_drawing([star, ring._replace(cells=lost)], "tail_max").panels
        series = {each.name: each for each in panels[1].series}
        assert series["peak gain"].x.tolist() == [1, 10, 100, 1000]
        assert series["peak gain"].y.tolist() == [24] * 4
        if known == 1:
            assert panels[1].note == "lanes ended at one ā alone: no line is fitted"
            assert "fit of the means" not in series
        else:
            assert series["fit of the means"].x.tolist() == [1, 10]


def test_rounding_does_not_stretch_the_axis_of_errors(folder):
    """It ends a decade below medians and lines; a bar that goes on below has an arrow."""
    star, ring = curves.curves(jaxnet.open(folder))
    every = [each.spread("tail_max", "median")[0] / each.sizes for each in (star, ring)]
    least = min(*np.ravel(every), *(min(each.limits("tail_max").values()) for each in (star, ring)))
    least = min(least, *(each.fit("tail_max")[0] for each in (star, ring)))
    tiny = star._replace(cells=star.cells.assign(tail_max_q05=1e-11))
    drawing = ultimate_drawing([star, ring._replace(bounds={}, fits={})], "tail_max")
    lines = [
        re.findall("coloured|grey", "; ".join(drawing.told([each]))) for each in drawing.panels
    ]
    assert lines == [["coloured", "grey"], []]  # told of panels that have them
    for found, is_low in (([star, ring], False), ([tiny, ring], True)):
        drawing = ultimate_drawing(found, "tail_max")
        assert least / 100 < drawing.y.ends[0] < least
        figure = printed(drawing)
        told = "arrows: intervals that go on beyond the axis"
        assert (told in figure.get_supxlabel().replace("\n", " ")) == is_low
        arrows = [line for line in figure.axes[0].lines if line.get_marker() == "v"]
        assert len(arrows) == is_low


def test_a_panel_of_errors_per_magnitude_shows_what_the_legend_names(folder):
    """Ticks at the magnitudes; a bound below the axis and lanes that failed have no entry."""
    star, ring = curves.curves(jaxnet.open(folder))
    drawing = ultimate_drawing([star, ring], "tail_max")
    assert printed(drawing).axes[0].get_xticks().tolist() == [1, 10]
    *_, means, median, most = drawing.panels[0].series
    assert (means.apart < median.apart).all()
    assert (most.apart == median.apart).all()
    lanes = [name for name in ring.cells if name.startswith(("tail_max", "tail_mean"))]
    lost = ring._replace(cells=ring.cells.assign(**dict.fromkeys(lanes, np.nan)), bounds={})
    drawing = ultimate_drawing([star, lost], "tail_max")
    assert (drawing.panels[1].series, drawing.panels[1].words) == ([], "no lane ended")
    page = plotted(drawing)
    assert "no lane ended" in page
    empty = re.findall(r'<script type="application/json">(.*?)</script>', page)[1]
    assert json.loads(empty)["columns"] == {drawing.x.title: [], drawing.y.title: []}  # for CSV
    low = star._replace(bounds={("static", "worst"): 1e-8})
    drawing = ultimate_drawing([low], "tail_max")
    assert "static" not in [each.name for each in drawing.panels[0].series]
    assert "coloured lines" not in printed(drawing).get_supxlabel()


def test_bounds_far_above_the_errors_are_told_in_place_of_drawn(folder):
    """A note has their slopes, and each panel keeps its least bound."""
    star, ring = curves.curves(jaxnet.open(folder))
    worst = max(star.worst, ring.worst)
    high = {("static", "worst"): 10 * worst, ("star_norm", "worst"): 50 * worst}
    drawings = [
        ultimate_drawing([star._replace(bounds=mine), ring._replace(bounds=high)], "tail_max")
        for mine in (high, {("peak_gain", "worst"): 60 * worst})
    ]
    drawn = [[{*map(attrgetter("name"), each.series)} for each in x.panels] for x in drawings]
    bounds = {"static", "star norm", "peak gain"}
    assert [each & bounds for each in drawn[0]] == [{"static"}] * 2
    assert [each & bounds for each in drawn[1]] == [{"peak gain"}, {"static", "star norm"}]
    told = f"bounds over {number_text(30 * worst)} ā are not drawn"
    assert drawings[0].notes[0] == f"{told} (star norm, up to {number_text(50 * worst)} ā)"
    assert "not drawn" not in " ".join(drawings[1].notes)


def test_many_notes_on_the_columns_are_folded(folder, monkeypatch):
    """Below the summary; few stand open."""
    results = jaxnet.open(folder)
    for many in (6, 7):
        monkeypatch.setattr(tables, "summary_notes", lambda *_, many=many: ["a note"] * many)
        body = sections.summary_section(results).body
        assert ("<details><summary>Notes on the columns" in body) == (many == 7)


def test_a_report_of_one_cell_draws_no_curve_of_one_point(tmp_path):
    study = systems.study(engine="exact", samples=2, horizon=1.0, tail=0.5)
    results = jaxnet.run(study, tmp_path / "out", progress=False)
    drawn = {file.stem for file in every.draw_figures(results, ("curve", "tails"))}
    assert drawn == {"tails"}


def test_no_line_of_a_note_ends_within_a_number():
    told = elements.notes_html(["by over 1e-08 m"])
    assert '<span style="white-space: nowrap">1e-08</span>\N{NO-BREAK SPACE}m.' in told


def test_titles_on_the_page_keep_names_and_units_on_a_line():
    """W-MSR, and a number beside its unit; what a config says is text."""
    html = elements.plot_html(elements.Plot("30 % lost, <W-MSR> F=2", None, {}))
    heading = re.search("<h3>(.*)</h3>", html)[1]
    assert "30\N{NO-BREAK SPACE}% lost" in heading
    assert 'nowrap">&lt;W-MSR&gt;</span> F=2' in heading


def test_missing_files_leave_their_sections_out(folder, tmp_path):
    """A folder of rows alone still makes a page, which says what to run."""
    bare = tmp_path / "bare folder"
    shutil.copytree(
        folder, bare, ignore=shutil.ignore_patterns("*.zarr", "fit.csv", "bounds.csv", "viol*")
    )
    text = page.write_page(jaxnet.open(bare)).read_text()
    assert 'id="bands"' not in text
    assert 'id="violations"' not in text
    assert f"jaxnet fit '{bare}'" in unescape(section(text, "findings"))
    assert "jaxnet replay" in section(text, "lanes")


@pytest.fixture
def opened(browser, folder, html):
    """Opens the page offline; at the end nothing else was asked for, and nothing complained of."""
    contexts, requests, complaints = [], [], []

    def open_page(width: int, scheme: str):
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        contexts.append(context)
        context.set_offline(True)
        shown = context.new_page()
        shown.on("request", lambda request: requests.append(request.url))
        shown.on("console", lambda message: complaints.append(message.text))
        shown.on("pageerror", lambda error: complaints.append(str(error)))
        shown.on("dialog", lambda dialog: complaints.append(dialog.message))
        shown.goto((folder / "report.html").as_uri())
        return shown

    yield open_page
    for context in contexts:
        context.close()
    assert set(requests) == {(folder / "report.html").as_uri()}
    assert complaints == []


def read_through(shown) -> None:
    """Scroll from top to bottom, as plots are drawn once they come near."""
    for top in range(0, shown.evaluate("document.scrollingElement.scrollHeight"), 600):
        shown.evaluate(f"scrollTo(0, {top})")
        settle(shown)


def settle(shown) -> None:
    """Wait for what is drawn with the next frames."""
    shown.evaluate(FRAMES)


FRAMES = (
    "new Promise(done => requestAnimationFrame(() =>"
    " requestAnimationFrame(() => setTimeout(done))))"
)


# Tables that are wider than the box in which they scroll, where this box is wider than the page.
TABLES_WITHIN = """[...document.querySelectorAll("main table")].filter(table =>
  !table.closest(".box") || table.closest(".box").getBoundingClientRect().right > innerWidth
).map(table => table.closest("section").id)"""


@pytest.mark.long
@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1200, "light")])
def test_every_plot_is_drawn_and_nothing_overflows(opened, width, scheme):
    """Text is read on its own ground; nothing hinders who sees or points otherwise (axe-core)."""
    from axe_playwright_python.sync_playwright import Axe

    shown = opened(width, scheme)
    read_through(shown)
    points = shown.eval_on_selector_all(
        ".plot",
        "plots => plots.filter(p => p.clientWidth)"
        ".map(p => p.querySelectorAll('.main-svg :is(.trace path, image)').length)",
    )
    assert len(points) == 1 + 2 + 6 + 1 + 3
    assert min(points) > 0
    assert shown.evaluate("document.scrollingElement.scrollWidth <= innerWidth")
    assert shown.evaluate(TABLES_WITHIN) == []
    assert Axe().run(shown, {"exclude": [[".main-svg"]]}).response["violations"] == []
    ground = "getComputedStyle(document.body).backgroundColor"
    ink = "getComputedStyle(document.querySelector('#lanes .xtick text')).fill"
    assert (np.mean(levels(shown.evaluate(ground))) > 128) == (scheme == "light")
    assert (np.mean(levels(shown.evaluate(ink))) < 128) == (scheme == "light")
    shown.emulate_media(color_scheme="dark" if scheme == "light" else "light")
    shown.locator("#lanes .plane").scroll_into_view_if_needed()
    settle(shown)
    assert (np.mean(levels(shown.evaluate(ink))) < 128) == (scheme == "dark")


def levels(colour: str) -> list[int]:
    """Red, green and blue."""
    return [int(level) for level in re.findall(r"\d+", colour)[:3]]


@pytest.mark.long
def test_a_table_shows_at_which_side_it_goes_on(opened):
    """By a shade at the side of its rows, which is gone where the table ends; by pixels."""
    shown = opened(390, "light")
    box = shown.locator("#summary .box")
    box.scroll_into_view_if_needed()
    assert box.evaluate("box => box.scrollWidth > box.clientWidth")
    is_dark = []
    for place in ("0", "box.scrollWidth"):
        box.evaluate(f"box => {{ box.scrollLeft = {place}; }}")
        settle(shown)
        rows = imread(io.BytesIO(box.screenshot()))[-60:, :, :3].mean(axis=2)
        lightest = np.quantile(rows, 0.9, axis=0)
        is_dark.append([bool(lightest[at] < lightest.max() - 0.05) for at in (3, -4)])
    assert is_dark == [[False, True], [True, False]]


@pytest.mark.long
def test_the_table_sorts(opened):
    """Numbers as numbers, by mouse and by keyboard, and the header says so; unknown ones last."""
    shown = opened(1400, "light")
    steps = (
        ("attack magnitude", "ascending", 3, ["0", "0", "1", "1", "10", "10"]),
        ("attack magnitude", "descending", 3, ["10", "10", "1", "1", "0", "0"]),
        ("unrecovered", "ascending", 4, ["25", "50", "75", "100", "–", "–"]),
    )
    for name, order, column, values in steps:
        head = shown.locator("#summary th", has_text=name)
        head.locator("button").press("Enter")
        assert head.get_attribute("aria-sort") == order
        texts = shown.locator(f"#summary td:nth-child({column})").all_inner_texts()
        assert [text.split(" ")[0] for text in texts] == values


def lane_shown(shown, path):
    """Choose the lane of cell 5 and sample 2; what its store holds."""
    chosen = shown.locator("#lanes option", has_text="sample 2").filter(has_text="cell 5")
    shown.locator("#lanes .lane").select_option(chosen.first.get_attribute("value"))
    shown.locator("#lanes .stage").scroll_into_view_if_needed()
    settle(shown)
    return xr.open_zarr(path / "replays" / "cell-5-sample-2.zarr").isel(lane=0)


def drawn(shown, name: str, mode: str = "markers") -> np.ndarray:
    """Points of the first trace of that name in the plane, without gaps."""
    find = f"plot => {{ const t = plot.data.find(t => t.name === '{name}' && t.mode === '{mode}');"
    found = shown.eval_on_selector("#lanes .plane", find + " return [[...t.x], [...t.y]] }")
    points = np.array(found, float).T
    return points[~np.isnan(points).any(axis=1)]


HONEST, ATTACKED = [0, 2, 3, 5, 6, 8, 9, 11], [1, 4, 7, 10]


@pytest.mark.long
def test_a_lane_in_motion_is_the_stores(opened, folder):
    """It opens at its worst around the navigator; slider and keys move vehicles and cursors."""
    shown = opened(1400, "light")
    lane = lane_shown(shown, folder)
    states, told = lane["states"].values, lane["states"].values[..., :2] + lane["attack"].values
    centre = lane["navigator"].values
    off = states[..., :2] - centre[:, None]
    worst = 8 + np.linalg.norm(off, axis=-1).max(axis=1)[8:].argmax()
    assert shown.locator("#lanes input").input_value() == str(worst)
    np.testing.assert_allclose(drawn(shown, "vehicle"), off[worst, HONEST], rtol=1e-4)
    false = (told[worst] - centre[worst])[ATTACKED]
    np.testing.assert_allclose(drawn(shown, "false place in messages"), false, rtol=1e-4)
    np.testing.assert_array_equal(drawn(shown, "navigator"), [[0.0, 0.0]])
    reach = shown.eval_on_selector("#lanes .plane", "plot => plot.layout.xaxis.range[1]")
    assert reach >= 1.1 * np.abs(off[5:]).max()
    shown.locator("#lanes .around").select_option("in the plane")
    for key, place in (("End", -1), ("Home", 0)):
        shown.locator("#lanes input").press(key)
        np.testing.assert_allclose(drawn(shown, "vehicle"), states[place, HONEST, :2], rtol=1e-5)
    clock = shown.locator("#lanes .stage output")
    assert clock.inner_text() == "t = 0.00 s"
    ahead = "plot => plot.data.find(t => t.marker?.symbol === 'diamond-tall').marker.angle"
    angles = np.array(shown.eval_on_selector("#lanes .plane", ahead))
    heading, speed = states[0, HONEST, 2], states[0, HONEST, 3]
    np.testing.assert_allclose(270 - angles, np.degrees(heading + np.pi * (speed < 0)), rtol=1e-4)
    shown.locator("#lanes .stage").press("ArrowRight")
    assert clock.inner_text() == "t = 0.10 s"
    cursors = "plots => plots.map(plot => plot.layout.shapes[0].x0)"
    places = shown.eval_on_selector_all("#lanes :is(.errors, .raster)", cursors)
    np.testing.assert_allclose(places, 0.1, rtol=1e-6)
    for place in (0, 4, 10):
        shown.locator("#lanes input").fill(str(place))
        settle(shown)
        found = drawn(shown, "false place in messages")
        np.testing.assert_allclose(found, told[place, ATTACKED], rtol=1e-5)
        hold_links(shown, lane.isel(time=place), place)


def hold_links(shown, lane, place: int) -> None:
    """The raster's column and the links that are drawn against those of `kept`."""
    texts = f"plot => plot.data[0].text.map(row => row[{place}])"
    rows = shown.eval_on_selector("#lanes .raster", texts)
    said = {
        tuple(map(int, re.findall(r"\d+", row.replace("the navigator", "0"))[:2])): row
        for row in rows
    }
    retained = systems.of_slots(lane["kept"].values, lane["source"].values) > 0
    assert len(said) == 36
    kept = {link for link, row in said.items() if ": retained" in row}
    assert kept == {(i + 1, j) for i, j in np.argwhere(retained)}
    assert {j for (_, j), row in said.items() if "attacked" in row} == {2, 5, 8, 11}
    assert len(drawn(shown, "retained link", "lines")) == 2 * retained.sum()
    assert len(drawn(shown, "dropped link", "lines")) == 2 * (36 - retained.sum())


@pytest.mark.parametrize(
    ("topology", "threat", "of_navigator", "replaced"),
    [
        ("star", "adds", True, False),
        ("path", "replaces", False, True),
        ("path", "adds", False, False),
    ],
)
def test_what_is_told_depends_on_the_attack(tmp_path, topology, threat, of_navigator, replaced):
    """What is heard of the navigator where no vehicle hears another; a replaced message."""
    attack = {"kind": "bias", "magnitude": 3, "threat": threat}
    save = {"trajectories": "all"}
    keys = {"topology": topology, "attack": attack, "horizon": 0.5, "tail": 0.1, "save": save}
    results = jaxnet.run(systems.study(engine="exact", **keys), tmp_path / "out")
    (lane,), stored = trajectories.lanes_data(results)
    assert stored == 1
    assert lane["falsified"] == ([0] * 4 if of_navigator else lane["attacked"])
    data = results.trajectories.isel(cell=0, sample=0)
    attacked = np.array(lane["attacked"]) - 1
    base = data["states"].values[:, attacked, :2]
    if of_navigator or replaced:
        base = np.repeat(data["navigator"].values[:, None], len(attacked), axis=1)
    told = np.frombuffer(base64.b64decode(lane["told"]["bdata"]), "<f4")
    np.testing.assert_allclose(told, (base + data["attack"].values[:, attacked]).ravel(), rtol=1e-6)
    apart = data["states"].values[:, :, :2] - data["navigator"].values[:, None]
    errors = np.log10(np.linalg.norm(apart, axis=2))
    low, high = lane["errors"]["layout"]["yaxis"]["range"]
    assert errors.min() - 1.5 < low <= errors.min()
    assert errors.max() <= high < errors.max() + 1.5


def test_headings_are_those_of_the_states():
    """In degrees, whatever the speed; a kind without a heading has none."""
    values = np.array([[[0.0, 0.0, 0.5 * np.pi, speed] for speed in (1.0, -1.0)]])
    named = xr.DataArray(values, dims=("time", "vehicle", "state"))
    assert headings(named.assign_coords(state=["x", "y", "heading", "speed"])).tolist() == [
        [90, 90]
    ]
    assert headings(named.assign_coords(state=list("xyvw"))) is None


def test_lanes_say_why_they_are_shown(folder, monkeypatch):
    """Median or worst of its cell, stored or replayed; before them the worst of all cells."""
    results = jaxnet.open(folder)
    with monkeypatch.context() as without:
        without.setattr(watched, "worst_of", lambda results: [])
        each = watched.watched(results)
    assert len(each) == 18  # the one that is replayed besides being stored counts once
    for cell, mine in results.lanes.sort_values("tail_mean").groupby("cell"):
        why = {one.sample: one.why for one in each if one.cell == cell}
        least, median, worst = mine["sample"]
        of_all = mine["tail_mean"].max() == results.lanes["tail_mean"].max()
        told = "worst lane of the study" if of_all else "worst of its cell"
        assert (why[median], why[worst]) == ("median of its cell", told)
        assert why[least] in ("stored", "replayed")
    row = results.lanes.loc[results.lanes["tail_mean"].idxmax()]
    greatest = row["cell"], row["sample"]
    other = (0, 1)  # of another ā: worst per ā, yet of a smaller error
    monkeypatch.setattr(watched, "worst_of", lambda results: [other, greatest])
    first, second = watched.watched(results)[:2]
    assert first[:3] == (*greatest, "worst lane of the study")
    assert second[:3] == (*other, "worst per ā")
    lanes, _ = trajectories.lanes_data(results)
    assert "(worst lane of the study): error" in lanes[0]["label"]


SHORT = {"engine": "exact", "horizon": 0.5, "tail": 0.1}


def test_the_report_simulates_a_dozen_cells_again(tmp_path, monkeypatch):
    """The worst lane of all; the median and the worst lane of two of three cells; none twice."""
    monkeypatch.setattr(watched, "MOST_REPLAYED", 2)
    study = systems.study(samples=3, sweep={"attack.magnitude": [1, 30, 2]}, **SHORT)
    results = jaxnet.run(study, tmp_path / "out")
    ranked = results.lanes.sort_values("tail_mean").groupby("cell")["sample"]
    wanted = [(cell, sample) for cell in (0, 2) for sample in ranked.get_group(cell).tolist()[1:]]
    row = results.lanes.loc[results.lanes["tail_mean"].idxmax()]
    assert row["cell"] == 1
    wanted.append((1, row["sample"]))
    times = []
    for many in (5, 0):
        assert watched.lanes_again(results) == many
        paths = list(watched.replay_watched(results))
        times.append([(path / "zarr.json").stat().st_mtime_ns for path in paths])
        names = {path.stem for path in paths}
        assert names == {f"cell-{cell}-sample-{sample}" for cell, sample in wanted}
    assert times[0] == times[1]


def test_the_studys_engine_simulates_what_the_nonlinear_one_gives_up(tmp_path, monkeypatch):
    """It alone is shown, and no later report tries again; a lane that failed itself stays."""
    given, tried = rerun.with_engine, []

    def with_engine(cell, engine):
        tried.append(engine)
        chosen = given(cell, engine)
        if engine is None:
            return chosen
        few = chosen.scenario.engine.model_copy(update={"max_steps": 1})
        return replace(chosen, scenario=chosen.scenario.model_copy(update={"engine": few}))

    sweep = {"attack.magnitude": [1, 30]}
    study = systems.study(samples=1, sweep=sweep, recovery={"tau": 0.01, "worst": 1}, **SHORT)
    results = jaxnet.run(study, tmp_path / "out")
    ((cell, sample),) = rerun.worst_of(results)
    with monkeypatch.context() as failing:
        failing.setattr(rerun, "with_engine", with_engine)
        for again in (True, False):
            names = {path.stem for path in watched.replay_watched(results)}
            assert f"cell-{cell}-sample-{sample}" in names
            assert bool(tried) == again == ("nonlinear" in tried)
            assert watched.lanes_again(results) == 0
            tried.clear()
    shown = watched.watched(results)
    assert {each.engine for each in shown} == {None}
    assert (cell, sample) in {each[:2] for each in shown}
    assert "nonlinear" not in sections.lanes_section(results).body
    with monkeypatch.context() as failed:
        row = results.lanes.iloc[0].replace("ok", "diverged")
        failed.setattr(Results, "row", lambda *_: row)
        assert "nonlinear" in {each.engine for each in watched.watched(results)}
    replay(results, cell, sample, "nonlinear")
    assert "Lanes marked “nonlinear engine” are" in sections.lanes_section(results).body


def test_a_report_without_replays_simulates_nothing(tmp_path, monkeypatch):
    """Where no trajectory is stored the page names the command that replays one."""
    from jaxnet.engine import batch

    results = jaxnet.run(systems.study(samples=2, **SHORT), tmp_path / "out")
    monkeypatch.setattr(every, "draw_figures", lambda *_, **__: iter(()))
    monkeypatch.setattr(batch, "simulate_each", lambda *_: pytest.fail("a lane is simulated"))
    (*_, path), out = writing.write_report(results, replayed=False), results.path
    assert not (out / "replays").exists()
    assert f"jaxnet replay {out} --cell 0 --sample" in section(path.read_text(), "lanes")
    assert results.report(replay=False) == path


def test_the_report_simulates_no_lane_again_that_is_too_large(tmp_path, monkeypatch):
    """It says so. A lane holds whom 12 vehicles retain in 3 slots at 6 output times."""
    results = jaxnet.run(systems.study(samples=2, **SHORT), tmp_path / "out")
    part = 6 * 12 * 3 * 4
    for most_bytes, most_vehicles, told in ((part, 12, "0.01 MB each"), (10 * part, 11, "lanes")):
        monkeypatch.setattr(watched, "MOST_BYTES", most_bytes)
        monkeypatch.setattr(watched, "MOST_VEHICLES", most_vehicles)
        with pytest.warns(UserWarning, match="out: lanes of 12 vehicles") as said:
            assert list(watched.replay_watched(results)) == []
        assert watched.lanes_again(results) == 0
        assert told in str(said[0].message)
    monkeypatch.setattr(watched, "MOST_VEHICLES", 12)
    assert watched.lanes_again(results) == len(list(watched.replay_watched(results))) == 2
    assert len(trajectories.lanes_data(results)[0]) == 2
    monkeypatch.setattr(trajectories, "MOST_VEHICLES", 11)
    assert trajectories.lanes_data(results) == ([], 2)
    assert "jaxnet animate" in sections.lanes_section(results).body


@pytest.mark.long
def test_paper_cuts_nothing(opened):
    """Light, tables in full, plots within a sheet; then all is as before."""
    shown = opened(1400, "dark")
    read_through(shown)
    widths = "plots => plots.filter(plot => plot.clientWidth)"
    widths += ".map(plot => plot.querySelector('.main-svg').clientWidth)"
    before = shown.eval_on_selector_all(".plot", widths)
    shown.set_viewport_size({"width": 703, "height": 900})
    shown.emulate_media(media="print", color_scheme="dark")
    shown.evaluate("dispatchEvent(new Event('beforeprint'))")
    boxes = "boxes => boxes.map(box => box.scrollWidth - box.clientWidth)"
    assert max(shown.eval_on_selector_all(".box, .plot", boxes)) <= 0
    assert max(shown.eval_on_selector_all(".plot", widths)) <= 703
    assert shown.evaluate("document.scrollingElement.scrollWidth <= innerWidth")
    ink = "getComputedStyle(document.querySelector('#lanes .xtick text')).fill"
    assert np.mean(levels(shown.evaluate(ink))) < 128
    shown.set_viewport_size({"width": 1400, "height": 900})
    shown.emulate_media(media="screen", color_scheme="dark")
    shown.evaluate("dispatchEvent(new Event('afterprint'))")
    read_through(shown)
    assert shown.eval_on_selector_all(".plot", widths) == before
    assert np.mean(levels(shown.evaluate(ink))) > 128


def numbers_of(shown, table: str) -> list[int]:
    """Numbers of the cells in the rows that are seen."""
    return [
        int(text)
        for text in shown.locator(f"{table} tbody tr:visible td:first-child").all_inner_texts()
    ]


def titles(shown, section: str) -> list[str]:
    """Of the plots that are seen."""
    return [
        text.replace("\xa0", " ")
        for text in shown.locator(f"{section} h3:visible").all_inner_texts()
    ]


@pytest.mark.long
def test_a_page_without_a_choice_shows_all_rows(folder, browser, tmp_path):
    """That of two studies compared."""
    results = jaxnet.open(folder)
    (tmp_path / "compare.html").write_text(comparison_page(jaxnet.compare(results, results)))
    with browser.new_context() as context:
        shown = context.new_page()
        shown.goto((tmp_path / "compare.html").as_uri())
        assert shown.locator("tr[data-cells]:visible").count() == len(results.cells)


@pytest.mark.long
def test_the_choice_shows_just_its_cells(opened):
    """In tables, plots and lanes; it stands in the address, and one that has nothing says so."""
    shown = opened(1400, "light")
    shown.locator(".filter summary").click()
    star, size = (shown.locator(".filter select").nth(n) for n in range(2))
    size.select_option("ā\xa0=\xa010\xa0m")
    assert numbers_of(shown, "#summary") == [2, 5]
    assert titles(shown, "#bands") == [f"{name}, ā = 10 m" for name in ("star", HOSTILE)]
    star.select_option("star")
    assert numbers_of(shown, "#summary") == [2]
    assert titles(shown, "#ultimate") == ["star"]
    assert shown.locator("#lanes .lane option:not(.other)").count() == 3
    after = "element => getComputedStyle(element, '::after').content"
    assert "No row is about" in shown.locator("#violations table").evaluate(after)
    assert "Cells shown: 1 of 6" in shown.locator(".filter summary").inner_text()
    shown.reload()
    assert numbers_of(shown, "#summary") == [2]
    size.select_option("ā\xa0=\xa00\xa0m", force=True)
    assert "nothing to draw" in shown.locator("#ultimate .view").first.evaluate(after)
    shown.locator(".filter summary").click()
    shown.locator(".filter button").click()
    assert numbers_of(shown, "#summary") == [0, 1, 2, 3, 4, 5]


@pytest.mark.long
def test_a_tile_tells_all_when_it_is_reached(opened, folder):
    """By pointer and keys; of the cells chosen, on one scale."""
    shown = opened(1400, "light")
    plot, told = shown.locator("#heat .plot").first, shown.locator("#heat .told").first
    plot.scroll_into_view_if_needed()
    settle(shown)
    texts = plot.locator(".heatmap-label").all_text_contents()
    assert texts == ["–", "2515–25", "5040–50", "–", "7565–75", "10090–100"]
    plot.focus()
    for key in ("ArrowUp", "ArrowRight"):  # the first arrow reaches the first tile
        shown.keyboard.press(key)
    words = "star, ā = 1 m (cell 1): 25 % unrecovered, 95 % interval 15 to 25 %, of 3 lanes;"
    words += " none failed."
    assert told.inner_text().replace("\xa0", " ") == words
    for key in ("ArrowDown", "ArrowRight", "ArrowRight"):
        shown.keyboard.press(key)
    assert "(cell 5): 100 % unrecovered" in told.inner_text()
    plot.locator(".hoverlayer", has_text="(cell 5)").wait_for()  # plotly draws it a little later
    box = plot.locator(".heatmaplayer image").bounding_box()
    shown.mouse.move(box["x"] + 9, box["y"] + 9)
    shown.locator("#heat .told", has_text="(cell 0)").first.wait_for()
    assert told.inner_text().endswith("(cell 0): no attack; none failed.")
    assert shown.locator("#heat .scale").first.inner_text().split()[-2:] == ["no", "attack"]
    shown.locator("#heat select").select_option("greatest tail error / ā")
    settle(shown)
    worst = pd.read_csv(folder / "cells.csv")["tail_max_max"][4]
    second = shown.locator("#heat .plot").nth(1)
    assert float(second.locator(".heatmap-label").nth(4).text_content()) == pytest.approx(
        worst, rel=0.05
    )
    shown.locator("#heat select").select_option("lanes unrecovered [%]")
    shown.locator(".filter summary").click()
    shown.locator(".filter select").nth(0).select_option(HOSTILE)
    settle(shown)
    z = plot.evaluate("plot => plot.data[0].z.map(row => [...row])")
    assert z == [[None] * 3, [None, 0.75, 1]]


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_texts_of_tiles_contrast_with_them(opened, scheme):
    """By 4.5 at least (WCAG 2.2), of every colour, and where no colour is."""
    shown = opened(1400, scheme)
    shown.locator("#heat .plot").first.scroll_into_view_if_needed()
    settle(shown)
    texts = "labels => labels.map(label => [label.__data__.z, fill(label)])"
    texts = texts.replace(
        "fill(label)",
        "getComputedStyle(label.querySelector('tspan tspan') || label.firstChild).fill",
    )
    paper = shown.evaluate("getComputedStyle(document.body).backgroundColor")
    found = shown.locator("#heat .heatmap-label").evaluate_all(texts)
    tiles = [rgb_of(paper) if z is None else to_rgb(PALETTE[round(63 * z)]) for z, _ in found]
    assert len({z for z, _ in found}) > 2
    assert (
        min(contrast(rgb_of(ink), tile) for (_, ink), tile in zip(found, tiles, strict=True)) > 4.5
    )


@pytest.mark.long
def test_a_saved_map_has_the_inks_and_the_scale_of_the_page(opened, tmp_path):
    """Words in black or white, and the scale of colours with its name."""
    shown = opened(1400, "dark")
    panel = shown.locator("#heat .panel").first
    panel.scroll_into_view_if_needed()
    settle(shown)
    panel.locator(".menu summary").click()
    with shown.expect_download() as saved:
        panel.get_by_text("Save as SVG").click()
    saved.value.save_as(tmp_path / "map.svg")
    picture = (tmp_path / "map.svg").read_text()
    labels = re.findall(r'<g class="heatmap-label">.*?</g>', picture, re.DOTALL)
    assert labels
    inks = [re.findall(r"fill:\s*(\w+)", each)[-1] for each in labels]
    assert {*inks} <= {"black", "white", "rgb"}
    assert "black" in inks
    assert "lanes unrecovered [%]" in picture


def rgb_of(text):
    return [int(each) / 255 for each in re.findall(r"\d+", text)[:3]]


def contrast(*colours):
    levels = np.array(colours)
    linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    low, high = sorted(linear @ (0.2126, 0.7152, 0.0722) + 0.05)
    return high / low


@pytest.mark.long
def test_a_plot_hides_curves_and_is_kept(opened, folder, tmp_path):
    """By its key, on all plots of its section; as numbers of cells.csv, and as a picture."""
    shown = opened(1400, "dark")
    shown.locator("#ultimate .grid").first.scroll_into_view_if_needed()
    settle(shown)
    entry = shown.locator("#ultimate .key button:visible", has_text="peak gain")
    seen = "plots => plots.filter(p => p.data).map(plot => plot.data.filter("
    seen += "t => t.name === 'peak gain' && t.visible !== false).length)"
    for pressed, many in (("true", 1), ("false", 0), ("true", 1)):
        assert shown.eval_on_selector_all("#ultimate .plot", seen) == [many] * 2
        assert entry.get_attribute("aria-pressed") == pressed
        entry.click()
    entry.click()
    panel, found = shown.locator("#ultimate .panel").first, {}
    for what in ("Save data as CSV", "Save as SVG"):
        panel.locator(".menu summary").click()
        with shown.expect_download() as saved:
            panel.get_by_text(what).click()
        found[saved.value.suggested_filename] = file = tmp_path / saved.value.suggested_filename
        saved.value.save_as(file)
    given = pd.read_csv(found["test_star.csv"]).set_index("series")
    stored, lanes = pd.read_csv(folder / "cells.csv")[1:3], given.loc["median, 5 to 95 % of lanes"]
    assert lanes["attack magnitude ā [m]"].tolist() == stored["attack.magnitude"].tolist()
    columns = {"greatest tail error / ā": "median", "low": "q05", "high": "q95"}
    for name, statistic in columns.items():
        np.testing.assert_array_equal(lanes[name], stored[f"tail_max_{statistic}"] / [1, 10])
    assert given.loc["peak gain", "greatest tail error / ā"].tolist() == [12, 12]
    picture = found["test_star.svg"].read_text()
    assert "peak gain" in picture
    assert "rgb(230, 233, 237)" not in picture  # the ink of the dark


def test_the_networks_are_drawn_in_the_colours_of_the_page(html):
    """Beside the setting: attacked links and vehicles, and in the dark too."""
    text = section(html, "run")
    assert "<dt>topology</dt><dd>star, " in text
    assert "s, without interrupted runs and searches</dd>" in text
    drawn = re.search(r'<svg role="img".*?</svg>', text, re.DOTALL)[0]
    assert "var(--red)" in drawn
    assert not re.search(r"#(000000|ffffff|262626|d55e00)", drawn, re.IGNORECASE)


NAMES = ("the ring of the first laboratory", "a star", "chain with a shortcut from last to first")
TOUCHING = """plots => plots.flatMap(plot => {
  const frame = plot.getBoundingClientRect();
  const texts = [...plot.querySelectorAll(".main-svg text")];
  const boxes = texts.map(text => [text.textContent, text.getBoundingClientRect()]);
  const seen = boxes.filter(([words, box]) => words.trim() && box.width);
  const out = seen.filter(([, box]) => Math.min(box.left - frame.left, box.top - frame.top) < -1
    || Math.min(frame.right - box.right, frame.bottom - box.bottom) < -1);
  const over = ([, a], [, b]) => Math.min(Math.min(a.right, b.right) - Math.max(a.left, b.left),
    Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top)) > 1;
  const pairs = seen.flatMap((one, n) =>
    seen.slice(n + 1).filter(other => over(one, other)).map(([words]) => [one[0], words]));
  return [...out.map(([words]) => words), ...pairs];
})"""


# Panels whose plots do not begin where those of their row do.
OUT_OF_LINE = """panels => {
  const rows = {}, top = (each) => Math.round(each.getBoundingClientRect().top);
  for (const panel of panels.filter((each) => each.clientWidth))
    (rows[top(panel)] ??= new Set()).add(top(panel.querySelector(".plot")));
  return Object.entries(rows).filter(([, tops]) => tops.size > 1);
}"""


@pytest.mark.long
def test_no_label_on_the_page_touches_another(browser, tmp_path):
    """In each plot, at each width; none is cut off, and nothing overflows."""
    sweep = {
        "topology": [{"kind": "star", "label": label} for label in NAMES],
        "attack.frequency": {"geomspace": [0.1, 10, 3]},
        "attack.magnitude": {"geomspace": [0.1, 100, 4]},
    }
    keys = {"samples": 1, "vehicles": 3, "horizon": 0.5, "tail": 0.1, "recovery": {"tau": 0.01}}
    keys |= {"attack": {"kind": "rotating", "vehicles": [2]}, "save": {"errors": True}}
    study = systems.study(engine="exact", sweep=sweep, **keys)
    path = page.write_page(jaxnet.run(study, tmp_path / "out"))
    shown = browser.new_page()
    shown.goto(path.as_uri())
    first, pager = titles(shown, "#bands"), shown.locator("#bands .pager")
    pager.locator("button", has_text="Next").click()
    assert pager.locator("output").inner_text() == "25 to 36 of 36"
    last = titles(shown, "#bands")
    assert (len(first), len(last), len({*first, *last})) == (24, 12, 36)
    assert not [title for title in first + last if re.search(r"\d\.\d{5}", title)]
    for width in (390, 800, 1400):  # [px] of a phone, a tablet and a desk
        shown.set_viewport_size({"width": width, "height": 900})
        read_through(shown)
        assert shown.eval_on_selector_all(".plot", TOUCHING) == [], width
        assert shown.eval_on_selector_all(".grid .panel", OUT_OF_LINE) == [], width
        assert shown.evaluate("document.scrollingElement.scrollWidth <= innerWidth")
    shown.close()
    assert path.stat().st_size < 8e6
