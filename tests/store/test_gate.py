"""A finished folder that lost something, or that a stranger made: told in a line."""

import json
import os
import shutil
import signal
import warnings
from pathlib import Path

import google_crc32c
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

import jaxnet
from jaxnet.cli import main
from jaxnet.store.folder import FolderError
from tests.store.conftest import STUDY as SMALL
from tests.test_looking import one_line as told

STUDY = SMALL | {
    "samples": 4,
    "vehicles": 3,
    "attack": {"kind": "rotating", "vehicles": [2]},
    "recovery": {"tau": 0.25},
    "save": {"errors": True, "vehicles": True},
}
ROWS, OTHER = "lanes/00000.parquet", "lanes/00001.parquet"
CHUNK = "errors.zarr/tracking/c/0/0/0"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The study's results."""
    place = tmp_path_factory.mktemp("made") / "small"
    jaxnet.run(STUDY, place, progress=False)
    return place


@pytest.fixture
def folder(made, tmp_path):
    """A copy of them, beside a folder of somebody else's; a reader that hangs is stopped."""
    shutil.copytree(made, tmp_path / "small")
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "mine").write_text("mine")
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.alarm(60)
    yield tmp_path / "small"
    signal.alarm(0)
    assert [each.name for each in (tmp_path / "outside").iterdir()] == ["mine"]
    assert (tmp_path / "outside" / "mine").read_text() == "mine"


LOST = {
    "is missing": None,
    "lost 1 of 4 rows": lambda rows, other: rows.slice(1),
    "lost samples, or has some twice": lambda rows, other: pa.concat_tables(
        [rows.slice(0, 3), rows.slice(0, 1)]
    ),
    "holds rows of another cell": lambda rows, other: other,
}


@pytest.mark.parametrize("words", LOST)
def test_a_finished_folder_that_lost_rows_says_which(words, made, folder):
    """Whoever opens it; a run simulates them again, to the last bit."""
    rows, change = pq.read_table(folder / ROWS), LOST[words]
    (folder / ROWS).unlink()
    if change is not None:
        pq.write_table(change(rows, pq.read_table(folder / OTHER)), folder / ROWS)
    line = f"{folder} lacks rows of its run: {ROWS} (cell 0, samples 0 to 3) {words}; jaxnet run"
    assert told("show", folder).startswith(line)
    assert told("compare", made, folder).startswith(line)
    with warnings.catch_warnings(action="ignore"):
        jaxnet.run(STUDY, folder, progress=False)
    assert jaxnet.open(folder).lanes.equals(jaxnet.open(made).lanes)


def test_an_unfinished_run_and_rows_of_a_part_open(made, folder):
    """Rows that no manifest promises are no fault, neither too few nor too many."""
    jaxnet.run_part(STUDY | {"samples": 6, "save": {}}, 0, 1, folder, progress=False)
    assert pq.read_table(folder / ROWS).num_rows == 6
    assert len(jaxnet.open(folder).lanes) == len(jaxnet.open(made).lanes)
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"finished": False}))
    (folder / OTHER).unlink()
    assert set(jaxnet.open(folder).lanes["cell"]) == {0}
    assert "holds an unfinished run" in told("show", folder)


@pytest.mark.parametrize(
    ("name", "what"),
    [
        (".lock", "link"),
        ("study.yaml", "pipe"),
        (ROWS, "pipe"),
        (CHUNK, "link to zeros"),
        ("figures", "link"),
        ("lanes", "link to zeros"),
        ("errors.zarr", "pipe"),
    ],
)
def test_only_files_and_folders_of_its_own_are_in_a_folder(name, what, folder, tmp_path):
    """Whatever else has one of our names is refused unopened, by readers and writers."""
    place, outside = folder / name, tmp_path / "outside"
    shutil.rmtree(place) if place.is_dir() else place.unlink(missing_ok=True)
    aim = outside / "mine" if place.suffix else outside
    if what == "pipe":
        os.mkfifo(place)
    else:
        place.symlink_to(aim if what == "link" else "/dev/zero")
    (tmp_path / "small.yaml").write_text(json.dumps(STUDY))
    line = f"{place} is a {what.split()[0]}, and only files and folders count here"
    assert told("show", folder) == line
    assert told("run", tmp_path / "small.yaml", "--out", folder, "--fresh") == line
    assert CliRunner().invoke(main, ["list", str(tmp_path)]).exit_code == 0


def test_a_link_to_the_folder_is_followed(folder, tmp_path):
    """To it, or above it: the user says where it is."""
    (tmp_path / "here").symlink_to(folder)
    (tmp_path / "up").symlink_to(tmp_path)
    for path in (tmp_path / "here", tmp_path / "up" / "here"):
        assert len(jaxnet.open(path).lanes) == 8
        assert jaxnet.open(path).errors["tracking"].shape == (2, 4, 11)
    assert jaxnet.open(folder).export(tmp_path / "here" / "mine.mat").exists()
    lines = CliRunner().invoke(main, ["list", str(tmp_path)]).output.splitlines()
    assert [Path(line.split()[-1]).name for line in lines[1:]] == ["here", "small"]


