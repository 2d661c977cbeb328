"""A study of 6,000 vehicles is checked, and lanes are drawn, without an array of their square."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

VEHICLES = 6_000
PROGRAM = """
import json, sys, tracemalloc
import jaxnet
from jaxnet.lanes.jobs import job, source_of
from jaxnet.view.text import check

def peak_of(topology):
    keys = {"samples": 2, "engine": "exact", "attack": {"kind": "rotating", "magnitude": 10}}
    tracemalloc.start()
    study = jaxnet.load({"vehicles": int(sys.argv[1]), "topology": topology, **keys})
    text, scenario = check.check_text(study), study.cells[0].scenario
    weights = job(scenario, source_of(study.config, scenario), range(2)).inputs.lane.weights
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak, text, weights.shape, weights.sum()

print(json.dumps(peak_of(json.loads(sys.argv[2]))))
"""  # by itself, for with types checked it takes a minute


@pytest.mark.long
def test_memory_grows_with_links_and_not_with_the_square_of_vehicles():
    """At its peak, Python and NumPy together, it is under a byte for each pair of vehicles."""
    lattice = {"kind": "lattice", "weighting": "metropolis", "navigator": {"share": 0.5}}
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    words = [sys.executable, "-c", PROGRAM, str(VEHICLES), json.dumps(lattice)]
    done = subprocess.run(words, env=environment, check=True, capture_output=True, text=True)
    peak, text, shape, total = json.loads(done.stdout)
    assert peak < VEHICLES**2
    assert f"{VEHICLES:,} vehicles" in text
    assert shape == [2, 5, VEHICLES]
    assert total == pytest.approx(2 * VEHICLES)
