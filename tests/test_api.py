"""What a script or notebook does: studies from what it holds, and all that results allow."""

import doctest
import gc
import inspect
import io
import os
import pkgutil
import pydoc
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from fsspec.implementations.memory import MemoryFileSystem
from upath import UPath

import jaxnet
from jaxnet import ConfigError, FolderError, KindError
from jaxnet.cli import main
from jaxnet.config.study import native
from jaxnet.explore import worst
from jaxnet.kinds.attacks.sinusoid import Sinusoid
from jaxnet.kinds.defences.w_msr import WMSR
from jaxnet.runs import cache, watched
from jaxnet.statistics import fits
from jaxnet.view.figures import SEARCH, SENSITIVITY, every

KEYS = {
    "samples": 2,
    "horizon": 1.0,
    "tail": 0.5,
    "engine": "exact",
    "defence": "none",
    "topology": "star",
    "vehicles": 3,
    "attack": {"vehicles": [2]},
    "sweep": {"attack.magnitude": [1, 5.5]},
    "save": {"errors": True, "vehicles": True, "trajectories": "all"},
}
NOT_HERE = {
    "answer",
    "heat",
    "heat_worst",
    *SEARCH,
    *SENSITIVITY,
}  # of two swept keys, other commands
PAGE = (Path(__file__).parents[1] / "docs" / "api.md").read_text()
PUBLIC = re.findall(r"^::: (\S+)$", PAGE, re.M)


@pytest.fixture(scope="module")
def results():
    """Two cells of two lanes, in memory, everything saved."""
    return jaxnet.simulate(KEYS)


def in_process(code: str, **environment: str) -> str:
    """What a script prints in a process of its own, where JAX was not told of a cache."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("JAX_")}
    return subprocess.check_output([sys.executable, "-c", code], text=True, env=kept | environment)


# --- what there is --------------------------------------------------------------------------------


def test_the_package_says_what_there_is():
    """To `dir` and to `help`, each name as what it is."""
    assert set(jaxnet.__all__) <= set(dir(jaxnet))
    text = pydoc.plain(pydoc.render_doc(jaxnet))
    for name in jaxnet.__all__:
        assert re.search(rf"^    (class )?{name}\(", text, re.MULTILINE), name


def examples(name):
    """Return the doctests of a public name and of its methods. An example imports what it uses."""
    found = pkgutil.resolve_name(name)
    finder = doctest.DocTestFinder(exclude_empty=False)
    return finder.find(found, name, sys.modules[found.__module__], {"__name__": "__main__"})


HEAVY = {"jaxnet.Results", "jaxnet.search", "jaxnet.rare", "jaxnet.sensitivity"}
# What these tell is used by the examples of Metric, Attack and Defence.
HEAVY |= {"jaxnet.engine.metrics.Observation", "jaxnet.engine.tick.Seen"}
HEAVY |= {"jaxnet.kinds.defences.Neighbourhood"}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long) if n in HEAVY else n for n in PUBLIC]
)
def test_every_public_name_has_an_example_that_runs(name, monkeypatch):
    """Each name of docs/api.md; the examples of its methods run too, and print what they show."""
    monkeypatch.setattr(fits, "RESAMPLES", 2)  # the intervals are tested elsewhere
    monkeypatch.setattr(worst, "FRESH", 8)
    found, runner = examples(name), doctest.DocTestRunner()
    assert next(each for each in found if each.name == name).examples, "no example"
    for example in found:
        runner.run(example)
    assert runner.failures == 0


def test_the_page_of_the_interface_has_every_public_name():
    """And every method that `Results` has beyond the stored tables has an example."""
    assert {f"jaxnet.{name}" for name in jaxnet.__all__} <= set(PUBLIC)
    lacking = [each.name for each in examples("jaxnet.Results") if not each.examples]
    methods = [name for name, each in vars(jaxnet.Results).items() if inspect.isfunction(each)]
    assert [
        name for name in methods if name[0] != "_" and f"jaxnet.Results.{name}" in lacking
    ] == []


def test_loading_imports_nothing_that_simulates_or_reads():
    """A script or the command's `--help` starts at once."""
    code = (
        "import sys, jaxnet; dir(jaxnet)\n"
        "print([n for n in ('numpy', 'pydantic') if n in sys.modules])\n"
        "try: jaxnet.load({'horizn': 1})\n"
        "except jaxnet.ConfigError: jaxnet.load({})\n"
        "print([n for n in ('jax', 'pandas', 'zarr', 'matplotlib') if n in sys.modules])"
    )
    assert in_process(code) == "[]\n[]\n"