def chunk_of(content: bytes) -> bytes:
    """A chunk with this content and the checksum that is due."""
    packed = pa.compress(content, codec="zstd", asbytes=True)
    return packed + google_crc32c.value(packed).to_bytes(4, "little")


def changed(old: str, new: str):
    """Change a text once."""

    def change(file: Path) -> None:
        assert old in file.read_text()
        file.write_text(file.read_text().replace(old, new, 1))

    return change


def grown(file: Path) -> None:
    """A terabyte, which takes no room on the disk."""
    os.truncate(file, 2**40)


MANIFEST, TABLE = "manifest.json", "cells.csv is not a table of ours"
HARMS = [
    (MANIFEST, grown, "manifest.json has 1,099,511,627,776 bytes, and 268,435,456 at most are due"),
    ("cells.csv", grown, "cells.csv has 1,099,511,627,776 bytes"),
    ("study.yaml", grown, "study.yaml"),
    (ROWS, grown, "00000.parquet has 1,099,511,627,776 bytes"),
    ("errors.zarr/zarr.json", grown, "errors.zarr/zarr.json has over 16,777,216 bytes"),
    (CHUNK, grown, f"{CHUNK} is corrupt"),
    ("errors.zarr/time/c/0", grown, "time/c/0 is corrupt (it has more than 1,112 bytes)"),
    (CHUNK, lambda file: file.write_bytes(chunk_of(bytes(2**24))), f"{CHUNK} is corrupt"),
    (CHUNK, lambda file: file.write_bytes(chunk_of(bytes(8))), f"{CHUNK} is corrupt"),
    (CHUNK, lambda file: file.write_bytes(b"x" * 40), f"{CHUNK} is corrupt"),
    (CHUNK, Path.unlink, f"{CHUNK} is missing"),
    ("cells.csv", changed("tail_mean_low", "law"), f"{TABLE} (no column tail_mean_low)"),
    ("cells.csv", changed(",4,4,0,", ",4,four,0,"), f"{TABLE} (ok holds text)"),
    ("cells.csv", changed("\n1.0,", "\n1.0,4\n1.0,"), "cells.csv is not a table of ours"),
    ("study.yaml", changed("tau: 0.25", "tau: 0.5"), "has another recovery than the tables"),
    (MANIFEST, changed('"jaxnet": "', '"jaxnot": "'), "not a manifest of ours: versions is"),
    (MANIFEST, changed('"wall_seconds"', '"wall"'), "of ours: it has no wall_seconds"),
    (MANIFEST, changed('"samples": 4', '"samples": 2147483648'), "00002.parquet (cell 0, samples"),
    (MANIFEST, changed('"cells": 2', '"cells": 1'), "tells of 1 cells, and its study has 2"),
    (MANIFEST, changed("{", "\x00{"), "manifest.json is not a manifest ("),
]


@pytest.mark.parametrize(("name", "harm", "words"), HARMS)
def test_what_was_harmed_is_told_in_one_line_that_names_the_file(name, harm, words, folder):
    """Nothing is read beyond what is due, packed or unpacked."""
    harm(folder / name)
    assert words in told("export", folder, "--mat")


def test_what_was_made_with_other_settings_goes(folder, tmp_path):
    """Another τ removes figures, page and fits, and says so."""
    for words in (["fit", folder], ["figure", folder, "tails", "--out", tmp_path / "made"]):
        CliRunner().invoke(main, list(map(str, words)))
    (folder / "report.html").write_text("τ was 0.25")
    other = STUDY | {"recovery": {"tau": 0.5}}
    line = (
        r"made with another recovery: fit\.csv, bounds\.csv, violations\.csv, figures, report\.html"
    )
    with pytest.warns(UserWarning, match=line):
        found = jaxnet.run(other, folder, progress=False)
    assert not [name for name in ("fit.csv", "figures", "report.html") if (folder / name).exists()]
    assert jaxnet.open(folder).cells.equals(found.cells)
    assert "made of other settings" in told("fit", folder, "--out", tmp_path / "made")
    with warnings.catch_warnings(action="error"):
        jaxnet.run(other, folder, progress=False)
    apart = r"holds another study: sweep\.attack\.magnitude\.1 is 5\.5 there and 6 here; give"
    with pytest.raises(FolderError, match=apart):
        jaxnet.run(STUDY | {"sweep": {"attack.magnitude": [1, 6, 7]}}, folder, progress=False)
