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

STUDY = {
    "name": "small",
    "samples": 4,
    "horizon": 1.0,
    "tail": 0.5,
    "vehicles": 3,
    "engine": "exact",
    "defence": "none",
    "attack": {"kind": "rotating", "vehicles": [2]},
    "recovery": {"tau": 0.25},
    "sweep": {"attack.magnitude": [1, 5.5]},
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


def told(*words) -> str:
    """The one line by which a command refuses."""
    ended = CliRunner().invoke(main, list(map(str, words)))
    assert ended.exit_code == 2, (ended.output, ended.exception)
    (line,) = ended.output.splitlines()
    return line


def lost(folder: Path, how: str) -> None:
    """Have the rows of the first cell lost."""
    table = pq.read_table(folder / ROWS)
    changed = {
        "short": lambda: table.slice(1),
        "doubled": lambda: pa.concat_tables([table, table]),
        "one twice": lambda: pa.concat_tables([table.slice(0, 3), table.slice(0, 1)]),
        "of another cell": lambda: pq.read_table(folder / OTHER),
    }
    if how == "deleted":
        (folder / ROWS).unlink()
    else:
        pq.write_table(changed[how](), folder / ROWS)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("deleted", "is missing"),
        ("short", "lost 1 of 4 rows"),
        ("doubled", "lost samples, or has some twice"),
        ("one twice", "lost samples, or has some twice"),
        ("of another cell", "holds rows of another cell"),
    ],
)
def test_a_finished_folder_that_lost_rows_says_which(how, words, made, folder):
    """Whoever opens it; a run simulates them again, to the last bit."""
    whole = jaxnet.open(made).lanes
    lost(folder, how)
    place = f"{ROWS} (cell 0, samples 0 to 3) {words}"
    line = f"{folder} lacks rows of its run: {place}; jaxnet run simulates them"
    for command in (["show", folder], ["export", folder, "--csv"], ["compare", made, folder]):
        assert told(*command).startswith(line), command
    with pytest.raises(FolderError, match="lacks rows of its run"):
        jaxnet.open(folder)
    with warnings.catch_warnings(action="ignore"):
        jaxnet.run(STUDY, folder, progress=False)
    assert jaxnet.open(folder).lanes.equals(whole)


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


PLACES = (".lock", "study.yaml", ROWS, CHUNK, "figures", "lanes", "errors.zarr")


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("what", ["link", "pipe", "link to zeros"])
def test_only_files_and_folders_of_its_own_are_in_a_folder(what, name, folder, tmp_path):
    """Whatever else has one of our names is refused unopened, by readers and writers."""
    place = folder / name
    shutil.rmtree(place) if place.is_dir() else place.unlink(missing_ok=True)
    outside = tmp_path / "outside"
    aims = {
        "link": outside / "mine" if place.suffix else outside,
        "link to zeros": Path("/dev/zero"),
    }
    os.mkfifo(place) if what == "pipe" else place.symlink_to(aims[what])
    line = f"{place} is a {what.split()[0]}, and only files and folders count here"
    for command in (["show", folder], ["run", tmp_path / "small.yaml", "--out", folder, "--fresh"]):
        (tmp_path / "small.yaml").write_text(json.dumps(STUDY))
        assert told(*command) == line
    assert CliRunner().invoke(main, ["list", str(tmp_path)]).exit_code == 0


