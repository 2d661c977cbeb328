"""The figure by axes: what is drawn is what the cells say, and no label touches another."""

import itertools
import json
import re
from collections import Counter

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib import text as mpl_text
from matplotlib.colors import to_rgb

from jaxnet.statistics.axes import choose_axes
from jaxnet.statistics.curves import log_ends
from jaxnet.statistics.quantities import Quantity
from jaxnet.view.drawings.drawing import (
    DODGE,
    LOOKS,
    MARKERS,
    MOVED_NOTE,
    Drawing,
    Panel,
    Scale,
    Trace,
)
from jaxnet.view.drawings.swept import hue_looks, swept_drawing
from jaxnet.view.drawings.ultimate import BOUND_LOOKS, FITS
from jaxnet.view.drawings.words import lines_within
from jaxnet.view.figures import COLUMN_WIDTHS, multiples, style
from jaxnet.view.figures.printed import printed, value_ticks
from jaxnet.view.page.plots import plotted
from tests import systems

LONG = [
    {"kind": "cyclic", "label": f"a rather long name of the graph, number {number}"}
    for number in range(6)
]


EYES = {  # of RGB, by Machado, Oliveira and Fernandes (2009)
    "all": np.eye(3),
    "no red": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "no green": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "no blue": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}


def study_cells(**sweep):
    """Cells of a sweep; nothing is run."""
    attack = {"kind": "rotating", "vehicles": [2]}
    return systems.study(vehicles=4, attack=attack, sweep=sweep).cells


def numbered(cells, share=True):
    """A quantity that is the number of the cell, with an interval, 2 below at most and 1 above."""
    numbers = np.array([cell.number for cell in cells], float) % 97
    ends = {"low": np.maximum(numbers - 2, 0), "high": numbers + 1}
    values = pd.DataFrame({"value": numbers, **ends})
    return Quantity("unrecovered", "lanes unrecovered", "%" if share else "m", share, 0.95, values)


RATES, RULES = {"attack.frequency": [0.1, 0.3, 1.0]}, ["none", "w_msr", "ms_norm", "trust"]
OF_RULES, NAMED = RATES | {"defence": RULES[:2]}, {"topology": LONG, "attack.magnitude": [1, 2, 4]}


@pytest.mark.parametrize(
    ("sweep", "named"),
    [
        (OF_RULES | {"tick": [0.05, 0.1]}, {}),
        (OF_RULES, {"x": "defence"}),
        (NAMED, {"x": "topology"}),
        ({}, {}),
    ],
)
def test_every_cell_is_drawn_at_its_value(sweep, named):
    """Markers lie at the values, whether numbers are across or names down."""
    cells = study_cells(**sweep)
    axes = choose_axes(cells, **named)
    figure = printed(swept_drawing(numbered(cells), axes, cells))
    rows = axes.x is None or isinstance(cells[0].labels[axes.x], str)
    drawn = [
        float(value)
        for panel in figure.axes
        for line in panel.lines
        if line.get_marker() in MARKERS
        for value in (line.get_xdata() if rows else line.get_ydata())
    ]
    assert sorted(drawn) == [cell.number for cell in cells]


SIZES = {
    1: {},
    6: {"topology": LONG},
    36: {"defence": RULES[:3], "attack.frequency": [0.1, 0.2, 0.4], "vehicles": [3, 4, 5, 6]},
    96: {"topology": LONG, "attack.magnitude": [1, 2, 5, 10], "defence": RULES},
    300: {"attack.magnitude": [float(number) for number in range(1, 51)], "topology": LONG},
}


