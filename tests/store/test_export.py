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
from tests import systems


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Two cells with text and numbers swept, everything saved."""
    study = systems.study(
        engine="exact",
        samples=2,
        horizon=1.0,
        tail=0.5,
        sweep={"attack": ["none", "rotating"], "gain": [[1, 3, 3]]},
        save={"errors": True, "trajectories": "all"},
    )
    return jaxnet.run(study, tmp_path_factory.mktemp("mat") / "out")


def test_the_numbers_are_the_same(swept, tmp_path):
    """Rows, cells, what is swept, errors and trajectories, to the last bit."""
    path = swept.export()
    assert path == swept.path / "results.mat"
    held = io.loadmat(path, simplify_cells=True)
    for name in ("tail_mean", "tail_max", "sample", "steps"):
        np.testing.assert_array_equal(held["lanes"][name], swept.lanes[name])
    assert held["lanes"]["status"].tolist() == swept.lanes["status"].tolist()
    np.testing.assert_array_equal(
        held["cells"]["tail_mean_median"], swept.cells["tail_mean_median"]
    )
    assert held["swept"]["attack"].tolist() == ["none", "rotating"]
    np.testing.assert_array_equal(held["errors"]["tracking"], swept.errors["tracking"])
    for name in ("states", "navigator", "attack", "kept", "source"):
        np.testing.assert_array_equal(held["trajectories"][name], swept.trajectories[name])
    dims = held["trajectories"]["dims"]["states"].tolist()
    assert dims == ["cell", "sample", "time", "vehicle", "state"]
    assert held["trajectories"]["attack_name"].tolist() == ["none", "rotating"]
    other = swept.export(tmp_path / "mine.mat")
    assert io.loadmat(other)["__header__"]


def test_a_variable_that_is_too_large_is_refused(swept, monkeypatch):
    """Before anything is written."""
    monkeypatch.setattr(export, "MOST_VARIABLE_BYTES", 1000)
    (swept.path / "results.mat").unlink(missing_ok=True)
    with pytest.raises(FolderError, match=r"mat: \w+\.zarr has"):
        swept.export()
    assert not (swept.path / "results.mat").exists()
    with pytest.raises(FolderError, match=r"ends in \.mat"):
        swept.export("x.csv")


def test_names_are_what_matlab_takes():
    """And none is another's."""
    given = ["attack.magnitude", "attack_magnitude", "end", "2nd", "_x", "a" * 70, "a" * 71, "für"]
    found = list(export.valid_names(dict.fromkeys(given)))
    assert found[:3] == ["attack_magnitude", "attack_magnitude_", "x_end"]
    assert len(set(found)) == len(given)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", name) for name in found)


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
        "attack.magnitude": [1, 5.5],
        "topology": ["star", {"kind": "star", "label": "other"}],
    },
}
ARRAYS = ("states", "state", ""), ("inputs", "input", ""), ("attack", "axis", "attack_")


@pytest.fixture(scope="module", params=["all", {"samples": [1]}], ids=["all", "chosen"])
def results(request):
    """Four cells of two lanes, with the trajectories of all or of one lane a cell."""
    return jaxnet.simulate(
        KEYS | {"save": {"errors": True, "trajectories": request.param}}, progress=False
    )


def test_csv_files_read_back_equal_the_arrays(tmp_path, results):
    """To the last bit, lane by lane, with the swept values in columns."""
    folder = results.export(tmp_path / "csv", form="csv")
    samples = [0, 1] if "lane" not in results.trajectories.dims else [1]
    names = {f"cell-{cell}-sample-{sample}.csv" for cell in range(4) for sample in samples}
    assert {path.name for path in folder.iterdir()} == names
    for path in folder.iterdir():
        table = pd.read_csv(path, keep_default_na=False)
        (cell,), (sample,) = table["cell"].unique(), table["sample"].unique()
        assert path.stem == f"cell-{cell}-sample-{sample}"
        labels = results.study.cells[cell].labels
        assert all((table[key] == value).all() for key, value in labels.items())
        lane = lane_of(results.trajectories, cell, sample)
        read = table.set_index(["time", "vehicle"]).to_xarray()
        for array, dim, before in ARRAYS:
            for label in lane[dim].values:
                known = lane[array].sel({dim: label}).transpose("time", "vehicle").values
                np.testing.assert_array_equal(read[f"{before}{label}"].values, known)
        for axis in ("x", "y"):
            known = lane["navigator"].sel(axis=axis).values
            np.testing.assert_array_equal(
                read[f"navigator_{axis}"].values, np.tile(known[:, None], 3)
            )


def lane_of(data, cell, sample):
    """The trajectory of a lane in a store of either layout."""
    if "lane" not in data.dims:
        return data.sel(cell=cell, sample=sample)
    return data.isel(
        lane=int(np.flatnonzero((data["cell"] == cell) & (data["sample"] == sample))[0])
    )


def test_the_command_writes_csv_and_says_what_is_missing(tmp_path):
    """Into RESULTS/csv, or a folder; MATLAB's file as before; an unknown form is refused."""
    save = {"errors": True, "trajectories": "all"}
    results = jaxnet.run(KEYS | {"save": save}, tmp_path / "run", progress=False)
    done = CliRunner().invoke(main, ["export", str(results.path), "--csv"])
    assert done.exit_code == 0, done.output
    assert len(list((tmp_path / "run" / "csv").glob("*.csv"))) == 8
    done = CliRunner().invoke(
        main, ["export", str(results.path), "--csv", str(tmp_path / "mine"), "--mat"]
    )
    assert done.exit_code == 0, done.output
    assert len(list((tmp_path / "mine").glob("*.csv"))) == 8
    assert (tmp_path / "run" / "results.mat").exists()
    with pytest.raises(FolderError, match=r"^form: one of mat, csv \(got 'xls'\)$"):
        results.export(form="xls")
    bare = jaxnet.simulate(KEYS | {"save": {"errors": True}}, progress=False)
    with pytest.raises(
        FolderError, match=r"the study in memory has no trajectories.zarr: run it with save"
    ):
        bare.export(tmp_path / "none", form="csv")


def test_every_array_tells_its_unit_and_meaning(results):
    """Variables, coordinates and swept keys; states and inputs one unit for each label."""
    for data in (results.errors, results.trajectories):
        for name, array in data.variables.items():
            if name != "lane" or array.attrs:  # the index of chosen lanes is xarray's own
                assert {"units", "long_name"} <= set(array.attrs), name
        assert data["time"].attrs["units"] == "s"
        assert data["attack.magnitude"].attrs == {"units": "m", "long_name": "attack magnitude"}
    assert results.errors["tracking"].attrs["units"] == "m"
    units = {
        dim: results.trajectories[name].attrs["units"]
        for name, dim in (("states", "state"), ("inputs", "input"))
    }
    assert units == {"state": "m, m, rad, m/s, rad, m/s²", "input": "m/s³, rad/s"}
