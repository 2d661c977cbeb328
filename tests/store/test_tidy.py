"""CSV files of trajectories hold what the arrays hold, and every array tells its unit."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import jaxnet
from jaxnet import FolderError
from jaxnet.cli import main

KEYS = {
    "samples": 2,
    "horizon": 0.4,
    "tail": 0.2,
    "engine": "exact",
    "vehicles": 3,
    "topology": "star",
    "attack": {"vehicles": [2]},
    "sweep": {"attack.magnitude": [1, 5.5], "defence": ["none", "trusted_trim"]},
}


@pytest.mark.parametrize("saved", ["all", {"samples": [1]}], ids=["all", "chosen"])
def test_csv_files_read_back_equal_the_arrays(tmp_path, saved):
    """To the last bit, lane by lane, with the swept values in columns."""
    results = jaxnet.simulate(KEYS | {"save": {"trajectories": saved}}, progress=False)
    folder = results.export(tmp_path / "csv", form="csv")
    samples = [0, 1] if saved == "all" else [1]
    names = {f"cell-{cell}-sample-{sample}.csv" for cell in range(4) for sample in samples}
    assert {path.name for path in folder.iterdir()} == names
    table = pd.concat(pd.read_csv(path, keep_default_na=False) for path in folder.iterdir())
    assert set(table["attack.magnitude"]) == {1, 5.5}
    assert set(table["defence"]) == {"none", "trusted_trim"}
    read = table.set_index(["cell", "sample", "time", "vehicle"]).to_xarray()
    stored = results.trajectories
    if saved != "all":
        stored = stored.drop_vars(["attack.magnitude", "defence"]).set_index(lane=["cell", "sample"])
        stored = stored.unstack("lane").transpose("cell", "sample", ...)
    order = ("cell", "sample", "time", "vehicle")
    for array, dim, before in (
        ("states", "state", ""),
        ("inputs", "input", ""),
        ("attack", "axis", "attack_"),
    ):
        for label in stored[dim].values:
            known = stored[array].sel({dim: label}).transpose(*order).values
            np.testing.assert_array_equal(read[f"{before}{label}"].transpose(*order).values, known)
    for axis in ("x", "y"):
        known = stored["navigator"].sel(axis=axis).values
        assert np.isin(known, read[f"navigator_{axis}"].values).all()


def test_the_command_writes_csv_and_says_what_is_missing(tmp_path):
    """Into RESULTS/csv, or a folder; MATLAB's file as before; an unknown form is refused."""
    results = jaxnet.run(KEYS | {"save": {"trajectories": "all"}}, tmp_path / "run", progress=False)
    done = CliRunner().invoke(main, ["export", str(results.path), "--csv"])
    assert done.exit_code == 0, done.output
    assert len(list((tmp_path / "run" / "csv").glob("*.csv"))) == 8
    done = CliRunner().invoke(main, ["export", str(results.path), "--csv", str(tmp_path / "mine"), "--mat"])
    assert done.exit_code == 0, done.output
    assert len(list((tmp_path / "mine").glob("*.csv"))) == 8
    assert (tmp_path / "run" / "results.mat").exists()
    with pytest.raises(FolderError, match=r"^form: one of mat, csv \(got 'xls'\)$"):
        results.export(form="xls")
    bare = jaxnet.simulate(KEYS, progress=False)
    with pytest.raises(FolderError, match=r"the study in memory has no trajectories.zarr: run it with save"):
        bare.export(tmp_path / "none", form="csv")


@pytest.mark.parametrize("saved", ["all", {"worst": 1}], ids=["all", "chosen"])
def test_every_array_tells_its_unit_and_meaning(saved):
    """Variables, coordinates and swept keys; states and inputs one unit for each label."""
    car = {"vehicle": "car", "save": {"errors": True, "trajectories": saved}}
    results = jaxnet.simulate(KEYS | car, progress=False)
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
