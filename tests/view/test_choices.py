"""What a figure of many cells shows, where its panels stand, and what its size and type are."""

import itertools
import json
import re

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr

import jaxnet
from jaxnet.config.naming import choices_words
from jaxnet.statistics.axes import choose_axes
from jaxnet.statistics.bands import error_bands
from jaxnet.statistics.curves import log_ends
from jaxnet.statistics.groups import evenly_over
from jaxnet.store.folder import FolderError
from jaxnet.view.drawings.drawing import LOOKS, MARKERS, Drawing, Panel, Scale, Trace
from jaxnet.view.drawings.swept import swept_drawing
from jaxnet.view.drawings.words import gone_words
from jaxnet.view.figures import style
from jaxnet.view.figures.printed import printed, value_ticks
from jaxnet.view.page.plots import plotted
from tests import systems
from tests.test_cli import jaxnet_does
from tests.view.test_figures import plain
from tests.view.test_heat import drawn, made, study_of
from tests.view.test_lines import OF_RULES, numbered, study_cells

KEYS = {"samples": 3, "horizon": 1.0, "tail": 0.5, "save": {"errors": True}, "vehicles": 4}
SWEEP = {"defence": ["none", "w_msr"], "attack.magnitude": [1, 2, 5, 10, 20], "gain": [[1, 3, 3]]}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Two defences by five magnitudes."""
    study = systems.study(engine="exact", sweep=SWEEP, **KEYS)
    return jaxnet.run(study, tmp_path_factory.mktemp("choices") / "out", progress=False)


def test_of_many_cells_some_of_each_key_are_chosen():
    """A product of a few values of each key, with its ends; of pairs, every so many."""
    labels = [{"a": a, "b": b} for a, b in itertools.product(range(20), range(3))]
    chosen = [labels[place] for place in evenly_over(labels, 24)]
    assert {each["b"] for each in chosen} == {0, 1, 2}
    assert sorted({each["a"] for each in chosen}) == [0, 3, 5, 8, 11, 14, 16, 19]
    assert len(chosen) == 24
    kinds = [
        {"topology": t, "defence": d, "a": a}
        for t, d, a in itertools.product("rst", ["none", "w_msr", "vote"], range(3))
    ]
    some = [kinds[place] for place in evenly_over(kinds, 18)]
    assert {(each["topology"], each["defence"]) for each in some} == {
        *itertools.product("rst", ["none", "w_msr", "vote"])
    }
    assert {each["a"] for each in some} == {0, 2}
    few = [kinds[place] for place in evenly_over(kinds[::3], 4)]
    assert len(few) == 3
    pairs = [{"a": number, "b": -number} for number in range(96)]
    places = evenly_over(pairs, 24)
    assert (len(places), places[0], places[-1]) == (24, 0, 95)
    assert evenly_over(labels, 60) == [*range(60)]


@pytest.mark.parametrize(
    ("most", "kept"),
    [
        (18, ({"ring", "lattice", "path"}, {"none", "trim", "norm"}, {1, 10})),
        (9, ({"ring", "lattice", "path"}, {"none", "trim", "norm"}, {10})),
        (6, ({"ring", "path"}, {"none", "trim", "norm"}, {10})),
    ],
)
def test_names_stay_while_numbers_can_go(most, kept):
    """The least and the greatest number, then the greatest alone; the note tells what is gone."""
    values = {"topology": ["ring", "lattice", "path"], "defence": ["none", "trim", "norm"]}
    values["attack.magnitude"] = [1, 3, 10]
    labels = [dict(zip(values, each, strict=True)) for each in itertools.product(*values.values())]
    shown = [labels[place] for place in evenly_over(labels, most)]
    assert [{each[key] for each in shown} for key in values] == [*kept]
    told = plain(", ".join(gone_words(shown, labels)))
    gone = {18: "ā = 3 m", 9: "ā = 1 m, ā = 3 m", 6: "lattice, ā = 1 m, ā = 3 m"}
    assert told == gone[most]
    assert gone_words([{"gain.1": 9}], [{"gain.1": n} for n in range(10)])[0][:8] == "9 of 10 "


@mpl.rc_context(style.PRINT_STYLE)
def test_rows_that_have_no_room_take_none():
    """Panel and notes stay together where many rows are left out."""
    labels = [{"attack.magnitude": n} for n in range(90)]
    rows = Scale("", names=[str(n) for n in range(90)], labels=labels)
    series = [Trace("", LOOKS[0], np.ones(1), np.full(1, n), "points") for n in range(90)]
    drawn = printed(Drawing([Panel({}, [0], series)], Scale("x"), rows))
    drawn.draw_without_rendering()
    assert len(drawn.axes[0].lines) == len(drawn.axes[0].get_yticks()) < 90
    assert drawn.axes[0].get_tightbbox().y0 > 0


def test_choices_are_named_by_their_values():
    """Products of values are one phrase; a key with all of its values is left out."""
    values = {"topology": ["ring", "star"], "attack.magnitude": [1, 3, 10], "gain.1": [5, 6]}
    every = [dict(zip(values, each, strict=True)) for each in itertools.product(*values.values())]
    some = [each for each in every if each["topology"] == "ring" and each["attack.magnitude"] > 1]
    assert [*map(plain, choices_words(some, every))] == ["ring, ā = 3 and 10 m"]
    apart = [*some, *(each for each in every if each["topology"] == "star")]
    assert [*map(plain, choices_words(apart, every))] == ["ring, ā = 3 and 10 m", "star"]
    assert choices_words(every, every) == ["all"]
    assert choices_words([{}], [{}]) == ["all"]


@mpl.rc_context(style.PRINT_STYLE)
def grid_of(count, width, named=""):
    """Panels of a line each, as a page has them."""
    panels = [
        Panel(
            {"tick": n, "defence": f"{named}{n}"},
            [n],
            [Trace("", LOOKS[0], np.ones(2), np.ones(2))],
        )
        for n in range(count)
    ]
    drawn = printed(Drawing(panels, Scale("x"), Scale("y")), width)
    drawn.draw_without_rendering()
    return drawn


def test_panels_of_one_column_are_alike():
    """The last of an odd number stands below the first of its column, and is no wider."""
    panels = grid_of(5, 3.5).axes
    places = [panel.get_position() for panel in panels]
    assert np.ptp([place.width for place in places]) < 0.01
    assert places[4].x0 == pytest.approx(places[0].x0, abs=0.01)
    assert [bool(panel.get_xlabel()) for panel in panels] == [False] * 4 + [True]


def test_rows_are_evenly_apart_where_the_last_is_not_full():
    """The labels above its hole stand in the hole."""
    panels = grid_of(11, 7.16, "d").axes
    tops = sorted({round(panel.get_position().y1, 3) for panel in panels})
    assert len(tops) == 3
    assert np.ptp(np.diff(tops)) < 0.02
    assert [bool(panel.get_xlabel()) for panel in panels] == [False] * 9 + [True, False]
    box = panels[7].xaxis.get_tightbbox()
    assert panels[10].get_window_extent().y0 < box.y0 < box.y1 < panels[7].get_window_extent().y0
    assert panels[10].get_window_extent().x1 < box.x0


def test_heat_maps_of_two_by_four_stand_in_two_rows():
    """Smaller tiles are better than a row that is not full."""
    sweep = {"topology": ["star", "cyclic"], "attack.frequency": [1.0, 2.0, 3.0, 4.0]}
    sweep |= {"defence": ["none", "w_msr"], "attack.magnitude": [1, 2, 3, 4, 5]}
    maps = [panel for panel in drawn(made(study_of(sweep))).axes if panel.get_title()]
    assert len(maps) == 8
    assert len({round(panel.get_position().y0, 2) for panel in maps}) == 2


def test_bands_tell_series_and_hue(results):
    """A colour a defence, a panel a magnitude; the legend names band and medians."""
    figure = results.figure("bands", y="disagreement", hue="defence")
    assert len(figure.axes) == 5
    told = [plain(text.get_text()) for text in figure.legends[0].get_texts()]
    assert told == ["5 to 95 % of lanes", "maximum", "median, no defence", "median, W-MSR"]
    median = np.median(results.errors["disagreement"][0], axis=0)
    lines = [line.get_ydata() for line in figure.axes[0].lines]
    assert any(np.allclose(line, median, rtol=1e-6) for line in lines)
    with pytest.raises(FolderError, match=r"y: must be one of disagreement, tracking \(got z\)"):
        results.figure("bands", y="z")
    with pytest.raises(FolderError, match=r"\(did you mean 'tracking'\?\)"):
        results.figure("bands", y="trackin")
    alone = results.figure("bands", {"attack.magnitude": 5})
    assert "ā" not in "".join(text.get_text() for text in alone.legends[0].get_texts())


def test_a_start_at_zero_has_no_place_on_a_log_axis(results):
    """It is not drawn until it rises; what never rises is."""
    values = np.stack([np.zeros((2, 4)), [[0.0, 0.0, 2.0, 0.0]] * 2])
    stored = xr.DataArray(values, dims=("cell", "sample", "time"), coords={"time": np.arange(4.0)})
    bands = error_bands(stored, results.study.cells[:2])
    np.testing.assert_array_equal(bands[0].median, np.zeros(4))
    np.testing.assert_array_equal(bands[1].median, [np.nan, np.nan, 2.0, 0.0])
    assert log_ends([np.nan, np.nan, 2.0, 1.0]) == (1.0, 10.0)
    assert log_ends(bands[1].greatest) == (1e-9, 10.0)


def test_curves_that_coincide_are_parted_on_the_page_as_in_print():
    """The same places; the values that are kept are those of the study."""
    cells = study_cells(**OF_RULES)
    drawing = swept_drawing(numbered(cells), choose_axes(cells), cells)
    (panel,) = printed(drawing).axes
    lines = [
        np.asarray(line.get_xdata()).tolist()
        for line in panel.lines
        if line.get_marker() in MARKERS
    ]
    (figure,) = re.findall(r'<script type="application/json">(.*?)</script>', plotted(drawing))
    read = json.loads(figure)
    assert [trace["x"] for trace in read["data"]] == lines
    assert lines[0] != lines[1]
    assert sorted({*read["columns"]["attack frequency [rad/s]"]}) == [0.1, 0.3, 1.0]


@mpl.rc_context(style.PRINT_STYLE)
def test_ticks_are_values_or_round_numbers():
    """None is without its number."""
    assert value_ticks(Scale("", ticks=[100, 101, 102, 200, 1000]), 1.0) == []
    cells = study_cells(**{"attack.frequency": [1.0, 1.01, 1.02, 2.0, 4.0]})
    drawn = printed(swept_drawing(numbered(cells), choose_axes(cells), cells), 3.5)
    drawn.draw_without_rendering()
    assert all(text.get_text() for text in drawn.axes[0].get_xticklabels())


def test_size_and_type_are_as_asked(results, tmp_path):
    """In inches or millimetres; other type in proportion; what is none is refused."""
    figure = results.figure("curve", y="tail_max", size="127x76.2mm", font_size=12, font="serif")
    assert figure.get_size_inches().tolist() == pytest.approx([5.0, 3.0])
    label = figure.axes[0].xaxis.label
    assert (label.get_fontsize(), label.get_fontfamily()) == (12.0, ["serif"])
    assert figure.axes[0].get_xticklabels()[0].get_fontsize() == 10.5
    figure.savefig(tmp_path / "figure.pdf")
    wrongs = {"size": "3x"}, {"size": "86"}, {"size": (0, 2)}, {"font_size": 90}, {"font": "none"}
    for wrong in wrongs:
        with pytest.raises(FolderError, match=next(iter(wrong))):
            results.figure("curve", **wrong)
    with pytest.raises(FolderError, match="tails takes no hue"):
        results.figure("tails", hue="defence")


def test_latex_is_what_show_prints(results):
    """To the letter."""
    done = jaxnet_does("show", results.path, "--format", "latex", "--pivot", "defence")
    assert results.latex(pivot="defence") == done.stdout.rstrip("\n")
