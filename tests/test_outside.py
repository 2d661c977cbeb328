"""Kinds from outside are what their files are, not what these are called."""

import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

import jaxnet
from jaxnet.kinds.kind import KindError
from jaxnet.outside import provenance

ROOT = Path(__file__).parents[1]
KINDS = """
from helper import FACTOR
from jaxnet.kinds.attacks.bias import Bias
from jaxnet.kinds.metrics import Metric


class Mine(Bias):
    def factor(self):
        return FACTOR


def measured(seen):
    from late import SHIFT

    return 0.0 * seen.errors() + FACTOR + SHIFT


mine = Metric("mine", "", measured)
"""
STUDY = """
name: mine
vehicles: 3
horizon: 0.2
output_step: 0.1
tail: 0.1
engine: exact
defence: none
attack: {kind: "own_kinds:Mine", vehicles: [2]}
metrics: ["own_kinds:mine"]
"""


def folder_with(path: Path, factor: float, shift: float = 0.0) -> Path:
    """A folder with a study and modules of these names, whose metric is factor + shift."""
    path.mkdir(exist_ok=True)
    (path / "own_kinds.py").write_text(KINDS)
    (path / "helper.py").write_text(f"FACTOR = {factor}\n")
    (path / "late.py").write_text(f"SHIFT = {shift}\n")
    (path / "study.yaml").write_text(STUDY)
    return path


def measured(study):
    """The metric of the study's one lane."""
    return jaxnet.simulate(study, progress=False).lanes["mine"].tolist()


def told(study):
    """What the metric of a study comes to, without a lane."""
    (metric,) = study.config.metrics
    return metric.of(SimpleNamespace(errors=lambda: 1.0))


def two_folders(home):
    """Two folders, each with a module of the same name."""
    return [folder_with(home / name, factor) for name, factor in (("one", 1.0), ("two", 2.0))]


def test_a_module_may_have_the_name_of_an_installed_package(tmp_path):
    """That of the study's folder is meant."""
    folder = folder_with(tmp_path / "here", 3.0)
    (folder / "own_kinds.py").rename(folder / "cmaes.py")
    (folder / "study.yaml").write_text(STUDY.replace("own_kinds:", "cmaes:"))
    assert measured(folder / "study.yaml") == [3.0]


def test_two_folders_may_each_have_a_module_of_one_name(tmp_path):
    """Each study simulates its own class, stores its own file's name, and has a hash of its own."""
    folders = two_folders(tmp_path)
    studies = [jaxnet.load(folder / "study.yaml") for folder in folders]
    assert [study.config.attack.factor() for study in studies] == [1.0, 2.0]
    results = [jaxnet.simulate(study, progress=False) for study in studies]
    assert [each.lanes["mine"].tolist() for each in results] == [[1.0], [2.0]]
    for folder, each in zip(folders, results, strict=True):
        files = {name: module["file"] for name, module in each.manifest["modules"].items()}
        names = ("helper", "late", "own_kinds")
        assert files == {name: str(folder / f"{name}.py") for name in names}
    assert results[0].manifest["hash"] != results[1].manifest["hash"]
    again = results[0].study.config.attack.factor()
    assert again == 1.0, "found again by its files, though loaded first"
    changed = jaxnet.load(studies[0], {"attack.magnitude": 3.0})
    assert changed.config.attack.factor() == 1.0
    assert not {"own_kinds", "helper", "late"} & set(sys.modules)
    assert str(folders[0]) not in sys.path


def test_a_module_that_a_notebook_edits_is_a_new_one(tmp_path):
    """The same for what it imports, also late; what was loaded before stays what it was."""
    folder = folder_with(tmp_path / "one", 1.0)
    before = jaxnet.load(folder / "study.yaml")
    edited = {"own_kinds": KINDS.replace("FACTOR + SHIFT", "FACTOR + 4.0 + SHIFT")}
    edited |= {"helper": "FACTOR = 5.0\n", "late": "SHIFT = 4.0\n"}
    for module, content in edited.items():
        text = (folder / f"{module}.py").read_text()
        (folder / f"{module}.py").write_text(content)
        after = jaxnet.load(folder / "study.yaml")
        assert told(after) == 5.0, module
        assert told(before) == 1.0, module
        (folder / f"{module}.py").write_text(text)
        again = jaxnet.load(folder / "study.yaml").config.attack
        assert type(again) is type(before.config.attack), module


SENT = """
import pickle, sys
from jaxnet.kinds.kind import KindError
try:
    scope, attack, (metric,) = pickle.load(sys.stdin.buffer)
    names = sorted(name for _, name in scope.known)
    print(attack.factor(), metric.of.__module__.endswith(".own_kinds"), names)
except KindError as error:
    print(error)
"""