# --- a study out of what a script holds -----------------------------------------------------------


def test_a_mapping_is_read_like_a_file(tmp_path):
    """The same keys, the same cells; a sweep keeps its order."""
    keys = {"name": "one", "sweep": {"topology": ["path", "star"], "attack.magnitude": [1, 2]}}
    file = tmp_path / "one.yaml"
    file.write_text("name: one\nsweep: {topology: [path, star], attack.magnitude: [1, 2]}\n")
    assert jaxnet.load(keys, {"seed": 3}) == jaxnet.load(file, ["seed=3"])
    assert jaxnet.load(str(file)) == jaxnet.load(UPath(file)) == jaxnet.load(keys)
    study = jaxnet.load({})
    assert study.config.name == "study"
    assert jaxnet.load(study) is study
    assert jaxnet.load(study, {"seed": 3}) == jaxnet.load({"seed": 3}) != study


EDGES = {"attack": "none", "vehicles": 2, "topology": {"kind": "edges"}}


def with_edges(edges):
    return EDGES | {"topology": {"kind": "edges", "edges": edges}}


@pytest.mark.parametrize(
    ("given", "plain"),
    [
        ({"seed": np.int64(3)}, {"seed": 3}),
        ({"save": {"errors": np.bool_(True)}}, {"save": {"errors": True}}),
        ({"gain": np.array([1.0, 4.0, 3.0])}, {"gain": [1.0, 4.0, 3.0]}),
        ({"attack": {"vehicles": pd.Series([3, 5])}}, {"attack": {"vehicles": [3, 5]}}),
        ({"sweep": {"attack.magnitude": np.arange(3)}}, {"sweep": {"attack.magnitude": [0, 1, 2]}}),
        ({"defence": {"theta": {np.int64(2): np.int8(1)}}}, {"defence": {"theta": {2: 1}}}),
        (with_edges(((1, 0, 1), (2, 1, np.float32(0.5)))), with_edges([[1, 0, 1], [2, 1, 0.5]])),
        ({"name": UPath("mine")}, {"name": "mine"}),
        ({"topology": {"label": np.str_("1e3")}}, {"topology": {"label": "1e3"}}),
    ],
)
def test_numpy_pandas_tuples_and_paths_are_plain_values(given, plain):
    """In a mapping and in overrides; the label, a number in YAML 1.2 alone, stays text."""
    assert native(given) == plain
    study = jaxnet.load(given)
    assert study == jaxnet.load(plain)
    if "sweep" not in given:
        assert jaxnet.load({}, given) == study


@pytest.mark.parametrize(
    ("given", "overrides", "says"),
    [
        ({"horizn": 3}, {}, r"^horizn: unknown key \(did you mean 'horizon'"),
        ({"sweep": {"seed": [2, {1}]}}, {}, r"sweep.seed.1: must be a number, .* \(got \{1\}\)"),
        ({}, {"attack": b"bias"}, r"attack: must be a number, .* \(got b'bias'\)"),
        ({}, {"attack.magnitude": np.nan}, r"attack.magnitude: must be finite \(got NaN\)"),
        ({}, {"attack.magnitude": -1}, r"^attack\.magnitude: must be at least 0 \(got -1\)$"),
        ({"defence": "w_msr"}, {"defence.F": -1}, r"^defence\.F: must be at least 0 \(got -1\)$"),
        ({"sweep": {"gian": [1, 2]}}, {}, r"^sweep\.gian: unknown key"),
        ({}, ["samples=none"], r"^command line 'samples=none': samples: "),
    ],
)
def test_what_is_wrong_in_a_mapping_is_said(given, overrides, says):
    """As of a file, by the dotted key alone; and of a value that no file can hold."""
    with pytest.raises(ConfigError, match=says):
        jaxnet.load(given, overrides)


