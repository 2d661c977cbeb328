"""The command line: what it says, where, and with which exit status."""

import contextlib
import io
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import webbrowser

import pandas as pd
import pytest
import xarray as xr
import yaml
from click.testing import CliRunner

import jaxnet
from jaxnet.cli import errors, main
from jaxnet.runs import watched
from jaxnet.store.folder import Folder

SMALL = {"name": "small", "samples": 2, "horizon": 1.0, "tail": 0.5, "engine": "exact"}
SMALL |= {"attack": "none", "defence": "none"}


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    """A small study's file."""
    path = tmp_path_factory.mktemp("cli") / "small.yaml"
    path.write_text(yaml.safe_dump(SMALL))
    return path


@pytest.fixture(scope="module")
def finished(config):
    """The study's results folder, made by the command line, and what it printed."""
    out = config.parent / "out"
    return out, jaxnet_does("run", config, "save={errors: true, trajectories: all}", "--out", out)


def jaxnet_does(*words):
    """One command, in this process."""
    return CliRunner().invoke(main, [str(word) for word in words])


LIMITED = "out of memory: ulimit -v allows"
LONG = pytest.mark.long


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("jaxnet check CONFIG >&-", "standard output is closed"),
        ("jaxnet check CONFIG > /dev/full", "cannot write standard output: No space left"),
        ("ulimit -v 400000; jaxnet check CONFIG", f"{LIMITED} 0.41 GB of addresses, 0.7 GB are"),
        pytest.param("ulimit -v 2000000; jaxnet run CONFIG", f"{LIMITED} 2 GB", marks=LONG),
        pytest.param("JAX_PLATFORMS=no jaxnet run CONFIG", "JAX: Unable to", marks=LONG),
    ],
)
def test_a_machine_that_cannot_is_told_in_a_line(config, tmp_path, command, says):
    """With status 2, and nothing else."""
    line = command.replace("jaxnet", f"{sys.executable} -m jaxnet").replace("CONFIG", str(config))
    ended = subprocess.run(
        ["sh", "-c", line], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert ended.returncode == 2, ended.stderr
    (told,) = ended.stderr.splitlines()
    assert told.startswith(says)


@pytest.mark.long
def test_a_terminal_without_our_characters_shows_others(config):
    """Such as latin-1, which has no ‖."""
    ended = subprocess.run(
        [sys.executable, "-m", "jaxnet", "check", config],
        capture_output=True,
        check=True,
        env=os.environ | {"PYTHONIOENCODING": "latin-1"},
    )
    assert "exp(-0.101 t) ?x(0)?" in ended.stdout.decode("latin-1")


def test_looking_and_checking_never_import_jax(config):
    """Nor numpy, for the commands' help."""
    heavy = "('jax', 'numpy', 'pydantic')"
    code = f"import sys, jaxnet.cli; print(any(name in sys.modules for name in {heavy}))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "False\n"
    code = (
        "import sys; from jaxnet.cli import main\n"
        f"main(['check', {str(config)!r}], standalone_mode=False); print('jax' in sys.modules)"
    )
    assert subprocess.check_output([sys.executable, "-c", code], text=True).endswith("False\n")


def test_run_prints_its_table_and_what_it_wrote(finished):
    """The table to stdout, the rest to stderr."""
    out, done = finished
    assert done.exit_code == 0, done.stderr
    assert "error, 95 %" in done.stdout
    assert f"2 of 2 lanes ok, 0 failed; wrote {out}: cells.csv, lanes/" in done.stderr
    assert done.stderr.splitlines()[-1] == f"next: jaxnet report {out}"
    shown = jaxnet_does("show", out)
    assert shown.stdout == done.stdout
    assert shown.stderr == f"next: jaxnet report {out}\n"


def test_check_names_the_run_of_what_it_checked(config):
    done = jaxnet_does("check", config, "gain=[1, 3, 3]")
    assert done.stderr == f"next: jaxnet run {config} 'gain=[1, 3, 3]'\n"


@pytest.mark.parametrize(
    ("command", "option"), [("sensitivity", "--samples=30"), ("rare", "--points=100")]
)
def test_an_analysis_names_the_report(config, tmp_path, command, option):
    keys = ["attack=bias", "recovery={tau: 0.2}", "gain=[{uniform: [1, 2]}, 3, 3]"]
    done = jaxnet_does(command, config, *keys, option, "--out", tmp_path)
    assert done.exit_code == 0, done.stderr
    assert done.stderr.splitlines()[-1] == f"next: jaxnet report {tmp_path}"


@pytest.fixture(scope="module")
def swept(config):
    """Results of four cells, two of them with a label that has braces."""
    out = config.parent / "swept"
    words = [
        "attack=bias",
        "sweep={topology: [star, cyclic], attack.magnitude: [0, {uniform: [1, 2]}]}",
    ]
    done = jaxnet_does("run", config, *words, "--out", out)
    assert done.exit_code == 0, done.stderr
    return out


def test_the_summary_is_shown_in_other_formats(swept):
    """CSV gives cells.csv's numbers back, Markdown and LaTeX three digits and safe labels."""
    cells = jaxnet.open(swept).cells
    table = pd.read_csv(io.StringIO(jaxnet_does("show", swept, "--format", "csv").stdout))
    assert table["tail_mean_mean"].tolist() == cells["tail_mean_mean"].tolist()
    assert table["attack.magnitude"].tolist() == cells["attack.magnitude"].tolist()
    given = f"{cells['tail_mean_median'][3]:.3g}"
    rows = jaxnet_does("show", swept, "--format", "markdown").stdout.splitlines()
    assert len({row.count("|") for row in rows}) == 1
    assert len(rows) == 2 + 4
    assert f"| {given} |" in rows[5]
    rows = jaxnet_does("show", swept, "--format", "latex").stdout.splitlines()
    assert len({row.count("&") for row in rows if row.endswith("\\\\")}) == 1
    assert f"& {given}" in rows[-3]
    assert any("uniform 1 to 2" in row for row in rows)
    assert any("fewer than 28 lanes" in row for row in rows)
    assert jaxnet_does("show", swept, "--format", "html").exit_code == 2


def test_a_figure_of_a_near_name_is_asked_for():
    told = jaxnet_does("figure", "anywhere", "curv").stderr
    assert told.rstrip().endswith("(did you mean 'curve'?)")
    assert "did you mean" not in jaxnet_does("figure", "anywhere", "xyzzy").stderr


def test_a_key_is_put_across(swept):
    """In every format; what is written elsewhere than to a terminal has all rows."""
    key = next(iter(jaxnet.open(swept).study.cells[0].labels))
    for form in ("text", "csv", "markdown", "latex"):
        done = jaxnet_does(
            "show", swept, "--pivot", key, "--columns", "tail_mean", "--format", form, "--all"
        )
        assert done.exit_code == 0, done.output
    assert "is not swept" in jaxnet_does("show", swept, "--pivot", "gain.0").output


@pytest.mark.long
def test_a_film_is_made_by_a_command(finished):
    lane = ["animate", finished[0], "--sample", 1, "--cell"]
    done = jaxnet_does(*lane, 0, "--out", finished[0] / "film.gif")
    assert done.exit_code == 0, done.stderr
    assert f"wrote {finished[0] / 'film.gif'}" in done.stderr
    for words in ([9], [0, "--out", "x.avi"]):
        assert jaxnet_does(*lane, *words).exit_code == 2


def test_a_second_run_of_the_same_study_has_nothing_to_do(finished, config):
    """Nothing is simulated, the same is printed."""
    out, done = finished
    stamps = [path.stat().st_mtime_ns for path in sorted((out / "lanes").iterdir())]
    again = jaxnet_does("run", config, "save={errors: true, trajectories: all}", "--out", out)
    assert again.stdout == done.stdout
    assert "nothing to do: all 2 lanes were there, 0 failed\n" in again.stderr
    assert "wrote" not in again.stderr
    assert again.stderr.splitlines()[-1] == f"next: jaxnet report {out}"
    assert [path.stat().st_mtime_ns for path in sorted((out / "lanes").iterdir())] == stamps


def test_results_are_listed_wherever_they_are_below(finished, config, tmp_path):
    """Finished ones, one that an interrupt left, parts alone."""
    here, part = tmp_path / "results", tmp_path / "results" / "more" / "part"
    shutil.copytree(finished[0], here / "small")
    shutil.copytree(finished[0], here / "more" / "cut")
    Folder(here / "more" / "cut").write_manifest(finished=False)
    assert jaxnet_does("run", config, "--out", part, "--shard", "0/1").exit_code == 0
    (here / "notes").mkdir()
    (here / "notes" / "manifest.json").write_text("{}")
    done = jaxnet_does("list", here)
    lines = [line.split() for line in done.stdout.splitlines()]
    assert lines[0] == ["cells", "lanes", "ok", "failed", "written", "results"]
    assert [[*line[:5], line[-1]] for line in lines[1:]] == [
        ["1", "2", "-", "-", "unfinished", str(here / "more" / "cut")],
        ["-", "-", "-", "-", "unfinished", str(part)],
        ["1", "2", "2", "0", "finished", str(here / "small")],
    ]
    assert jaxnet_does("list", tmp_path / "none").stderr == f"no results in {tmp_path / 'none'}\n"


def test_replay_gives_the_stored_row_again(finished):
    """To the last bit, with the trajectory in a store of its own."""
    out, _ = finished
    done = jaxnet_does("replay", out, "--cell", 0, "--sample", 1)
    assert done.exit_code == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "the same as the stored row"
    lane = xr.open_zarr(out / "replays" / "cell-0-sample-1.zarr")
    assert (lane["cell"].values.tolist(), lane["sample"].values.tolist()) == ([0], [1])
    assert "wrote" in done.stderr
    next_step = f"next: jaxnet animate {out} --cell 0 --sample 1"
    assert done.stderr.splitlines()[-1] == next_step
    beyond = jaxnet_does("replay", out, "--cell", 0, "--sample", 2)
    assert beyond.exit_code == 2
    assert "samples 0 to 1 (got cell 0, sample 2)" in beyond.stderr


def test_one_figure_is_drawn_by_name(finished, tmp_path):
    """As PNG and PDF; unknown names, and those without data in the folder, are user errors."""
    shutil.copytree(finished[0], tmp_path / "copy", ignore=shutil.ignore_patterns("figures"))
    done = jaxnet_does("figure", tmp_path / "copy", "bands")
    assert done.exit_code == 0, done.stderr
    written = sorted((tmp_path / "copy" / "figures").iterdir())
    assert [path.name for path in written] == ["bands.pdf", "bands.png"]
    assert written[0].read_bytes().startswith(b"%PDF")
    assert jaxnet_does("figure", tmp_path / "copy", "band").exit_code == 2
    assert "tails takes no x" in jaxnet_does("figure", finished[0], "tails", "--x", "k").stderr
    lacking = jaxnet_does("figure", tmp_path / "copy", "ultimate")
    assert lacking.exit_code == 2
    assert "No two cells differ in ā > 0 alone" in lacking.stderr
    assert "sweep.attack.magnitude={geomspace" in lacking.stderr


def test_report_draws_the_figures(finished, monkeypatch):
    """Each as PNG and PDF, and no stale ones; the page is opened if it is asked for."""
    out, _ = finished
    pages = []
    monkeypatch.setattr(webbrowser, "open", lambda page: pages.append(page) or True)
    monkeypatch.setattr(watched, "lanes_again", lambda results: 7)
    (out / "figures").mkdir(exist_ok=True)
    for stale in ("curve_median", "heat"):  # of an earlier version, and of data that are not there
        (out / "figures" / f"{stale}.png").touch()
    done = jaxnet_does("report", out, "--open")
    assert done.exit_code == 0, done.stderr
    assert pages == [(out / "report.html").as_uri()]
    assert "no browser" not in done.stderr
    again = "7 lanes are simulated again to show their motion; --no-replay leaves them out\n"
    assert done.stderr.startswith(again)
    assert f"wrote {out / 'figures' / 'tails.png'} and .pdf\n" in done.stderr
    again = jaxnet_does("report", out).stderr
    there = len([*(out / "replays").glob("*")])
    assert "replays/" not in again
    assert (f"replays: {there} were there already\n" in again) is (there > 0)
    written = sorted(path.name for path in (out / "figures").iterdir())
    names = ("bands", "panels", "tails", "topologies")  # of one cell no curve
    assert written == sorted(f"{name}.{kind}" for name in names for kind in ("png", "pdf"))


def test_failed_lanes_are_named_and_strict_says_so(config, tmp_path):
    """Status 0, or 3 if asked; the message has the command that replays the lane."""
    words = ("run", config, "engine={kind: nonlinear, max_steps: 1}", "--out", tmp_path / "out")
    done = jaxnet_does(*words)
    assert done.exit_code == 0
    assert "failed: 2 max_steps of 2 lanes in cell 0" in done.stderr
    again = f"next: jaxnet replay {tmp_path / 'out'} --cell 0 --sample 0"
    assert done.stderr.splitlines()[-1] == again
    assert done.stdout == ""  # no table of lanes that did not end
    curve = jaxnet_does("figure", tmp_path / "out", "curve", "--y", "tail_mean")
    assert "no lane of these cells came to its end" in curve.stderr
    assert jaxnet_does(*words, "--strict").exit_code == 3
    shown = jaxnet_does("show", tmp_path / "out").stdout
    assert "failed: 2 max_steps of 2 lanes in cell 0" in shown
    assert "max_steps: more steps than engine.max_steps allows" in shown


def test_mistakes_of_the_user_end_with_status_2(config, finished, tmp_path):
    """A folder that holds another study, or is none; an unknown option."""
    out, _ = finished
    other = jaxnet_does("run", config, "seed=1", "--out", out)
    assert other.exit_code == 2
    assert "seed is 0 there and 1 here" in other.stderr
    assert "--fresh" in other.stderr
    rare = jaxnet_does("rare", config, "seed=1", "recovery={tau: 0.2}", "--out", out).stderr
    assert "give another folder with --out" in rare
    assert "--fresh" not in rare  # no option of that command
    assert "Traceback" not in other.stderr
    assert jaxnet_does("show", tmp_path).exit_code == 2
    assert jaxnet_does("run", config, "--outt", "x").exit_code == 2


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_that_is_ignored_comes_again(monkeypatch, number, status):
    """As one is that falls into a callback of the garbage collector; the handlers are put back."""
    statuses, before = [], signal.getsignal(number)
    monkeypatch.setattr(os, "_exit", statuses.append)
    with errors.user_errors():
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(number)
        time.sleep(20 * errors.REPEAT_AFTER)
    assert statuses == [status]
    assert signal.getsignal(number) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_an_error_that_nobody_foresaw_ends_in_a_line(config, tmp_path, monkeypatch):
    """Status 70; the traceback is in a file, or printed where no file can be written."""

    def fail(*_):
        raise RuntimeError("odd\nand more")

    monkeypatch.setattr("jaxnet.view.text.check.check_text", fail)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    done = jaxnet_does("check", config)
    (written,) = tmp_path.glob("jaxnet-*.txt")
    said = f"jaxnet failed: {__file__}:{fail.__code__.co_firstlineno + 1}: RuntimeError: odd"
    assert (done.exit_code, done.stderr) == (70, f"{said}; its traceback is in {written}\n")
    assert "RuntimeError: odd\nand more" in written.read_text()


def test_init_writes_a_config_that_check_accepts(tmp_path, monkeypatch):
    """It says what the defaults are, with a horizon at which its defence is done."""
    monkeypatch.chdir(tmp_path)
    done = jaxnet_does("init", "mine.yaml")
    assert (done.exit_code, done.stderr) == (0, "wrote mine.yaml\nnext: jaxnet check mine.yaml\n")
    assert (tmp_path / "mine.yaml").read_text().startswith("# jaxnet run mine.yaml\n")
    assert jaxnet_does("check", "mine.yaml").stdout.startswith("mine: 3 cells × 100 samples")
    rest = {"samples": 100, "recovery": {}, "sweep": {"attack.magnitude": [0.1, 1, 10]}}
    rest["horizon"] = 90
    assert jaxnet.load("mine.yaml").config == jaxnet.load({"name": "mine", **rest}).config
    again = jaxnet_does("init", "mine.yaml")
    assert (again.exit_code, again.stderr) == (2, "mine.yaml is there already: give another FILE\n")
    wrong = jaxnet_does("init", "my study.yaml")
    assert wrong.exit_code == 2
    assert wrong.stderr.startswith("my study.yaml:3:1: name: must be a plain file name")
    assert not (tmp_path / "my study.yaml").exists()


def test_two_results_are_compared(swept, tmp_path):
    """The table in every format, the files beside B or where asked; what cannot be is status 2."""
    done = jaxnet_does("compare", swept, swept, "--format", "csv")
    assert done.exit_code == 0, done.stderr
    table = pd.read_csv(io.StringIO(done.stdout))
    assert table["mean [m]"].tolist() == [0] * 4
    names = {path.name for path in (swept.parent / "swept-swept").iterdir()}
    assert names >= {"compare.html", "differences.csv", "changed.csv", "failed.csv"}
    same = jaxnet_does("compare", swept, swept, "--out", tmp_path / "x")
    assert "they are the same study" in same.stdout
    assert (tmp_path / "x" / "compare.html").exists()
    assert jaxnet_does("compare", swept, tmp_path).exit_code == 2


def test_a_figure_of_some_cells_has_a_name_of_its_own(swept):
    """Beside the plain one."""
    done = jaxnet_does("figure", swept, "topologies", "--where", "topology=star", "--column", "one")
    assert done.exit_code == 0, done.stderr
    assert (swept / "figures" / "topologies-topology=star-one-column.pdf").exists()
    assert not (swept / "figures" / "topologies.pdf").exists()
    assert jaxnet_does("figure", swept, "topologies", "--where", "topology=path").exit_code == 2
    assert jaxnet_does("figure", swept, "topologies", "--where", "topology").exit_code == 2


def test_results_are_exported(swept):
    """With and without a file's name; without a program it is not known what to write."""
    assert f"wrote {swept / 'results.mat'}" in jaxnet_does("export", swept, "--mat").stderr
    assert jaxnet_does("export", swept, "--mat", swept / "other.mat").exit_code == 0
    assert (swept / "other.mat").exists()
    assert jaxnet_does("export", swept).exit_code == 2
