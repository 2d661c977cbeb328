"""Figures say what they show: axes with units, a legend, every cell, nothing over the edge."""

import itertools
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from matplotlib.image import imread
from upath import UPath

import jaxnet
from jaxnet.api import writing
from jaxnet.config.scenario import situation_of
from jaxnet.statistics.bands import error_bands
from jaxnet.store.results import Results
from jaxnet.view.figures import (
    FIGURE_NAMES,
    every,
    multiples,
    panels,
    spreads,
    style,
    topology,
)
from jaxnet.view.page.drawings import bands_html
from tests import systems


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Two topologies with and without attack, two samples, everything saved."""
    study = systems.study(
        engine="exact",
        samples=2,
        horizon=1.0,
        tail=0.5,
        sweep={"topology": ["star", "cyclic"], "attack.magnitude": [0, 5]},
        save={"errors": True, "trajectories": "all"},
    )
    return jaxnet.run(study, tmp_path_factory.mktemp("view") / "out")


def texts(figure):
    """Everything written in a figure."""
    return [
        text.get_text()
        for axes in figure.axes
        for text in [axes.title, axes.xaxis.label, axes.yaxis.label]
    ]


def test_panels(results):
    """A row per magnitude; planes in metres and on one scale, errors on log axes."""
    figure = panels.panels_figure(results, results.study.cells, trajectories=True, errors=True)
    planes = [axes for axes in figure.axes if axes.get_xlabel() == "x [m]"]
    errors = [axes for axes in figure.axes if axes.get_yscale() == "log"]
    assert [axes.get_title() for axes in planes] == [
        "(a) star",
        "(b) cyclic",
        "(d) star",
        "(e) cyclic",
    ]
    assert len(errors) == 4
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in planes}) == 1
    assert "no\N{NO-BREAK SPACE}attack\ny [m]" in texts(figure)
    written = [text.get_text() for text in figure.legends[0].get_texts()]
    assert written == ["navigator", "vehicle", "attacked vehicle", "start", "end"]
    # 12 vehicles with path, start and end, and the navigator, inside the frame
    for axes in planes:
        assert len(axes.lines) == 37
        points = np.concatenate([line.get_xydata() for line in axes.lines])
        assert np.abs(points).max() <= axes.get_xlim()[1]
    # the median of two samples, one line per topology
    tracked = results.errors["tracking"].values[[1, 3]].mean(axis=1)
    drawn = [axes for axes in errors if "tilde{e}" in axes.get_ylabel()][1]
    np.testing.assert_allclose([line.get_ydata() for line in drawn.lines], tracked, rtol=1e-6)


def test_topologies(results):
    """An arrow for every link, in the attack's look where the link is attacked."""
    figure = topology.topology_figure(results.study.cells)
    star, cyclic = figure.axes
    assert (star.get_title(), cyclic.get_title()) == ("star", "cyclic")
    assert (len(star.patches), len(cyclic.patches)) == (12, 36)
    red = [
        [patch.get_linestyle() != "-" for patch in axes.patches].count(True)
        for axes in (star, cyclic)
    ]
    assert red == [4, 8]
    labels = {text.get_text() for text in cyclic.texts}
    assert {"0.1", "0.45", *map(str, range(13))} == labels


def test_tails(results):
    """A row per cell, a dot per lane."""
    (axes,) = spreads.tails_figure(results, results.study.cells).axes
    assert axes.get_xscale() == "log"
    assert axes.get_xlabel().endswith("[m]")
    named = axes.get_yticklabels()
    assert named[0].get_text().replace("\N{NO-BREAK SPACE}", " ") == "star, ā = 0 m"
    dots = np.concatenate([line.get_xdata() for line in axes.lines if line.get_marker() == "."])
    np.testing.assert_allclose(np.sort(dots), np.sort(results.lanes["tail_mean"]))


