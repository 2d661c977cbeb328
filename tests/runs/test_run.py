"""The results folder: what the contract says is in it, and that no interruption changes it."""

import json
import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml
from upath import UPath

import jaxnet
from jaxnet.config.scenario import situation_of
from jaxnet.engine import batch, programs
from jaxnet.model.graph import dense
from jaxnet.runs.replay import replay, replay_each
from jaxnet.runs.run import Run
from jaxnet.runs.tally import Tally
from jaxnet.statistics import intervals
from jaxnet.store import layout
from jaxnet.store.admission import admit
from jaxnet.store.arrays import lane_in
from jaxnet.store.folder import Folder, FolderError
from jaxnet.store.results import Results
from jaxnet.view.figures import panels
from jaxnet.view.text import progress
from jaxnet.view.text.tables import lane_text
from tests import systems

STUDY = {
    "name": "small",
    "engine": "exact",
    "samples": 3,
    "horizon": 2.0,
    "tail": 1.0,
    "sweep": {"topology": ["star", "cyclic"], "attack.magnitude": [0, 5.5]},
    "save": {"errors": True, "trajectories": "all"},
}
COLUMNS = (
    "cell sample topology attack.magnitude status tail_mean tail_max tail_disagreement peak_error"
    " min_speed peak_turn_rate tail_fall steps switches unheard cut_off cut_off_at"
)


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> Path:
    """The study's file."""
    path = tmp_path_factory.mktemp("config") / "small.yaml"
    path.write_text(yaml.safe_dump(STUDY, sort_keys=False))
    return path


@pytest.fixture(scope="module")
def results(config, tmp_path_factory) -> Results:
    """The study's results, undisturbed."""
    return jaxnet.run(jaxnet.load(config), tmp_path_factory.mktemp("results") / "small")


def test_rows_have_the_contract_s_columns(results):
    """Names, order and types; one row per lane."""
    rows = results.lanes
    assert rows.columns.tolist() == COLUMNS.split()
    assert rows[["cell", "sample", "steps", "switches", "unheard"]].dtypes.eq(np.int64).all()
    assert rows["attack.magnitude"].tolist() == [0, 0, 0, 5.5, 5.5, 5.5] * 2
    assert rows["topology"].tolist() == ["star"] * 6 + ["cyclic"] * 6
    assert rows["sample"].tolist() == [0, 1, 2] * 4
    assert (rows["status"] == "ok").all()
    files = sorted(path.name for path in (results.path / "lanes").iterdir())
    assert files == [f"{number:05d}.parquet" for number in range(4)]


COMMANDS = """
import json, sys
from jaxnet.cli import main
for words in json.loads(sys.argv[1]):
    main(words, standalone_mode=False)
"""


@pytest.mark.long
def test_optimised_programs_make_the_same_rows(config, results, tmp_path):
    """As users compile them, unlike the tests; a lane replayed is the same to the last bit."""
    commands, sweep = [], "sweep={attack.magnitude: [0, 5.5]}"
    for engine in ("exact", "nonlinear"):
        words = [f"engine={engine}", "topology=cyclic", sweep, "save={}"]
        commands.append(["run", str(config), *words, "--out", str(tmp_path / engine)])
        commands.append(["replay", str(tmp_path / engine), "--cell", "1", "--sample", "2"])
    optimised = {key: value for key, value in os.environ.items() if key != "XLA_FLAGS"}
    started = [sys.executable, "-c", COMMANDS, json.dumps(commands)]
    said = subprocess.check_output(started, env=optimised, text=True)
    assert said.count("the same as the stored row") == 2
    known = results.lanes.query("topology == 'cyclic'")
    for engine, accuracy in {"exact": 1e-9, "nonlinear": 1e-5}.items():
        ours = jaxnet.open(tmp_path / engine).lanes
        np.testing.assert_allclose(ours["tail_mean"], known["tail_mean"], rtol=0, atol=accuracy)
        assert ours["switches"].tolist() == known["switches"].tolist()