@pytest.mark.parametrize(
    ("cells", "column", "share"),
    [
        (next(iter(SIZES)), "one", True),
        (max(SIZES), "two", False),
        *(
            pytest.param(*each, marks=pytest.mark.long)
            for each in itertools.product(SIZES, COLUMN_WIDTHS, [True, False])
        ),
    ],
)
def test_no_label_touches_another(cells, column, share):
    """Titles, ticks, labels, legend and notes of all panels, in both widths, within the page."""
    found = study_cells(**SIZES[cells])
    assert len(found) == cells
    with mpl.rc_context(style.PRINT_STYLE):
        figure = printed(
            swept_drawing(numbered(found, share), choose_axes(found), found), COLUMN_WIDTHS[column]
        )
        figure.draw_without_rendering()
    boxes = [(text.get_text(), text.get_window_extent()) for text in shown_texts(figure)]
    for words, box in boxes:
        assert box.x0 >= figure.bbox.x0 - 2, words
        assert box.x1 <= figure.bbox.x1 + 2, words
    for (one, first), (other, second) in itertools.combinations(boxes, 2):
        across = min(first.x1, second.x1) - max(first.x0, second.x0)
        up = min(first.y1, second.y1) - max(first.y0, second.y0)
        assert min(across, up) <= 1, f"{one!r} over {other!r}"
    assert figure.get_figheight() <= style.GREATEST_HEIGHT + 0.01


def shown_texts(figure):
    """Texts that are seen: matplotlib also keeps the labels of ticks beyond the ends of an axis."""
    hidden = set()
    for panel in figure.axes:
        for axis, ends in ((panel.xaxis, panel.get_xlim()), (panel.yaxis, panel.get_ylim())):
            side = "labelbottom" if axis is panel.xaxis else "labelleft"
            told = panel.axison and axis.get_tick_params(which="major").get(side, True)
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                if not told or not min(ends) <= tick.get_loc() <= max(ends):
                    hidden.add(id(tick.label1))
    every = figure.findobj(mpl_text.Text)
    return [
        text
        for text in every
        if text.get_text().strip() and text.get_visible() and id(text) not in hidden
    ]


@pytest.mark.parametrize("entries", range(2, 10))
@pytest.mark.parametrize("width", COLUMN_WIDTHS.values())
@mpl.rc_context(style.PRINT_STYLE)
def test_a_legend_is_no_wider_than_the_figure(entries, width):
    """Rows of entries that are not full too: nine in two rows are five columns."""
    names = [f"{'Lyapunov, corrected'[: 8 + n]} {n}" for n in range(entries)]
    series = [Trace(name, LOOKS[0], np.ones(1), np.ones(1), "both") for name in names]
    drawn = printed(Drawing([Panel({}, [0], series)], Scale("x"), Scale("y"), []), width)
    drawn.draw_without_rendering()
    (legend,) = drawn.legends
    box = legend.get_window_extent()
    assert drawn.bbox.x0 <= box.x0
    assert box.x1 <= drawn.bbox.x1


def test_more_colours_than_a_palette_has_are_a_scale():
    """Numbers of many values are told apart by a scale of colours and by markers."""
    many = hue_looks(list(range(1, 11)))
    assert len({str(each.color) for each in many}) == 10
    assert len({each.marker for each in many}) == len(MARKERS)
    cells = study_cells(**{"attack.magnitude": list(range(1, 13)), "attack.frequency": [1.0, 2.0]})
    axes = choose_axes(cells, x="attack.frequency", hue="attack.magnitude")
    page = plotted(swept_drawing(numbered(cells), axes, cells))
    assert page.count("aria-pressed") == len({*re.findall(r"<svg.*?</svg>", page)}) == 12


@pytest.mark.parametrize("eye", EYES)
def test_each_line_of_a_bound_or_fit_has_its_own_look(eye):
    """Dashes alone tell one from another in grey; colours tell bounds apart for all eyes."""
    bounds = [*BOUND_LOOKS.values()]
    dashes = [(look.dash, look.width > 1) for look in (*bounds, *(fit for _, fit in FITS.values()))]
    assert len({*dashes}) == len(dashes)
    seen = [np.clip(np.array(EYES[eye]) @ to_rgb(look.color), 0, 1) for look in bounds]
    apart = (np.linalg.norm(one - other) for one, other in itertools.combinations(seen, 2))
    assert min(apart) > 0.1


