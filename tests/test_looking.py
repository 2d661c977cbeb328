"""Results of a stranger: looked at without running what they name."""

import io
import json
import pickle
import re
import shutil
import sys
import zlib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from click.testing import CliRunner
from upath import UPath

import jaxnet
from jaxnet.cli import main
from jaxnet.kinds import registry
from jaxnet.runs import shards
from jaxnet.store import arrays
from jaxnet.store.folder import FolderError
from jaxnet.store.rows import TornError, read_rows

KINDS = """
import numpy as np
from jaxnet.kinds.attacks.bias import Bias
from jaxnet.kinds.defences.trusted_trim import TrustedTrim
from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.metrics import Metric


class Mine(Bias):
    strength: float = 2.0

    def describe(self):
        return f"mine of {self.strength}"


class Rule(TrustedTrim):
    theta: int = 1


class Line(Graph):
    def weights(self, vehicles):
        return np.eye(vehicles, vehicles + 1)


speed = Metric("speed", "m/s", lambda seen: abs(seen.speed), words="greatest speed")
"""
STUDY = """
name: stranger
vehicles: 3
samples: 2
horizon: 0.4
output_step: 0.1
tail: 0.2
engine: exact
topology: "their_kinds:Line"
attack: {kind: "their_kinds:Mine", vehicles: [2], strength: 3.0}
metrics: ["their_kinds:speed"]
recovery: {tau: 0.01, worst: 1}
save: {errors: true}
sweep:
  defence: ["their_kinds:Rule", none]
  attack.magnitude: [1, 10]
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A stranger's results, beside whose study a module leaves a marker when it is run."""
    home = tmp_path_factory.mktemp("stranger")
    (home / "their_kinds.py").write_text(KINDS)
    (home / "study.yaml").write_text(STUDY)
    jaxnet.run(home / "study.yaml", home / "results", progress=False)
    marker = home / "marker"
    (home / "results" / "their_kinds.py").write_text(
        f"import pathlib\n\npathlib.Path({str(marker)!r}).touch()\n{KINDS}"
    )
    (home / "their_kinds.py").rename(home / "kept.py")
    return home / "results"


@pytest.fixture
def results(made, tmp_path, monkeypatch):
    """A copy, in a process that has not run the study; the folder is where the command is typed."""
    registry.LOADED.clear()
    (made.parent / "marker").unlink(missing_ok=True)
    shutil.copytree(made, tmp_path / "results")
    monkeypatch.chdir(tmp_path / "results")
    yield tmp_path / "results"
    assert not (made.parent / "marker").exists(), "its code was run"


def rewrite(name, change):
    """Change a file of JSON or YAML: a function of its content, or the new content."""
    load, dump = (yaml.safe_load, yaml.dump) if name == "study.yaml" else (json.loads, json.dumps)
    content = load(Path(name).read_text())
    Path(name).write_text(dump(change(content) if callable(change) else change))


def said(*words, status=0):
    """What a command prints."""
    done = CliRunner().invoke(main, list(map(str, words)))
    assert done.exit_code == status, (done.output, done.exception)
    return done.output


def one_line(*words):
    """The one line by which a command refuses."""
    lines = said(*words, status=2).splitlines()
    assert len(lines) == 1, lines
    return lines[0]


def test_looking_needs_no_code(results, tmp_path, monkeypatch):
    """Tables, lists, a comparison, an export, figures and fits, by what is stored."""
    assert "their_kinds" not in sys.modules
    table = said("show", ".")
    assert "Rule" in table
    assert len(table.splitlines()) >= 5
    assert "results" in said("list", tmp_path)
    assert "they are the same study" in said("compare", ".", ".", "--out", tmp_path / "compared")
    assert "wrote results.mat" in said("export", ".", "--mat")
    assert "tails.png" in said("figure", ".", "tails")
    opened = jaxnet.open(".")
    assert opened.lanes["speed"].gt(0).all()
    assert opened.errors["tracking"].shape == (4, 2, 5)
    assert opened.missing == [f"their_kinds:{name}" for name in ("Line", "Mine", "Rule", "speed")]
    attack = opened.study.cells[1].scenario.attack
    known = attack.reference(), attack.strength, attack.amplitude()
    assert known == ("their_kinds:Mine", 3.0, 10)


