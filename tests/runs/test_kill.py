"""A run that is killed at any moment loses nothing: the same command completes it."""

import numpy as np
import pytest

import jaxnet
from experiments import kill

pytestmark = pytest.mark.usefixtures("many_side_by_side")

STUDY = kill.STUDY | {
    "samples": 256,
    "topology": "star",
    "defence": "none",
    "sweep": {"attack.magnitude": {"linspace": [0, 10, 24]}},
}


@pytest.mark.long
def test_a_run_killed_twice_ends_as_one_left_alone(tmp_path):
    """No table is ever torn or a shard written twice, and the results are equal to the last bit."""
    config, whole, broken = kill.written(STUDY, tmp_path), tmp_path / "whole", tmp_path / "broken"
    jaxnet.run(config, whole)
    with kill.watched(broken) as reader:
        delays = np.random.default_rng(0).uniform(0.0, 0.2, 2)
        brought = [kill.run_and_kill(config, broken, delay) for delay in delays]
        _, shards = kill.run_through(config, broken)
    assert min(brought) > 0
    assert sum(brought) < shards == 24
    assert reader.reads > shards
    kill.compare(broken, whole)
