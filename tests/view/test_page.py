"""The report page: the folder's numbers, nothing fetched, every plot drawn, in any light and width."""

import json
import re
import shutil
from html import unescape

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

import jaxnet
from jaxnet.runs.replay import replay
from jaxnet.statistics import curves
from jaxnet.store.results import Results
from jaxnet.view import page
from jaxnet.view.figures import bands, style, ultimate, unrecovered
from jaxnet.view.figures import every as figures
from jaxnet.view.page import plots, sections
from tests import systems

HOSTILE = "<script>alert('ring')</script> & <b>more $x$"
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two topologies, one with a hostile label, by three ā, with all that other commands write."""
    study = systems.study(
        engine="exact",
        samples=3,
        horizon=1.0,
        tail=0.5,
        sweep={
            "topology": ["star", {"kind": "cyclic", "label": HOSTILE}],
            "attack.magnitude": [0, 1, 10],
        },
        save={"errors": True, "trajectories": "all"},
    )
    results = jaxnet.run(study, tmp_path_factory.mktemp("page") / "out")
    replay(results, 5, 2)
    share = pd.read_csv(results.path / "cells.csv")
    share["unrecovered"] = [np.nan, 0.25, 0.5, np.nan, 0.75, 1.0]
    share["unrecovered_low"], share["unrecovered_high"] = share["unrecovered"] - 0.1, share["unrecovered"]
    share.to_csv(results.path / "cells.csv", index=False)
    slopes, fits = [], []
    for place, topology in enumerate(("star", HOSTILE), 1):
        for vehicle in (*range(1, 13), "worst", "fleet"):
            slopes.append([topology, "static", vehicle, "" if place == 2 else 7.25])
            slopes.append([topology, "peak_gain", vehicle, place * (vehicle if vehicle in range(13) else 12)])
            slopes.append([topology, "lyapunov_printed", vehicle, np.inf if place == 2 else 40])
        fits.append([topology, "tail_max", "proportional", "", "s", 3.5 * place, 3, 4, -8.0])
        fits.append([topology, "tail_max", "proportional", 0.95, "s", 6.5, 6, 7, ""])
        fits.append([topology, "tail_max", "affine", "", "s", 99, 98, 100, -7.0])
    columns = ["topology", "bound", "vehicle", "slope"]
    pd.DataFrame(slopes, columns=columns).to_csv(results.path / "bounds.csv", index=False)
    columns = ["topology", "metric", "model", "quantile", "parameter", "estimate", "low", "high", "aicc"]
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
    rows = re.findall(r"<tr>(<td.*?)</tr>", text)
    cells = [re.findall(r'<td class="number"(?: data-value="(.*?)")?>', row) for row in rows]
    return [[float(value) if value else np.nan for value in row] for row in cells]


def test_the_summary_has_the_numbers_of_cells_csv(folder, html):
    """All cells, in full precision."""
    stored = pd.read_csv(folder / "cells.csv")
    columns = ["attack.magnitude", "ok", "failed", "unrecovered", "unrecovered_low", "unrecovered_high"]
    columns += [f"tail_mean_{name}" for name in ("mean", "low", "high", "median", "q95")] + ["tail_max_max"]
    shown = np.array(rows_of(section(html, "summary")))
    np.testing.assert_array_equal(shown[:, 0], range(6))
    np.testing.assert_array_equal(shown[:, 1:], stored[columns])


def test_what_a_config_says_is_text(html):
    """A label never becomes markup, neither in the page nor in the script's data."""
    assert "<script>alert" not in html
    assert html.count("</script>") == 3
    assert HOSTILE in unescape(section(html, "summary"))
    assert HOSTILE in json.loads(data_of(html))["lanes"][0]["label"]


def data_of(html: str) -> str:
    """The numbers of the plots."""
    return re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.DOTALL)[1]


def test_violations_and_failures_have_their_commands(folder, html, monkeypatch):
    """What is listed, and that there is nothing to list."""
    assert "jaxnet replay out --cell 4 --sample 1" in section(html, "violations")
    assert "None." in section(html, "failed")
    failed = pd.DataFrame({"cell": [3], "sample": [2], "status": ["singular"]})
    monkeypatch.setattr(Results, "failed", lambda self, most: (1, failed))
    listed = unescape(sections.failed(jaxnet.open(folder)).body)
    assert "1 lane:" in listed
    assert f"<td>singular</td><td>jaxnet replay {folder} --cell 3 --sample 2</td>" in listed