def test_what_needs_code_says_what_brings_it(results):
    """A replay, a film and a figure of networks, in one line each."""
    for words in (["replay", "."], ["animate", "."]):
        line = one_line(*words, "--cell", 0, "--sample", 0)
        assert line.startswith("the code of their_kinds:Line, their_kinds:Mine, their_kinds:Rule,")
        assert "--config FILE" in line
        assert "--trust" in line
    refused = one_line("figure", ".", "topologies")
    assert refused.startswith("the code of their_kinds:Line is needed")
    config = jaxnet.open(".").study.config
    for ask in (config.attack.describe, lambda: config.topology.weights(3)):
        with pytest.raises(jaxnet.KindError, match="is needed, and none is run because"):
            ask()


def test_the_page_is_made_without_code(results, monkeypatch):
    """And says what it leaves out."""
    from jaxnet.view import page

    page.write_page(jaxnet.open("."))
    text = Path("report.html").read_text()
    assert {"Summary", "What was run", "Left out"} <= set(re.findall("<h2>(.*?)</h2>", text))
    assert "the code of their_kinds:Line, their_kinds:Mine" in text


@pytest.mark.filterwarnings("always:bounds that need it")
def test_a_fit_without_code_after_one_with_it_prints_its_table(results, made, tmp_path):
    """And warns, as in a fresh folder."""
    home = tmp_path / "home"
    home.mkdir()
    shutil.copy(made.parent / "kept.py", home / "their_kinds.py")
    (home / "study.yaml").write_text(STUDY)
    with_code = said("fit", ".", "--config", home / "study.yaml")
    assert "violations.csv" in with_code
    registry.LOADED.clear()
    assert jaxnet.open(".").missing != []
    without = said("fit", ".")
    assert "warning: bounds that need it are left out" in without
    assert "mean error" in without
    assert "violations.csv" not in without


def test_the_config_s_place_or_trust_brings_the_code(results, made, monkeypatch):
    """From there a lane is simulated again as it was."""
    home = made.parent / "home"
    home.mkdir(exist_ok=True)
    shutil.copy(made.parent / "kept.py", home / "their_kinds.py")
    (home / "study.yaml").write_text(STUDY)
    again = said("replay", ".", "--cell", 1, "--sample", 1, "--config", home / "study.yaml")
    assert "the same as the stored row" in again
    wrong = one_line("replay", ".", "--cell", 0, "--sample", 0, "--config", "no")
    assert "there is no such config" in wrong
    assert jaxnet.open(".", config=home).missing == []
    registry.LOADED.clear()
    assert jaxnet.open(".").missing != []
    with pytest.warns(UserWarning, match="their_kinds was changed since the rows"):
        assert jaxnet.open(".", trust=True).missing == []
    (made.parent / "marker").unlink()


@pytest.mark.parametrize(
    "named", ["os:system", "their_kinds:Mine", "/their_kinds:Mine", "..their_kinds:Mine"]
)
def test_whatever_a_study_names_is_a_name(named, results):
    """Modules beside it, of Python, at a path: shown, not imported."""
    rewrite("study.yaml", lambda study: study | {"attack": {"kind": named, "vehicles": [2]}})
    rewrite("manifest.json", lambda manifest: manifest | {"kinds": {}, "modules": {}})
    assert named in jaxnet.open(".").missing
    assert "Rule" in said("show", ".")
    assert one_line("replay", ".", "--cell", 0, "--sample", 0).startswith("the code of ")


class Bomb:
    """Leaves a marker when it is unpickled."""

    def __init__(self, marker):
        self.marker = str(marker)

    def __reduce__(self):
        return open, (self.marker, "w")


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"samples": "many"}, 'samples is "many"'),
        ({"samples": 10**12}, "samples is 1000000000000"),
        ({"samples": -1}, "samples is -1"),
        ({"shard_size": 0}, "shard_size is 0"),
        ({"lanes": {"total": 1}}, 'lanes is {"total": 1}'),
        ({"modules": {"their_kinds": "../x"}}, 'modules.their_kinds is "../x"'),
        ([], "it is no mapping"),
    ],
)
def test_a_manifest_is_told(change, wrong, results):
    """In a line, whichever command reads it."""
    rewrite("manifest.json", lambda manifest: manifest | change if change else change)
    assert one_line("show", ".") == f"manifest.json: not a manifest of ours: {wrong}"
    assert "unfinished" in said("list", ".")