@pytest.mark.parametrize("shape", [(2, 2), (3, 3), (2, 5), (4, 4), (5, 6), (4, 2), (2, 8)])
def test_no_row_of_panels_mixes_values_of_the_first_key(shape):
    """In print, and on the page where it has room; all rows are full."""
    graphs = ["cyclic", "lattice of 4", "complete", "star", "random of 5"][: shape[0]]
    rules = ["no defence", "trusted trimming", "W-MSR", "clipping", *"abcd"][: shape[1]]
    labels = [{"topology": graph, "defence": rule} for graph in graphs for rule in rules]
    line = Trace("", LOOKS[0], np.arange(3.0), np.arange(3.0))
    drawing = Drawing([Panel(each, [], [line]) for each in labels], Scale("x"), Scale("y"))
    with mpl.rc_context(style.PRINT_STYLE):
        figure = printed(drawing)
        figure.draw_without_rendering()
    rows = {}
    for panel in figure.axes:
        title = panel.get_title().replace("\n", " ")
        rows.setdefault(round(panel.get_position().y0, 2), []).append(title.split(",")[0])
    rows = [Counter(row) for row in rows.values()]
    assert len({row.total() for row in rows}) == 1
    assert all(len({*row.values()}) == 1 for row in rows)  # each value has as many panels
    assert any(len(row) == 1 for row in rows) or shape[1] == 2
    across = int(re.search(r"--columns: (\d+)", plotted(drawing))[1])
    assert across % shape[1] == 0 or shape[1] % across == 0
    begin = plotted(drawing).split('class="panel')[1:]
    begin = [place for place, each in enumerate(begin) if each.startswith(" begins")]
    assert begin == [*range(0, len(labels), max(across, shape[1]))]  # where a window is narrow too


def test_ticks_stand_at_the_values_where_they_are_few():
    """Also on a log axis; each value that has room has its number, with few digits."""
    sweep = {"attack.frequency": [0.1, 0.2, 0.4, 0.8, 1.6, 3.2], "defence": ["none", "w_msr"]}
    cells = study_cells(**sweep)
    with mpl.rc_context(style.PRINT_STYLE):
        drawing = swept_drawing(numbered(cells), choose_axes(cells), cells)
        figure = printed(drawing, COLUMN_WIDTHS["one"])
        figure.draw_without_rendering()
    panel = figure.axes[0]
    assert panel.get_xscale() == "log"
    assert panel.get_xticks().tolist() == sweep["attack.frequency"]
    texts = [each.get_text() for each in panel.get_xticklabels()]
    assert texts == ["0.1", "0.2", "0.4", "0.8", "1.6", "3.2"]
    assert set(range(0, 101, 20)) <= set(panel.get_yticks())


@pytest.mark.parametrize(
    ("values", "log", "room", "texts"),
    [
        (np.geomspace(0.1, 3, 5).tolist(), True, 1.3, ["0.1", "0.23", "0.55", "1.3", "3"]),
        ([100, 101, 102, 200, 1000], False, 1.0, []),
        ([123, 1000], False, 3.0, ["123", "1000"]),
    ],
)
@mpl.rc_context(style.PRINT_STYLE)
def test_labels_of_ticks_have_the_digits_that_fit(values, log, room, texts):
    """Where two digits are too many, there are none, and ticks are round numbers."""
    assert value_ticks(Scale("", log=log, ticks=values), room) == texts


@pytest.mark.parametrize("log", [False, True])
def test_curves_stand_side_by_side(log):
    """As far apart at each value, around it, at DODGE of the axis; a note says it."""
    cells = study_cells(**RATES | {"defence": RULES[:3]})
    found = numbered(cells)._replace(share=not log, unit="" if log else "%")
    drawing = swept_drawing(found, choose_axes(cells), cells)
    none, w_msr, ms_norm = (np.asarray(each.drawn_x) for each in drawing.panels[0].series)
    np.testing.assert_allclose(w_msr, [0.1, 0.3, 1.0])
    np.testing.assert_allclose(ms_norm / w_msr, 10**DODGE)
    np.testing.assert_allclose(none / w_msr, 10**-DODGE)
    assert MOVED_NOTE in printed(drawing).get_supxlabel().replace("\n", " ")


