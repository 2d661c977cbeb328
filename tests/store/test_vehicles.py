"""Errors of each vehicle over the tail: stored, resumed, tabled and drawn."""

import shutil

import numpy as np
import pytest

import jaxnet
from jaxnet.statistics.bands import vehicle_table
from jaxnet.store.folder import FolderError
from jaxnet.view.page import sections

KEYS = {
    "name": "vehicles",
    "vehicles": 5,
    "topology": "cyclic",
    "engine": "exact",
    "horizon": 12.0,
    "initial": {"position": {"uniform": [-2.0, 2.0]}},
    "tail": 1.0,
    "output_step": 0.5,
    "samples": 4,
    "attack": {"kind": "rotating", "vehicles": [2], "magnitude": 10, "frequency": 1.0},
    "recovery": {"tau": 0.3},
    "save": {"vehicles": True, "trajectories": "all"},
}
PATH = {"topology": "path", "defence": "w_msr"}  # its decisions cut vehicles off at once


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Two samples of two cells, then two more in the same folder."""
    study = {**KEYS, "sweep": {"defence": ["none", "trusted_trim"]}}
    place = tmp_path_factory.mktemp("results") / "vehicles"
    jaxnet.run({**study, "samples": 2}, place, progress=False)
    return jaxnet.run(study, place, progress=False)


def errors_of_trajectories(results):
    """‖y_i - y_0‖ at the output times of the tail, (cell, sample, time, vehicle)."""
    data = results.trajectories.isel(time=slice(-3, None))
    position = data["states"].sel(state=["x", "y"]).values
    return np.linalg.norm(position - data["navigator"].values[:, None, :, None], axis=-1)


def test_the_errors_of_each_vehicle_are_those_of_its_trajectory(results):
    """Mean and maximum over the tail, also of samples that came later; rows have the fleet's."""
    known, stored = errors_of_trajectories(results), results.vehicles
    assert stored["tail_mean"].dims == ("cell", "sample", "vehicle")
    np.testing.assert_allclose(stored["tail_mean"], known.mean(axis=2), rtol=1e-6)
    np.testing.assert_allclose(stored["tail_max"], known.max(axis=2), rtol=1e-6)
    of_rows = results.lanes["tail_mean"].to_numpy().reshape(2, 4)
    np.testing.assert_allclose(stored["tail_mean"].mean("vehicle"), of_rows, rtol=1e-6)


def test_table_figure_and_page_show_who_tracks(results):
    """By a count over the trajectories, with the threshold tau · ā = 3 m."""
    known = errors_of_trajectories(results).mean(axis=2)
    table = vehicle_table(results, results.study.cells)
    assert table["vehicle"].tolist() == [1, 2, 3, 4, 5] * 2
    np.testing.assert_allclose(table["unrecovered"], 100 * (known > 3.0).mean(axis=1).ravel())
    np.testing.assert_allclose(table["greatest"], known.max(axis=1).ravel(), rtol=1e-6)
    assert 0 < table["unrecovered"].sum() < 1000
    for panel in results.plot.vehicles().axes:
        points = [line for line in panel.lines if line.get_marker() in ("o", "s")]
        assert sorted(len(line.get_xdata()) for line in points) == [1, 4]
    shown = str(sections.vehicles_section(results))
    assert "lanes over threshold [%]" in shown
    assert "own error (mean error over the tail &gt; 0.3\xa0ā = 3\xa0m)" in shown


def test_a_lane_that_failed_has_no_errors_of_vehicles(tmp_path):
    """Not-a-number for each vehicle; a figure of failed lanes alone is refused."""
    keys = {**KEYS, **PATH, "save": {"vehicles": True}}
    results = jaxnet.run(keys, tmp_path / "out", progress=False)
    assert (results.lanes["status"] == "disconnected").all()
    assert np.isnan(results.vehicles["tail_mean"]).all()
    with pytest.raises(FolderError, match="no lane of these cells came to its end"):
        results.plot.vehicles()
    shutil.rmtree(results.path / "vehicles.zarr")
    with pytest.raises(FolderError, match=r"has no vehicles.zarr: run .* with save.vehicles=true"):
        _ = jaxnet.open(results.path).vehicles