def test_a_study_that_was_edited_is_told(tmp_path):
    """Its rows are those of another study, and bounds that hold for it do not hold for them."""
    keys = {"name": "x", "samples": 2, "horizon": 0.4, "output_step": 0.1, "tail": 0.2}
    made = jaxnet.run(keys | {"engine": "exact"}, tmp_path / "x", progress=False)
    file = tmp_path / "x" / "study.yaml"
    file.write_text(file.read_text().replace("horizon: 0.4", "horizon: 0.5"))
    told = "is not the study whose rows the folder holds: it was edited since"
    assert one_line("fit", made.path).endswith(told)


@pytest.mark.parametrize("content", ["", "one,two\n1,2\n", None])
def test_a_table_that_is_not_ours_is_told(content, results):
    """Also a folder in its place."""
    Path("cells.csv").unlink()
    if content is None:
        Path("cells.csv").mkdir()
    else:
        Path("cells.csv").write_text(content)
    assert "cells.csv is not a table of ours" in one_line("show", ".")


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"codecs": [{"name": "numcodecs.pickle"}]}, 'codecs.0.name is "numcodecs.pickle"'),
        ({"codecs": ["json2"]}, 'codecs.0 is "json2"'),
        ({"data_type": "object"}, 'data_type is "object"'),
        ({"data_type": {"name": "numpy.void"}}, 'data_type is {"name": "numpy.void"}'),
        ({"shape": [10**12]}, "too large: [1000000000000]"),
        ({"shape": ["a"]}, 'shape.0 is "a"'),
        ({"zarr_format": 2}, "zarr_format is 2"),
    ],
)
def test_an_array_unlike_ours_is_not_read(change, wrong, results):
    """Its own metadata say so, whatever those of all together say, which nothing reads."""
    rewrite("errors.zarr/time/zarr.json", lambda metadata: metadata | change)
    with pytest.raises(FolderError, match="no array of ours: it.* " + re.escape(wrong)):
        _ = jaxnet.open(".").errors
    assert arrays.open_for_writing(jaxnet.open(".").path / "errors.zarr") is None


def test_a_store_of_version_2_is_not_read(results, made):
    """It may name codecs that unpickle."""
    store = Path("errors.zarr")
    shutil.rmtree(store)
    store.mkdir()
    (store / ".zgroup").write_text('{"zarr_format": 2}')
    (store / "time").mkdir()
    pickled = {"zarr_format": 2, "shape": [1], "chunks": [1], "dtype": "|O", "fill_value": None}
    pickled |= {"order": "C", "compressor": None, "filters": [{"id": "pickle", "protocol": 5}]}
    (store / "time" / ".zarray").write_text(json.dumps(pickled))
    (store / "time" / "0").write_bytes(pickle.dumps([Bomb(made.parent / "marker")]))
    for words in (["export", ".", "--mat"], ["figure", ".", "bands"]):
        assert "errors.zarr is no store of ours: it has no zarr.json" in one_line(*words)


def test_pickled_arrays_are_not_read(made, results):
    """Beside rows, with the checksum that their stamp has."""
    content = io.BytesIO()
    np.savez(content, tracking=np.array([Bomb(made.parent / "marker")], dtype=object))
    Path("lanes/00000.npz").write_bytes(content.getvalue())
    stamp = read_rows(jaxnet.open(".").path / "lanes/00000.parquet")[1]
    stamp = stamp._replace(checksums={"npz": zlib.crc32(content.getvalue())})
    unread = dict.fromkeys(shards.Assignment._fields)
    given = unread | {"folder": jaxnet.store.folder.Folder(".")}
    work = shards.Assignment(**given)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TornError, match="cannot be read"):
        shards.read_beside(work, jaxnet.open(".").shards[0], stamp)


