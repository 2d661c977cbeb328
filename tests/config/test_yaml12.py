"""Tabs of YAML 1.2, held against libyaml, which lets them separate too."""

from random import Random

import pytest
import yaml

from jaxnet.config.yaml12 import Yaml12Loader

PARTS = ["a", "b: ", "c:", "\n", "\n", "  ", "- ", "[", "]", ",", "{", "}", "'x\ty'", '"q\t"', " # c", "\t"]
PARTS += [" ", "|\n", "> \n", "\n\t", "key: v", "key:\tv", "\t\n", "? ", "&x ", "---\n", "...\n", "  - a\n"]


def events(text, loader):
    """What a text is made of, or None if it is not YAML."""
    try:
        return [(type(each), getattr(each, "value", None)) for each in yaml.parse(text, loader)]
    except yaml.YAMLError:
        return None


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML without libyaml")
def test_tabs_mean_what_they_mean_to_libyaml():
    """Wherever both take a text; whatever PyYAML took as it is means the same as before."""
    random, agreed = Random(38), 0
    for _ in range(4000):
        text = "".join(random.choice(PARTS) for _ in range(random.randint(2, 9)))
        found, theirs, before = (events(text, each) for each in (Yaml12Loader, yaml.CLoader, yaml.SafeLoader))
        assert before in (None, found), text
        if found and theirs:
            assert found == theirs, text
            agreed += "\t" in text
    assert agreed > 100