def test_points_at_zero_are_moved_too():
    """On a linear axis, as far as others."""
    cells = study_cells(**{"channel.delay": [0.0, 0.1, 0.3], "defence": RULES[:2]})
    table = pd.DataFrame({"value": [50.0] * 6, "low": 40.0, "high": 60.0})
    drawing = swept_drawing(numbered(cells)._replace(values=table), choose_axes(cells), cells)
    none, w_msr = (each.drawn_x for each in drawing.panels[0].series)
    shift = (w_msr - none) / 2
    assert shift[0] > 0
    np.testing.assert_allclose(shift, shift[0])
    np.testing.assert_allclose((w_msr + none) / 2, [0.0, 0.1, 0.3], atol=1e-12)


def test_a_curve_without_a_point_has_no_entry_in_the_legend():
    """In print and on the page; a panel without any says so."""
    cells = study_cells(**RATES | {"defence": RULES[:3], "tick": [0.05, 0.1]})
    found = numbered(cells)
    values = found.values.copy()
    for cell in cells:
        if cell.labels["defence"] == "w_msr" or cell.labels["tick"] == 0.1:
            values.loc[cell.number] = np.nan
    drawing = swept_drawing(found._replace(values=values), choose_axes(cells), cells)
    figure = printed(drawing)
    legend = [each.get_text() for each in figure.legends[0].get_texts()]
    assert legend == re.findall('data-name="(.*?)"', plotted(drawing))
    assert legend == ["no\N{NO-BREAK SPACE}defence", "ms_norm"]
    assert [text.get_text() for text in figure.axes[1].texts] == ["no value"]


def test_a_legend_names_what_the_drawn_panels_show():
    """Not what stands in panels for which the page has no room, nor in rows that are not drawn."""
    at = np.array([1.0, 2.0])
    common = Trace("everywhere", LOOKS[0], at, at)
    rare = Trace("in one panel", LOOKS[1], at, at)
    panels = [Panel({"tick": n}, [n], [common, rare] if n == 2 else [common]) for n in range(60)]
    figure = printed(Drawing(panels, Scale("x"), Scale("y")))
    assert len(figure.axes) < 60
    assert "tick = 2" not in [
        axes.get_title().replace("\N{NO-BREAK SPACE}", " ") for axes in figure.axes
    ]
    assert [each.get_text() for each in figure.legends[0].get_texts()] == ["everywhere"]
    names = [str(n) for n in range(200)]
    mark = LOOKS[0]._replace(marker="o")
    every = Trace("everywhere", mark, np.arange(200.0), np.arange(200.0), "points")
    few = Trace("in one row", mark, np.array([1.0]), np.array([2.0]), "points")
    rows = Drawing([Panel({}, [0], [every, few])], Scale("x"), Scale("", names=names))
    figure = printed(rows)
    assert [each.get_text() for each in figure.legends[0].get_texts()] == ["everywhere"]


def test_the_note_says_of_how_many_lanes_a_point_is():
    """Of as many, or between how many."""
    found = numbered(study_cells(**RATES))
    assert "lanes a point" not in found.notes
    assert "; 200 lanes a point; " in f"; {found._replace(lanes=[200, 200]).notes}"
    assert "24 to 30 lanes a point" in found._replace(lanes=[30, 24, 25]).notes