def test_what_is_wrong_with_a_kind_in_python_is_said():
    """In words of ours, key by key, also of a kind inside another and of a metric."""
    with pytest.raises(KindError, match=r"^WMSR: F: must be at least 0 \(got -1\)$"):
        WMSR(F=-1)
    with pytest.raises(KindError, match=r"^WMSR: f: unknown key \(did you mean 'F'\?\)$"):
        WMSR(f=1)
    with pytest.raises(
        KindError, match=r"^Sinusoid: magnitude: must be .*\nSinusoid: frequency: must be"
    ):
        Sinusoid(magnitude="big", frequency="fast")
    code = "from jaxnet.kinds.metrics import Metric, KindError\n"
    code += "try: Metric('m', '', abs, time='median')\nexcept KindError as error: print(error)"
    said = "metric m: time is one of mean, max, min, sum, integral, last (got 'median')\n"
    assert in_process(code) == said  # where annotations are not checked


def test_a_study_is_shown_in_few_words():
    """In a line, and in a notebook as a table in which a label is text."""
    topologies = [{"label": "<b>"}, *({"label": f"p{n}"} for n in range(99))]
    study = jaxnet.load({"name": "n" * 100, "samples": 7, "sweep": {"topology": topologies}})
    assert repr(study) == f"Study('{'n' * 100}', cells=100, lanes=700)"
    html = study._repr_html_()
    assert "<th>lanes</th><td>700</td>" in html
    assert "&lt;b&gt;, p0, p1" in html
    assert "<b>" not in html
    assert len(html) < 500


# --- runs -----------------------------------------------------------------------------------------


def test_a_run_takes_a_path_a_mapping_or_a_study(results, tmp_path):
    """And makes the same rows of them, in a folder as in memory."""
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump({"name": "mine", **KEYS}))
    for number, source in enumerate([str(file), KEYS]):
        made = jaxnet.run(source, tmp_path / str(number))
        pd.testing.assert_frame_equal(made.lanes, results.lanes, check_exact=True)
    assert jaxnet.run_part(file, 1, 2, tmp_path / "part").simulated == 1
    with pytest.raises(ConfigError, match="horizn: unknown key"):
        jaxnet.run({"horizn": 3}, tmp_path / "none")
    assert type(jaxnet.open(tmp_path / "0")) is type(made) is jaxnet.Results


@pytest.mark.long
def test_memory_is_freed_with_the_results_and_not_before():
    """What was read stays; what is being read keeps them alive."""

    def held() -> int:
        gc.collect()
        return sum(name.startswith("/jaxnet/") for name in MemoryFileSystem.store)

    before = held()
    made = jaxnet.simulate(KEYS, samples=np.int64(3))
    assert held() > before
    rows, arrays = made.lanes, made.errors
    assert len(rows) == 6
    del made
    assert held() == before
    assert arrays["tracking"].shape[:2] == (2, 3)
    assert np.isfinite(arrays["tracking"]).all()
    assert [len(lanes) for _, lanes in jaxnet.simulate(KEYS).by_cell("sample")] == [2, 2]
    assert held() == before

    def failing(*_: int) -> None:
        raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine"):
        jaxnet.simulate(KEYS, progress=failing)
    assert held() == before


@pytest.mark.long
def test_python_keeps_compiled_programs_as_the_command_does(tmp_path):
    """In the user's cache folder; one that JAX was told of before is left as it is."""
    code = f"import jax, jaxnet; jax.numpy.ones(3).sum(); jaxnet.simulate({KEYS!r})"
    in_process(code, XDG_CACHE_HOME=str(tmp_path))
    assert list(tmp_path.glob("jaxnet/xla/*/*-cache"))
    code = (
        "import jax; jax.config.update('jax_compilation_cache_dir', '/mine')\n"
        "from jaxnet.runs.cache import enable; enable()\n"
        "print(jax.config.jax_compilation_cache_dir)"
    )
    assert in_process(code, XDG_CACHE_HOME=str(tmp_path)) == "/mine\n"


def test_flags_of_xla_that_are_set_stand(monkeypatch):
    """Else loops over few bytes become one function."""
    monkeypatch.setenv("XLA_FLAGS", "--mine")
    cache.enable()
    assert os.environ["XLA_FLAGS"] == "--mine"
    monkeypatch.delenv("XLA_FLAGS")
    cache.enable()
    assert "small_while_loop" in os.environ["XLA_FLAGS"]


