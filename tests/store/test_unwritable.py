"""A results folder that cannot be written to: commands read it, and write elsewhere when asked."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import jaxnet
from jaxnet.api.writing import write_figure
from jaxnet.store.folder import FolderError
from tests.store.conftest import STUDY

COMMANDS = """
import json, sys
from click.testing import CliRunner
from jaxnet.cli import main
from jaxnet.statistics import fits
from jaxnet.view.figures import every
fits.RESAMPLES, drawn = 2, every.draw_figures
# the other figures are alike
every.draw_figures = lambda results, names=("tails",), told=None: drawn(results, names[:1])
for words in json.loads(sys.argv[1]):
    ended = CliRunner().invoke(main, words)
    print(json.dumps([ended.exit_code, ended.stdout, ended.stderr]), flush=True)
"""
BOUND = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"]  # root whom permissions bind


def bound() -> list[str]:
    """How to start a process whom permissions bind; skips the test where there is no way."""
    if os.geteuid():
        return []
    if (
        shutil.which("setpriv") is None
        or subprocess.run([*BOUND, "true"], capture_output=True).returncode
    ):
        pytest.skip("this is root, whom no permission binds, and setpriv cannot change that here")
    return BOUND


@pytest.fixture(scope="module")
def shelf(tmp_path_factory):
    """A folder with a config and the study's results, none of which can be written to."""
    shelf = tmp_path_factory.mktemp("shelf") / "shelf"
    jaxnet.run(jaxnet.load(STUDY), shelf / "small")
    (shelf / "small.yaml").write_text(json.dumps(STUDY))
    every = [shelf, *shelf.rglob("*")]
    for path in every:
        path.chmod(0o555 if path.is_dir() else 0o444)
    yield shelf
    for path in every:
        path.chmod(0o755)


def given(commands: list[list[str]], place: Path) -> list[tuple[int, str, str]]:
    """Status, stdout and stderr of commands that are given one after the other."""
    words = [*bound(), sys.executable, "-c", COMMANDS, json.dumps(commands)]
    said = subprocess.run(words, capture_output=True, text=True, cwd=place)
    assert said.returncode == 0, said.stderr
    return [tuple(json.loads(line)) for line in said.stdout.splitlines()]


def contents(folder: Path) -> dict[str, bytes]:
    """All files in a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.long
def test_a_folder_that_cannot_be_written_to(shelf, tmp_path):
    """Reading works; what writes ends with status 2 and a line, or writes elsewhere."""
    small, lane, before = str(shelf / "small"), ["--cell", "1", "--sample", "1"], contents(shelf)
    locked = f"{small} cannot be written to: Permission denied; give another folder with --out\n"

    def refused(file: str, option: str = "--out", reason: str = "Permission denied") -> str:
        return f"cannot write {file}: {reason}; give another place with {option}\n"

    ends = {  # of a command: what it says where it is refused, else nothing
        ("show", small): "",
        ("list", str(shelf)): "",
        ("run", str(shelf / "small.yaml"), "--out", small): locked,
        ("fit", small): locked,
        ("replay", small, *lane): refused(rf"{small}/replays/cell-1-sample-1.zarr/\S+"),
        ("export", small, "--mat"): refused(f"{small}/results.mat", "--mat"),
        ("figure", small, "tails", "--out", f"{small}/cells.csv"): locked.replace(
            " cannot be written to: Permission denied",
            "/cells.csv cannot be written to: File exists",
        ),
        ("init", f"{shelf}/mine.yaml"): rf"\[Errno 13\] Permission denied: '{shelf}/mine.yaml'\n",
        ("compare", small, small): refused(f"{shelf}/small-small/differences.csv"),
        ("fit", small, "--out", "made"): "",
        ("replay", small, *lane, "--out", "made"): "",
        ("export", small, "--mat", "mine.mat"): "",
    }
    answers = given([*map(list, ends)], tmp_path)
    for (words, line), (status, _, said) in zip(ends.items(), answers, strict=True):
        assert status == (2 if line else 0), (words, said)
        said = re.sub("next: .*\n", "", said)
        assert re.fullmatch(line, said) if line else small not in said, (words, said)
    assert contents(shelf) == before
    made = {path.split("/")[0] for path in contents(tmp_path / "made")}
    tables = {"fit.csv", "bounds.csv", "violations.csv"}
    assert made == {".lock", "made-of.json", "figures", "replays", *tables}
    assert {path.name for path in tmp_path.iterdir()} == {"made", "mine.mat"}
    assert len(jaxnet.open(small, tmp_path / "made").fits) > 0


def test_what_is_made_of_some_rows_is_not_taken_for_that_of_others(tmp_path):
    """Another study, or more samples of the same. What is refused leaves no folder."""
    first = jaxnet.run(jaxnet.load(STUDY), tmp_path / "first")
    other = jaxnet.run(jaxnet.load(STUDY, {"seed": 1}), tmp_path / "other")
    for _ in range(2):
        assert jaxnet.open(first.path, tmp_path / "made").out.path == tmp_path / "made"
    with pytest.raises(FolderError, match="x: bogus is not swept"):
        list(
            write_figure(jaxnet.open(first.path, tmp_path / "made"), "curve", chosen={"x": "bogus"})
        )
    assert not (tmp_path / "made").exists()
    jaxnet.open(first.path, tmp_path / "made").replay(0, 0)
    with pytest.raises(
        FolderError, match="made holds what was made of other rows: give another folder"
    ):
        jaxnet.open(other.path, tmp_path / "made")
    jaxnet.run(jaxnet.load(STUDY, {"samples": 3}), first.path)
    with pytest.raises(FolderError, match="made holds what was made of other rows"):
        jaxnet.open(first.path, tmp_path / "made")
    with pytest.raises(FolderError, match=r"other holds study\.yaml of something else"):
        jaxnet.open(first.path, other.path)
