"""A results folder at a URL: the same files, the same last bits."""

import json
import logging
import os
import shutil
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from typing import Any

import boto3
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner
from moto.server import ThreadedMotoServer
from s3fs import S3FileSystem
from upath import UPath

import jaxnet
from jaxnet.cli import main
from jaxnet.config.study import Study
from jaxnet.runs import shards
from jaxnet.runs.cluster import ClusterError
from jaxnet.statistics import summary
from jaxnet.store import folder as folders
from jaxnet.store import lock
from jaxnet.store.admission import admit
from jaxnet.store.arrays import store_at
from jaxnet.store.folder import Folder, FolderError, TakenError, place
from jaxnet.store.results import Results
from tests.store.conftest import STUDY as SMALL

STUDY = SMALL | {"save": {"errors": True, "trajectories": "all"}}
OTHER = b'{"owner": "process 1 on Mars", "since": "2026-01-02 03:04:05 UTC"}'  # what a lock holds


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    """A bucket of an S3-compatible server that the environment leads to."""
    logging.getLogger("werkzeug").setLevel(logging.ERROR)  # it tells of every request
    server = ThreadedMotoServer("127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        environment.setenv("AWS_DEFAULT_REGION", "us-east-1")
        for key in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            environment.setenv(key, "test")
        boto3.client("s3").create_bucket(Bucket="bucket")
        yield "s3://bucket"
    server.stop()


@pytest.fixture(params=[pytest.param("s3", marks=pytest.mark.long), "memory"])
def url(request) -> str:
    """A URL where there are objects, with none at it."""
    root = request.getfixturevalue("bucket") if request.param == "s3" else "memory://there"
    return f"{root}/{uuid.uuid4().hex}/study"


@pytest.fixture(scope="module")
def study() -> Study:
    """Two cells."""
    return jaxnet.load(STUDY)


@pytest.fixture(scope="module")
def local(study, tmp_path_factory) -> Results:
    """The study's results on the local disk."""
    return jaxnet.run(study, tmp_path_factory.mktemp("results") / "small")


def assert_equal(got: Results, wanted: Results, samples: int = 2) -> None:
    """The first samples' rows and arrays are equal to the last bit, as far as they are saved."""
    rows = got.lanes[got.lanes["sample"] < samples].reset_index(drop=True)
    pd.testing.assert_frame_equal(rows, wanted.lanes, check_exact=True)
    stores = ["errors", *["trajectories"] * (got.study.config.save.trajectories != "none")]
    for mine, theirs in ((getattr(got, name), getattr(wanted, name)) for name in stores):
        assert mine.isel(sample=slice(samples)).drop_attrs().identical(theirs.drop_attrs())


def files(path: str | UPath) -> dict[str, bytes]:
    """Every file there, as another client sees it."""
    seen = UPath(path, skip_instance_cache=True) if "://" in str(path) else UPath(path)
    found = seen.fs.find(seen.path)
    return {
        name.removeprefix(seen.fs._strip_protocol(seen.path)): seen.fs.cat_file(name)
        for name in found
    }


def progress(study: Study, out: str, **options: Any) -> tuple[int, int]:
    """Run; how many lanes were there at first and at last."""
    told = []
    jaxnet.run(study, out, progress=lambda done, *_: told.append(done), **options)
    return told[0], told[-1]


def test_results_at_a_url_are_those_on_the_disk(url, local):
    """A second run does nothing; what is torn or swapped is done again."""
    study = jaxnet.load(STUDY, {"save.trajectories": "none"})  # tests of parts save them
    assert progress(study, url) == (0, 4)
    assert_equal(jaxnet.open(url), local)
    here = {name for name in files(local.path) if "trajectories" not in name}
    assert {*files(url)} | {"/.lock"} == here
    rows = place(url) / "lanes/00000.parquet"
    chunks = [place(url) / f"errors.zarr/tracking/c/{cell}/0/0" for cell in (0, 1)]
    whole = {path: path.read_bytes() for path in (rows, *chunks)}
    assert progress(study, url) == (4, 4)
    rows.write_bytes(whole[rows][:-9])
    for chunk, other in (chunks, reversed(chunks)):
        chunk.write_bytes(whole[other])
    with pytest.warns(UserWarning, match="simulated again") as told:
        assert progress(study, url) == (0, 4)
    other, torn = sorted(str(each.message) for each in told)
    assert other.startswith(f"{rows}: torn")
    assert "00001.parquet: errors.zarr is corrupt at cell 1, samples 0 to 1; its lanes" in torn
    assert whole == {path: path.read_bytes() for path in whole}
    assert progress(jaxnet.load(study, {"samples": 3}), url) == (4, 6)
    assert_equal(jaxnet.open(url), local)


@pytest.mark.long
def test_parts_make_the_same_in_a_bucket(bucket, study, local):
    """A part writes rows and arrays of a shard, a run takes them in."""
    url = f"{bucket}/shared"
    assert jaxnet.run_part(study, 0, 2, url)[1:] == (1, 1, 0)
    assert {*files(url)} == {"/lanes/00000.parquet", "/lanes/00000.npz"}
    jaxnet.run(study, url)
    assert_equal(jaxnet.open(url), local)
    assert {*files(url)} | {"/.lock"} == {*files(local.path)}
    for words in (["show", url], ["replay", url, "--cell", "1", "--sample", "1"]):
        assert (again := CliRunner().invoke(main, words)).exit_code == 0, again.output
    replayed = xr.open_zarr(store_at(place(url) / "replays/cell-1-sample-1.zarr"))
    np.testing.assert_array_equal(replayed["states"][0], local.trajectories["states"][1, 1])


def test_what_is_not_ours_is_left_alone(url, study):
    """A folder of something else is refused; of results, `fresh` removes what a run has made."""
    thesis, ours = Folder(f"{url}/thesis"), Folder(f"{url}/ours")
    thesis.put("chapter1.tex", b"mine")
    for fresh in (False, True):
        with pytest.raises(FolderError, match=r"chapter1\.tex"):
            jaxnet.run(study, thesis.path, fresh=fresh)
    with pytest.raises(FolderError, match="not a results folder"):
        jaxnet.open(f"{url}/thesis")
    for name in ("lanes/00000.parquet", "errors.zarr/tracking/c/0/0/0", "cells.csv", "notes/mine"):
        ours.put(name, b"something")
    entries = {"hash": "another", "save": {}, "samples": 1, "finished": False}
    ours.write_manifest(versions={"jaxnet": "0"}, **entries)
    with pytest.raises(FolderError, match=r"written by jaxnet 0"):
        admit(ours, study.config)
    admit(ours, study.config, fresh=True)
    assert {*files(url)} - {"/thesis/.lock"} == {"/thesis/chapter1.tex", "/ours/notes/mine"}


@pytest.mark.long
def test_what_another_has_just_written_is_seen(bucket):
    """Also by a path that was listed before, and by one that came with a cache of its own."""
    there = [place(f"{bucket}/seen"), place(UPath(f"{bucket}/seen"))]
    for number in range(3):
        found = [f"{each}.parquet" for each in range(number)]
        for path in there:
            assert [each.name for each in path.glob("lanes/*.parquet")] == found
        key = f"seen/lanes/{number}.parquet"
        boto3.client("s3").put_object(Bucket="bucket", Key=key, Body=b"")


def refused(folder: Folder, alone: bool = True) -> None:
    """Somebody who wants the folder as well is told who has it."""
    owner = rf"written by (parts of a run, the last that began by )?process {os.getpid()} on"
    with pytest.raises(FolderError, match=owner), folder.writing(alone):
        pass


def test_one_who_lives_is_not_disturbed(url, monkeypatch):
    """Not by one alone nor by others, also where the store would let them overwrite it."""
    monkeypatch.setattr(lock, "BEAT", 0.05)
    folder = Folder(url)
    pipe = folder.path.fs.pipe_file
    waiting = pytest.warns(UserWarning, match="waiting 20 s for a sign of life")
    with folder.writing(), waiting:
        refused(folder)
        refused(folder, alone=False)
        monkeypatch.setattr(
            folder.path.fs, "pipe_file", lambda path, value, mode=None: pipe(path, value)
        )
        refused(folder)
    assert files(url) == {}
    with folder.writing(alone=False), folder.writing():
        pass


def test_the_place_of_one_who_died_is_taken(url, monkeypatch):
    """By the next, after a while without a sign of life."""
    monkeypatch.setattr(lock, "SILENCE", 0.3)
    for alone in (True, False):
        folder = Folder(url)
        folder.put(".lock", OTHER)
        with (
            pytest.warns(UserWarning, match="held by process 1 on Mars: waiting"),
            folder.writing(alone),
        ):
            assert b"Mars" not in lock.read_lock(folder.path / ".lock")
        assert files(url) == {}


def test_one_who_was_taken_for_dead_stops(url, monkeypatch):
    """It writes and removes nothing any more, in a folder inside either, and says why."""
    monkeypatch.setattr(lock, "BEAT", 0.05)
    folder = Folder(url)
    with folder.writing():
        inside = Folder(folder.path / "worst/0", folder.holds)
        with inside.writing():
            inside.put("one", b"mine")
            for _ in range(5):  # a beat that is under way may overwrite one
                place(f"{url}/.lock").write_bytes(OTHER)
                time.sleep(0.1)
            words = "was taken over by process 1 on Mars at 2026-01-02 03:04:05 UTC: this process"
            late = lambda: folder.put("one", b"late"), lambda: folder.remove("worst")
            for write in (*late, lambda: inside.put("one", b"late")):
                with pytest.raises(TakenError, match=f"{url} {words} writes no more; what it"):
                    write()
    assert files(url) == {"/.lock": OTHER, "/worst/0/one": b"mine"}


def once(url: str, action: Callable[[], Any]) -> Callable[..., None]:
    """A display of progress that does something once, when a shard is there."""
    done = []

    def display(*_: int) -> None:
        if not done and len(list(place(url).glob("lanes/*.parquet"))) == 1:
            done.append(action())

    return display


@pytest.mark.parametrize("root", ["memory://taken", "file://"])
def test_a_run_whose_folder_is_taken_over_writes_no_more(root, study, local, tmp_path, monkeypatch):
    """After one of its shards: no rows, arrays, tables or manifest."""
    monkeypatch.setattr(shards, "MOST_UNWRITTEN", 0)  # no rows are on the way at that moment
    url, before = f"{root}{tmp_path}/study", []

    def take() -> None:
        place(f"{url}/.lock").write_bytes(OTHER)
        before.append(files(url))

    with pytest.raises(TakenError, match="taken over by process 1 on Mars") as error:
        jaxnet.run(study, url, progress=once(url, take))
    assert str(error.value).endswith("what it has written stays: 2 of 4 lanes")
    assert before == [files(url)]
    place(f"{url}/.lock").unlink()
    assert progress(study, url) == (2, 4)
    assert_equal(jaxnet.open(url), local)


def test_a_folder_that_is_removed_ends_its_run(study, tmp_path):
    """Nothing is made in its place."""
    out = tmp_path / "out"
    remove = once(str(out), lambda: shutil.rmtree(out))
    with pytest.raises(TakenError, match=rf"{out} was removed, or its \.lock was: this process"):
        jaxnet.run(study, out, progress=remove)
    assert not out.exists()


def test_a_folder_that_is_removed_before_its_tables_is_said(study, tmp_path, monkeypatch):
    """The rows are read again for them."""
    out, summarise = tmp_path / "out", summary.summarise

    def removed(*given: Any) -> Any:
        shutil.rmtree(out)
        return summarise(*given)

    monkeypatch.setattr(summary, "summarise", removed)
    with pytest.raises(TakenError, match=rf"{out} was removed, or its \.lock was"):
        jaxnet.run(study, out, progress=False)
    assert not out.exists()


def test_writers_of_parts_share_a_disk(tmp_path):
    """Any number of them, and neither one nor a run beside a lone writer."""
    folder = Folder(tmp_path)
    with folder.writing(alone=False), folder.writing(alone=False):
        refused(folder)
    with folder.writing():
        refused(folder, alone=False)
        with pytest.raises(FolderError, match=f"written by process {os.getpid()} on"):
            jaxnet.run(STUDY, tmp_path, progress=False)


UNREACHED = {
    "sftpp://there/study": "Unsupported filesystem: 'sftpp'",
    "gs://bucket/study": "install gcsfs",
    "s3:/bucket/study": "bucket/container missing",
    "s3://no-such-bucket/study": "there is no s3://no-such-bucket/",
}


@pytest.mark.long
def test_what_cannot_be_reached_is_said(bucket, study, tmp_path, monkeypatch):
    """Status 2 within seconds, with the URL and why; nothing is made on the way."""
    monkeypatch.setitem(sys.modules, "gcsfs", None)  # as if it were not installed
    monkeypatch.setattr(folders, "ANSWER", 1)
    (tmp_path / "small.yaml").write_text(json.dumps(STUDY))
    for url, why in UNREACHED.items():
        for command in (["show", url], ["run", str(tmp_path / "small.yaml"), "--out", url]):
            ended = CliRunner().invoke(main, command)
            assert ended.exit_code == 2, ended.output
            assert why in ended.output
            assert url in ended.output
    assert [each["Name"] for each in boto3.client("s3").list_buckets()["Buckets"]] == ["bucket"]
    with pytest.raises(ClusterError, match="seen by this process alone"):
        jaxnet.run(study, "memory://there/alone", workers=2)
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setattr(S3FileSystem, "_cache", {})  # connections to the other server
    with pytest.raises(FolderError, match=r"study: (no answer within 1 s|Could not connect)"):
        jaxnet.open("s3://bucket/study")
