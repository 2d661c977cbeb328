"""A metric with keys from outside, which is one file, and metrics of jaxnet with keys."""

import json
import pickle
import sys

import numpy as np
import pytest

import jaxnet
from jaxnet.config.document import ConfigError
from jaxnet.config.schema import config_schema
from jaxnet.kinds import registry

# Distance of the farthest vehicle from a place, and how long it is beyond a length.
MODULE = """
from jaxnet.kinds.fields import setting
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.metrics import MetricKeys, Metric, of_fleet
from jaxnet.model.plane import length


class FarFrom(MetricKeys):
    place: list[float] = setting([0.0, 0.0], "[m], the place")
    beyond: float = setting(1.0, "[m], the length", gt=0)

    def words(self):
        return f"outputs with a vehicle over {self.beyond:g} m from {self.place}"

    def faults(self, scenario):
        if len(self.place) != 2:
            yield Fault(("metrics",), "far_from: a place has two coordinates")

    def __call__(self, seen):
        xp = seen.error.__array_namespace__()
        away = length(seen.state[:2] - xp.asarray(self.place)[:, None, None])
        return of_fleet(seen, (away.max(axis=0) > self.beyond).astype(float))


far_from = Metric("far_from", "", FarFrom(), time="sum")
"""
KEYS = {"kind": "near_kinds:far_from", "place": [20.0, 0.0], "beyond": 200.0}
STUDY = {"engine": "exact", "vehicles": 3, "defence": "none", "horizon": 1.0, "tail": 0.5}
STUDY |= {"save": {"trajectories": "all"}, "attack": "none", "metrics": [KEYS]}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "near_kinds.py").write_text(MODULE)
    (tmp_path / "study.yaml").write_text(json.dumps(STUDY | {"name": "near"}))  # JSON is YAML
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_keys_from_outside_count_as_they_say(folder):
    results = jaxnet.simulate(folder / "study.yaml", samples=8, progress=False)
    places = results.trajectories["states"].values[0, ..., :2]
    away = np.linalg.norm(places - [20.0, 0.0], axis=-1).max(axis=-1)
    expected = (away > 200.0).sum(axis=1)
    assert 0 < expected.sum() < expected.size * 11
    np.testing.assert_array_equal(results.lanes["far_from"], expected)
    assert (
        results.study.config.metrics[0].words
        == "outputs with a vehicle over 200 m from [20.0, 0.0]"
    )


def test_keys_are_stored_changed_sent_and_looked_at_without_code(folder, monkeypatch):
    study = jaxnet.load("study.yaml")
    again = jaxnet.load(study, {"samples": 2})
    assert again.config.model_dump(mode="json")["metrics"] == [KEYS]
    assert pickle.loads(pickle.dumps(again.config.metrics)) == again.config.metrics
    bare = jaxnet.load(study, {"metrics": ["near_kinds:far_from"]}).config.metrics[0]
    assert bare.keys == {"place": [0.0, 0.0], "beyond": 1.0}
    jaxnet.run("study.yaml", "results", progress=False)
    (folder / "near_kinds.py").unlink()
    registry.LOADED.clear()
    opened = jaxnet.open("results")
    assert opened.missing == ["near_kinds:far_from"]
    assert opened.study.config.model_dump(mode="json")["metrics"] == [KEYS]
    assert opened.study.config.metrics[0].words.startswith("outputs with a vehicle over 200 m")


def test_a_script_passes_a_metric_with_keys(folder, monkeypatch):
    from jaxnet.kinds.metrics.settling_time import SETTLING_TIME

    monkeypatch.syspath_prepend(folder)
    import near_kinds  # pyright: ignore[reportMissingImports]

    given = [near_kinds.far_from.with_keys(beyond=2.0), SETTLING_TIME.with_keys(below=0.2)]
    config = jaxnet.load(STUDY | {"metrics": given}).config
    assert config.metrics == given
    assert [each.keys for each in jaxnet.load(config.model_dump()).config.metrics] == [
        {"place": [0.0, 0.0], "beyond": 2.0},
        {"below": 0.2, "fraction": None, "of": "mean"},
    ]
    del sys.modules["near_kinds"]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"beyond": -1.0}, r"study.yaml:1:\d+: metrics.0.beyond: must be greater than 0 \(got -1"),
        ({"beyonds": 1.0}, r"metrics.0.beyonds: unknown key \(did you mean 'beyond'\?\)"),
        ({"place": [0.0]}, r"metrics: far_from: a place has two coordinates"),
    ],
)
def test_wrong_keys_from_outside_are_told_where_they_are(folder, wrong, told):
    (folder / "study.yaml").write_text(json.dumps(STUDY | {"name": "n", "metrics": [KEYS | wrong]}))
    with pytest.raises(ConfigError, match=told):
        jaxnet.load("study.yaml")


def test_the_schema_has_the_keys_of_each_metric():
    found = config_schema()["$defs"]
    assert {"$ref": "#/$defs/SettlingTime"} in found["metrics"]["anyOf"]
    for name, model in registry.models("metrics").items():
        known = found[model.__name__]["properties"]
        assert known.keys() == {"kind", "name", *registry.find("metrics", name).keys}
        assert all("description" in each for key, each in known.items() if key != "kind")
