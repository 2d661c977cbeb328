"""Figures say what they show: axes with units, a legend, every cell, nothing over the edge."""

import itertools
import re
from collections import Counter
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.colors import to_rgba
from matplotlib.image import imread
from upath import UPath

import jaxnet
from jaxnet.api import writing
from jaxnet.config.scenario import situation_of
from jaxnet.statistics import quantities
from jaxnet.statistics.bands import error_bands
from jaxnet.statistics.groups import Group, scenes
from jaxnet.statistics.quantities import quantity_of
from jaxnet.statistics.tiles import share_lost
from jaxnet.store.folder import FolderError
from jaxnet.store.results import Results
from jaxnet.view.drawings import spreads
from jaxnet.view.drawings.drawing import Drawing, Look, Panel, Scale, Trace
from jaxnet.view.figures import FIGURE_NAMES, every, multiples, panels, style, topology
from jaxnet.view.figures.printed import printed
from jaxnet.view.page import sections
from jaxnet.view.page.plots import plotted
from tests import systems

SAVED = {"errors": True, "trajectories": "all"}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Two topologies with and without attack, two samples, everything saved."""
    sweep = {"topology": ["star", "cyclic"], "attack.magnitude": [0, 5]}
    keys = {"samples": 2, "horizon": 1.0, "tail": 0.5, "sweep": sweep, "save": SAVED}
    study = systems.study(engine="exact", **keys)
    return jaxnet.run(study, tmp_path_factory.mktemp("view") / "out")


def plain(words: str) -> str:
    return words.replace("\N{NO-BREAK SPACE}", " ")


def dots_of(axes) -> np.ndarray:
    """Sorted values of the dots in a panel."""
    return np.sort(np.concatenate([x.get_xdata() for x in axes.lines if x.get_marker() == "."]))


def test_panels(results):
    """A row per magnitude; planes in metres and on one scale, errors on log axes."""
    figure = results.plot.panels()
    planes = [axes for axes in figure.axes if axes.get_xlabel() == "x [m]"]
    titles = ["(a) star", "(b) cyclic", "(d)", "(e)"]  # a name stands above its column
    assert [axes.get_title() for axes in planes] == titles
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in planes}) == 1
    assert plain(planes[0].get_ylabel()) == "no attack\ny [m]"
    written = [text.get_text() for text in figure.legends[0].get_texts()]
    attacked = ["attacked vehicle", "false place in messages"]
    graphs = ["error, star", "error, cyclic"]
    assert {*written} == {"navigator", "vehicle", *attacked, "start", "end", *graphs}
    for place, axes in enumerate(planes):  # 12 vehicles with path, start and end, the navigator
        told = [line.get_xydata() for line in axes.lines if line.get_color() == style.RED]
        assert len(axes.lines) == 37 + 4 * (place > 1)
        assert len(told) == 16 * (place > 1)
        points = np.concatenate([line.get_xydata() for line in axes.lines])
        box = np.array([axes.get_xlim(), axes.get_ylim()]).T
        assert ((box[0] <= points) & (points <= box[1])).all()
        assert (points.max(axis=0) - points.min(axis=0) > 0.4 * (box[1] - box[0])).any()
    told = figure.get_supxlabel().replace("\n", " ")
    assert "paths: the first stored lane of each cell, sample 0; all on one scale" in told
    assert "lines: median of the lanes, bands: 5 to 95 % of lanes; ẽ: mean error" in told
    errors = [axes for axes in figure.axes if axes.get_yscale() == "log"]
    assert len(errors) == 4
    assert not any(axes.get_legend() for axes in figure.axes)  # it would hide lines
    tracked = results.errors["tracking"].values[[1, 3]].mean(axis=1)  # the median of two samples
    np.testing.assert_allclose([line.get_ydata() for line in errors[2].lines], tracked, rtol=1e-6)


def test_the_worst_lane_is_told_as_such(tmp_path):
    """By its sample, if only the worst lanes are stored; and the path that it is told."""
    keys = {"horizon": 1.0, "tail": 0.5, "save": {"trajectories": {"worst": 1}}}
    attack = {"kind": "bias", "vehicles": [2], "magnitude": 3, "direction": 0}
    sweep = {"topology": ["star", "cyclic"]}
    study = systems.study(engine="exact", samples=6, attack=attack, sweep=sweep, **keys)
    results = jaxnet.run(study, tmp_path / "out", progress=False)
    figure = results.plot.panels()
    rows = results.lanes
    worst = rows.loc[rows.groupby("cell")["tail_mean"].idxmax(), "sample"].tolist()
    told = figure.get_supxlabel().replace("\n", " ")
    each = [f"{sample} in ({letter})" for sample, letter in zip(worst, "ab", strict=True)]
    samples = each if worst[0] != worst[1] else [str(worst[0])]
    assert f"paths: the worst lane of each cell, sample {', '.join(samples)}" in told
    lane, cyclic = results.trajectories.isel(lane=1), figure.axes[1]
    paths = [line.get_xydata() for line in cyclic.lines if line.get_linewidth() == 0.8]
    (shift,) = {tuple(np.round(path[-1] - lane["states"].values[-1, 1, :2], 6)) for path in paths}
    assert np.hypot(*shift) == pytest.approx(3.0, rel=1e-3)


def test_a_false_place_that_stands_still_has_a_mark(tmp_path):
    """All of its path is one place; the row says in words what is false."""
    attack = {"kind": "own_path", "vehicles": [2], "centre": [30, 40], "swing": [0, 0]}
    keys = {"horizon": 1.0, "tail": 0.5, "save": {"trajectories": "all"}, "attack": attack}
    results = jaxnet.run(systems.study(engine="exact", **keys), tmp_path / "out", progress=False)
    panel = results.plot.panels().axes[0]
    (still,) = (line for line in panel.lines if line.get_marker() == "x")
    assert {*map(tuple, still.get_xydata().round(9))} == {(30.0, 40.0)}
    assert still.get_markevery() == [-1]
    assert "attack: path of its own, ā = 5 m" in plain(panel.get_ylabel()).replace("\n", " ")


def test_a_curve_warns_of_errors_that_are_not_ultimate(results):
    """Where errors may still fall or the fleet is lost, of the cells that are drawn."""
    found = jaxnet.open(results.path)
    vars(found)["cells"] = found.cells.assign(tail_mean_median=1e12, falling=1.0)
    warnings = "farthest start) in all", "errors still fall when the run ends"
    for y, is_told in (("tail_mean", True), ("tail_max_q95", True), ("failed", False)):
        told = plain(found.figure("curve", y=y).get_supxlabel().replace("\n", " "))
        assert [each in told for each in warnings] == [is_told] * 2, y
    told = found.figure("curve", {"topology": "cyclic"}).get_supxlabel().replace("\n", " ")
    assert "farthest start) in all" in told
    assert "cell " not in told  # values instead of numbers


def test_topologies(results):
    """An arrow for every link, in the attack's look where the link is attacked.

    Links there and back are one arrow of two heads if they look alike: four pairs of honest ones.
    """
    star, cyclic = results.plot.topologies().axes
    weights = "weights: neighbours 0.45, navigator 0.1"
    titles = ["star\nweights: navigator 1", f"cyclic\n{weights}"]
    given = [plain(axes.get_title().replace(",\n", ", ")) for axes in (star, cyclic)]
    assert given == titles
    attacked = [[patch.get_linestyle() != "-" for patch in axes.patches] for axes in (star, cyclic)]
    assert [(len(each), sum(each)) for each in attacked] == [(12, 4), (32, 8)]
    assert {text.get_text() for text in cyclic.texts} == {*map(str, range(13))}


def test_lanes_that_failed_are_seen(tmp_path):
    """A curve counts them as a heat map does; where none ended an error is a cross at the top."""
    keys = {"horizon": 1.0, "tail": 0.5, "samples": 3, "topology": "path"}
    sweep = {"defence": ["none", "w_msr"], "attack.magnitude": [1, 5]}
    study = systems.study(engine="exact", sweep=sweep, recovery={"tau": 0.01}, **keys)
    results = jaxnet.run(study, tmp_path / "out", progress=False)
    assert results.cells["ok"].tolist() == [3, 3, 0, 0]
    found = quantity_of(results, results.study.cells, "unrecovered")
    assert found.values["value"].tolist() == (100 * share_lost(results)["unrecovered"]).tolist()
    assert found.values["value"].tolist()[2:] == [100.0, 100.0]
    assert (found.words, found.lanes) == ("lanes failed or unrecovered", [3] * 4)
    assert "ā, or failed" in plain(found.notes)
    for name, options in (("curve", {"y": "tail_mean"}), ("tails", {})):
        figure = results.figure(name, **options)
        crosses = [line for line in figure.axes[0].lines if line.get_marker() == "x"]
        axis = figure.axes[0].yaxis if name == "curve" else figure.axes[0].xaxis
        of = "get_ydata" if name == "curve" else "get_xdata"
        at = np.concatenate([getattr(line, of)() for line in crosses])
        texts = [label.get_text().strip() for label in axis.get_ticklabels()]
        *numbers, band = axis.get_majorticklocs()
        assert (texts[-1], at.tolist()) == ("none ended", [band] * 2)  # at no number
        assert max(numbers) < band < axis.get_view_interval()[1]
        assert [each.get_text() for each in figure.legends[0].get_texts()][-1] == "no lane ended"
    page = sections.answer_section(results).body
    assert "x-thin-open" in page
    assert '"name":"no lane ended"' in page
    assert page.count('"none ended"') == 1


def test_failed_lanes_of_drawn_cells_are_told(results, monkeypatch):
    """How many of how many, and why; of panels that are drawn, not of others."""
    cells = results.study.cells  # star and cyclic, without and with an attack
    counts = {"ok": [5, 3, 1, 0], "failed": [0, 2, 4, 5], "lanes": 5}
    made = Results(UPath("nowhere"))
    vars(made).update(study=results.study, cells=pd.DataFrame(counts))
    kinds = {cell: Counter(disconnected=many) for cell, many in enumerate(counts["failed"]) if many}
    monkeypatch.setattr(quantities, "failed_kinds", lambda results: kinds)
    assert plain(quantities.unended_words(made, cells)) == (
        "no lane ended: cyclic, ā = 5 m (5 disconnected);"
        " 4 of 5 lanes failed: cyclic, ā = 0 m (4 disconnected);"
        " 2 of 5 lanes failed: star, ā = 5 m (2 disconnected)"
    )
    assert quantities.unended_words(made, cells[:1]) == ""
    line = Trace("", Look(), np.ones(2), np.arange(2))
    panels = [Panel({"tick": n}, [n], [line]) for n in range(100)]
    figure = printed(Drawing(panels, Scale("x"), Scale("y")))
    assert len(figure.cells) == len(figure.axes) < 100
    assert {*results.plot.panels().cells} == {cell.number for cell in cells}


def test_vehicles_drawn_for_each_lane_are_told_beside_the_graph():
    """Their number, for no vehicle is marked; of listed ones nothing is told."""
    for vehicles, told in (({"random": 2}, "2 attacked vehicles drawn for each lane"), ([3], "")):
        attack = {"kind": "rotating", "magnitude": 5, "vehicles": vehicles}
        drawn = topology.topology_figure(systems.study(attack=attack, topology="complete").cells)
        assert ("drawn for each lane" in drawn.get_supxlabel()) is bool(told)
        assert told in drawn.get_supxlabel()
    sweep = {"attack.vehicles": [{"random": 1}, {"random": 2}]}
    drawn = topology.topology_figure(systems.study(topology="complete", sweep=sweep).cells)
    assert "1 to 2 attacked vehicles drawn for each lane" in drawn.get_supxlabel()


@pytest.mark.parametrize("redraw", [False, True])
def test_a_graph_that_each_lane_draws_anew_is_told_to_be_an_example(redraw):
    graph = {"kind": "erdos_renyi", "redraw": redraw}
    cells = systems.study(topology=graph, defence="none", attack="none").cells
    title = topology.topology_figure(cells).axes[0].get_title()
    assert ("each lane has another graph" in title.replace("\n", " ")) is redraw


def test_links_of_the_navigator_stand_out():
    """In a complete graph: dark, in front of the others, and in the legend."""
    cells = systems.study(topology="complete", defence="none", attack="none").cells
    drawn = topology.topology_figure(cells)
    assert [each.get_text() for each in drawn.legends[0].get_texts()[1:]] == [
        "link of the navigator",
        "other link",
    ]
    dark = to_rgba(topology.LINK_LOOKS["link of the navigator"]["color"])
    front = {True: set(), False: set()}
    for patch in drawn.axes[0].patches:
        front[patch.get_edgecolor() == dark].add(patch.get_zorder())
    assert len(drawn.axes[0].patches) == 12 + 12 * 11 // 2
    assert min(front[True]) > max(front[False])


def test_tails_are_rows_of_dots(results):
    """A dot per lane; what all rows share stands above them."""
    (axes,) = results.plot.tails().axes
    assert (axes.get_xscale(), axes.get_xlabel()[-3:]) == ("log", "[m]")
    assert plain(axes.get_yticklabels()[0].get_text()) == "star, ā = 0 m"
    np.testing.assert_allclose(dots_of(axes), np.sort(results.lanes["tail_mean"]))
    figure = results.plot.tails(where={"topology": "cyclic"})
    named = [plain(label.get_text()) for label in figure.axes[0].get_yticklabels()]
    assert named == ["ā = 0 m", "ā = 5 m"]
    told = "all with cyclic; one dot per lane; median and 5 to 95 %; tail: the last 0.5 of 1 s"
    assert plain(figure.get_supxlabel()) == told
    kept = results.lanes.loc[results.lanes["topology"] == "cyclic", "tail_mean"]
    np.testing.assert_allclose(dots_of(figure.axes[0]), np.sort(kept))


def test_what_rows_of_dots_would_repeat_is_a_title(tmp_path):
    """A panel per value of a third key, with the lanes of its cells; one panel if rows differ."""
    sweep = {"topology": ["star", "cyclic"], "defence": ["none", "trusted_only"]}
    sweep |= {"attack.magnitude": [1, 5], "tick": [0.05]}
    keys = {"samples": 3, "horizon": 1.0, "tail": 0.5, "sweep": sweep}
    found = jaxnet.run(systems.study(engine="exact", **keys), tmp_path / "out", progress=False)
    figure = found.plot.tails()
    titles = [plain(panel.get_title()) for panel in figure.axes]
    assert titles == ["no defence", "trusted only"]
    named = [plain(label.get_text()) for label in figure.axes[0].get_yticklabels()]
    assert named == [f"{graph}, ā = {size} m" for graph in sweep["topology"] for size in (1, 5)]
    assert "all with tick = 0.05 s; one dot" in plain(figure.get_supxlabel())
    for panel, defence in zip(figure.axes, sweep["defence"], strict=True):
        mine = found.lanes[found.lanes["defence"] == defence]
        np.testing.assert_allclose(dots_of(panel), np.sort(mine["tail_mean"]))
        for row, (_, lanes) in enumerate(mine.groupby("cell")):
            dots = [line for line in panel.lines if line.get_marker() == "."][row]
            assert {*np.rint(dots.get_ydata())} == {row}
            np.testing.assert_allclose(np.sort(dots.get_xdata()), np.sort(lanes["tail_mean"]))
    some = [cell for cell in found.study.cells if cell.number != 3]
    (panel,) = spreads.tails_drawing(found, some).panels
    assert (panel.labels, panel.cells) == ({}, [cell.number for cell in some])


@mpl.rc_context(style.PRINT_STYLE)
def test_cells_in_rows_of_panels_are_counted():
    """What is drawn of them are the rows of the panels that have room."""
    line = Trace("", Look(), np.ones(30), np.arange(30), "points")
    there = [{"tick": n, "horizon": row} for n in range(9) for row in range(30)]
    panels = [Panel({"tick": n}, [], [line]) for n in range(9)]
    rows = Scale("", names=["a row"] * 30, labels=[{"horizon": row} for row in range(30)])
    figure = printed(Drawing(panels, Scale("x"), rows, there=(there, "cells")))
    many = len(figure.axes) * len(figure.axes[0].get_yticklabels())
    assert 1 < many < 270
    assert f"{many} of 270 cells are drawn" in plain(figure.get_supxlabel())
    assert figure.get_figheight() <= style.GREATEST_HEIGHT


def test_few_dots_stand_for_many_lanes():
    """Quantiles stay where they are, and nobody is left out at the ends."""
    values = np.random.default_rng(0).lognormal(size=50_000)
    dots, levels = spreads.thin_by_rank(values), [0.05, 0.5, 0.95]
    assert len(dots) == spreads.MOST_DOTS
    assert (dots[0], dots[-1]) == (values.min(), values.max())
    np.testing.assert_allclose(np.quantile(dots, levels), np.quantile(values, levels), 2e-3)
    np.testing.assert_array_equal(spreads.thin_by_rank(values[:7]), np.sort(values[:7]))


@pytest.fixture
def many():
    """More than a figure takes: 15 frequencies, five topologies, four sizes ā each; not run."""
    graphs = [{"kind": "cyclic", "label": f"graph {number}"} for number in range(5)]
    sweep = {"topology": graphs, "attack.frequency": {"linspace": [0.1, 1.5, 15]}}
    sweep["attack.magnitude"] = [1, 2, 3, 4]
    return systems.study(vehicles=4, attack={"vehicles": [2]}, sweep=sweep)


@mpl.rc_context(style.PRINT_STYLE)
def test_what_has_no_room_is_told(many, results, monkeypatch):
    """Rows of panels, named by attack, ā and what else is swept; groups and sizes ā of bands."""
    values, times = np.ones((len(many.cells), 1, 3)), np.arange(3.0)
    there = dict.fromkeys(("tracking", "disagreement"), (("cell", "sample", "time"), values))
    monkeypatch.setattr(Results, "errors", xr.Dataset(there, {"time": times}))
    made = Results(UPath("nowhere"))
    vars(made).update(study=many)
    figure = panels.panels_figure(made, many.cells, trajectories=False, errors=True)
    titles = [plain(axes.get_title()) for axes in figure.axes[::2]]
    assert titles[1] == "(b) attack: rotating, ā = 4 m, attack frequency = 0.1 rad/s"
    assert len(titles) == 4
    told = plain(figure.get_supxlabel()).replace("\n", " ")
    gone = "13 of 15 values of attack frequency, ā = 2 m, ā = 3 m, graph 2"
    where = "all are in errors.zarr"
    assert told.endswith(
        f"; 4 of 60 rows and 4 of 5 topologies are drawn; not drawn: {gone}; {where}"
    )
    gone = "11 of 15 values of attack frequency, ā = 2 m"
    left_out = f"20 of 75 groups and 3 of 4 sizes ā are drawn; not drawn: {gone}; {where}"
    for cells, told in ((many.cells, left_out), (results.study.cells, "")):
        drawn = printed(spreads.bands_drawing(scenes(cells), {}, "tracking"))
        assert plain(drawn.get_supxlabel()).replace("\n", " ") == told


def test_one_lane_is_a_line_and_no_band(results):
    """Without quantiles and maximum, in the figure and on the page; two lanes have both."""
    cells = results.study.cells[:1]
    two = error_bands(results.errors["tracking"], cells)
    known = np.quantile(results.errors["tracking"][0], [0.05, 0.5, 0.95, 1.0], axis=0)
    np.testing.assert_allclose(two[0][1:5], known, rtol=1e-6)
    alone = {number: band._replace(lanes=1) for number, band in two.items()}
    groups = [Group(dict(cell.labels), (cell,)) for cell in cells]
    for found, many, drawn in ((two, True, (1, 2)), (alone, False, (0, 1))):
        figure = printed(spreads.bands_drawing(scenes(cells), found, "tracking"))
        told = {text.get_text() for text in figure.legends[0].get_texts()}
        assert ({"5 to 95 % of lanes", "maximum"} <= told) == many
        assert (len(figure.axes[0].collections), len(figure.axes[0].lines)) == drawn
        page = plotted(spreads.bands_drawing(groups, found, "tracking"))
        assert ("one lane" in page) == (not many)


def test_cells_without_a_lane_that_ended_are_told_beside_errors_over_time(tmp_path):
    """Which and why, in the figure and on the page; alone, they are refused."""
    keys = {"horizon": 1.0, "tail": 0.5, "samples": 3, "topology": "path"}
    sweep = {"defence": ["none", "w_msr"]}  # W-MSR cuts a vehicle of one source off at once
    study = systems.study(engine="exact", sweep=sweep, save={"errors": True}, **keys)
    results = jaxnet.run(study, tmp_path / "out", progress=False)
    assert results.cells["ok"].tolist() == [3, 0]
    words = "o lane ended: W-MSR (3 disconnected)"
    figure = results.plot.bands()
    assert words in figure.get_supxlabel().replace("\n", " ")
    assert [text.get_text() for axes in figure.axes for text in axes.texts] == ["no lane ended"]
    body = re.sub("<[^>]*>", "", sections.bands_section(results).body)
    assert words in body
    with pytest.raises(FolderError, match="no lane of these cells came to its end"):
        results.plot.bands({"defence": "w_msr"})


@pytest.mark.parametrize("ends", [(2.1, 4.5), (80.0, 210.0), (0.9, 9.5), (1.0, 99.0), (1e-3, 1e3)])
def test_log_axes_have_numbers_side_by_side(ends):
    """Two at least however short the axis, and none on another."""
    with mpl.rc_context(style.PRINT_STYLE):
        figure = style.Figure(figsize=(1.7, 1.2))
        panel = figure.add_subplot()
    multiples.log_axis(panel, "x", ends)
    multiples.log_axis(panel, "y", ends)
    figure.draw_without_rendering()
    for axis, side in ((panel.xaxis, 0), (panel.yaxis, 1)):
        ticks = [tick for tick in axis.get_major_ticks() if ends[0] <= tick.get_loc() <= ends[1]]
        labels = [tick.label1 for tick in ticks if tick.label1.get_text()]
        boxes = [label.get_window_extent() for label in labels]
        assert len(boxes) >= 2
        edges = sorted((box.min[side], box.max[side]) for box in boxes)
        assert all(one[1] <= other[0] for one, other in itertools.pairwise(edges))
        assert not any(label.get_text() for label in axis.get_minorticklabels())


@mpl.rc_context(style.PRINT_STYLE)
def graphs_of(vehicles, attacked, topologies):
    """The figure of these graphs."""
    attack, sweep = {"kind": "bias", "vehicles": attacked}, {"topology": topologies}
    cells = systems.study(vehicles=vehicles, attack=attack, sweep=sweep).cells
    figure = topology.topology_figure(cells)
    figure.draw_without_rendering()
    return figure, cells


def test_nodes_of_graphs_keep_apart():
    """Each has its number, at 5 points or more; of many, the navigator and the attacked alone."""
    figure, _ = graphs_of(48, [2], ["star", "cyclic", "path"])
    for axes in figure.axes:
        nodes: Any = [line for line in axes.lines if line.get_marker() in ("o", "s")]
        places = axes.transData.transform([line.get_xydata()[0] for line in nodes])
        places *= 72 / figure.dpi
        apart = np.hypot(*(places[:, None] - places).T) + 1e3 * np.eye(len(nodes))
        assert apart.min() > max(line.get_markersize() for line in nodes)
        written: dict[str, Any] = {text.get_text(): text.get_fontsize() for text in axes.texts}
        assert {str(number) for number in range(49)} <= set(written)
        assert min(written.values()) >= 5
    assert figure.get_supxlabel() == ""
    figure, _ = graphs_of(300, [7], ["star"])
    assert {text.get_text() for text in figure.axes[0].texts} == {"0", "7"}
    assert plain(figure.axes[0].get_title()) == "star\nweights: navigator 1"
    words = "There is no room for the numbers of vehicles that are not attacked"
    assert figure.get_supxlabel() == words


def test_graphs_that_differ_by_a_key_are_all_drawn():
    """Their values stand in the title; what has no part in a graph is no note on it."""
    losses = ["none", {"kind": "bernoulli", "probability": 0.2, "label": "a fifth"}]
    sweep = {"channel.loss": losses, "topology.neighbours": [4, 6], "vehicles": [8, 9]}
    keys = {"attack": {"vehicles": [2]}, "topology": {"kind": "lattice", "neighbours": 4}}
    study = systems.study(**keys, sweep=sweep)
    made = Results(UPath("nowhere"))
    vars(made).update(study=study)
    figure = every.Plots(made).topologies()
    given = [axes.get_title().replace(",\n", ", ") for axes in figure.axes]
    titles = [plain(words.split("\n")[0]) for words in given]
    assert titles[:2] == ["lattice, neighbours = 4, vehicles = 8", titles[1]]
    assert len(set(titles)) == 4
    links = [len(axes.patches) - axes.get_title().count("navigator") for axes in figure.axes]
    assert len(set(links)) == 4
    assert figure.get_supxlabel() == ""


def test_rows_of_graphs_are_alike():
    """Three and two rather than four and one."""
    rings = [{"kind": "cyclic", "label": f"ring {n}"} for n in range(5)]
    figure, _ = graphs_of(8, [2], rings)
    rows = [round(axes.get_position().y0, 2) for axes in figure.axes]
    assert sorted(map(rows.count, {*rows})) == [2, 3]


def test_a_ring_with_few_informed_vehicles_is_a_circle():
    """As one with many; a chain is not."""
    ring = {"kind": "lattice", "neighbours": 2, "navigator": [1]}
    for keys, is_ring in ((ring, True), ({"kind": "path"}, False)):
        cell = jaxnet.load({"vehicles": 10, "topology": keys, "attack": "none"}).cells[0]
        places = topology.source_places(situation_of(cell.scenario).graph)[1:]
        assert np.allclose(np.hypot(*places.T), 1.0) == is_ring


def test_a_grid_is_drawn_as_a_grid():
    """Vehicles in rows and columns, the navigator beside them; no link runs through a node."""
    grid = {"kind": "grid", "rows": 2, "columns": 3, "torus": True}
    (network,) = topology.networks_of(jaxnet.load({"vehicles": 6, "topology": grid}).cells)
    x, y = network.places.T
    assert len({*x[1:].round(6)}) == 3
    assert len({*y[1:].round(6)}) == 2
    assert x[0] < x[1:].min()
    assert y[1:].min() < y[0] < y[1:].max()
    assert network.bends(0, 3)  # over vehicle 2


def test_a_title_tells_no_number_of_attacked_vehicles():
    """Where they are drawn for each lane: one graph stands for cells of several numbers."""
    sweep = {"attack.vehicles": [{"random": 1}, {"random": 2}]}
    study = systems.study(vehicles=8, topology="star", sweep=sweep)
    (network,) = topology.networks_of(study.cells)
    assert network.title.split("\n")[0] == "star"


def test_a_large_fleet_is_shown_by_its_matrix():
    """Grey if anybody in a bin hears anybody there, else white; a strip for 0, marked attacks."""
    figure, cells = graphs_of(720, [2, 700], ["cyclic", "path"])
    for panel, cell in zip(figure.axes, cells, strict=True):
        image, strip = panel.images
        known, hears = np.zeros((60, 60), bool), set()
        for i, j in situation_of(cell.scenario).graph.pairs():
            if j == 0:
                hears.add(i // 12)
            else:
                known[i // 12, (j - 1) // 12] = True
        np.testing.assert_array_equal(image.get_array() < 1.0, known)
        assert image.get_extent() == [0.5, 720.5, 720.5, 0.5]
        assert set(np.flatnonzero(strip.get_array()[:, 0, 3])) == hears
        assert panel.lines[0].get_xdata().tolist() == [2, 700]


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
    shown = [each for each in figure.findobj(mpl.text.Text) if each.get_text()]
    assert min(text.get_fontsize() for text in shown if text.get_visible()) >= 6
    box = figure.get_tightbbox()
    assert min(box.x0, box.y0, width - box.x1, height - box.y1) >= -0.02


def test_a_choice_is_told_by_the_files_name():
    """Short, safe and distinct."""
    chosen = [["star"], ["st/ar"], ["st:ar"], ["x" * 300]]
    names = [every.file_name("tails", {}, column) for column in ("two", "one")]
    names += [every.file_name("tails", {"topology": each}, "two") for each in chosen]
    assert names[:3] == ["tails", "tails-one-column", "tails-topology=star"]
    assert len(set(names)) == len(names)
    assert all("/" not in name and len(name) < 120 for name in names)
    assert every.file_name("curve", {}, "two", note=False) == "curve-no-note"
    rules = ["w_msr", {"kind": "geometric_median", "label": "geo. median"}]
    alike = {"kind": "coordinate_median", "label": "geo median"}
    for listed, is_plain in ((rules, True), ([*rules[1:], alike], False)):
        cells = systems.study(sweep={"defence": listed}).cells
        made = every.file_name("heat", {"defence": "geo. median"}, "two", cells=cells)
        assert (made == "heat-defence=geo_median") == is_plain


def test_a_dollar_in_a_label_is_a_dollar():
    """Neither mathematics nor an error, and on the page the label itself."""
    star = {"kind": "star", "label": "costs $5_{$"}
    cell = jaxnet.load({"vehicles": 3, "topology": star, "attack": "none"}).cells[0]
    drawn = topology.topology_figure([cell])
    drawn.canvas.draw()
    assert drawn.axes[0].get_title() == r"costs \$5_{\$"
    assert topology.topology_name(cell) == "costs $5_{$"


def test_style_and_note_can_be_left_out(results):
    """A plain figure has matplotlib's sizes, drawn and saved; the other has its own."""
    assert all(getattr(every.Plots, name).__doc__ for name in FIGURE_NAMES)
    with mpl.rc_context({"font.size": 17.0, "savefig.dpi": 50}):
        plain, print_ = results.plot.plain.tails(), results.plot.tails()
        (file, *_) = writing.write_figure(results, "tails", plain=True)
    assert plain.axes[0].xaxis.label.get_fontsize() == 17.0
    assert print_.axes[0].xaxis.label.get_fontsize() == 8.0
    assert file.name == "tails-plain.png"
    assert imread(str(file)).shape[1] == pytest.approx(50 * plain.get_figwidth(), abs=1)
    for plots in (results.plot, results.plot.plain):
        assert plots.tails().get_supxlabel()
        assert plots.tails(note=False).get_supxlabel() == ""


@pytest.mark.parametrize(
    ("name", "size", "told"),
    [
        ("topologies", "86x40mm", "too low for its panels"),
        ("bands", "30x30mm", "1 of 2 groups"),
    ],
)
def test_a_figure_without_room_says_which_size_has_it(results, name, size, told):
    """That size has room indeed."""

    def draw(size):
        return results.figure(name, size=size)

    words = every.room_words(draw(size), size, draw)
    assert told in words
    room = words.partition("--size ")[2].removesuffix(" has room")
    assert every.room_words(draw(room), room, draw) == ""
