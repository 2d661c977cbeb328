"""Folders of `sensitivity` and `rare`, in which no run of the study is: shown, drawn."""

import re
import shutil

import pandas as pd
import pytest

import jaxnet
from jaxnet.store.folder import FolderError
from tests.test_looking import said

STUDY = {"name": "small", "vehicles": 3, "topology": "star", "engine": "exact", "defence": "none"}
STUDY |= {"horizon": 1.0, "tail": 0.5, "recovery": {"tau": 0.2}}
STUDY |= {"attack": {"kind": "rotating", "vehicles": [2], "frequency": {"uniform": [0.5, 2]}}}


@pytest.fixture(scope="module")
def shelf(tmp_path_factory):
    """A folder of each analysis, and one of a run with both."""
    home = tmp_path_factory.mktemp("analyses")
    jaxnet.sensitivity(STUDY, 30, home / "sens")
    jaxnet.rare(STUDY, 100, home / "rare")
    both = STUDY | {"samples": 4, "sweep": {"defence": ["none"]}}
    jaxnet.run(both, home / "both", progress=False)
    jaxnet.sensitivity(both, 30, home / "both")
    return home


def test_show_prints_the_tables_that_are_there(shelf):
    """The indices, the share of rare failures; beside a run, after its summary."""
    sens, rare, both = (said("show", shelf / name) for name in ("sens", "rare", "both"))
    assert re.search(r"^ +0 +initial.position +\d", sens, re.MULTILINE)
    assert "parts of the variance" in sens
    assert re.search(r"^cell +fails +at least +at most", rare, re.MULTILINE)
    assert both.index("unrecovered [%]") < both.index("initial.position")
    table = pd.read_csv(shelf / "rare" / "rare.csv")
    csv = said("show", shelf / "rare", "--format", "csv").splitlines()
    assert csv[0].split(",")[:4] == ["cell", "share", "low", "high"]
    assert float(csv[1].split(",")[1]) == table["share"][0]
    assert r"\toprule" in said("show", shelf / "sens", "--format", "latex")


def test_a_folder_is_listed_by_what_it_holds(shelf):
    """Not as an unfinished run."""
    lines = {line.split("/")[-1]: line for line in said("list", shelf).splitlines()}
    assert " sensitivity " in lines["sens"]
    assert " rare " in lines["rare"]
    assert " finished " in lines["both"]


def test_the_page_and_the_figure_need_no_run(shelf, undrawn, tmp_path):
    """The page begins with what was analysed, tells what was run, and has no section of lanes."""
    assert "sensitivity.png and .pdf" in said(
        "figure", shelf / "sens", "sensitivity", "--out", tmp_path
    )
    for name, there in (("sens", "<td>initial position</td>"), ("rare", "share that fails")):
        said("report", shelf / name, "--out", tmp_path / name)
        html = (tmp_path / name / "report.html").read_text()
        ids = re.findall(r'<section id="(.*?)"', html)
        assert ids[1:] == ["run"]
        assert ids[0] == {"sens": "sensitivity", "rare": "rare"}[name]
        assert there in html


def test_beside_a_run_both_are_told(shelf, tmp_path):
    """The report has the run's figures and sections too."""
    said("report", shelf / "both", "--no-replay", "--out", tmp_path)
    html = (tmp_path / "report.html").read_text()
    assert {"sensitivity", "run", "summary"} <= {*re.findall(r'<section id="(.*?)"', html)}
    table = html[html.index('<section id="sensitivity"') :]
    assert "<td>no\xa0defence</td><td>tail mean</td>" in table
    assert (tmp_path / "figures" / "tails.pdf").exists()


def test_python_opens_them(shelf):
    """With tables and a repr that say what is there."""
    sens, rare, both = (jaxnet.open(shelf / name) for name in ("sens", "rare", "both"))
    assert repr(sens) == f"Results({str(shelf / 'sens')!r}, sensitivity)"
    assert repr(both) == f"Results({str(shelf / 'both')!r})"
    pd.testing.assert_frame_equal(sens.sensitivity, pd.read_csv(shelf / "sens" / "sensitivity.csv"))
    pd.testing.assert_frame_equal(rare.rare, pd.read_csv(shelf / "rare" / "rare.csv"))
    assert len(both.sensitivity) == len(sens.sensitivity)
    with pytest.raises(FolderError, match=r"has no rare.csv: jaxnet rare CONFIG makes it"):
        _ = sens.rare
    with pytest.raises(FolderError, match="holds sensitivity and no run: jaxnet run CONFIG --out"):
        _ = sens.cells


@pytest.mark.parametrize(
    "words", [["fit"], ["replay", "--cell", "0", "--sample", "0"], ["export", "--mat"]]
)
def test_what_needs_lanes_says_so(shelf, words):
    """In one line, with the command that adds a run."""
    command, *rest = words
    assert "holds sensitivity and no run" in said(command, shelf / "sens", *rest, status=2)


def test_a_run_keeps_the_figures_of_an_analysis(shelf, tmp_path):
    """They are not made of its rows, as other figures are."""
    out = tmp_path / "sens"
    shutil.copytree(shelf / "sens", out)
    before = sorted((out / "figures").iterdir())
    (out / "figures" / "tails.png").write_bytes(b"")
    with pytest.warns(UserWarning, match="made of the rows before: figures "):
        jaxnet.run(STUDY | {"samples": 4}, out, progress=False)
    assert len(before) == 4
    assert sorted((out / "figures").iterdir()) == before


def test_a_rare_failure_may_come_of_noise(tmp_path):
    """Its numbers are no key of the config."""
    noisy = STUDY | {"channel": {"noise": {"position": 0.1}}}
    assert 0 <= jaxnet.rare(noisy, 100, tmp_path / "noisy")["share"][0] <= 1