def test_a_link_to_the_folder_is_followed(folder, tmp_path):
    """To it, or above it: the user says where it is."""
    (tmp_path / "here").symlink_to(folder)
    (tmp_path / "up").symlink_to(tmp_path)
    for path in (tmp_path / "here", tmp_path / "up" / "small", tmp_path / "up" / "here"):
        assert len(jaxnet.open(path).lanes) == 8
        assert jaxnet.open(path).errors["tracking"].shape == (2, 4, 11)
    assert jaxnet.open(folder).export(tmp_path / "here" / "mine.mat").exists()
    lines = CliRunner().invoke(main, ["list", str(tmp_path)]).output.splitlines()
    assert [Path(line.split()[-1]).name for line in lines[1:]] == ["here", "small"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "manifest.json",
            "manifest.json has 1,099,511,627,776 bytes, and 268,435,456 at most are due",
        ),
        ("cells.csv", "cells.csv has 1,099,511,627,776 bytes"),
        ("study.yaml", "study.yaml"),
        (ROWS, "00000.parquet has 1,099,511,627,776 bytes"),
        ("errors.zarr/zarr.json", "errors.zarr/zarr.json has over 16,777,216 bytes"),
        (CHUNK, f"{CHUNK} is corrupt"),
        ("errors.zarr/time/c/0", "errors.zarr/time/c/0 is corrupt (it has more than 1,112 bytes)"),
    ],
)
def test_no_file_is_read_beyond_what_is_due(name, words, folder):
    """One of a terabyte, which takes no room on the disk, is told at once."""
    os.truncate(folder / name, 2**40)
    assert words in told("export", folder, "--mat")


def chunk_of(content: bytes) -> bytes:
    """A chunk with this content and the checksum that is due."""
    packed = pa.compress(content, codec="zstd", asbytes=True)
    return packed + google_crc32c.value(packed).to_bytes(4, "little")


@pytest.mark.parametrize(
    "content",
    [
        chunk_of(bytes(2**24)),
        chunk_of(bytes(8)),
        b"",
        b"x" * 40,
        b"(\xb5/\xfd"
        + bytes(30)
        + google_crc32c.value(b"(\xb5/\xfd" + bytes(30)).to_bytes(4, "little"),
        None,
    ],
    ids=["a bomb", "short", "empty", "rotten", "rotten with its checksum", "gone"],
)
def test_a_chunk_is_what_its_store_promises(content, folder):
    """Told with its name where it is larger, shorter, rotten or gone."""
    if content is None:
        (folder / CHUNK).unlink()
    else:
        (folder / CHUNK).write_bytes(content)
    line = told("figure", folder, "bands")
    assert line.startswith(f"{folder / CHUNK} is {'missing' if content is None else 'corrupt'}")


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        (
            "cells.csv",
            "tail_mean_low",
            "tail_mean_law",
            "cells.csv is not a table of ours (no column tail_mean_low)",
        ),
        ("cells.csv", ",4,4,0,", ",4,four,0,", "cells.csv is not a table of ours (ok holds text)"),
        (
            "study.yaml",
            "tau: 0.25",
            "tau: 0.5",
            "study.yaml has another recovery than the tables beside it",
        ),
        ("manifest.json", '"jaxnet": "', '"jaxnot": "', "not a manifest of ours: versions is"),
        (
            "manifest.json",
            '"wall_seconds"',
            '"wall"',
            "not a manifest of ours: it has no wall_seconds",
        ),
        (
            "manifest.json",
            '"samples": 4',
            '"samples": 2147483648',
            "lanes/00002.parquet (cell 0, samples 4096 to",
        ),
        (
            "manifest.json",
            '"cells": 2',
            '"cells": 1',
            "its manifest tells of 1 cells, and its study has 2",
        ),
        ("manifest.json", "{", "\x00{", "manifest.json is not a manifest ("),
    ],
)
def test_what_was_tampered_with_is_told(name, old, new, words, folder):
    """In one line that names the file."""
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new, 1))
    assert words in told("show", folder)


def test_what_was_made_with_other_settings_goes(folder, tmp_path):
    """Another τ removes figures, page and fits, and says so."""
    for command in (
        ["figure", folder, "vehicles"],
        ["fit", folder],
        ["figure", folder, "heat", "--out", tmp_path / "made"],
    ):
        CliRunner().invoke(main, list(map(str, command)))
    (folder / "report.html").write_text("τ was 0.25")
    assert {each.name for each in (folder / "figures").iterdir()} >= {"vehicles.png"}
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
    for draw in (found.plot.vehicles, found.plot.curve):
        assert "0.5\N{NO-BREAK SPACE}ā" in draw().get_suptitle().replace("\n", " ")