def test_cells_summarise_the_rows(results):
    """One row per cell, statistics recomputed with pandas."""
    cells, rows = results.cells, results.lanes
    assert cells.columns[:5].tolist() == ["topology", "attack.magnitude", "lanes", "ok", "failed"]
    for number, cell in cells.iterrows():
        mine = rows[rows["cell"] == number]
        for metric in ("tail_mean", "tail_max"):
            assert cell[f"{metric}_mean"] == pytest.approx(mine[metric].mean(), rel=1e-12)
            assert cell[f"{metric}_median"] == pytest.approx(mine[metric].median(), rel=1e-12)
            assert cell[f"{metric}_max"] == mine[metric].max()
            ends = intervals.quantile_interval(mine[metric].to_numpy(), 0.5, 0.95)
            told = cell[f"{metric}_median_low"], cell[f"{metric}_median_high"]
            assert told == pytest.approx(ends, rel=1e-12, nan_ok=True)


def test_arrays_are_labelled_as_the_contract_says(results):
    """Dimensions, coordinates, types, and agreement with the rows."""
    errors, paths = results.errors, results.trajectories
    kinds = {
        "states": ("cell sample time vehicle state", np.float64),
        "attack": ("cell sample time vehicle axis", np.float64),
        "kept": ("cell sample time slot vehicle", np.float32),
        "navigator": ("cell time axis", np.float64),
        "source": ("cell slot vehicle", np.int32),
    }
    for name, (dims, dtype) in kinds.items():
        assert (paths[name].dims, paths[name].dtype) == (tuple(dims.split()), dtype)
    assert errors["tracking"].dims == ("cell", "sample", "time")
    assert errors["tracking"].dtype == np.float32
    assert paths["state"].values.tolist() == ["x", "y", "heading", "speed", "turn_rate", "force"]
    assert paths["vehicle"].values.tolist() == list(range(1, 13))
    for data in (paths, errors):
        assert data["time"].values.tolist() == [k / 10 for k in range(21)]
    assert paths.sel(time=0.3).sizes["vehicle"] == 12  # 3 * 0.1 is another double
    np.testing.assert_allclose(paths["kept"].sum("slot").values, 1.0, atol=1e-6)
    heading = paths.sel(state="heading")["states"].values
    assert ((heading > -np.pi) & (heading <= np.pi)).all()
    position = paths["states"].sel(state=["x", "y"]).values
    apart = np.linalg.norm(position - paths["navigator"].values[:, None, :, None], axis=-1)
    tail = apart[:, :, 10:].mean(axis=(2, 3)).ravel()
    np.testing.assert_allclose(tail, results.lanes["tail_mean"])
    np.testing.assert_allclose(errors["tracking"].values, apart.mean(axis=3), rtol=1e-6)
    attack = np.linalg.norm(paths["attack"].values, axis=-1)
    np.testing.assert_allclose(attack[1][:, :, [1, 4, 7, 10]], 5.5)
    assert not attack[1][:, :, [0, 2, 3, 5, 6, 8, 9, 11]].any()


def test_arrays_are_selected_by_what_was_swept(results):
    """By one key, by one after the other, and by the number of a cell still."""
    for data in (results.errors, results.trajectories):
        attacked = data.sel({"attack.magnitude": 5.5})
        assert attacked["cell"].values.tolist() == [1, 3]
        assert attacked.sel(topology="cyclic")["cell"].item() == 3
        one, other = data.sel(cell=3), attacked.isel(cell=1)
        assert one.drop_vars("sample").identical(other.drop_vars("sample"))