def test_few_dots_stand_for_many_lanes():
    """Quantiles stay where they are, and nobody is left out at the ends."""
    values = np.random.default_rng(0).lognormal(size=50_000)
    dots = spreads.thin_by_rank(values)
    assert len(dots) == spreads.MOST_DOTS
    assert (dots[0], dots[-1]) == (values.min(), values.max())
    np.testing.assert_allclose(
        np.quantile(dots, [0.05, 0.5, 0.95]), np.quantile(values, [0.05, 0.5, 0.95]), 2e-3
    )
    np.testing.assert_array_equal(spreads.thin_by_rank(values[:7]), np.sort(values[:7]))


@pytest.fixture
def many():
    """More than a figure takes: 15 frequencies, five topologies, four sizes ā each; not run."""
    return systems.study(
        vehicles=4,
        attack={"vehicles": [2]},
        sweep={
            "topology": [{"kind": "cyclic", "label": f"graph {number}"} for number in range(5)],
            "attack.frequency": {"linspace": [0.1, 1.5, 15]},
            "attack.magnitude": [1, 2, 3, 4],
        },
    )


def made_of(study, **stored):
    """Results that have these stores, and are in no folder."""
    made = Results(UPath("nowhere"))
    vars(made).update(study=study, **stored)
    return made


def test_panels_without_trajectories_name_their_rows(many, monkeypatch):
    """By attack, ā and what else is swept; what is left out is said."""
    times = np.arange(3.0)
    values = np.ones((len(many.cells), 1, 3))
    there = dict.fromkeys(("tracking", "disagreement"), (("cell", "sample", "time"), values))
    monkeypatch.setattr(Results, "errors", xr.Dataset(there, {"time": times}))
    figure = panels.panels_figure(made_of(many), many.cells, trajectories=False, errors=True)
    titles = [axes.get_title().replace("\N{NO-BREAK SPACE}", " ") for axes in figure.axes[::2]]
    assert titles[1] == "(b) rotating attack, ā = 2 m, attack frequency = 0.1 rad/s"
    assert len(titles) == 4
    assert (
        figure.get_suptitle()
        == "4 of 60 rows and 4 of 5 topologies are drawn; all are in errors.zarr"
    )


def test_one_lane_is_a_line_and_no_band(results):
    """Without quantiles and maximum, in the figure and on the page; two lanes have both."""
    cells = results.study.cells[:1]
    two = error_bands(results, cells)
    alone = {number: band._replace(lanes=1) for number, band in two.items()}
    parts = {"5 to 95 % of lanes", "maximum"}
    for found, many in ((two, True), (alone, False)):
        drawn = spreads.bands_figure(cells, found)
        told = {text.get_text() for text in drawn.legends[0].get_texts()}
        assert (parts <= told, "without a band: one lane" in told) == (many, not many)
        assert (len(drawn.axes[0].collections), len(drawn.axes[0].lines)) == (
            (1, 2) if many else (0, 1)
        )
        assert ("one lane" in bands_html(found, "ẽ [m]", cells)) == (not many)


def test_bands_say_what_they_leave_out(many, results):
    """Groups and sizes ā; nothing where all are drawn."""
    few = spreads.bands_figure(results.study.cells, {})
    assert few.get_suptitle() == ""
    assert spreads.bands_figure(many.cells, {}).get_suptitle() == (
        "24 of 75 groups and 3 of 4 sizes ā are drawn; all are in errors.zarr"
    )


