"""Shards by one process or by parts: the same rows to the last bit, whatever is torn on the way."""

import re

import numpy as np
import pytest
from upath import UPath

import jaxnet
from jaxnet.runs import shards
from jaxnet.store import arrays, layout
from jaxnet.store.folder import FolderError
from tests.runs.conftest import SHARDS, STUDY, done

pytestmark = pytest.mark.usefixtures("many_side_by_side")

LANES = STUDY["samples"]


def told_by(study, out):
    """What a run says of its progress: lanes done, all, failed."""
    told = []
    jaxnet.run(study, out, progress=lambda *now: told.append(now))
    return told


def swap(one, other):
    content = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(content)


def flip(path, place):
    """Change one bit of a file."""
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)


def test_three_parts_in_any_order(parted, assert_same, tmp_path):
    """They write `lanes/` alone; a run makes the rest, and simulates what a part has left out."""
    out = tmp_path / "out"
    for part in (2, 0):
        assert jaxnet.run_part(parted, part, 3, out) == (out, 4, 4, 0)
    assert {path.name for path in out.iterdir()} == {"lanes", ".lock"}
    assert [int(path.stem) % 3 for path in done(out)] == [0, 2] * 4
    there = done(out)
    assert jaxnet.run_part(parted, 2, 3, out).simulated == 0
    assert done(out) == there
    with pytest.raises(FolderError, match="another study"):
        jaxnet.run_part(jaxnet.load(parted, {"seed": 1}), 1, 3, out)
    (out / "lanes" / "00002.npz").write_bytes(b"PK")
    swap(*(out / "lanes" / f"{shard}.npz" for shard in ("00005", "00008")))
    with pytest.warns(UserWarning, match="the arrays beside it are torn .* again") as said:
        told = told_by(parted, out)
    numbers = sorted(re.search(r"\d{5}", str(each.message))[0] for each in said)
    assert numbers == ["00002", "00005", "00008"]
    assert told[0] == (5 * LANES, SHARDS * LANES, 0)  # all of two parts, but for these
    assert_same(jaxnet.open(out))
    assert not list(out.glob("lanes/*.npz"))


def test_what_was_torn_is_told_and_done_again(parted, assert_same, tmp_path):
    """Row files cut short, changed, of another study; chunks changed, gone, empty, swapped."""
    out, arrays_at = tmp_path / "out", tmp_path / "out" / "errors.zarr"
    jaxnet.run(parted, out)
    other = jaxnet.run(jaxnet.load(parted, {"seed": 1}), tmp_path / "other")
    kept, _, cut, changed, foreign, gone, *_ = done(out)
    written = kept.stat().st_mtime_ns
    cut.write_bytes(cut.read_bytes()[:-100])
    for place in range(300, 400):  # headers of pages have no checksum
        flip(changed, place)
    foreign.write_bytes((other.path / "lanes" / foreign.name).read_bytes())
    gone.rename(gone.with_name(f".{gone.name}.4711"))  # as a killed writer leaves it
    flip(arrays_at / "tracking/c/6/0/0", 500)
    (arrays_at / "disagreement/c/8/0/0").unlink()
    (arrays_at / "disagreement/c/9/0/0").write_bytes(b"")
    swap(arrays_at / "tracking/c/10/0/0", arrays_at / "tracking/c/11/0/0")
    with pytest.warns(UserWarning, match="simulated again") as said:
        told = told_by(parted, out)
    assert told[0][0] == (SHARDS - 9) * LANES
    assert_same(jaxnet.open(out))
    assert kept.stat().st_mtime_ns == written
    words = {re.search(r"\d{5}", str(each.message))[0]: str(each.message) for each in said}
    assert "torn" in words["00002"]
    assert "torn" in words["00003"]
    assert "another study" in words["00004"]
    for cell in (6, 8, 9, 10, 11):
        told = f"errors.zarr is corrupt at cell {cell}, samples 0 to {LANES - 1}"
        assert told in words[f"{cell:05d}"]


def test_a_store_that_cannot_be_read_is_made_anew(parted, assert_same, tmp_path):
    """Its lanes are simulated again."""
    jaxnet.run(parted, tmp_path / "out")
    (tmp_path / "out" / "errors.zarr" / "tracking" / "zarr.json").write_bytes(b"")
    assert told_by(parted, tmp_path / "out")[0][0] == 0
    assert_same(jaxnet.open(tmp_path / "out"))


def test_lanes_that_failed_at_once_are_stored_like_others(parted, tmp_path):
    """A chunk of nothing but not-a-number is there, and is not taken for one that is gone."""
    place, cells = UPath(tmp_path / "errors.zarr"), jaxnet.load(parted).cells
    arrays.prepare(place, layout.ERRORS, cells, samples=4, chunk=2)
    store = arrays.open_for_writing(place)
    blank = np.full((2, 51), np.nan)
    arrays.write_chunks(store, (3, slice(2, 4)), dict.fromkeys(layout.ERRORS, blank))
    written = arrays.read_checksums(place, layout.ERRORS, (3, 1))
    assert arrays.is_intact(place, layout.ERRORS, (3, 1), written)
    assert not arrays.is_intact(place, layout.ERRORS, (3, 0), written)


def test_lanes_are_drawn_again_where_no_room_is_left_to_keep_them(
    parted, assert_same, tmp_path, monkeypatch
):
    monkeypatch.setattr(shards, "MOST_HELD", 0)
    assert_same(jaxnet.run(parted, tmp_path / "out"))


def test_parts_of_a_longer_study(parted, assert_same, tmp_path):
    """A shorter run takes its own; the longer one has all arrays; what was derived goes."""
    out, longer = tmp_path / "out", jaxnet.load(parted, {"samples": LANES + 9})
    for part in (0, 1):
        jaxnet.run_part(longer, part, 2, out)
    assert_same(jaxnet.run(parted, out))
    (out / "fit.csv").touch()
    for part in (0, 1):
        jaxnet.run_part(longer, part, 2, out)
    assert len(jaxnet.open(out).lanes) == SHARDS * LANES
    with pytest.warns(UserWarning, match=r"removing what was made of the rows before: fit\.csv \("):
        results = jaxnet.run(longer, out)
    assert len(results.lanes) == SHARDS * (LANES + 9)
    assert not results.errors["tracking"].isnull().any()
    assert not (out / "fit.csv").exists()
    assert results.row(0, LANES + 9) is None
    assert results.row(3, LANES)["sample"] == LANES
