"""A peer must simulate the same as jaxnet, and each script of the races must at least start."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from experiments.benchmarks import peers, row
from jaxnet.engine import batch
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from tests import systems

BENCHMARKS = Path(peers.__file__).parent
PEERS = {
    "scipy dense": peers.with_scipy,
    "scipy structured": lambda lanes: peers.with_scipy(lanes, dense=False),
    "diffrax dense": peers.with_diffrax,
    "diffrax structured": lambda lanes: peers.with_diffrax(lanes, dense=False),
    "octave dense": peers.with_octave,
}


@pytest.fixture(scope="module")
def attacked():
    """A lane whose graph, gain and attack have no symmetry to hide behind."""
    edges = [[1, 0, 1], [2, 0, 1], [2, 1, 3], [3, 2, 1], [3, 4, 2], [4, 3, 1], [4, 1, 2]]
    (cell,) = systems.study(
        vehicles=4,
        topology={"kind": "edges", "edges": edges},
        gain=[6, 11, 6],
        attack={"kind": "rotating", "vehicles": [1, 3]},
        defence="none",
        horizon=3.0,
        tail=1.0,
    ).cells
    return job(cell.scenario, Keyed(0), [0])


@pytest.mark.parametrize("name", PEERS)
def test_a_peer_simulates_the_same_lane(name, attacked):
    """Within what its tolerances allow, 1e-5 m."""
    try:
        positions = PEERS[name](attacked)
    except peers.NotInstalledError as program:
        pytest.skip(f"{program}: not on this machine")
    assert positions.shape == (1, 31, 4, 2)
    assert peers.greatest_error(attacked, positions) < 1e-5


@pytest.mark.parametrize("what", ["heyoka", "numba"])
def test_a_compiled_peer_simulates_the_same_lanes(what):
    """Within what its tolerances allow, in a process of its own as in the race."""
    keys = {"attack": "rotating", "defence": "none", "horizon": 3.0, "tail": 1.0}
    found = row.apart({"what": what, "keys": keys, "lanes": 12, "checked": 4})
    if "missing" in found:
        pytest.skip(f"{found['missing']}: not on this machine")
    assert found["error"] < 1e-5


def test_the_nonlinear_loop_by_hand_simulates_the_same_lanes():
    """Within what its tolerances allow, 1e-5 m, on the ring of the default study."""
    (cell,) = systems.study(attack="none", defence="none").cells
    lanes = job(cell.scenario, Keyed(0), range(3))
    try:
        positions = peers.nonlinear_by_hand(lanes)
    except peers.NotInstalledError as program:
        pytest.skip(f"{program}: not on this machine")
    assert positions.shape == (3, 301, 12, 2)
    assert peers.greatest_error(lanes, positions) < 1e-5


@pytest.mark.long
@pytest.mark.usefixtures("many_side_by_side")
def test_the_loop_by_hand_simulates_the_same_study():
    """Mean tail error and share over 0.1 m of 4,096 lanes each, within four standard errors."""
    (cell,) = systems.study(attack="rotating", defence="trusted_trim", engine="exact").cells
    lanes = job(cell.scenario, Keyed(0), range(4096))
    try:
        theirs = peers.by_hand(lanes)
    except peers.NotInstalledError as program:
        pytest.skip(f"{program}: not on this machine")
    ours = batch.simulate(lanes).metrics["tail_mean"]
    noise = np.sqrt(2 / 4096)
    assert abs(ours.mean() - theirs.tail_mean) < 4 * noise * ours.std()
    assert abs((ours > 0.1).mean() - theirs.share) <= 4 * noise * (ours > 0.1).std()


@pytest.mark.long
@pytest.mark.parametrize("script", ["commands", "speed", "scaling", "memory", "row"])
def test_a_script_says_what_it_does(script):
    """Under `--help`, with its question or task first."""
    command = [sys.executable, BENCHMARKS / f"{script}.py", "--help"]
    path = os.pathsep.join(sys.path)
    shown = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True
    )
    assert shown.returncode == 0, shown.stderr
    assert "usage" in shown.stdout