@pytest.mark.parametrize("ends", [(2.1, 4.5), (80, 210), (0.9, 9.5), (1, 99), (1e-3, 1e3)])
def test_log_axes_have_numbers_side_by_side(ends):
    """Two at least however short the axis, and none on another."""
    with mpl.rc_context(style.PRINT_STYLE):
        figure = style.Figure(figsize=(1.7, 1.2))
        panel = figure.add_subplot()
    panel.set(xscale="log", xlim=ends, yscale="log", ylim=ends)
    for axis in (panel.xaxis, panel.yaxis):
        multiples.log_ticks(axis)
    figure.draw_without_rendering()
    for axis, side in ((panel.xaxis, 0), (panel.yaxis, 1)):
        within = [
            tick.label1 for tick in axis.get_major_ticks() if ends[0] <= tick.get_loc() <= ends[1]
        ]
        boxes = [label.get_window_extent() for label in within if label.get_text()]
        assert len(boxes) >= 2
        edges = sorted((box.min[side], box.max[side]) for box in boxes)
        assert all(one[1] <= other[0] for one, other in itertools.pairwise(edges))
        assert not any(label.get_text() for label in axis.get_minorticklabels())


@mpl.rc_context(style.PRINT_STYLE)
def graphs_of(vehicles, attacked, topologies, **keys):
    """The figure of these graphs."""
    given = {
        "vehicles": vehicles,
        "attack": {"vehicles": attacked},
        "sweep": {"topology": topologies},
    }
    figure = topology.topology_figure(systems.study(**given, **keys).cells)
    figure.draw_without_rendering()
    return figure


@pytest.mark.parametrize("vehicles", [48])
def test_nodes_of_graphs_keep_apart(vehicles):
    """Each has its number, at 5 points or more, and none lies on another."""
    figure = graphs_of(vehicles, [2], ["star", "cyclic", "path"])
    for axes in figure.axes:
        nodes: Any = [line for line in axes.lines if line.get_marker() in ("o", "s")]
        places = (
            axes.transData.transform([line.get_xydata()[0] for line in nodes]) * 72 / figure.dpi
        )
        apart = np.hypot(*(places[:, None] - places).T) + 1e3 * np.eye(len(nodes))
        assert apart.min() > max(line.get_markersize() for line in nodes)
        written: dict[str, Any] = {text.get_text(): text.get_fontsize() for text in axes.texts}
        assert {str(number) for number in range(vehicles + 1)} <= set(written)
        assert min(written.values()) >= 5
    assert figure.get_suptitle() == ""


def test_graphs_too_large_for_numbers_say_so():
    """The navigator and the attacked keep theirs."""
    figure = graphs_of(300, [7], ["star"])
    assert {text.get_text() for text in figure.axes[0].texts} == {"0", "7"}
    assert figure.axes[0].get_title() == "star\nweights: 1 from 0"
    words = "There is no room for the numbers of vehicles that are not attacked"
    assert figure.get_suptitle() == words


@pytest.mark.parametrize(
    ("name", "column"),
    [("topologies", "two"), ("tails", "one"), ("panels", "one"), ("bands", "two")],
)
def test_figures_are_as_wide_as_columns_and_no_taller_than_a_page(results, name, column):
    """With type of 6 points at least, and nothing that is written over the edge."""
    figure = getattr(results.plot, name)(column=column)
    width, height = figure.get_size_inches()
    assert width == {"one": 3.5, "two": 7.16}[column]
    assert height <= style.GREATEST_HEIGHT
    with mpl.rc_context(style.PRINT_STYLE):
        figure.draw_without_rendering()
    for text in figure.findobj(mpl.text.Text):
        if text.get_text() and text.get_visible():
            assert text.get_fontsize() >= 6
    box = figure.get_tightbbox()
    assert box.x0 >= -0.02
    assert box.y0 >= -0.02
    assert box.x1 <= width + 0.02
    assert box.y1 <= height + 0.02


