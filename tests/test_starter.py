"""`jaxnet init`: what it writes loads, says what its keys mean, and offers every kind that needs no key."""

import pytest

import jaxnet
from jaxnet.config import starter
from jaxnet.config.document import ConfigError
from jaxnet.kinds import registry

PAIRS = [(family, name) for family in starter.ASKED_FAMILIES for name in starter.kinds_without_keys(family)]


@pytest.mark.parametrize(("family", "name"), PAIRS)
def test_what_is_written_loads(tmp_path, family, name):
    """Of every kind offered; the first line is the command that runs it."""
    file = tmp_path / "my study.yaml"
    answers = {family: name, "samples": 7, "vehicles": 5}
    with pytest.raises(ConfigError, match="must be a plain file name"):
        starter.starter_config(str(file), answers)
    file = tmp_path / "mine.yaml"
    file.write_text(starter.starter_config(str(file), answers))
    study = jaxnet.load(file)
    assert file.read_text().splitlines()[0] == f"# jaxnet run {file}"
    assert study.config.name == "mine"
    assert (study.config.samples, study.config.vehicles) == (7, 5)
    assert getattr(study.config, family).reference() == name
    model = registry.find(family, name)
    given = getattr(study.config, family)
    expected = model(**({"vehicles": [2, 5]} if "vehicles" in model.model_fields else {}))
    assert given == expected


def test_kinds_are_offered_by_the_registry(monkeypatch):
    """A new one too, and not those that need more than a name."""
    needing = {"circulant", "edges", "file", "grid", "switching"}
    assert set(registry.kind_names("topology")) - set(starter.kinds_without_keys("topology")) == needing
    names, find = registry.kind_names, registry.find
    monkeypatch.setattr(registry, "kind_names", lambda family: [*names(family), "theirs"])
    monkeypatch.setattr(
        registry, "find", lambda family, name: find(family, "none" if name == "theirs" else name)
    )
    assert "theirs" in starter.kinds_without_keys("defence")


def test_comments_are_those_of_the_models():
    """Units and meanings; lines that are too long have them above."""
    text = starter.starter_config("s.yaml", {})
    assert "  frequency: 0.7                # [rad/s], of the turning\n" in text
    above = "falsified each on its own also a list, one for each order from 0; orders beyond it are true"
    assert f"  #   {above}\n  magnitude: 5.0\n" in text
    assert max(map(len, text.splitlines())) <= starter.LINE_LENGTH


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        ({"attack": "bais"}, "s.yaml: attack: must be one of bias"),
        ({"topology": "edges"}, "s.yaml: topology: edges needs edges"),
        ({"topology": "figure1"}, "vehicles: figure1 has 5 vehicles"),
        ({"magnitudes": [-1.0]}, "must be at least 0"),
    ],
)
def test_answers_that_cannot_be_are_refused(answers, words):
    """With the key, what was given and what is allowed."""
    with pytest.raises(ConfigError, match=words):
        starter.starter_config("s.yaml", answers)