def test_what_is_below_the_floor_of_a_log_axis_is_drawn_there():
    """Hollow, in print and on the page, as the caption says; what is above is not moved."""
    cells = study_cells(**RATES)
    values = pd.DataFrame({"value": [8e-3, 3e-8, 1e-12], "low": np.nan, "high": np.nan})
    found = numbered(cells, share=False)._replace(values=values)
    drawing = swept_drawing(found, choose_axes(cells), cells)
    figure, page = printed(drawing), plotted(drawing)
    line, hollow = (each for each in figure.axes[0].lines if each.get_marker() in MARKERS)
    np.testing.assert_array_equal(line.get_ydata(), [8e-3, 3e-8, np.nan])  # no line leads there
    assert np.asarray(hollow.get_ydata()).tolist() == [1e-9]
    assert hollow.get_markerfacecolor() == "white"
    assert dict(ticks_of(figure.axes[0].yaxis))[1e-9] == r"≤ $\mathdefault{10^{-9}}$"
    (shown,) = re.findall(r'<script type="application/json">(.*?)</script>', page)
    trace, hollow = json.loads(shown)["data"]
    assert (trace["y"], hollow["y"]) == ([8e-3, 3e-8, None], [1e-9])
    assert (trace["mode"], hollow["mode"]) == ("lines+markers", "markers")
    assert (trace["marker"]["symbol"], hollow["marker"]["symbol"]) == ("circle", "circle-open")
    assert "≤ 10<sup>−9</sup>" in json.loads(shown)["layout"]["yaxis"]["ticktext"]
    above = found._replace(values=values.replace(1e-12, 1e-8))
    drawn = printed(swept_drawing(above, choose_axes(cells), cells))
    assert not any("≤" in label for _, label in ticks_of(drawn.axes[0].yaxis))


def test_a_lost_fleet_does_not_flatten_the_others():
    """An axis of too many decades is around most values; others stand at its ends, hollow."""
    cells = study_cells(**RATES)
    value = [0.3, 30.0, 4e9]
    values = pd.DataFrame({"value": value, "low": [0.0, 20.0, 5.0], "high": [0.4, 1e9, 5e9]})
    found = numbered(cells, share=False)._replace(values=values)
    drawing = swept_drawing(found, choose_axes(cells), cells)
    figure, page = printed(drawing), plotted(drawing)
    panel = figure.axes[0]
    assert drawing.y.ends == (0.1, 1500.0)
    line, hollow = (each for each in panel.lines if each.get_marker() == "o")
    np.testing.assert_array_equal(line.get_ydata(), [0.3, 30.0, np.nan])
    assert [label for _, label in ticks_of(panel.yaxis)][-1] == r"≥ $\mathdefault{10^{3}}$"
    assert np.asarray(hollow.get_ydata()).tolist() == [1000.0]
    assert arrows_of(panel) == {"v": [0.1], "^": [1000.0]}
    (shown,) = re.findall(r'<script type="application/json">(.*?)</script>', page)
    _, lost, *_ = (each for each in json.loads(shown)["data"] if "text" in each)
    assert "4e+09" in lost["text"][0]  # what a point tells is the number itself


@pytest.mark.parametrize(
    ("values", "ends"),
    [
        ([1e-6, 1.0, 90.0], (1e-6, 100.0)),  # eight decades are not cut
        ([0.0, 1e-3, 1.0], (1e-4, 1.0)),
        ([1e-8, 2e-8, 5.0], (1e-8, 1.5e-6)),  # most values
        ([1e-8, 5.0], (0.1, 10.0)),  # as many: the greatest
        ([0.0, 0.0, 0.0], (1e-9, 1e-8)),
    ],
)
def test_an_axis_of_values_has_eight_decades_at_most(values, ends):
    """Powers of ten with a decade of room for what is beyond, within those around all values."""
    scale = Scale("", log_ends(values), log=True).cut(values)
    assert scale.ends == pytest.approx(ends)


def ticks_of(axis) -> list[tuple[float, str]]:
    """Places and names of the ticks of an axis, from the least."""
    names = (label.get_text() for label in axis.get_ticklabels())
    return sorted(zip(axis.get_ticklocs(), names, strict=True))


def arrows_of(panel) -> dict[str, list[float]]:
    """Places along y of the arrows of error bars, by their symbol."""
    marks = (line for line in panel.lines if line.get_marker() in ("v", "^"))
    return {line.get_marker(): line.get_ydata().tolist() for line in marks}