def test_curves_have_the_groups_own_bounds_and_fits(folder):
    """ā = 0 is left out; blank bounds are none and infinite ones not drawn; other models are not taken."""
    star, ring = curves.curves(jaxnet.open(folder))
    assert star.sizes.tolist() == [1, 10]
    assert star.limits("tail_max") == {"static": 7.25, "peak_gain": 12, "lyapunov_printed": 40}
    assert star.limits("tail_mean")["peak_gain"] == pytest.approx(6.5)  # mean of 1 to 12
    assert ring.limits("tail_max") == {"peak_gain": 24}
    assert np.isinf(ring.slope("lyapunov_printed", "fleet"))
    assert (star.fit("tail_max"), ring.fit("tail_max")) == ((3.5, 3, 4), (7, 3, 4))
    assert ring.fit("tail_max", 0.95) == (6.5, 6, 7)
    assert star.fit("tail_mean") is None


def test_values_are_alike_however_a_file_writes_them():
    """A column of 1 and 2.5 is written as 1.0 and 2.5."""
    assert curves.alike(1) == curves.alike(1.0) == curves.alike("1")
    assert curves.alike("star") != curves.alike("cyclic")


def test_bands_are_quantiles_over_samples(folder):
    """The same lanes sorted by hand."""
    results = jaxnet.open(folder)
    band = curves.all_bands(results)[4]
    values = np.sort(results.errors["tracking"].values[4], axis=0)
    np.testing.assert_allclose(band.median, values[1], rtol=1e-6)
    np.testing.assert_allclose(band.greatest, values[2], rtol=1e-6)
    np.testing.assert_allclose(band.low, 0.9 * values[0] + 0.1 * values[1], rtol=1e-6)
    assert band.time.tolist() == results.errors["time"].values.tolist()


def test_figures_for_paper_show_the_same(folder):
    """A panel a group; bounds, maxima and shares where they belong; a label is no formula."""
    results = jaxnet.open(folder)
    found = curves.curves(results)
    star, ring = ultimate.figure(found).axes
    assert star.get_title() == "star"
    assert ring.get_title().replace("\n", " ").replace("\\$", "$") == HOSTILE
    assert (star.get_xscale(), star.get_yscale(), star.get_ylabel()) == (
        "log",
        "log",
        "greatest tail error [m]",
    )
    heights = [line.get_ydata().tolist() for line in star.lines]
    assert heights[:4] == [[7.25, 72.5], [12, 120], [40, 400], [3.5, 35]]
    assert heights[-1] == results.cells["tail_max_max"][1:3].tolist()
    shares = [panel.lines[0].get_ydata().tolist() for panel in unrecovered.figure(results, found).axes]
    assert shares == [[25, 50], [75, 100]]
    over_time = bands.figure(results.study.cells, curves.all_bands(results))
    assert [len(panel.lines) for panel in over_time.axes] == [6, 6]
    assert [text.get_text() for text in over_time.legends[0].get_texts()][:3] == [
        "no attack",
        "ā = 1 m",
        "ā = 10 m",
    ]


def test_shares_of_cells_where_no_size_is_swept(folder):
    """A row a cell that has a share, named by what is swept, its label escaped for plotly."""
    grid = plots.unrecovered_rows(jaxnet.open(folder), 24)
    (trace,) = grid["panels"][0][0]
    assert (trace["x"], trace["y"]) == ([25, 50, 75, 100], [0, 1, 2, 3])
    np.testing.assert_allclose(trace["error_x"]["arrayminus"], 10)
    names = grid["layouts"][0]["yaxis"]["ticktext"]
    joined = unescape(names[2].replace("<br>", "")).replace(" ", "").replace("\N{NO-BREAK SPACE}", "")
    assert joined == f"{HOSTILE}, attack.magnitude = 1 m".replace(" ", "")
    assert "<script" not in names[2]


def test_figures_are_written_in_both_formats(folder):
    """What `report` adds to the folder."""
    with mpl.rc_context(style.RC):
        paths = list(figures.save(jaxnet.open(folder), "shares", unrecovered.rows(jaxnet.open(folder))))
    assert [path.read_bytes()[:4] for path in paths] == [b"\x89PNG", b"%PDF"]


def test_missing_files_leave_their_sections_out(folder, tmp_path):
    """A folder of rows alone still makes a page, which says what to run."""
    bare = tmp_path / "bare folder"
    shutil.copytree(folder, bare, ignore=shutil.ignore_patterns("*.zarr", "fit.csv", "bounds.csv", "viol*"))
    cells = pd.read_csv(bare / "cells.csv")
    cells.drop(columns=[name for name in cells if "unrecovered" in name]).to_csv(
        bare / "cells.csv", index=False
    )
    text = page.write_page(jaxnet.open(bare)).read_text()
    assert 'id="bands"' not in text
    assert 'id="unrecovered"' not in text
    command = unescape(section(text, "violations"))
    assert f"jaxnet fit '{bare}'" in command
    assert "jaxnet replay" in section(text, "lanes")


