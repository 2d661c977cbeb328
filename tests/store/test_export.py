"""Results for other programs hold the same numbers: MATLAB's file, CSV of trajectories, units."""

import re

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scipy import io

import jaxnet
from jaxnet import FolderError
from jaxnet.cli import main
from jaxnet.store import export
from jaxnet.store.arrays import lane_in

KEYS = {
    "vehicle": "car",
    "samples": 2,
    "horizon": 0.4,
    "tail": 0.2,
    "engine": "exact",
    "vehicles": 3,
    "topology": "star",
    "attack": {"vehicles": [2]},
    "sweep": {
        "attack": [
            {"kind": "bias", "vehicles": [2]},
            {"kind": "rotating", "vehicles": [2], "label": "turns"},
        ],
        "gain": [[1, 3, 3], [2, 3, 3]],
    },
}
ARRAYS = ("states", "state", ""), ("inputs", "input", ""), ("attack", "axis", "attack_")


@pytest.fixture(scope="module", params=["all", {"samples": [1]}], ids=["all", "chosen"])
def results(request, tmp_path_factory):
    """Four cells of two lanes, with the trajectories of all or of one lane a cell."""
    save = {"errors": True, "trajectories": request.param}
    place = tmp_path_factory.mktemp("export") / "out"
    return jaxnet.run(KEYS | {"save": save}, place, progress=False)


def test_the_numbers_are_the_same(results, tmp_path):
    """Rows, cells, what is swept, errors and trajectories, to the last bit."""
    ended = CliRunner().invoke(main, ["export", str(results.path), "--mat"])
    assert ended.exit_code == 0, ended.output
    held = io.loadmat(results.path / "results.mat", simplify_cells=True)
    for name in ("tail_mean", "tail_max", "sample", "steps"):
        np.testing.assert_array_equal(held["lanes"][name], results.lanes[name])
    assert held["lanes"]["status"].tolist() == results.lanes["status"].tolist()
    medians = "tail_mean_median"
    np.testing.assert_array_equal(held["cells"][medians], results.cells[medians])
    assert held["swept"]["attack"].tolist() == ["bias", "bias", "turns", "turns"]
    np.testing.assert_array_equal(held["errors"]["tracking"], results.errors["tracking"])
    for name in ("states", "navigator", "attack", "kept", "source"):
        known = results.trajectories[name]
        np.testing.assert_array_equal(held["trajectories"][name], known.squeeze())
        assert held["trajectories"]["dims"][name].tolist() == [*known.dims]
    assert held["trajectories"]["attack_name"].tolist() == ["bias", "bias", "turns", "turns"]
    assert io.loadmat(results.export(tmp_path / "mine.mat"))["__header__"]


def test_what_cannot_be_exported_is_said(results, monkeypatch, tmp_path):
    """Before anything is written."""
    monkeypatch.setattr(export, "MOST_VARIABLE_BYTES", 1000)
    with pytest.raises(FolderError, match=r"mat: \w+\.zarr has"):
        results.export(tmp_path / "large.mat")
    with pytest.raises(FolderError, match=r"ends in \.mat"):
        results.export("x.csv")
    with pytest.raises(FolderError, match=r"^form: one of mat, csv \(got 'xls'\)$"):
        results.export(form="xls")
    bare = jaxnet.simulate({**KEYS, "sweep": {}}, progress=False)
    words = r"the study in memory has no trajectories.zarr: run it with save"
    with pytest.raises(FolderError, match=words):
        bare.export(tmp_path / "none", form="csv")
    assert not list(tmp_path.iterdir())


def test_names_are_what_matlab_takes():
    """And none is another's."""
    given = ["attack.magnitude", "attack_magnitude", "end", "2nd", "_x", "a" * 70, "a" * 71, "für"]
    found = list(export.valid_names(dict.fromkeys(given)))
    assert found[:3] == ["attack_magnitude", "attack_magnitude_", "x_end"]
    assert len(set(found)) == len(given)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", name) for name in found)


def test_csv_files_read_back_equal_the_arrays(tmp_path, results):
    """To the last bit, lane by lane, with the swept values in columns."""
    folder = tmp_path / "csv"
    ended = CliRunner().invoke(main, ["export", str(results.path), "--csv", str(folder)])
    assert ended.exit_code == 0, ended.output
    samples = [0, 1] if "lane" not in results.trajectories.dims else [1]
    names = {f"cell-{cell}-sample-{sample}.csv" for cell in range(4) for sample in samples}
    assert {path.name for path in folder.iterdir()} == names
    for path in folder.iterdir():
        table = pd.read_csv(path, keep_default_na=False)
        (cell,), (sample,) = table["cell"].unique(), table["sample"].unique()
        assert path.stem == f"cell-{cell}-sample-{sample}"
        labels = results.study.cells[cell].labels
        assert all((table[key] == value).all() for key, value in labels.items())
        lane = lane_in(results.trajectories, int(cell), int(sample))
        read = table.set_index(["time", "vehicle"]).to_xarray()
        for array, dim, before in ARRAYS:
            for label in lane[dim].values:
                known = lane[array].sel({dim: label}).transpose("time", "vehicle").values
                np.testing.assert_array_equal(read[f"{before}{label}"].values, known)
        for axis in ("x", "y"):
            known = np.tile(lane["navigator"].sel(axis=axis).values[:, None], 3)
            np.testing.assert_array_equal(read[f"navigator_{axis}"].values, known)


def test_every_array_tells_its_unit_and_meaning(results):
    """Variables, coordinates and swept keys; states and inputs one unit for each label."""
    for data in (results.errors, results.trajectories):
        for name, array in data.variables.items():
            if name != "lane" or array.attrs:  # the index of chosen lanes is xarray's own
                assert {"units", "long_name"} <= set(array.attrs), name
        assert data["time"].attrs["units"] == "s"
        assert data["gain"].attrs == {"units": "", "long_name": "gain"}
    assert results.errors["tracking"].attrs["units"] == "m"
    units = [results.trajectories[name].attrs["units"] for name in ("states", "inputs")]
    assert units == ["m, m, rad, m/s, rad, m/s²", "m/s³, rad/s"]