def test_the_stored_study_runs_as_it_is(results):
    """`study.yaml` says everything and describes the same rows."""
    again, manifest = jaxnet.load(results.path / "study.yaml"), results.manifest
    assert manifest["lanes"] == {"total": 12, "ok": 12, "failed": 0}
    assert [str(cell) for cell in again.cells] == [str(cell) for cell in results.study.cells]
    admit(Folder(results.path), again.config)
    assert {"jaxnet", "jax", "jaxlib", "diffrax", "numpy", "python"} == set(manifest["versions"])


def test_another_study_is_refused_and_loses_nothing(config, results, tmp_path):
    """The message names the key that differs; `fresh` replaces."""
    shutil.copytree(results.path, tmp_path / "taken")
    other = jaxnet.load(config, {"gain": [6, 11, 6]})
    words = r"holds another study: gain.0 is 1.0 there and 6.0 here; give"
    with pytest.raises(FolderError, match=words):
        jaxnet.run(other, tmp_path / "taken")
    swapped = dict(reversed(STUDY["sweep"].items()))
    with pytest.raises(FolderError, match="another order"):  # which numbers the cells
        jaxnet.run(jaxnet.load(config, {"sweep": swapped}), tmp_path / "taken")
    kept = jaxnet.open(tmp_path / "taken")
    pd.testing.assert_frame_equal(kept.lanes, results.lanes, check_exact=True)
    replaced = jaxnet.run(other, tmp_path / "taken", fresh=True)
    assert not replaced.lanes["tail_mean"].equals(results.lanes["tail_mean"])
    Folder(tmp_path / "taken").write_manifest(versions={"jaxnet": "0.0.1"})
    with pytest.raises(FolderError, match=r"written by jaxnet 0\.0\.1"):
        jaxnet.run(other, tmp_path / "taken")


def test_a_folder_of_something_else_is_left_alone(config, tmp_path):
    """A folder with a photo or a thesis, and a file, are neither written to nor read."""
    for name, inside in {"mine": "figures/photo.png", "thesis": "chapter1.tex"}.items():
        file = tmp_path / name / inside
        file.parent.mkdir(parents=True)
        file.touch()
        for fresh in (False, True):
            with pytest.raises(FolderError, match=f"holds {inside.split('/')[0]}"):
                jaxnet.run(jaxnet.load(config), tmp_path / name, fresh=fresh)
        assert file.exists()
        with pytest.raises(FolderError, match="not a results folder"):
            jaxnet.open(tmp_path / name)
    (tmp_path / "file").write_text("mine")
    for path in (tmp_path / "file", tmp_path / "file" / "inside"):
        words = "cannot be written to: .* give another folder with --out"
        with pytest.raises(FolderError, match=words):
            jaxnet.run(jaxnet.load(config), path)
        with pytest.raises(FolderError, match="not a results folder"):
            jaxnet.open(path)
    assert (tmp_path / "file").read_text() == "mine"


def test_swept_attacks_stand_beside_their_signals(config, tmp_path):
    """The label of a swept attack does not take the name of the array; odd names read back."""
    keys = {"sweep": {"attack": ["none", "rotating"]}, "name": "1e5", "samples": 1}
    results = jaxnet.run(jaxnet.load(config, keys), tmp_path / "odd")
    assert results.trajectories["attack_name"].values.tolist() == ["none", "rotating"]
    assert results.trajectories["attack"].ndim == 5
    assert results.trajectories.sel(attack_name="rotating")["cell"].item() == 1
    assert results.study.config.name == "1e5"