@pytest.fixture(scope="module")
def browser():
    """A Chromium that is told to ask nobody for anything."""
    if BROWSER is None:
        pytest.skip("no Chromium is installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        chromium = driver.chromium.launch(
            executable_path=BROWSER, args=["--no-sandbox", "--disable-background-networking"]
        )
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser, folder, html):
    """Opens the page offline; at the end nothing but the file was asked for and nothing was complained of."""
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


@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1400, "light")])
def test_every_plot_is_drawn_and_nothing_overflows(opened, width, scheme):
    """Plots of two groups in three sections and the plane have traces; text is read on its own ground."""
    shown = opened(width, scheme)
    points = shown.eval_on_selector_all(
        ".plot", "plots => plots.map(p => p.querySelectorAll('.main-svg .trace path').length)"
    )
    assert len(points) == 7
    assert min(points) > 0
    assert shown.evaluate("document.scrollingElement.scrollWidth <= innerWidth")
    ground = "getComputedStyle(document.body).backgroundColor"
    ink = "getComputedStyle(document.querySelector('.xtick text')).fill"
    assert (np.mean(levels(shown.evaluate(ground))) > 128) == (scheme == "light")
    assert (np.mean(levels(shown.evaluate(ink))) < 128) == (scheme == "light")
    shown.emulate_media(color_scheme="dark" if scheme == "light" else "light")
    shown.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert (np.mean(levels(shown.evaluate(ink))) < 128) == (scheme == "dark")


def levels(colour: str) -> list[int]:
    """Red, green and blue."""
    return [int(level) for level in re.findall(r"\d+", colour)[:3]]


def test_the_table_sorts(opened):
    """Numbers as numbers, by mouse and by keyboard, and the header says so."""
    shown = opened(1400, "light")
    column = shown.locator("#summary th", has_text="attack.magnitude")

    def values():
        return [float(text) for text in shown.locator("#summary td:nth-child(3)").all_inner_texts()]

    assert values() == [0, 1, 10, 0, 1, 10]
    column.locator("button").click()
    assert values() == [0, 0, 1, 1, 10, 10]
    assert column.get_attribute("aria-sort") == "ascending"
    column.locator("button").press("Enter")
    assert values() == [10, 10, 1, 1, 0, 0]
    assert column.get_attribute("aria-sort") == "descending"
    share = shown.locator("#summary th", has_text="share low").locator("button")
    share.click()
    low = shown.locator("#summary td:nth-child(7)").all_inner_texts()
    assert low[-2:] == ["–", "–"]


def test_the_slider_moves_the_vehicles(opened, folder):
    """At the start and at the end vehicles stand where the store has them."""
    import xarray as xr

    shown = opened(1400, "light")
    states = xr.open_zarr(folder / "replays" / "cell-5-sample-2.zarr")["states"].values[0]
    slider = shown.locator("#lanes input")
    honest = [0, 2, 3, 5, 6, 8, 9, 11]

    def places():
        return np.array(shown.eval_on_selector("#lanes .plot", "plot => [plot.data[3].x, plot.data[3].y]")).T

    np.testing.assert_allclose(places(), states[-1, honest, :2], rtol=1e-5)
    slider.focus()
    slider.press("Home")
    np.testing.assert_allclose(places(), states[0, honest, :2], rtol=1e-5)
    assert shown.locator("#lanes output").inner_text() == "t = 0.0 s"
    assert shown.eval_on_selector("#lanes .plot", "plot => plot.data[4].text") == [
        f"vehicle {n}" for n in (2, 5, 8, 11)
    ]
    assert "--cell 5 --sample 2" in shown.locator("#lanes code").inner_text()


def test_choosing_another_size_redraws(opened):
    """The bands of ā = 10 m end higher than those without an attack."""
    shown = opened(1400, "light")
    last = "plots => plots.map(plot => plot.calcdata[3].at(-1).y)"
    before = np.array(shown.eval_on_selector_all("#bands .plot", last))
    shown.locator("#bands select").select_option("ā = 10 m")
    after = np.array(shown.eval_on_selector_all("#bands .plot", last))
    assert before.shape == (2,)
    assert (before != after).all()