def test_chosen_cells_are_what_is_drawn(results):
    """What all rows share stands above them; a choice is told by the file's name."""
    figure = results.plot.tails(where={"topology": "cyclic"})
    named = [
        label.get_text().replace("\N{NO-BREAK SPACE}", " ")
        for label in figure.axes[0].get_yticklabels()
    ]
    assert named == ["ā = 0 m", "ā = 5 m"]
    assert figure.get_suptitle() == "all with cyclic; one dot per lane; median and 5 to 95 %"
    dots = np.concatenate(
        [line.get_xdata() for line in figure.axes[0].lines if line.get_marker() == "."]
    )
    kept = results.lanes[results.lanes["topology"] == "cyclic"]
    np.testing.assert_allclose(np.sort(dots), np.sort(kept["tail_mean"]))
    names = [
        every.file_name("tails", {}, "two"),
        every.file_name("tails", {}, "one"),
        every.file_name("tails", {"topology": ["star"]}, "two"),
        every.file_name("tails", {"topology": ["st/ar"]}, "two"),
        every.file_name("tails", {"topology": ["st:ar"]}, "two"),
        every.file_name("tails", {"topology": ["x" * 300]}, "two"),
    ]
    assert names[:3] == ["tails", "tails-one-column", "tails-topology=star"]
    assert len(set(names)) == len(names)
    assert all("/" not in name and len(name) < 120 for name in names)


def test_a_large_fleet_is_shown_by_its_matrix():
    """Grey if anybody in a bin hears anybody there, else white; a strip for 0, marked attacks."""
    attack = {"kind": "bias", "vehicles": [2, 700]}
    study = systems.study(vehicles=720, attack=attack, sweep={"topology": ["cyclic", "path"]})
    for panel, cell in zip(topology.topology_figure(study.cells).axes, study.cells, strict=True):
        (image, strip), m = panel.images, 720
        known, hears = np.zeros((60, 60), bool), set()
        for i, j in situation_of(cell.scenario).graph.pairs():
            if j == 0:
                hears.add(i // 12)
            else:
                known[i // 12, (j - 1) // 12] = True
        np.testing.assert_array_equal(image.get_array() < 1.0, known)
        assert image.get_extent() == [0.5, m + 0.5, m + 0.5, 0.5]
        assert set(np.flatnonzero(strip.get_array()[:, 0, 3])) == hears
        assert panel.lines[0].get_xdata().tolist() == [2, 700]


def test_a_dollar_in_a_label_is_a_dollar():
    """Neither mathematics nor an error, and on the page the label itself."""
    star = {"kind": "star", "label": "costs $5_{$"}
    study = jaxnet.load({"vehicles": 3, "topology": star, "attack": "none"})
    cell = study.cells[0]
    drawn = topology.topology_figure([cell])
    drawn.canvas.draw()
    assert drawn.axes[0].get_title() == r"costs \$5_{\$"
    assert topology.graph_caption(cell) == "costs $5_{$"


def test_the_style_for_print_can_be_left_out(tmp_path):
    """A plain figure has matplotlib's sizes, drawn and saved; the other has its own."""
    results = jaxnet.run(
        systems.study(samples=2, horizon=1.0, tail=0.5, engine="exact"), tmp_path / "out"
    )
    with mpl.rc_context({"font.size": 17.0, "savefig.dpi": 50}):
        plain, print_ = results.plot.plain.tails(), results.plot.tails()
        (name,) = [
            path
            for path in writing.write_figure(results, "tails", plain=True)
            if path.suffix == ".png"
        ]
    assert plain.axes[0].xaxis.label.get_fontsize() == 17.0
    assert print_.axes[0].xaxis.label.get_fontsize() == 8.0
    assert name.name == "tails-plain.png"
    width = imread(str(name)).shape[1]
    assert width == pytest.approx(50 * plain.get_figwidth(), abs=1)


def test_the_note_can_be_left_out(results, tmp_path):
    """Every figure takes `note`; the file's name tells that there is none."""
    assert results.plot.tails().get_suptitle()
    assert results.plot.tails(note=False).get_suptitle() == ""
    assert results.plot.plain.tails(note=False).get_suptitle() == ""
    assert every.file_name("curve", {}, "two", note=False) == "curve-no-note"
    assert all(getattr(every.Plots, name).__doc__ for name in FIGURE_NAMES)
