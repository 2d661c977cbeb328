"""Heat maps: every cell in its place, numbers that do not flatter, colours that all can read."""

import json
import re
from collections import Counter
from fractions import Fraction

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb
from upath import UPath

from jaxnet.statistics import tiles
from jaxnet.statistics.intervals import clopper_pearson
from jaxnet.statistics.tiles import NO_CELL, tiling
from jaxnet.store.results import Results
from jaxnet.view.figures import every, heat, style
from jaxnet.view.page import sections
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
        labels = found.panels[panel] | {
            "defence": found.rows[row],
            "attack.frequency": found.columns[column],
        }
        assert cells[number].labels == labels
    found = tiling([cell for cell in cells if cell.number != 13])
    assert found is not None
    assert sorted(found.cells.ravel()) == [NO_CELL, *(n for n in range(24) if n != 13)]


@pytest.mark.parametrize(
    ("sweep", "row", "column"),
    [
        (
            {"attack.magnitude": [1, 2, 3], "attack.frequency": [1.0, 2.0]},
            "attack.frequency",
            "attack.magnitude",
        ),
        (
            {"attack.magnitude": [1, 2, 3], "topology": ["star", "cyclic"]},
            "topology",
            "attack.magnitude",
        ),
        (
            {"topology": ["star", "cyclic"], "defence": ["none", "trusted_trim"]},
            "defence",
            "topology",
        ),
        ({"tick": [0.05, 0.1], "attack.magnitude": [1, 2, 3]}, "tick", "attack.magnitude"),
    ],
)
def test_numbers_stand_along_kinds_down(sweep, row, column):
    """What is varied more stands along; numbers rise upwards."""
    found = tiling(study_of(sweep).cells)
    assert found is not None
    assert (found.row, found.column) == (row, column)
    if row == "attack.frequency":
        assert found.rows == [2.0, 1.0]


def test_only_all_lanes_are_100_per_cent():
    """And only none are 0; a share is told to a twentieth of what it is nearer to."""
    for lanes in (7, 400):
        for count in range(lanes + 1):
            share = 100 * Fraction(count, lanes)
            words = tiles.tile_text("unrecovered", float(share))
            assert (words == "0", words == "100") == (count == 0, count == lanes)
            assert len(words) <= 5
            assert abs(Fraction(words) - share) <= min(share, 100 - share) / 20


@pytest.mark.parametrize(
    ("share", "few", "many"),
    [
        (36.5, "37", "36.5"),
        (36.499999999999996, "37", "36.5"),
        (63.5, "64", "63.5"),
        (0.0, "0", "0"),
        (100.0, "100", "100"),
        (99.998, "99.998", "99.998"),
    ],
)
def test_a_tile_agrees_with_the_table(share, few, many):
    """Its four digits where there is room, else halves are rounded up on both sides of 50 %."""
    assert tiles.tile_text("unrecovered", share) == few
    assert tiles.tile_text("unrecovered", share, whole=True) == many


@pytest.mark.parametrize("lanes", [7, 400])
def test_a_rounded_interval_holds_the_exact_one(lanes):
    """And is not much wider."""
    count = np.arange(lanes + 1)
    for low, high in zip(
        *(100 * end for end in clopper_pearson(count, np.full(lanes + 1, lanes), 0.95)), strict=True
    ):
        told = [float(end) for end in tiles.interval_text(low, high).split("–")]
        assert 0 <= told[0] <= low < high <= told[1] <= 100
        assert told[1] - told[0] <= 1.2 * (high - low)


@pytest.mark.parametrize(
    ("error", "words"), [(3.14, "3.1"), (0.11, "0.11"), (7.2e-4, "7e-4"), (1e-12, "0")]
)
def test_errors_are_told_in_four_letters(error, words):
    """Below 1e-9 of ā they are rounding."""
    assert tiles.tile_text("worst", error) == words


def luminance(colour) -> float:
    """Relative luminance of WCAG 2.2."""
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in to_rgb(colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other) -> float:
    """Of two colours, as WCAG 2.2 has it."""
    low, high = sorted(map(luminance, (one, other)))
    return (high + 0.05) / (low + 0.05)


def test_colours_darken_steadily_and_carry_their_ink():
    """In grey too a greater number is darker; words have a contrast of 4.5 on all of them."""
    colours, inks = zip(*heat.palette(), strict=True)
    assert (np.diff([luminance(colour) for colour in colours]) < 0).all()
    assert min(map(contrast, colours, inks)) >= 4.5


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


def test_a_tile_tells_its_cells_share_and_interval():
    """Of 40 lanes; hatched without an attack; failed lanes are a star and a note, in no share."""
    results = made(study_of(SWEEP), failed={7: ["disconnected"] * 2, 18: ["nonfinite"] * 40})
    figure = drawn(results)
    panels = [panel for panel in figure.axes if panel.get_title()]
    assert [plain(panel.get_title()) for panel in panels] == [
        f"{graph}, ā = {size} m" for graph in ("star", "cyclic") for size in (0, 10)
    ]
    words = tile_words(panels[1])
    assert words[0, 1] == [tiles.interval_text(*interval_of(6, 40)), "15"]
    assert words[0, 0] == [tiles.interval_text(*interval_of(7, 38)), "18.42*"]
    assert {word for each in tile_words(panels[0]).values() for word in each} == {""}
    assert tile_words(panels[3])[0, 1] == ["*"]
    assert plain(figure.get_suptitle()) == (
        "38 to 40 lanes a tile; 95 % intervals, at most 17 points to a side;"
        " * other lanes failed, and are in no number: 40 nonfinite, 2 disconnected"
    )
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "no attack, no lane ended"
    ]
    assert panels[0].get_xlabel() == ""
    assert panels[2].get_xlabel() == "attack frequency [rad/s]"
    bar = next(panel for panel in figure.axes if panel.get_xlabel() == "lanes unrecovered [%]")
    assert bar.get_xlim() == (0, 100)


