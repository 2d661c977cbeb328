"""Heat maps: every cell in its place, numbers that do not flatter, colours that all can read."""

import itertools
import json
import re
from collections import Counter
from fractions import Fraction

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from upath import UPath

from jaxnet.model.wording import number_text
from jaxnet.statistics import tiles
from jaxnet.statistics.intervals import clopper_pearson
from jaxnet.statistics.tiles import NO_CELL, tiling
from jaxnet.store.results import Results
from jaxnet.view import columns
from jaxnet.view.drawings import heat
from jaxnet.view.figures import every, style
from jaxnet.view.figures.printed import printed
from jaxnet.view.page import elements, sections
from jaxnet.view.page.plots import power_text
from tests import systems

ROTATING = {"kind": "rotating", "vehicles": [2]}
SWEEP = {
    "topology": ["star", "cyclic"],
    "attack.magnitude": [0, 10],
    "defence": ["trusted_trim", "none", "trusted_only"],
    "attack.frequency": [2.8, 0.7],
}


def study_of(sweep, **keys):
    """A study of four vehicles; nothing is run."""
    return systems.study(vehicles=4, attack=ROTATING, sweep=sweep, **keys)


def made(study, failed=(), **columns) -> Results:
    """Results of 40 lanes a cell, as many unrecovered as the cell's number."""
    cells = study.cells
    lost = {cell: Counter(kinds) for cell, kinds in dict(failed).items()}
    ok = np.array([40 - lost.get(n, Counter()).total() for n in range(len(cells))])
    number = np.minimum(np.arange(len(cells)), ok)
    low, high = clopper_pearson(number, ok, 0.95)
    known = (ok > 0) & [cell.scenario.attack.amplitude() > 0 for cell in cells]
    share = number / np.maximum(ok, 1)
    shares = {"unrecovered": share, "unrecovered_low": low, "unrecovered_high": high}
    table = {name: np.where(known, values, np.nan) for name, values in shares.items()}
    table |= {
        "tail_max_max": np.where(ok > 0, share, np.nan),
        "tail_mean_median": share,
        "ok": ok,
        "failed": 40 - ok,
        **columns,
    }
    results = Results(UPath("nowhere"))
    rows = [(cell, pd.DataFrame({"status": [*kinds.elements()]})) for cell, kinds in lost.items()]
    vars(results).update(
        study=study,
        cells=pd.DataFrame(table),
        manifest={"samples": 40, "lanes": {"failed": int((40 - ok).sum())}},
        by_cell=lambda *columns, where: iter(rows),
    )
    return results


def plain(words: str) -> str:
    """Words with ordinary spaces."""
    return words.replace("\N{NO-BREAK SPACE}", " ").replace("\n", " ")


def test_every_cell_stands_where_its_values_say():
    """Frequencies rise to the right, defences stand in order, the others make panels."""
    cells = study_of(SWEEP).cells
    found = tiling(cells)
    assert found is not None
    assert (found.column, found.columns) == ("attack.frequency", [0.7, 2.8])
    assert (found.row, found.rows) == ("defence", SWEEP["defence"])
    assert sorted(found.cells.ravel()) == list(range(24))
    for (panel, row, column), number in np.ndenumerate(found.cells):
        along = {"defence": found.rows[row], "attack.frequency": found.columns[column]}
        assert cells[number].labels == found.panels[panel] | along
    found = tiling([cell for cell in cells if cell.number != 13])
    assert found is not None
    assert sorted(found.cells.ravel()) == [NO_CELL, *(n for n in range(24) if n != 13)]


GRAPHS, DEFENCES, SIZES = ["star", "cyclic"], ["none", "trusted_trim"], [1, 2, 3]


@pytest.mark.parametrize(
    ("sweep", "row", "column"),
    [
        ({"attack.magnitude": SIZES, "attack.frequency": [1.0, 2.0]}, "attack.frequency",
         "attack.magnitude"),
        ({"attack.magnitude": SIZES, "topology": GRAPHS}, "topology", "attack.magnitude"),
        ({"topology": GRAPHS, "defence": DEFENCES}, "defence", "topology"),
        ({"tick": [0.05, 0.1], "attack.magnitude": SIZES}, "tick", "attack.magnitude"),
    ],
)  # fmt: skip
def test_numbers_stand_along_kinds_down(sweep, row, column):
    """What is varied more stands along; numbers rise upwards."""
    found = tiling(study_of(sweep).cells)
    assert found is not None
    assert (found.row, found.column) == (row, column)
    if row == "attack.frequency":
        assert found.rows == [2.0, 1.0]