SLOW_CODE = """
from jaxnet.runs.cache import enable; enable()
import jax, jax.numpy as jnp, numpy as np
big = np.ones((100, 100), np.float32)
window = (31, 31), (1, 1), "SAME"  # folded for seconds; XLA tells of it after one
total = lambda x: x + jax.lax.reduce_window(jnp.asarray(big), 0.0, jax.lax.add, *window)
jax.jit(total).lower(1.0).compile()
"""


@pytest.mark.long
def test_slow_compilation_is_no_news_to_a_user(tmp_path):
    """XLA asks for a report of it, as of a fault of its own."""
    code, environment = [sys.executable, "-c", SLOW_CODE], os.environ | {"JAX_PLATFORMS": "cpu"}
    environment |= {"XDG_CACHE_HOME": str(tmp_path)}
    environment.pop("TF_CPP_MIN_LOG_LEVEL", None)
    done = subprocess.run(code, env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == ""


# --- results --------------------------------------------------------------------------------------


def test_a_lane_is_replayed_by_the_numbers_that_a_table_holds(results):
    """Those of a row of floats too; the row is the stored one, the trajectory the saved one."""
    worst = results.lanes[["cell", "sample", "tail_mean"]].nlargest(1, "tail_mean").iloc[0]
    again = results.replay(worst["cell"], worst["sample"])
    assert again.row["tail_mean"] == worst["tail_mean"]
    pd.testing.assert_series_equal(
        results.row(worst["cell"], np.int64(worst["sample"])), again.row, check_names=False
    )
    saved = results.trajectories["states"].sel(cell=worst["cell"], sample=worst["sample"])
    np.testing.assert_array_equal(again.trajectory["states"][0], saved)
    chosen = results.by_cell("sample", cells=pd.Series([1], index=[9]))
    assert [number for number, _ in chosen] == [1]


@pytest.mark.parametrize(
    ("cell", "sample", "said"),
    [
        (-1, 0, r"cell is a whole number from 0 on \(got -1\)"),
        (0, 0.5, r"sample is a whole number from 0 on \(got 0.5\)"),
        (2, 0, r"cells 0 to 1 and samples 0 to 1 \(got cell 2, sample 0\)"),
    ],
)
def test_a_lane_that_is_none_is_refused(results, cell, sample, said):
    """With what was given and what is allowed."""
    with pytest.raises(FolderError, match=said):
        results.replay(cell, sample)


def test_results_are_fitted_and_reported(results, monkeypatch):
    """Into the tables, bounds and figures that the commands write."""
    monkeypatch.setattr(fits, "RESAMPLES", 2)  # the intervals are tested elsewhere
    monkeypatch.setattr(watched, "replay_watched", lambda *_: iter(()))  # so are the lanes shown
    with pytest.raises(FolderError, match=r"study in memory has no bounds\.csv: Results\.fit"):
        _ = results.bounds
    table = results.fit()
    assert {"model", "estimate"} <= set(table)
    pd.testing.assert_frame_equal(results.fits, table)
    assert len(results.bounds)
    page = results.report()
    assert page.read_text().startswith("<!DOCTYPE html>")
    drawn = {path.stem for path in (results.path / "figures").iterdir()}
    assert drawn == {*every.FIGURE_NAMES} - NOT_HERE


def test_run_and_search_take_the_same_arguments():
    """By name, order and default."""
    run, search = (
        [(each.name, each.default) for each in inspect.signature(one).parameters.values()]
        for one in (jaxnet.run, jaxnet.search)
    )
    assert run == search
    options = [[each.name for each in main.commands[name].params] for name in ("run", "search")]
    assert [name for name in options[0] if name not in ("strict", "shard")] == options[1]


def test_fits_and_replays_are_written_where_they_are_asked_for(tmp_path, monkeypatch):
    """Into `out`, with the values that are returned."""
    monkeypatch.setattr(fits, "RESAMPLES", 2)
    results = jaxnet.run(KEYS, tmp_path / "results", progress=False)
    before = sorted(results.path.rglob("*"))
    table, lane = results.fit(tmp_path / "out"), results.replay(1, 0, out=tmp_path / "out")
    written = pd.read_csv(tmp_path / "out" / "fit.csv")
    pd.testing.assert_frame_equal(table, written[table.columns.tolist()])
    assert lane.path == tmp_path / "out" / "replays" / "cell-1-sample-0.zarr"
    assert (lane.path / "zarr.json").exists()
    assert sorted(results.path.rglob("*")) == before


@pytest.mark.long
def test_results_in_memory_are_reported_and_filmed_in_a_folder(tmp_path, monkeypatch):
    """Nothing that a user reads names a place in memory, and nothing is added there."""
    monkeypatch.setattr(fits, "RESAMPLES", 2)
    drawn = every.draw_figures  # the other figures are alike
    tails = lambda results, told=None: drawn(results, ("tails",))  # noqa: E731
    monkeypatch.setattr(every, "draw_figures", tails)
    results = jaxnet.simulate(KEYS | {"save": {"trajectories": "none"}}, progress=False)
    before = len(MemoryFileSystem.store)
    page = results.report(tmp_path / "report")
    assert page == tmp_path / "report" / "report.html"
    assert (page.parent / "fit.csv").exists()
    assert (page.parent / "figures" / "tails.pdf").exists()
    film = results.animate(1, 0, tmp_path / "films")
    assert film.parent == tmp_path / "films"
    assert film.stem == "cell-1-sample-0"
    assert results.animate(1, 0, tmp_path / "one.gif") == tmp_path / "one.gif"
    assert len(MemoryFileSystem.store) == before
    shown = [repr(results), repr(results.replay(0, 1)), results._repr_html_(), page.read_text()]
    assert shown[:2] == [
        "Results('study', cells=2, lanes=4, in memory)",
        "Replay(cell=0, sample=1, status='ok')",
    ]
    assert not [each for each in shown if "memory:" in each]
    other = jaxnet.simulate(KEYS | {"seed": 1}, progress=False)
    with pytest.raises(FolderError, match="of other rows"):
        other.report(tmp_path / "report")


@pytest.mark.parametrize("name", sorted({*every.FIGURE_NAMES} - NOT_HERE))
def test_a_notebook_shows_every_figure(results, name):
    """Without pyplot and on a screen's scale."""
    figure = getattr(results.plot, name)()
    width, _ = figure.get_size_inches()
    assert width_of(figure._repr_png_()) == int(100 * width)
    if name == "tails":  # saved by hand it has the resolution for print
        figure.savefig(content := io.BytesIO())
        assert width_of(content.getvalue()) == int(300 * width)


def width_of(png: bytes) -> int:
    """Of a picture [pixels]."""
    assert png.startswith(b"\x89PNG")
    return int.from_bytes(png[16:20], "big")


def test_a_figure_without_data_says_what_gives_them(tmp_path):
    """Of each that needs more than rows."""
    remedies = {
        "panels": "save.errors=true or save.trajectories=all",
        "bands": "save.errors=true",
        "ultimate": "sweep.attack.magnitude=",
        "ultimate_mean": "sweep.attack.magnitude=",
    }
    plain = {**KEYS, "sweep": {}, "save": {}}
    bare = jaxnet.simulate(plain)
    for name, remedy in remedies.items():
        with pytest.raises(FolderError, match=re.escape(remedy)):
            getattr(bare.plot, name)()
    assert bare.plot.tails().axes
    with pytest.raises(FolderError, match="curve draws what is first on the page"):
        bare.plot.answer()
    with pytest.raises(
        FolderError, match=r"y: must be one of failed, tail_mean, .* \(got unrecovered\)"
    ):
        bare.plot.curve(y="unrecovered")
    recovering = jaxnet.simulate({**plain, "recovery": {"tau": 0.01}}, samples=3)
    assert recovering.plot.curve().axes[0].get_xlabel() == "lanes unrecovered [%]"


def test_results_are_shown_in_few_words(results):
    """In a line, and in a notebook with lanes, failures and the summary."""
    assert repr(results) == "Results('study', cells=2, lanes=4, in memory)"
    assert {*every.FIGURE_NAMES} <= {*dir(results.plot)}
    html = results._repr_html_()
    assert "4 of 4 lanes ok, 0 failed" in html
    assert html.count("<tr") == 3
    assert f"{results.cells['tail_mean_mean'][1]:.3g}" in html


def test_an_unfinished_run_is_shown_as_such(results, tmp_path):
    """Not as an error in a notebook."""
    jaxnet.run(KEYS, tmp_path / "out")
    (tmp_path / "out" / "cells.csv").unlink()
    assert "unfinished run" in jaxnet.open(tmp_path / "out")._repr_html_()