@pytest.mark.parametrize(
    ("low", "high", "arrows"),
    [
        ([0.0, 1.0], [4.0, 5.0], {"v": [1.0]}),  # on a log axis that ends at a least value of 1
        ([1.0, 1.0], [4.0, 500.0], {"^": [10.0]}),
        ([np.nan, 1.0], [4.0, np.nan], {"v": [1.0], "^": [10.0]}),  # an end that is not known
        ([np.nan, 2.0], [np.nan, 4.0], {}),  # no interval
    ],
)
def test_bars_show_both_ends_or_that_they_go_on(low, high, arrows):
    """In print and on the page, said once below all panels."""
    at, value = np.array([1.0, 2.0]), np.array([2.0, 3.0])
    look = LOOKS[0]._replace(marker="o")
    series = Trace("", look, at, value, "both", np.array(low), np.array(high))
    scale = Scale("error [m]", (1.0, 10.0), log=True)
    drawing = Drawing([Panel({}, [0], [series])] * 2, Scale("x"), scale)
    figure = printed(drawing)
    assert [arrows_of(panel) for panel in figure.axes] == [arrows] * 2
    assert figure.get_supxlabel().count("go on beyond the axis") == bool(arrows)
    (page,) = re.findall(r"<script[^>]*>(.*?)</script>", plotted(drawing), re.DOTALL)[:1]
    bars, *marks = json.loads(page)["data"]
    sides = {"v": "triangle-down", "^": "triangle-up"}
    assert [mark["marker"]["symbol"] for mark in marks] == [sides[each] for each in arrows]
    below, above = (np.array(bars["error_y"][name], float) for name in ("arrayminus", "array"))
    assert (
        np.isnan(below).tolist()
        == np.isnan(above).tolist()
        == (np.isnan(low) & np.isnan(high)).tolist()
    )
    assert np.fmin(value - below, 1.0).min() == 1.0
    assert np.fmax(value + above, 10.0).max() == 10.0


def test_a_bar_of_rounding_does_not_leave_the_axis():
    """It begins where its mark stands, at the floor."""
    assert Scale("error [m]", log=True).bars(1e-20, 1e-9, 1.0)[0] == (1e-9, 1.0)


def test_a_narrow_title_breaks_no_word_that_fits():
    """A key is parted from its value before a word is."""
    words = "in place of lost\N{NO-BREAK SPACE}messages\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}drop"
    lines = multiples.wrapped(words, 12).split("\n")
    assert lines == ["in place of", "lost", "messages =", "drop"]


@pytest.mark.parametrize(
    ("words", "letters", "lines"),
    [
        ("loss of 30 % lost", 11, ["loss of", "30 % lost"]),
        ("defence W-MSR F=2", 11, ["defence", "W-MSR F=2"]),
        ("tail: the last 5 s", 16, ["tail: the last", "5 s"]),
        ("mean error of the fleet [m]", 23, ["mean error of the", "fleet [m]"]),
        ("a look-ahead-vehicle", 8, ["a look-", "ahead-", "vehicle"]),  # longer than a line
    ],
)
def test_no_line_ends_within_a_unit_or_a_name(words, letters, lines):
    """The words have ordinary spaces afterwards."""
    assert lines_within(words, letters) == lines


def test_labels_of_axes_do_not_touch_in_larger_type():
    """Two panels in one column of a journal, in matplotlib's own style and in a larger one."""
    labels = [{"defence": "none"}, {"defence": "w_msr"}]
    for size in (10.0, 14.0):
        larger: style.Style = {**style.LAYOUT, "font.size": size}
        with mpl.rc_context(larger):
            drawn, panels = multiples.panel_grid(
                labels,
                "attack magnitude ā [m]",
                "spread of the vehicles, median [m]",
                COLUMN_WIDTHS["one"],
                most=2,
            )
            drawn.draw_without_rendering()
            (only,) = (each.xaxis.label for each in panels if each.get_xlabel())
            box, (left, right) = only.get_window_extent(), [each.bbox for each in panels]
            assert drawn.bbox.x0 <= box.x0
            assert box.x1 <= drawn.bbox.x1
            middle = (left.x0 + right.x1) / 2  # between the two
            assert (box.x0 + box.x1) / 2 == pytest.approx(middle, abs=0.05 * drawn.bbox.width)