def test_chosen_trajectories(config, tmp_path):
    """The worst lane of each cell, or named samples, equal the whole's; nothing else is there."""
    keys = {"sweep.topology": ["cyclic"]}
    whole = jaxnet.run(jaxnet.load(config, keys), tmp_path / "all")
    worst = whole.lanes.groupby("cell")["tail_mean"].idxmax()
    choices = {
        "worst": ({"worst": 1}, [divmod(row, 3) for row in worst]),
        "samples": ({"samples": [2, 0]}, [(0, 0), (0, 2), (1, 0), (1, 2)]),
    }
    for name, (choice, lanes) in choices.items():
        given = jaxnet.load(config, {**keys, "save.trajectories": choice})
        part = jaxnet.run(given, tmp_path / name).trajectories
        assert part["states"].dims == ("lane", "time", "vehicle", "state")
        assert list(zip(part["cell"].values, part["sample"].values, strict=True)) == lanes
        assert part["attack.magnitude"].values.tolist() == [5.5 * cell for cell, _ in lanes]
        for cell, sample in lanes:
            one = part.sel({"cell": cell, "sample": sample, "attack.magnitude": 5.5 * cell})
            wanted = whole.trajectories.sel(cell=cell, sample=sample)
            for variable in wanted.data_vars:
                np.testing.assert_array_equal(one[variable].squeeze(), wanted[variable])
        assert {variable.encoding["chunks"][0] for variable in part.data_vars.values()} == {1}
        stored = sum(variable.nbytes for variable in part.data_vars.values())
        assert stored == layout.disk_bytes(given.config, given.cells, lanes=0)


@pytest.mark.long
def test_chosen_lanes_of_all_cells_cost_no_more_loads_than_the_run(monkeypatch, tmp_path):
    """One load a program, whatever the number of cells; and what the run does is told meanwhile."""
    loads, told, seen = [], [], list[Tally]()
    advance = programs.advance_load

    def counted(plan, arguments, device):
        loads.append("state" in plan.save)
        told.append(progress.Speed().words(seen[-1]))
        return advance(plan, arguments, device)

    monkeypatch.setattr(programs, "advance_load", counted)
    few = {"samples": 2, "horizon": 1.0, "tail": 0.5, "save": {"trajectories": {"worst": 1}}}
    swept = {"sweep": {"topology": ["star", "cyclic"], "attack.magnitude": [1, 2, 3]}}
    given = systems.study(engine="exact", **few, **swept)
    folder = Folder(UPath(tmp_path))
    with folder.writing():
        Run(given.config, given.cells, folder, seen.append, systems.FEW).whole()
    assert loads.count(True) == 2 <= loads.count(False) == 4
    assert told[-2:] == ["trajectories, cell 1 of 6", "trajectories, cell 4 of 6"]
    assert progress.Speed().words(seen[-1]) == "writing results"


@pytest.mark.parametrize(
    "choice",
    ["all", pytest.param({"samples": [0, 1]}, marks=pytest.mark.long)],
    ids=["all", "chosen"],
)
def test_whom_vehicles_retain_is_told_of_cells_with_more_or_less_slots(tmp_path, choice):
    """By the formula of the documentation: of links of the graph alone, and of all on a star."""
    keys = {"horizon": 2.0, "tail": 1.0, "samples": 2, "save": {"trajectories": choice}}
    given = systems.study(engine="exact", sweep={"topology": ["star", "cyclic"]}, **keys)
    data = jaxnet.run(given, tmp_path / "out").trajectories.load()
    for cell in given.cells:
        graph = dense(situation_of(cell.scenario).graph)
        one = lane_in(data, cell.number, 1)
        weights = [one["kept"].where(one["source"] == j).sum("slot").values for j in range(13)]
        weights = np.stack(weights, axis=-1)
        np.testing.assert_allclose(weights.sum(axis=2), 1.0, atol=1e-6)
        assert ((weights > 0) <= (graph > 0)).all()
        star = cell.labels["topology"] == "star"
        assert ((weights > 0) == (graph > 0)).all() == star
        assert (one["kept"].isnull().all(("time", "vehicle")).values == [False, star, star]).all()
        assert ((one["source"] < 0).all("vehicle").values == [False, star, star]).all()