def received(content):
    """What another process says of a study's kinds."""
    command = [sys.executable, "-c", SENT]
    done = subprocess.run(command, input=content, capture_output=True, check=True, cwd=ROOT)
    return done.stdout.decode().strip()


def test_a_worker_loads_the_file_or_refuses(tmp_path):
    """By its path; a neighbour of it that was changed meanwhile is told."""
    folder = folder_with(tmp_path / "one", 7.0)
    config = jaxnet.load(folder / "study.yaml").config
    content = pickle.dumps((config.scope, config.attack, config.metrics))
    assert received(content) == "7.0 True ['own_kinds:Mine', 'own_kinds:mine']"
    (folder / "helper.py").write_text("FACTOR = 8.0\n")
    refused = received(content)
    assert refused.startswith("own_kinds is another one in process ")
    assert refused.endswith(f"({folder / 'own_kinds.py'})")
    (folder / "own_kinds.py").unlink()
    assert "is not found by process" in received(content)


def test_a_class_handed_over_is_refused_once_its_file_has_changed(tmp_path, monkeypatch):
    """Its rows would be told to be of the new file; imported again, it is taken."""
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "handed_kinds.py"
    text = "from jaxnet.kinds.attacks.bias import Bias\n\n\n"
    text += "class Handed(Bias):\n    number = lambda self: 1\n"
    file.write_text(text)
    import handed_kinds  # pyright: ignore[reportMissingImports]

    keys = {"vehicles": 3, "attack": handed_kinds.Handed(vehicles=[2])}
    assert jaxnet.load(keys).config.attack.reference() == "handed_kinds:Handed"
    # longer, or Python would take what it has compiled
    file.write_text(text.replace("1", "2 + 20"))
    with pytest.raises(KindError, match=r"handed_kinds:Handed was changed since it was imported"):
        jaxnet.load(keys)
    del sys.modules["handed_kinds"]
    import handed_kinds  # pyright: ignore[reportMissingImports]

    again = jaxnet.load({**keys, "attack": handed_kinds.Handed(vehicles=[2])})
    assert again.config.attack.number() == 22


def test_two_modules_of_one_name_in_one_study_are_refused(tmp_path):
    """A manifest tells modules by their names."""
    studies = [jaxnet.load(folder / "study.yaml") for folder in two_folders(tmp_path)]
    first, second = (study.config.attack for study in studies)
    with pytest.raises(KindError, match="two classes are called own_kinds:Mine: rename one"):
        jaxnet.load({"sweep": {"attack": [first, second]}, "vehicles": 3})


LIBRARIES = ["zstandard", "bottleneck", "numexpr", "etils", "libtpu", "numcodecs", "cupy"]


@pytest.mark.parametrize(
    "words",
    [
        ["-m", "jaxnet"],
        pytest.param(["-c", "import jaxnet.cli as c; c.main()"], marks=pytest.mark.long),
    ],
)
def test_files_beside_a_config_shadow_no_library(tmp_path, words):
    """Whatever libraries look for, nothing is run but what the config names."""
    folder = folder_with(tmp_path / "beside", 1.0)
    marker, out = tmp_path / "marker", tmp_path / "out"
    for name in ("yaml", "click", *LIBRARIES):
        (folder / f"{name}.py").write_text(f"open({str(marker)!r}, 'w')\n")
    (folder / "own_kinds.py").write_text("import pandas as pd\n" + KINDS)
    run = [sys.executable, *words, "run", str(folder / "study.yaml"), "--out", str(out)]
    typed_there = words[0] == "-m"  # of `-c`, Python itself looks where it is typed
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    where = folder if typed_there else ROOT
    subprocess.run(run, capture_output=True, check=True, cwd=where, env=environment)
    assert not marker.exists()
    assert pd.read_parquet(out / "lanes" / "00000.parquet")["mine"].tolist() == [1.0]


def test_packages_and_relative_imports_are_found(tmp_path):
    """A package beside the config, one module of which imports another in three ways."""
    package = tmp_path / "own_package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "one.py").write_text("ONE = 1.0\n")
    (package / "kinds.py").write_text(
        "import own_package.one\nfrom . import one\n"
        "from own_package import one as same\nfrom .one import ONE\n"
        "from jaxnet.kinds.attacks.bias import Bias\n\n\n"
        "class Mine(Bias):\n"
        "    def found(self):\n        return own_package.one is one is same, ONE\n"
    )
    text = "name: one\nvehicles: 3\nattack: {kind: 'own_package.kinds:Mine', vehicles: [2]}\n"
    (tmp_path / "study.yaml").write_text(text)
    config = jaxnet.load(tmp_path / "study.yaml").config
    assert config.attack.found() == (True, 1.0)
    assert config.attack.reference() == "own_package.kinds:Mine"
    known = provenance.provenance([type(config.attack)])
    assert sorted(known) == ["own_package", "own_package.kinds", "own_package.one"]