def interval_of(count: int, lanes: int) -> tuple[float, float]:
    """The exact one [%]."""
    low, high = clopper_pearson(np.array(count), np.array(lanes), 0.95)
    return 100 * float(low), 100 * float(high)


def test_a_tile_has_the_colour_of_its_number():
    """The same scale in all panels; a cell that was not run has none."""
    results = made(study_of(SWEEP | {"attack.magnitude": [10]}))
    figure = drawn(results)
    for first, panel in zip((0, 6), figure.axes, strict=False):
        values = np.asarray(panel.collections[0].get_array()).ravel()
        order = [first + 2 * row + 1 - column for row in range(3) for column in range(2)]
        np.testing.assert_allclose(values, 100 * np.array(order) / 40)
        assert panel.collections[0].get_clim() == (0, 100)
    cells = [cell for cell in results.study.cells if cell.number != 4]
    some = tiling(cells)
    assert some is not None
    with_gap = heat.heat_figure(results, some, "unrecovered")
    assert np.ma.getmaskarray(with_gap.axes[0].collections[0].get_array()).sum() == 1
    assert [text.get_text() for text in with_gap.legends[0].get_texts()] == ["not run"]


def test_words_stay_within_their_tiles():
    """In one column and in two, with long and with short numbers."""
    sweep = {"defence": SWEEP["defence"], "attack.frequency": [0.1, 0.2, 0.4, 0.8, 1.6]}
    results = made(study_of(sweep))
    results.cells["tail_max_max"] = np.geomspace(1e-7, 30, 15)
    for metric, column in (("unrecovered", "one"), ("worst", "two")):
        panel = drawn(results, metric, column=column).axes[0]
        width = panel.get_window_extent().width / 5
        height = panel.get_window_extent().height / 3
        for text in panel.texts:
            box = text.get_window_extent()
            assert box.width < width
            assert box.height < height


def test_errors_are_per_size_on_a_log_scale():
    """Between powers of ten around all of them."""
    results = made(study_of(SWEEP | {"attack.magnitude": [10]}))
    results.cells["tail_max_max"] = np.geomspace(2e-3, 20, 12)
    figure = drawn(results, "worst")
    mesh = figure.axes[0].collections[0]
    np.testing.assert_allclose(
        np.asarray(mesh.get_array()).ravel()[:2], results.cells["tail_max_max"][[1, 0]] / 10
    )
    assert mesh.get_clim() == pytest.approx((1e-4, 10))


@pytest.mark.long
def test_more_panels_than_a_page_has_room_for():
    """The figure is no taller than a page and says what is left out."""
    graphs = [{"kind": "cyclic", "label": f"graph {n}"} for n in range(30)]
    sweep = {
        "topology": graphs,
        "defence": SWEEP["defence"],
        "attack.frequency": np.arange(1.0, 9).tolist(),
    }
    figure = drawn(made(study_of(sweep)))
    shown = [panel for panel in figure.axes if panel.get_title()]
    assert f"{len(shown)} of 30 panels are drawn; all are in cells.csv" in plain(
        figure.get_suptitle()
    )
    assert len(shown) >= 12
    assert figure.get_figheight() <= style.GREATEST_HEIGHT


@pytest.mark.parametrize(
    ("sweep", "where", "remedy"),
    [
        ({}, {}, "a sweep of two values at least of two keys"),
        ({"attack.frequency": [1.0, 2.0]}, {}, "a sweep of two values at least of two keys"),
        (
            SWEEP,
            {"topology": "star", "attack.magnitude": 10, "defence": "none"},
            "a sweep of two values",
        ),
        (SWEEP, {"attack.magnitude": 0}, "an attack and 'recovery={tau: 0.01}'"),
    ],
)
def test_where_nothing_suits_it_says_why(sweep, where, remedy):
    """Fewer than two keys with two values, or nobody attacked; the page has no map then."""
    results = made(study_of(sweep, recovery={"tau": 0.01}))
    with pytest.raises(every.LackingError, match=remedy):
        drawn(results, where=where)
    if not where:
        section = sections.heat_section(results)
        assert (section is None) == (len(sweep) < 2)
        assert section is None or "came to its end" in section.body


def test_the_page_has_the_numbers_of_the_cells():
    """All to the last digit, places on the scale; words as in the figure; failures by kind."""
    results = made(study_of(SWEEP), failed={7: ["disconnected"] * 2})
    body = sections.heat_section(results).body
    found = re.findall(r'<script type="application/json">(.*?)</script>', body, re.DOTALL)
    panels = [json.loads(each) for each in found][:4]
    share = 100 * results.cells["unrecovered"]
    numbers = {}
    for panel in panels:
        numbers |= dict(zip(panel["columns"]["cell"], panel["columns"]["unrecovered"], strict=True))
        (tiles,) = panel["data"]
        places, cells = np.array(tiles["z"], float), np.array(tiles["meta"]["cells"])
        np.testing.assert_allclose(places, share.to_numpy()[cells] / 100)
    np.testing.assert_array_equal(
        np.array([numbers[n] for n in range(24)], float), share.to_numpy(dtype=float)
    )
    told = [words for panel in panels for row in panel["data"][0]["hovertext"] for words in row]
    assert sum("failed: 2 disconnected" in words for words in told) == 1
    assert sum("no attack" in words for words in told) == 12
    titles = [plain(each) for each in re.findall("<h3>(.*?)</h3>", body)]
    assert titles[:4] == [
        f"{graph}, ā = {size} m" for graph in ("star", "cyclic") for size in (0, 10)
    ]