def test_chosen_lanes_that_were_harmed_are_stored_again(tmp_path):
    """Two swapped, one with a bit changed, one gone; where all is well nothing is written."""
    given = {"engine": "exact", "horizon": 2.0, "tail": 1.0, "topology": "star"}
    study = systems.study(samples=3, save={"trajectories": {"samples": [0, 2]}}, **given)
    whole = jaxnet.run(study, tmp_path / "out").trajectories.load()
    chunks = tmp_path / "out" / "trajectories.zarr" / "states" / "c"
    first, second = (chunks / lane / "0/0/0" for lane in "01")
    content = first.read_bytes()

    def swap() -> None:
        first.write_bytes(second.read_bytes())
        second.write_bytes(content)

    for harm in (
        swap,
        lambda: first.write_bytes(bytes([content[0] ^ 1]) + content[1:]),
        second.unlink,
    ):
        harm()
        assert jaxnet.run(study, tmp_path / "out").trajectories.identical(whole)
        assert first.read_bytes() == content
    written = first.stat().st_mtime_ns
    jaxnet.run(study, tmp_path / "out")
    assert first.stat().st_mtime_ns == written


def test_saving_more_later_keeps_the_rows(config, tmp_path):
    """`save` is not part of the study's identity; what was made of the rows stays too."""
    keys = {"sweep.topology": ["star"], "sweep.attack.magnitude": [5.5]}
    bare = jaxnet.run(jaxnet.load(config, {**keys, "save": {}}), tmp_path / "later")
    rows, mine = bare.lanes, tmp_path / "later" / "figures" / "mine.png"
    mine.parent.mkdir()
    mine.touch()
    with pytest.raises(FolderError, match=r"no errors\.zarr"):
        _ = bare.errors
    fuller = jaxnet.run(jaxnet.load(config, keys), tmp_path / "later")
    pd.testing.assert_frame_equal(fuller.lanes, rows, check_exact=True)
    assert not np.isnan(fuller.errors["tracking"].values).any()
    assert mine.exists()
    with pytest.warns(UserWarning, match="made of the rows before: figures"):
        jaxnet.run(jaxnet.load(config, {**keys, "samples": 4}), tmp_path / "later")
    assert not mine.exists()


def test_a_failed_lane_keeps_its_row(config, tmp_path):
    """With its status, NaN metrics, NaN arrays from where it failed, and is counted.

    All have failed, so none is chosen: the store of trajectories is there, and has none.
    """
    keys = {"engine": {"max_steps": 1}, "sweep": {}, "samples": 6}
    keys |= {"save.trajectories": {"worst": 1}}
    results = jaxnet.run(jaxnet.load(config, keys), tmp_path / "failing")
    assert results.trajectories["states"].shape == (0, 21, 12, 6)
    panels.panels_figure(results, results.study.cells, trajectories=True, errors=False)
    failed = results.lanes[results.lanes["status"] == "max_steps"]
    assert len(failed) == 6
    assert failed[["tail_mean", "peak_error", "min_speed"]].isna().all(axis=None)
    assert (failed["steps"] == 1).all()
    assert results.manifest["lanes"]["failed"] == len(failed) == results.cells["failed"][0]
    tracking = results.errors["tracking"].values[0]
    assert np.isnan(tracking[:, -1]).all()
    assert not np.isnan(tracking[:, 0]).any()