COLUMNS = {"cell": [0, 0], "sample": [0, 1], "status": ["ok", "ok"], "tail_mean": [1.0, 2.0]}


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"cell": ["a", "b"]}, "its column cell holds string"),
        ({"more": [{"a": 1}, {"a": 2}]}, "its column more holds struct<a: int64>"),
        ({"more": [b"x", b"y"]}, "its column more holds binary"),
        ({"status": None}, "it has no column status"),
    ],
)
def test_rows_unlike_ours_are_not_read(change, wrong, results):
    """Types that no row of ours has; and columns that are missing."""
    columns = {name: each for name, each in {**COLUMNS, **change}.items() if each is not None}
    pq.write_table(pa.table(columns), "lanes/00000.parquet")
    with pytest.raises(TornError, match=re.escape(wrong)):
        read_rows(UPath("lanes/00000.parquet"))
    assert wrong in one_line("figure", ".", "tails")


def test_metadata_of_rows_run_nothing(made, results):
    """A pickled type, as pyarrow once had them, and what pandas would make of its own."""
    bomb = pickle.dumps(Bomb(made.parent / "marker"))
    kind = {"ARROW:extension:name": "arrow.py_extension_type", "ARROW:extension:metadata": bomb}
    table = pq.read_table("lanes/00000.parquet")
    place = table.schema.get_field_index("steps")
    schema = table.schema.set(place, table.schema.field(place).with_metadata(kind))
    pandas = '{"index_columns": ["cell"], "columns": [{"name": "x"}], "column_indexes": []}'
    schema = schema.with_metadata({**(table.schema.metadata or {}), "pandas": pandas})
    pq.write_table(pa.table(table.columns, schema=schema), "lanes/00000.parquet")
    assert list(jaxnet.open(".").lanes.columns[:3]) == ["cell", "sample", "defence"]


HTML = '</script><script>alert(1)</script>"><img src=x onerror=alert(1)>'


def test_nothing_of_results_becomes_html(results, tmp_path, monkeypatch):
    """Labels, the words of kinds, statuses, metrics, versions and the folder's name."""
    from jaxnet.view import page

    def hostile_study(study):
        study["attack"] |= {"label": HTML, "kind": HTML + ":x"}
        labels = (HTML, HTML + "2")
        study["sweep"]["defence"] = [{"kind": "none", "label": each} for each in labels]
        return study

    def hostile_manifest(manifest):
        manifest["versions"][HTML], manifest["lanes"]["failed"] = HTML, 1
        return manifest | {"device": HTML, "seed": 0}

    rewrite("study.yaml", hostile_study)
    rewrite("manifest.json", hostile_manifest)
    table = pq.read_table("lanes/00000.parquet")
    place = table.column_names.index("status")
    table = table.set_column(place, "status", pa.array([HTML] * len(table)))
    pq.write_table(table, "lanes/00000.parquet")
    hostile = tmp_path / re.sub("/", "_", HTML)
    shutil.copytree(".", hostile)
    page.write_page(jaxnet.open(hostile))
    said("compare", hostile, hostile, "--out", tmp_path / "compared")
    for file in (hostile / "report.html", tmp_path / "compared" / "compare.html"):
        text = file.read_text()
        assert "onerror=alert" in text, "it is shown"
        assert "<img src=x" not in text
        assert "<script>alert" not in text


def test_a_folder_in_the_place_of_rows_is_told(results):
    """It cannot be simulated again either."""
    row_file = next(Path("lanes").glob("*.parquet"))
    row_file.unlink()
    row_file.mkdir()
    with pytest.raises(FolderError, match=r"is a folder, where a file of rows is due$"):
        read_rows(UPath(row_file.absolute()))


def test_a_manifest_that_is_too_deep_is_told(results):
    """Instead of a traceback of Python's."""
    Path("manifest.json").write_text("[" * 100_000)
    assert "not a manifest" in one_line("show", ".")


def test_a_tag_in_a_study_is_told(results):
    """None of them makes an object."""
    tag = "seed: !!python/object/apply:os.getcwd []"
    Path("study.yaml").write_text(Path("study.yaml").read_text().replace("seed: 0", tag))
    told = "the tag tag:yaml.org,2002:python/object/apply:os.getcwd has no meaning here"
    assert told in one_line("show", ".")
