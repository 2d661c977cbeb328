"""One study of twelve shards for every test of this folder, and its undisturbed results."""

import pandas as pd
import pytest
import yaml

import jaxnet
from jaxnet.kinds import registry

STUDY = {
    "name": "parted",
    "samples": 64,
    "horizon": 5.0,
    "tail": 1.0,
    "topology": "star",
    "defence": "none",
    "engine": "exact",
    "sweep": {"attack.magnitude": {"linspace": [0, 10, 12]}},
    "save": {"errors": True},
}


SHARDS = 12


def done(out):
    """Shards whose rows are there, and when they were written."""
    return {path: path.stat().st_mtime_ns for path in sorted(out.glob("lanes/*.parquet"))}


@pytest.fixture(scope="session")
def parted(tmp_path_factory):
    """The study's file."""
    path = tmp_path_factory.mktemp("parted") / "parted.yaml"
    path.write_text(yaml.safe_dump(STUDY, sort_keys=False))
    return path


@pytest.fixture(scope="session")
def whole(parted):
    """The study's results, by this process alone, with as many lanes side by side as in tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry.find("engine", "exact"), "chunk", 128)
        return jaxnet.run(jaxnet.load(parted), parted.parent / "whole", progress=False)


@pytest.fixture(scope="session")
def assert_same(whole):
    """Rows, tables and arrays equal those of `whole` to the last bit, and nothing torn is left."""

    def compare(results):
        pd.testing.assert_frame_equal(results.lanes, whole.lanes, check_exact=True)
        assert results.errors.load().drop_attrs().identical(whole.errors.load().drop_attrs())
        assert (results.path / "cells.csv").read_bytes() == (whole.path / "cells.csv").read_bytes()
        assert results.manifest["lanes"] == whole.manifest["lanes"]
        assert {path.name for path in results.path.rglob(".*")} == {".lock"}

    return compare


@pytest.fixture(scope="session")
def assert_begins(whole):
    """The first rows of a run with more samples equal those of `whole`."""

    def compare(rows):
        first = rows[rows["sample"] < STUDY["samples"]].reset_index(drop=True)
        pd.testing.assert_frame_equal(first, whole.lanes, check_exact=True)

    return compare
