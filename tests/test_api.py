"""A study is loaded from a file or from a mapping."""

import pytest

import jaxnet
from jaxnet.config.document import ConfigError


def test_a_mapping_is_read_like_a_file(tmp_path):
    """The same keys, the same cells; a sweep keeps its order."""
    keys = {"name": "one", "samples": 2, "sweep": {"topology": ["path", "star"], "attack.magnitude": [1, 2]}}
    file = tmp_path / "one.yaml"
    file.write_text("name: one\nsamples: 2\nsweep:\n  topology: [path, star]\n  attack.magnitude: [1, 2]\n")
    assert jaxnet.load(keys, {"seed": 3}) == jaxnet.load(file, ["seed=3"])
    assert jaxnet.load({}).config.name == "study"


def test_what_is_wrong_in_a_mapping_is_said():
    """As of a file."""
    with pytest.raises(ConfigError, match=r"study:2:1: horizn: unknown key \(did you mean 'horizon'"):
        jaxnet.load({"horizn": 3})