@pytest.mark.parametrize("lanes", [7, 400])
def test_a_share_is_not_flattered(lanes):
    """Only all lanes are 100 %, only none 0; one decimal of what is between."""
    for count in range(lanes + 1):
        share = 100 * Fraction(count, lanes)
        words = tiles.tile_text("unrecovered", float(share))
        assert (words == "0", words == "100") == (count == 0, count == lanes)
        assert len(words) <= 5
        assert abs(Fraction(words) - share) <= Fraction(1, 20)


def test_ends_of_intervals_have_one_decimal():
    """But what is near 0 or 100 % is neither."""
    ends = [0.0, 0.0633, 0.13, 8.81, 70.2, 91.19, 94.29, 99.9367, 100.0]
    told = ["0", "0.1", "0.1", "8.8", "70.2", "91.2", "94.3", "99.9", "100"]
    assert [number_text(end, whole=100.0) for end in ends] == told


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (12.5, "12.5"),
        (4.186, "4.2"),
        (0.0633, "0.1"),
        (26.8, "26.8"),
        (36.45, "36.5"),
        (36.449999999999996, "36.5"),
        (0.0, "0"),
        (100.0, "100"),
        (99.9367, "99.9"),
        (99.95, "99.95"),
        (99.998, "99.998"),
        (0.0417, "0.04"),
    ],
)
def test_a_share_reads_the_same_everywhere(value, words):
    """On a tile, in the terminal's table, in findings and in tables of the page."""
    entries = pd.DataFrame({"value": [value / 100]})
    column = columns.Column("unrecovered", "", "", entries, scale=100.0)
    assert tiles.tile_text("unrecovered", value) == column.texts()[0] == words
    assert number_text(value, whole=100.0) == words
    rows = pd.DataFrame({"lanes unrecovered [%]": [value]})
    assert f">{words}</td>" in elements.sortable_table(rows)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (3.14159, "3.14"),
        (0.114, "0.114"),
        (0.01234, "0.0123"),
        (7.234e-4, "7.2×10⁻⁴"),
        (1e-12, "0"),
        (8274.4, "8274"),
        (253038.0, "2.5×10⁵"),
        (2.1e16, "2.1×10¹⁶"),
        (np.inf, "inf"),
    ],
)
def test_a_tile_has_room_for_small_and_great_errors(value, words):
    """Three digits, or two and the power of ten; below 1e-9 of ā they are rounding."""
    assert tiles.tile_text("worst", value) == words


def test_rounding_is_zero_in_text_figure_and_page():
    """A spread below 1e-9 ā, however it is shown; one beside a smaller attack is not."""
    sweep = {"defence": ["none", "w_msr"], "attack.magnitude": [1, 10]}
    keys = {"navigator": "none", "topology": "complete", "vehicle": "single_integrator"}
    keys |= {"law": "local", "gain": [1], "vehicles": 4, "attack": ROTATING}
    study = systems.study(sweep=sweep, **keys)
    spread = np.full(4, 3.61e-9)
    results = made(study, spread_max=spread, spread_median=spread)
    table = tiles.tile_table(results)
    texts = [tiles.tile_text("worst", *row) for row in table[["worst", "size"]].to_numpy()]
    assert texts == ["3.6×10⁻⁹", "0"] * 2
    (shown,) = columns.summary_columns(results, ["spread_max"])[-1:]
    assert shown.texts() == ["3.61e-09", "0"] * 2
    drawn = heat.heat_drawing(results, tiling(study.cells), "worst")
    tile = drawn.panels[0].tiles
    assert sorted({*tile.texts.ravel()}) == ["0", "3.6×10⁻⁹"]
    assert all(
        ("0 (rounding)" in words) == ("ā = 10" in plain(words)) for words in tile.told.ravel()
    )


@pytest.mark.parametrize(
    ("value", "words"),
    [(1234.5, "1235"), (999.96, "1000"), (1e-7, "1e-07"), (2.5e12, "2.5e+12"), (-0.0, "0")],
)
def test_a_number_loses_no_digit_before_its_point(value, words):
    """Other than of very great and very small ones."""
    assert number_text(value) == words