def test_numbers_and_distributions_swept_together(tmp_path):
    """A column of one type, rows that stay when samples are added, a study with the same cells."""
    gains = [[1, 3, 3], [{"uniform": [1, 2]}, {"uniform": [3, 4]}, {"uniform": [3, 4]}]]
    sweep = {
        "topology.navigator_weight": [{"uniform": [0.1, 0.2]}, 0.15],
        "gain": gains,
        "attack.phase.uniform": [[0, 1]],
    }
    given = {"engine": "exact", "horizon": 2.0, "tail": 1.0, "sweep": sweep}
    few = jaxnet.run(systems.study(samples=2, **given), tmp_path / "out").lanes
    study = systems.study(samples=4, **given)
    many = jaxnet.run(study, tmp_path / "out")
    with pytest.warns(UserWarning, match="begun with samples: 4, and keeps them; for samples: 2"):
        assert jaxnet.run(systems.study(samples=2, **given), tmp_path / "out").found_all
    first = many.lanes[many.lanes["sample"] < 2].reset_index(drop=True)
    pd.testing.assert_frame_equal(first, few, check_exact=True)
    weights = ['{"uniform": [0.1, 0.2]}', "0.15"]
    for table, times in ((many.lanes, 8), (many.cells, 2)):
        labels = [name for name in weights for _ in range(times)]
        assert table["topology.navigator_weight"].tolist() == labels
    assert many.lanes["tail_mean"].nunique() == 16
    assert [cell.scenario for cell in many.study.cells] == [cell.scenario for cell in study.cells]
    assert [cell.labels for cell in many.study.cells] == [cell.labels for cell in study.cells]


def test_a_run_that_the_disk_has_no_room_for_is_not_begun(config, tmp_path, monkeypatch):
    """It says how much it may need, and how much there is."""
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=1000))
    with pytest.raises(FolderError, match=r"may need \d+ MiB, and 0 MiB are free there"):
        jaxnet.run(jaxnet.load(config), tmp_path / "full")
    assert not list(tmp_path.glob("full/lanes/*"))
    more = {"samples": 10**9, "save.trajectories": "all"}  # so many numbers would be 8 GB
    monkeypatch.setattr(layout, "shards_of", None)
    for run in (jaxnet.run, partial(jaxnet.run_part, part=0, parts=2)):
        with pytest.raises(FolderError, match="are free there"):
            run(jaxnet.load(config, more), out=tmp_path / "full")


def test_a_lane_is_replayed_by_either_engine(results, tmp_path):
    """By its own it is the same to the last bit; by the other it goes the same way."""
    shutil.copytree(results.path, tmp_path / "copy")
    copy = jaxnet.open(tmp_path / "copy")
    _, own = replay(copy, 1, 2)
    assert own.equals(results.lanes.iloc[5])
    assert lane_text(copy, own).endswith("the same as the stored row")
    path, other = replay(copy, 1, 2, "nonlinear")
    assert "DIFFERS" in lane_text(copy, other)
    assert other["steps"] > own["steps"] == 0
    assert other["tail_mean"] == pytest.approx(own["tail_mean"], abs=1e-6)
    paths = xr.open_zarr(path)["states"].values[0, :, :, :2]
    np.testing.assert_allclose(
        paths, results.trajectories["states"].values[1, 2, :, :, :2], atol=1e-5
    )


def test_lanes_of_one_network_are_replayed_side_by_side(results, tmp_path, monkeypatch):
    """Cells that differ in numbers alone. Each store is that of a lane alone, to the last bit."""
    for name in ("alone", "together"):
        shutil.copytree(results.path, tmp_path / name)
    lanes = [(1, 2), (3, 0), (0, 1), (1, 0)]  # star, cyclic, star, star
    for cell, sample in lanes:
        replay(jaxnet.open(tmp_path / "alone"), cell, sample)
    sizes, simulate = [], batch.simulate_each

    def counted(batches, lanes, *rest):
        sizes.append(lanes)
        return simulate(batches, lanes, *rest)

    monkeypatch.setattr(batch, "simulate_each", counted)
    wanted = [(*lane, None) for lane in lanes]
    found = list(replay_each(jaxnet.open(tmp_path / "together"), wanted))
    assert sizes == [3, 1]
    assert {(shard.cell.number, *shard.samples) for _, shard, _ in found} == set(lanes)
    files = [path for path in (tmp_path / "alone" / "replays").rglob("*") if path.is_file()]
    assert len([path for path in files if path.parent.suffix == ".zarr"]) == len(lanes)
    for path in files:
        same = tmp_path / "together" / path.relative_to(tmp_path / "alone")
        assert path.read_bytes() == same.read_bytes(), path.name
