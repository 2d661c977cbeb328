"""`jaxnet export --mat`: MATLAB reads the same numbers."""

import re

import numpy as np
import pytest
from scipy import io

import jaxnet
from jaxnet.store import export
from jaxnet.store.folder import FolderError
from tests import systems


@pytest.fixture(scope="module")
def results(tmp_path_factory):
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


def test_the_numbers_are_the_same(results, tmp_path):
    """Rows, cells, what is swept, errors and trajectories, to the last bit."""
    path = results.export()
    assert path == results.path / "results.mat"
    held = io.loadmat(path, simplify_cells=True)
    for name in ("tail_mean", "tail_max", "sample", "steps"):
        np.testing.assert_array_equal(held["lanes"][name], results.lanes[name])
    assert held["lanes"]["status"].tolist() == results.lanes["status"].tolist()
    np.testing.assert_array_equal(
        held["cells"]["tail_mean_median"], results.cells["tail_mean_median"]
    )
    assert held["swept"]["attack"].tolist() == ["none", "rotating"]
    np.testing.assert_array_equal(held["errors"]["tracking"], results.errors["tracking"])
    for name in ("states", "navigator", "attack", "kept", "source"):
        np.testing.assert_array_equal(held["trajectories"][name], results.trajectories[name])
    assert held["trajectories"]["dims"]["states"].tolist() == [
        "cell",
        "sample",
        "time",
        "vehicle",
        "state",
    ]
    assert held["trajectories"]["attack_name"].tolist() == ["none", "rotating"]
    other = results.export(tmp_path / "mine.mat")
    assert io.loadmat(other)["__header__"]


def test_a_variable_that_is_too_large_is_refused(results, monkeypatch):
    """Before anything is written."""
    monkeypatch.setattr(export, "MOST_VARIABLE_BYTES", 1000)
    (results.path / "results.mat").unlink(missing_ok=True)
    with pytest.raises(FolderError, match=r"mat: \w+\.zarr has"):
        results.export()
    assert not (results.path / "results.mat").exists()
    with pytest.raises(FolderError, match=r"ends in \.mat"):
        results.export("x.csv")


def test_names_are_what_matlab_takes():
    """And none is another's."""
    given = ["attack.magnitude", "attack_magnitude", "end", "2nd", "_x", "a" * 70, "a" * 71, "für"]
    found = list(export.valid_names(dict.fromkeys(given)))
    assert found[:3] == ["attack_magnitude", "attack_magnitude_", "x_end"]
    assert len(set(found)) == len(given)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", name) for name in found)