def luminance(colour) -> float:
    """Relative luminance of WCAG 2.2."""
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in to_rgb(colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_colours_darken_steadily_and_carry_their_ink():
    """In grey too a greater number is darker; words have a contrast of 4.5 on all of them."""
    pairs = [(luminance(each), luminance(heat.text_colour(each))) for each in heat.PALETTE]
    assert (np.diff([colour for colour, _ in pairs]) < 0).all()
    assert min((max(pair) + 0.05) / (min(pair) + 0.05) for pair in pairs) >= 4.5


@mpl.rc_context(style.PRINT_STYLE)
def drawn(results, metric="unrecovered", where=None, column="two"):
    """The figure, laid out."""
    name = {"unrecovered": "heat", "worst": "heat_worst"}[metric]
    figure = getattr(every.Plots(results), name)(where, column)
    figure.draw_without_rendering()
    return figure


def tile_words(panel) -> dict[tuple[int, int], list[str]]:
    """What stands in each tile, by row and column."""
    found: dict[tuple[int, int], list[str]] = {}
    for text in panel.texts:
        x, y = text.get_position()
        found.setdefault((int(y), int(x)), []).append(text.get_text())
    return found


def interval_of(count: int, lanes: int) -> str:
    """The exact interval as text [%]."""
    ends = clopper_pearson(np.array(count), np.array(lanes), 0.95)
    return "–".join(number_text(100 * float(end), whole=100.0) for end in ends)


def test_a_tile_tells_its_cells_share_and_interval():
    """Of 40 lanes; hatched without an attack; failed lanes have a star and count as lost."""
    results = made(study_of(SWEEP), failed={7: ["disconnected"] * 2, 18: ["nonfinite"] * 40})
    figure = drawn(results)
    panels = [panel for panel in figure.axes if panel.get_title()]
    titles = [f"{graph}, ā = {size} m" for graph in GRAPHS for size in (0, 10)]
    assert [plain(panel.get_title()) for panel in panels] == titles
    words = tile_words(panels[1])
    assert words[0, 1] == [interval_of(6, 40), "15"]
    assert words[0, 0] == [interval_of(9, 40), "22.5*"]
    assert {word for each in tile_words(panels[0]).values() for word in each} == {""}
    assert tile_words(panels[3])[0, 1] == [interval_of(40, 40), "100*"]
    colours = np.asarray(panels[3].collections[0].get_array())
    assert colours[0, 1] == colours.max() == 100  # the darkest
    assert plain(figure.get_supxlabel()) == (
        "40 lanes a tile; 95 % intervals reach at most 16.6 percentage points from the value;"
        " * with lanes that failed: 40 nonfinite, 2 disconnected;"
        " tail: the last 5 of 30 s"
    )
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["no attack"]
    assert panels[0].get_xlabel() == ""
    assert plain(panels[2].get_xlabel()) == "attack frequency [rad/s]"
    title = "lanes failed or unrecovered [%]"
    bar = next(panel for panel in figure.axes if panel.get_xlabel() == title)
    assert bar.get_xlim() == (0, 100)


def test_a_tile_has_the_colour_of_its_number():
    """The same scale in all panels; a cell that was not run has none; errors are on a log scale."""
    results = made(study_of(SWEEP | {"attack.magnitude": [10]}))
    order = np.array([[2 * row + 1 - column for column in range(2)] for row in range(3)])
    for first, panel in zip((0, 6), drawn(results).axes, strict=False):
        values = np.asarray(panel.collections[0].get_array())
        np.testing.assert_allclose(values, 100 * (first + order) / 40)
        assert panel.collections[0].get_clim() == (0, 100)
    some = tiling([cell for cell in results.study.cells if cell.number != 4])
    assert some is not None
    with_gap = printed(heat.heat_drawing(results, some, "unrecovered"))
    assert np.ma.getmaskarray(with_gap.axes[0].collections[0].get_array()).sum() == 1
    assert [text.get_text() for text in with_gap.legends[0].get_texts()] == ["not run"]
    results.cells["tail_max_max"] = np.geomspace(2e-3, 20, 12)
    mesh = drawn(results, "worst").axes[0].collections[0]
    wanted = results.cells["tail_max_max"].to_numpy()[order] / 10
    np.testing.assert_allclose(np.asarray(mesh.get_array()), wanted)
    assert mesh.get_clim() == pytest.approx((1e-4, 10))


def test_a_lost_fleet_does_not_take_the_colours_from_the_others():
    """The scale is around most numbers; what is beyond has the colour of an end, and is told."""
    results = made(study_of(SWEEP | {"attack.magnitude": [1]}))
    results.cells["tail_max_max"] = [3e8, 0, *np.geomspace(0.3, 30, 10)]
    figure = drawn(results, "worst")
    assert figure.axes[0].collections[0].get_clim() == pytest.approx((0.01, 1000))
    assert heat.BEYOND_COLOURS in plain(figure.get_supxlabel())
    text = elements.sentence_case(heat.BEYOND_COLOURS)
    section = sections.heat_section(results)
    assert section is not None
    assert text in section.body
    assert "<span>greatest tail error / ā</span><span>≤ 0.01</span><i" in section.body
    bar = figure.axes[-1]
    assert [label.get_text()[0] for label in bar.get_xticklabels()][-2:] == ["≤", "≥"]
    assert power_text(1e5) == "10<sup>5</sup>"
    results.cells["tail_max_max"] = np.geomspace(0.3, 30, 12)
    assert heat.BEYOND_COLOURS not in plain(drawn(results, "worst").get_supxlabel())


def test_the_name_of_few_rows_is_within_the_figure():
    """Two rows of tiles leave less height than "attacked vehicles" is long."""
    sweep = {"topology": ["star", "cyclic"], "attack.vehicles": [{"random": 1}, {"random": 2}]}
    figure = drawn(made(study_of(sweep)))
    label = figure.axes[0].yaxis.label
    assert label.get_text() == "attacked\nvehicles"
    assert label.get_window_extent().y1 <= figure.bbox.y1


def test_words_stay_within_their_tiles():
    """In one column and in two, with long and with short numbers."""
    sweep = {"defence": SWEEP["defence"], "attack.frequency": [0.1, 0.2, 0.4, 0.8, 1.6]}
    results = made(study_of(sweep))
    results.cells["tail_max_max"] = np.geomspace(1e-7, 30, 15)
    for metric, column in (("unrecovered", "one"), ("worst", "two")):
        panel = drawn(results, metric, column=column).axes[0]
        frame = panel.get_window_extent()
        boxes = [text.get_window_extent() for text in panel.texts]
        assert max(box.width for box in boxes) < frame.width / 5
        assert max(box.height for box in boxes) < frame.height / 3


@pytest.mark.parametrize("rows", [2, 4, 12])
@pytest.mark.parametrize("kinds", [True, False])
def test_a_number_and_its_interval_stand_in_the_middle(rows, kinds):
    """Ink is as far from the upper edge of its tile as from the lower; names may be steep."""
    rules = [{"kind": "clipping", "radius": n, "label": f"a clipping of {n}"} for n in (5, 6, 7)]
    graphs = [{"kind": "cyclic", "label": f"graph {n}"} for n in range(rows)]
    across = {"defence": rules} if kinds else {"attack.magnitude": [1, 2, 4]}
    figure = drawn(made(study_of({"topology": graphs} | across, recovery={"tau": 0.01})))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    panel = figure.axes[0]
    assert len(panel.texts) == 2 * 3 * rows  # with intervals
    corners = panel.transData.transform([(-0.5, 0.5), (0.5, -0.5)])
    (left, low), (right, high) = np.rint(corners).astype(int)
    shade = np.asarray(canvas.buffer_rgba())[::-1, :, :3].mean(axis=2)
    inked = (shade[low + 2 : high - 2, left + 2 : right - 2] < 100).any(axis=1)
    below, above = (np.argmax(each) for each in (inked, inked[::-1]))
    assert abs(below - above) <= 2
    assert min(below, above) >= 1


@pytest.mark.parametrize(("column", "told"), [("one", True), ("two", False)])
def test_a_number_that_has_no_room_is_told(column, told):
    """Errors of seven letters in ten columns; those of four have room."""
    sweep = {"defence": ["none", "w_msr"], "attack.magnitude": list(range(1, 11))}
    results = made(study_of(sweep))
    results.cells["tail_max_max"] = [1.0] * 19 + [0.00723]
    figure = drawn(results, "worst", column=column)
    note = "tiles of a value without its number have no room for it"
    assert (note in figure.get_supxlabel().replace("\n", " ")) == told
    assert (len(figure.axes[0].texts) < 20) == told


def test_tiles_keep_their_height_below_long_titles_and_above_steep_names():
    """Numbers stay within them; the names of the rows' axes do not touch."""
    sweep = {"topology": ["star", "cyclic"], "channel.missing": ["drop", "hold"]}
    sweep |= {"channel.delay": [0.1, 0.2, 0.3, 0.4, 0.5]}
    sweep |= {"attack.magnitude": np.geomspace(0.0123, 45, 10).tolist()}
    figure = drawn(made(study_of(sweep)))
    maps = [panel for panel in figure.axes if panel.get_title()]
    assert "\n" in maps[0].get_title()
    assert maps[-1].get_xticklabels()[0].get_rotation() == 90
    for panel in maps:
        tile = panel.get_window_extent().height / 2
        assert max(text.get_window_extent().height for text in panel.texts) < tile / 2
    named = [panel.yaxis.label.get_window_extent() for panel in maps if panel.get_ylabel()]
    assert all(upper.y0 > lower.y1 for upper, lower in itertools.pairwise(named))


@pytest.mark.long
def test_more_panels_than_a_page_has_room_for():
    """The figure is no taller than a page and says what is left out."""
    graphs = [{"kind": "cyclic", "label": f"graph {n}"} for n in range(30)]
    frequencies = {"attack.frequency": np.arange(1.0, 9).tolist()}
    figure = drawn(
        made(study_of(SWEEP | frequencies | {"topology": graphs, "attack.magnitude": [1]}))
    )
    shown = [panel for panel in figure.axes if panel.get_title()]
    words = plain(figure.get_supxlabel())
    assert f"{len(shown)} of 30 panels are drawn" in words
    assert "all are in cells.csv" in words
    assert len(shown) >= 12
    assert figure.get_figheight() <= style.GREATEST_HEIGHT


ONE_KEY = {"topology": "star", "attack.magnitude": 10, "defence": "none"}


@pytest.mark.parametrize(
    ("sweep", "where", "remedy"),
    [
        ({}, {}, "a sweep of two values at least of two keys"),
        ({"attack.frequency": [1.0, 2.0]}, {}, "a sweep of two values at least of two keys"),
        (SWEEP, ONE_KEY, "a sweep of two values"),
        (SWEEP, {"attack.magnitude": 0}, "an attack and 'recovery={tau: 0.01}'"),
    ],
)
def test_where_nothing_suits_it_says_why(sweep, where, remedy):
    """Fewer than two keys with two values, or nobody attacked; the page has no map then."""
    results = made(study_of(sweep, recovery={"tau": 0.01}))
    with pytest.raises(every.LackingError, match=remedy):
        drawn(results, where=where)
    if not where:
        assert sections.heat_section(results) is None


def test_the_page_has_the_numbers_of_the_cells():
    """All to the last digit, places on the scale; words as in the figure; failures by kind."""
    results = made(study_of(SWEEP), failed={7: ["disconnected"] * 2})
    body = sections.heat_section(results).body
    found = re.findall(r'<script type="application/json">(.*?)</script>', body, re.DOTALL)
    panels, title = [json.loads(each) for each in found][:4], "lanes failed or unrecovered [%]"
    share, numbers = 100 * results.cells["unrecovered"].to_numpy(dtype=float), {}
    share[7] = 100 * 9 / 40
    for panel in panels:
        columns = panel["columns"]
        numbers |= dict(zip(columns["cell"], columns[title], strict=True))
        (tiles,) = panel["data"]
        places, cells = np.array(tiles["z"], float), np.array(tiles["meta"]["cells"])
        np.testing.assert_allclose(places, share[cells] / 100)
    np.testing.assert_array_equal(np.array([numbers[n] for n in range(24)], float), share)
    told = [words for panel in panels for row in panel["data"][0]["hovertext"] for words in row]
    assert sum("failed: 2 disconnected" in words for words in told) == 1
    assert sum("no attack" in words for words in told) == 12
    titles = [f"{graph}, ā = {size} m" for graph in GRAPHS for size in (0, 10)]
    assert [plain(each) for each in re.findall("<h3>(.*?)</h3>", body)][:4] == titles
