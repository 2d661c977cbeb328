"""A peer must simulate the same as jaxnet, and each script of the races must at least start."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.benchmarks import launches, peers, row
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


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.long] * (name != "scipy dense")) for name in PEERS],
)
def test_a_peer_simulates_the_same_lane(name, attacked):
    """Within what its tolerances allow, 1e-5 m."""
    try:
        positions = PEERS[name](attacked)
    except peers.NotInstalledError as program:
        pytest.skip(f"{program}: not on this machine")
    assert positions.shape == (1, 31, 4, 2)
    assert peers.greatest_error(attacked, positions) < 1e-5


@pytest.mark.long
@pytest.mark.parametrize("what", ["heyoka", "numba"])
def test_a_compiled_peer_simulates_the_same_lanes(what):
    """Within what its tolerances allow, in a process of its own as in the race."""
    keys = {"attack": "rotating", "defence": "none", "horizon": 3.0, "tail": 1.0}
    found = row.apart({"what": what, "keys": keys, "lanes": 12, "checked": 4})
    if "missing" in found:
        pytest.skip(f"{found['missing']}: not on this machine")
    assert found["error"] < 1e-5


@pytest.mark.long
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
@pytest.mark.parametrize("script", ["commands", "speed", "scaling", "memory", "launches", "row"])
def test_a_script_says_what_it_does(script):
    """Under `--help`, with its question or task first."""
    command = [sys.executable, BENCHMARKS / f"{script}.py", "--help"]
    path = os.pathsep.join(sys.path)
    shown = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True
    )
    assert shown.returncode == 0, shown.stderr
    assert "usage" in shown.stdout


def test_launches_and_bytes_of_a_program_are_counted():
    """Numbers with 8 bytes are read and written once by a kernel; a slice counts as the slice."""
    lanes = jnp.zeros((64, 1000))

    def counted(function, *given, passes=None):
        return launches.Program(jax.jit(function).lower(*given).compile().as_text(), passes)

    whole = counted(lambda x: jnp.sin(x) * 2, lanes).work()
    assert whole == launches.Work(1, 0, 2 * 8 * 64_000, 2 * 64_000)
    part = counted(lambda x, n: 2 * jax.lax.dynamic_slice_in_dim(x, n, 1), lanes, 3).work()
    assert part.launches == 1
    assert 0 <= part.moved - 2 * 8 * 1000 <= 8  # and the place of the slice

    def halve(_, x):
        return 0.5 * jnp.sort(x, axis=0)

    known = counted(lambda x: jax.lax.fori_loop(0, 5, halve, x), lanes)
    assert known.counts() == {
        "known loops": 1,
        "other loops": 0,
        "conditional": 0,
        "sort": 1,
        "scatter": 0,
        "custom-call": 0,
    }
    assert known.work().flags == 0
    other = counted(lambda x, n: jax.lax.fori_loop(0, n, halve, x), lanes, 5)
    assert other.counts()["other loops"] == 1
    assert other.work().flags == 2
    once = other.work(*next(each for each in other.all if each.op == "while").calls("body"))
    assert 5 * once.launches <= known.work().launches <= other.work().launches + 4 * once.launches
