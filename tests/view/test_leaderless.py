"""A study without a navigator speaks of agreement: in its table, its figures and its page."""

import itertools
import re

import numpy as np
import pytest
from matplotlib.text import Text
from scipy.spatial import Delaunay
from scipy.stats import binomtest

import jaxnet
from jaxnet.explore import worst as explored
from jaxnet.film import film_figure, film_of
from jaxnet.runs.replay import trajectory_of
from jaxnet.statistics import pairs
from jaxnet.statistics.quantities import quantity_of
from jaxnet.store.folder import FolderError
from jaxnet.view import columns, page
from jaxnet.view.drawings.analyses import worst_drawing
from jaxnet.view.figures import every
from jaxnet.view.figures.printed import printed
from jaxnet.view.page.sections import search_section
from jaxnet.view.text import check, comparison, tables, worst
from tests import systems
from tests.view.test_page import read_through, section

DEAF = [(1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (3, 2), (4, 2)]  # links that are not there
LINKS = [[i, j, 1.0] for i, j in itertools.product(range(1, 6), repeat=2) if (i, j) not in DEAF]
KEYS = {
    "name": "agree",
    **systems.AGENTS,
    "gain": [8.0],
}
KEYS |= {
    "vehicles": 5,
    "topology": {"kind": "edges", "edges": LINKS},
    "tick": 0.1,
    "engine": "exact",
    "horizon": 2.0,
    "tail": 0.5,
}
KEYS |= {"attack": {"kind": "bias", "vehicles": [2]}, "samples": 4}
KEYS |= {"sweep": {"defence": ["none", "w_msr"], "attack.magnitude": [1, 40]}}
KEYS |= {"save": {"errors": True, "trajectories": "all"}, "recovery": {"tau": 0.01}}
OF_A_NAVIGATOR = re.compile("navigator|error|bound", re.IGNORECASE)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Four vehicles and a liar, without a defence and with W-MSR."""
    return jaxnet.run(KEYS, tmp_path_factory.mktemp("agree") / "out", progress=False)


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """The same draws for a shorter time, and a liar that hides where it is."""
    hides = {"horizon": 1.0, "attack": KEYS["attack"] | {"threat": "replaces"}}
    return jaxnet.run(KEYS | hides, tmp_path_factory.mktemp("hides") / "out", progress=False)


@pytest.fixture(scope="module")
def spreads(results):
    """Greatest distance of vehicles other than the liar by cell, sample and time."""
    places = np.delete(results.trajectories["states"].values, 1, axis=3)
    pairs_of = itertools.combinations(range(places.shape[3]), 2)
    return np.max(
        [np.linalg.norm(places[:, :, :, i] - places[:, :, :, j], axis=3) for i, j in pairs_of], 0
    )


def test_rows_arrays_and_cells_hold_the_spread(results, spreads):
    """Over time and the tail; a lane is without agreement if its spread is over τ ā."""
    assert set(results.errors.data_vars) == {"spread", "disagreement"}
    np.testing.assert_allclose(results.errors["spread"].values, spreads, rtol=1e-6, atol=1e-12)
    tail = spreads[:, :, -6:].max(axis=2)
    rows = results.lanes["spread"].to_numpy().reshape(4, 4)
    np.testing.assert_allclose(rows, tail, rtol=1e-9, atol=1e-12)
    places = results.trajectories["states"].values[:, :, -6:]
    middle = np.delete(places, 1, axis=3).mean(axis=3, keepdims=True)
    farthest = np.linalg.norm(places - middle, axis=-1).max(axis=(2, 3))
    rows = results.lanes["tail_max"].to_numpy().reshape(4, 4)
    np.testing.assert_allclose(rows, farthest, rtol=1e-9, atol=1e-12)
    over = tail > 0.01 * np.array([[1], [40], [1], [40]])
    assert results.cells["unrecovered"].to_list() == over.mean(axis=1).tolist()
    assert 0 < over.mean() < 1


def test_the_share_in_the_hull_is_that_of_a_plain_search(monkeypatch):
    """Honest vehicles at every output time, among triangles of their starts, by Delaunay."""
    keys = KEYS | {
        "sweep": {"defence": ["none", "w_msr"]},
        "attack": KEYS["attack"] | {"magnitude": 70.0},
    }
    results = jaxnet.simulate(keys | {"samples": 5}, progress=False)
    places = np.delete(results.trajectories["states"].values, 1, axis=3)[..., :2]
    stays = np.ones(places.shape[:2], bool)
    for cell, sample in np.ndindex(*stays.shape):
        starts = places[cell, sample, 0]
        triangles = Delaunay(starts + 1e-6 * (starts - starts.mean(axis=0)))
        stays[cell, sample] = (triangles.find_simplex(places[cell, sample]) >= 0).all()
    assert 0 < stays[0].mean() < 1
    assert stays[1].all()
    assert results.cells["in_hull"].to_list() == stays.mean(axis=1).tolist()
    quantity = quantity_of(results, results.study.cells, "in_hull")
    np.testing.assert_allclose(quantity.values["value"], 100 * stays.mean(axis=1))
    known = [binomtest(int(each.sum()), 5).proportion_ci(method="exact") for each in stays]
    np.testing.assert_allclose(
        results.cells["in_hull_low"], [each.low for each in known], atol=1e-12
    )
    np.testing.assert_allclose(
        quantity.values["high"], [100 * each.high for each in known], atol=1e-9
    )
    monkeypatch.setenv("COLUMNS", "200")
    text = tables.summary_text(results)
    assert "leaves the convex hull of the honest starts by over 1e-08 m" in text
    assert "[low, high] of without agreement; in the hull: exact binomial 95 % intervals" in text


def test_links_of_a_network_without_a_navigator_are_just_links(results):
    """In the legend of the figure, which the page shows too."""
    (legend,) = results.plot.topologies().legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "attacked vehicle",
        "attacked link",
        "link",
    ]


def test_the_table_is_about_the_spread(results, monkeypatch):
    """Columns and notes; what follows from the spread is defined below the table."""
    monkeypatch.setenv("COLUMNS", "200")
    text = tables.summary_text(results)
    assert not OF_A_NAVIGATOR.search(text)
    titles = [each.title for each in columns.summary_columns(results)]
    for words in (
        "without agreement [%]",
        "spread, mean [m]",
        "spread, max [m]",
        "outside, max [m]",
    ):
        assert words in titles
    assert "without agreement (unrecovered): spread over the tail > 0.01\N{NO-BREAK SPACE}ā" in text
    assert "spread: greatest distance of two honest vehicles over the tail" in text
    assert "max: greatest of " in text


def words_of(figure):
    """All that is written in a figure."""
    return "\n".join(each.get_text() for each in figure.findobj(Text))


@pytest.mark.parametrize(
    "name", ["curve", "tails", "bands", "panels", "heat", "heat_worst", "topologies"]
)
def test_a_figure_says_nothing_of_errors(results, name):
    """Neither on an axis nor in a legend or note."""
    words = words_of(getattr(every.Plots(results), name)())
    assert not OF_A_NAVIGATOR.search(words)
    if name != "topologies":
        assert "spread" in words.lower() or "without agreement" in words


def test_figures_draw_the_spread(results, spreads):
    """The median of the lanes over time, and the greatest spread in metres, in each tile."""
    figure = every.Plots(results).bands()
    drawn = [line.get_ydata() for panel in figure.axes for line in panel.lines]
    medians = np.maximum(np.median(spreads, axis=1), 1e-9)
    for median in medians:
        assert any(
            len(line) == len(median) and np.allclose(line, median, rtol=1e-5) for line in drawn
        )
    heat = every.Plots(results).heat_worst()
    values = heat.axes[0].collections[0].get_array().ravel()
    np.testing.assert_allclose(sorted(values), sorted(results.cells["spread_max"]), rtol=1e-12)


def test_what_needs_a_navigator_is_refused(results):
    """There is no error to bound or to fit; the message names the figure of the spread."""
    with pytest.raises(
        FolderError, match="without a navigator there is no error to fit and no bound"
    ):
        every.Plots(results).ultimate()
    with pytest.raises(FolderError, match="`jaxnet figure curve` draws the spread"):
        results.fit()


def test_a_film_has_no_navigator(other):
    """Distances are from the mean of the vehicles that are not attacked."""
    lane, graph = trajectory_of(other, 1, 0)
    film = film_of(lane, other.study.cells[1], graph)
    honest = np.delete(lane["states"].values, 1, axis=1)
    apart = np.linalg.norm(lane["states"].values - honest.mean(axis=1, keepdims=True), axis=2)
    np.testing.assert_allclose(film.off, apart, rtol=0, atol=1e-12)
    told = lane["attack"].values[:, 1]
    np.testing.assert_array_equal(
        film.told[:, 0], told
    )  # of a link that is replaced, the signal alone
    figure, *_ = film_figure(film, other.study.cells[1], 0)
    assert not OF_A_NAVIGATOR.search(words_of(figure))


def test_a_comparison_is_of_spreads(results, other):
    """The mean difference of paired lanes."""
    found = pairs.compare_studies(results, other)
    apart = (other.lanes["spread"] - results.lanes["spread"]).groupby(results.lanes["cell"]).mean()
    np.testing.assert_allclose(found.cells["spread_difference"], apart, rtol=1e-12)
    assert not OF_A_NAVIGATOR.search(comparison.comparison_text(found))


def test_check_knows_the_stability_of_a_fleet_whose_liar_is_drawn():
    """A complete graph of five has eigenvalues 1 and -1/4: k0 = 4/5/tick agrees in one step."""
    drawn = {"kind": "bias", "threat": "replaces", "vehicles": {"random": 1}}
    text = " ".join(
        check.check_text(jaxnet.load(KEYS | {"attack": drawn, "topology": "complete"})).split()
    )
    assert (
        "stable, deviations times 0.0000 at each tick of 0.1 s; stability counts no attack" in text
    )
    assert "none: rows measure the spread of honest vehicles" in text
    assert "error" not in text


VISIBLE = """() => {
  for (const each of document.querySelectorAll("details")) each.remove();
  const plots = [...document.querySelectorAll(".plot")].filter(plot => plot.data);
  const hovers = plots.flatMap(plot => plot.data)
    .flatMap(trace => [trace.name, trace.hovertemplate, ...[trace.text ?? []].flat(3)]);
  const drawn = [...document.querySelectorAll("svg text")].map(each => each.textContent);
  const named = [...document.querySelectorAll("[aria-label]")]
    .map(each => each.getAttribute("aria-label"));
  return [document.body.innerText, ...hovers, ...drawn, ...named].join("\\n");
}"""


def test_the_page_says_nothing_of_errors(browser, results):
    """In no sentence, table, plot or hint; only the setting says that there is no navigator."""
    path = page.write_page(results)
    text = path.read_text()
    assert re.findall(r'<section id="(.*?)"', text) == [
        "findings", "answer", "run", "summary", "bands", "heat", "lanes"
    ]  # fmt: skip
    assert "<dt>navigator</dt><dd>no navigator</dd>" in section(text, "run")
    shown = browser.new_page()
    complaints = []
    shown.on("pageerror", lambda error: complaints.append(str(error)))
    shown.goto(path.as_uri())
    read_through(shown)
    words = shown.evaluate(VISIBLE)
    shown.close()
    assert complaints == []
    assert "m from the mean" in words
    assert "Distance of each vehicle from the mean of honest ones" in words
    left = re.sub("navigator\nno navigator|save\n.*\n", "", words)
    assert [
        left[each.start() - 40 : each.end() + 40] for each in OF_A_NAVIGATOR.finditer(left)
    ] == []


@pytest.mark.long
def test_a_search_speaks_of_metres_and_of_no_bound(tmp_path, monkeypatch):
    """The spread is told in metres; a panel is not empty where vehicles agree."""
    monkeypatch.setattr(explored, "FRESH", 8)
    attack = {
        "kind": "own_path",
        "vehicles": [2],
        "centre": [30, 0],
        "frequency": {"uniform": [0.1, 1]},
    }
    over = {
        "over": {"attack.frequency": [0.1, 1]},
        "maximise": "spread",
        "budget": 100,
        "until": 1.0,
    }
    keys = KEYS | {
        "attack": attack,
        "defence": "w_msr",
        "sweep": {"gain": [[8.0], [6.0]]},
        "save": {},
    }
    results = jaxnet.search(keys | {"search": over}, tmp_path / "out", progress=False)
    told = worst.search_text(results)
    assert "greatest distance of two honest vehicles [m], by search" in told
    assert not re.search("ā|bound", told)
    rows, found = worst.worst_rows(results), results.worst
    np.testing.assert_array_equal(rows["found by the search"], found["found"])
    assert "bound" not in str(search_section(results))
    for name in ("search", "search_worst"):
        drawn = getattr(every.Plots(results), name)()
        assert not any("bound" in words.get_text() for words in drawn.findobj(Text))
        for panel in drawn.axes:
            heights = np.concatenate(
                [line.get_data()[name == "search"] for line in panel.get_lines()]
            )
            assert np.isfinite(np.log(heights)).all()
    under_way = printed(worst_drawing(rows.head(1), results.study.cells, "spread"), 3.5)
    assert any("1 of 2 cells are drawn" in words.get_text() for words in under_way.findobj(Text))
