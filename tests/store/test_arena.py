"""The script for the arena drives robots as jaxnet does, from wherever they start."""

import ast
import runpy
import sys
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner

import jaxnet
from jaxnet import FolderError
from jaxnet.api.writing import write_robotarium
from jaxnet.cli import main
from jaxnet.store import arena
from tests import systems

STEP = 0.033
BASE = {
    "vehicles": 6,
    "vehicle": "robotarium",
    "engine": {"kind": "sampled", "move": "euler"},
    **systems.clock(STEP, 60 * STEP, STEP),
    "law": "local",
    "gain": [1.0],
    "navigator": "none",
    "topology": {"kind": "circulant", "offsets": [1, 2, -1]},
    "initial": {"position": {"uniform": [-0.5, 0.5]}},
    **systems.QUIET,
    "save": {"trajectories": "all"},
}
DRAWN = {"uniform": [0.5, 4.0]}
CIRCLE = {"kind": "circle", "radius": 0.4, "turn_rate": 0.3, "phase": DRAWN}
LEADER = {"navigator": {"kind": "lissajous", "amplitude": [0.8, 0.4], "frequency": [0.3, 0.6]}}
SPARED = {"trusted": {1: [2], 4: [5, 6]}}


def attack(kind, **keys):
    return {"attack": {"kind": kind, "vehicles": [2, 5], "magnitude": 0.3, **keys}}


def loss(kind, **keys):
    return {"channel": {"loss": {"kind": kind, **keys}}}


TOGETHER = {
    **attack("rotating", frequency={"each": DRAWN}),
    **loss("gilbert_elliott", fail=0.2, recover=0.5),
    **LEADER,
    "defence": {"kind": "trusted_trim", **SPARED},
    "formation": CIRCLE,
}
FILTERED = {
    **attack("sinusoid"),
    "initial": {"position": {"uniform": [-0.2, 0.2]}},
    "filter": {"kind": "barrier", "form": "halves", "distance": 0.4},
    "defence": {"kind": "w_msr", "F": 1},
    "formation": CIRCLE,
}
ALONE = {
    "filter": {"filter": {"kind": "barrier", "form": "halves", "speed": None, "power": 1}},
    "together, without a navigator": {
        "attack": {"kind": "own_path", "vehicles": {"random": 1}, "swing": [0.3, 0.2]},
        **loss("bernoulli", probability=0.4),
        "defence": {"kind": "w_msr", "F": 1},
        "formation": {"kind": "offsets", "offsets": [[0.1 * i, -0.05 * i] for i in range(6)]},
        "law": {"kind": "local", "hold": False},
    },
    "nothing": {},
    "bias": attack("bias", direction={"each": DRAWN}),
    "rotating": attack("rotating", frequency=DRAWN),
    "sinusoid": attack("sinusoid", listeners="each"),
    "own path": attack("own_path", centre=[0.5, 0.5], swing=[0.0, 0.0]),
    "own path of a link from the navigator": {
        **attack("own_path", swing=[0.2, 0.1], links="navigator"),
        **LEADER,
    },
    "replaced": {**attack("bias", threat="replaces", vehicles={"random": 2}), **LEADER},
    "sybils": attack("rotating", sybils=2),
    "trusted_only": {**attack("bias"), "defence": {"kind": "trusted_only", **SPARED}},
    "trusted_trim": {
        **attack("bias"),
        "defence": {"kind": "trusted_trim", "theta": {1: 1, 4: 1}, "tolerance": 0.01, **SPARED},
    },
    "w_msr": {**attack("bias"), "defence": {"kind": "w_msr", "drop_trusted": True, **SPARED}},
    "bernoulli": loss("bernoulli", probability=0.3, of="transmitter"),
    "gilbert_elliott": loss("gilbert_elliott", fail={"uniform": [0.1, 0.5]}, recover=0.3),
    "jamming": loss("jamming", starts=2, seconds=0.5, intervals=[[0.1, 0.3]]),
    "circle": {"formation": CIRCLE},
    "line": {"formation": {"kind": "line", "spacing": 0.2}},
    "grid": {"formation": {"kind": "grid", "spacing": 0.3}},
    "own weight": {"topology": {"kind": "circulant", "offsets": [1, -1], "own_weight": 1.0}},
    "navigator": LEADER,
}


class StandIn:
    """The step of the arena's simulator 2.1.0: wheels are clipped, Euler's step, wrapped."""

    start = None  # where the robots really start

    def __init__(
        self, number_of_robots, show_figure=True, initial_conditions=None, sim_in_real_time=True
    ):
        assert initial_conditions.shape == (3, number_of_robots)
        self.poses = (initial_conditions if self.start is None else self.start).copy()
        self.velocities, self.asked = np.zeros((2, number_of_robots)), False

    def get_poses(self):
        assert not self.asked
        self.asked = True
        return self.poses.copy()

    def set_velocities(self, ids, velocities):
        self.velocities[:, ids] = velocities

    def step(self):
        assert self.asked
        self.asked, radius, base = False, 0.016, 0.11
        (speed, turn), (x, y, heading) = self.velocities, self.poses
        wheels = np.stack([2 * speed - base * turn, 2 * speed + base * turn]) / (2 * radius)
        left, right = np.clip(wheels, -12.5, 12.5)
        speed, turn = radius * (left + right) / 2, radius * (right - left) / base
        x, y = x + STEP * speed * np.cos(heading), y + STEP * speed * np.sin(heading)
        heading = heading + STEP * turn
        self.poses = np.stack([x, y, np.arctan2(np.sin(heading), np.cos(heading))])

    def call_at_scripts_end(self):
        """Of version 1; version 2 has `debug`."""


@pytest.fixture
def simulator(monkeypatch, tmp_path):
    module, package = ModuleType("rps.robotarium"), ModuleType("rps")
    module.Robotarium = type("Robotarium", (StandIn,), {})
    package.robotarium = module
    monkeypatch.setitem(sys.modules, "rps", package)
    monkeypatch.setitem(sys.modules, "rps.robotarium", module)
    monkeypatch.chdir(tmp_path)
    return module.Robotarium


def simulated(keys):
    results = jaxnet.simulate({**BASE, **keys}, samples=2, progress=False)
    assert (results.lanes["status"] == "ok").all()
    return results


def furthest(poses, others):
    apart = poses - others
    apart[:, 2] = np.arctan2(np.sin(apart[:, 2]), np.cos(apart[:, 2]))
    return np.abs(apart).max()


@pytest.mark.parametrize(
    "keys",
    [
        pytest.param(TOGETHER, id="together"),
        pytest.param(FILTERED, id="filtered"),
        *(pytest.param(keys, id=name, marks=pytest.mark.long) for name, keys in ALONE.items()),
    ],
)
def test_the_script_drives_robots_as_jaxnet_does(keys, simulator):
    results, sample = simulated(keys), 0 if keys is FILTERED else 1
    write_robotarium(results, 0, sample, "lane.py")
    measured = runpy.run_path("lane.py")["measured"]
    poses = np.load("lane_poses.npy")
    states = results.trajectories["states"].values[0, sample]
    assert furthest(poses, np.moveaxis(states, -1, 1)) < 1e-12
    assert measured.shape == poses.shape == (61, 3, 6)
    assert np.abs(poses[-1] - poses[0]).max() > 0.05  # something moves
    assert furthest(measured, poses) < 1e-9
    if keys is FILTERED:  # two robots of six have no velocity that is safe
        assert results.lanes["infeasible"][sample] == pytest.approx(1 / 3)
    np.testing.assert_array_equal(np.load("lane_measured.npy"), measured)


def test_robots_that_start_elsewhere_follow_the_law_from_there(simulator):
    """0.05 m and 0.2 rad off, the script moves robots as jaxnet moves those that start there."""
    places = np.array([[0.7, 0.1], [0.2, 0.6], [-0.5, 0.4], [-0.7, -0.3], [0.1, -0.6], [0.6, -0.4]])
    keys = {
        **attack("rotating"),
        **loss("bernoulli", probability=0.4),
        "defence": {"kind": "w_msr", "F": 1},
    }
    sign = np.array([1, -1, 1, 1, -1, -1])
    off = places + 0.05 / np.sqrt(2) * sign[:, None]
    there = {"position": off.tolist(), "heading": (0.3 + 0.2 * sign).tolist()}
    moved = simulated({**keys, "initial": there}).trajectories["states"].values[0, 0]
    known = np.moveaxis(moved, -1, 1)
    start = {"position": places.tolist(), "heading": [0.3] * 6}
    results = simulated({**keys, "initial": start})
    write_robotarium(results, 0, 0, "lane.py")
    simulator.start = known[0]
    measured = runpy.run_path("lane.py")["measured"]
    assert furthest(measured, known) < 1e-9
    assert furthest(measured, np.load("lane_poses.npy")) > 0.04


def test_the_script_is_plain_numpy(tmp_path):
    """It imports the simulator and NumPy; its head says study, cell, sample and how to run it."""
    keys = {**BASE, "sweep": {"gain": [[1.0], [2.0]]}, "name": "ours", "samples": 2}
    place = tmp_path / "out"
    jaxnet.run(keys, place, progress=False)
    words = ["export", str(place), "--robotarium", str(tmp_path / "one.py"), "--cell", "1"]
    ended = CliRunner().invoke(main, [*words, "--sample", "0"])
    assert ended.exit_code == 0, ended.output
    assert all(str(tmp_path / name) in ended.output for name in ("one.py", "one_poses.npy"))
    text = (tmp_path / "one.py").read_text()
    assert "study ours, cell 1 (gain = 2), sample 0" in text
    assert "python one.py" in text
    tree = ast.parse(text)
    from_modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    imported = [node.names[0].name for node in ast.walk(tree) if isinstance(node, ast.Import)]
    assert {*imported, *from_modules} == {"numpy", "rps.robotarium", "types", "typing"}
    needed = CliRunner().invoke(main, words)
    assert needed.exit_code == 2
    assert "--sample" in needed.output


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"vehicle": "look_ahead"}, "vehicle: robotarium (got look_ahead)"),
        ({"engine": "exact", "vehicle": "single_integrator"}, "engine: sampled (got exact)"),
        ({"engine": {"kind": "sampled", "move": "exact"}}, 'engine.move: "euler" (got "exact")'),
        ({"tick": 0.0165}, "tick: 0.033 (got 0.0165)"),
        ({**LEADER, "law": "exact"}, "law: local (got exact)"),
        (attack("chirp"), "(got chirp)"),
        (attack("greedy"), "(got greedy)"),
        ({"attack": "freeze"}, "attack: none or bias or rotating or sinusoid or own_path (got"),
        (
            {"attack": {"kind": "bias", "vehicles": {"at": [0.033], "sets": [[1]]}}},
            "attack.vehicles: the same ones at all times (got",
        ),
        ({"defence": "clipping"}, "(got clipping)"),
        ({"defence": "trust"}, "(got trust)"),
        ({"defence": {"kind": "trusted_trim", "score": "jets"}}, 'defence.score: "position" (got'),
        ({"defence": {"kind": "trusted_trim", "filter": 1.0}}, "defence.filter: null (got 1.0)"),
        ({"defence": {"kind": "w_msr", "noise": 0.1}}, "defence.noise: 0.0 (got 0.1)"),
        (loss("range", radius=1.0), "(got range)"),
        ({"filter": "barrier"}, 'filter.form: "halves" (got "joint")'),
        ({"channel": {"missing": "hold"}}, 'channel.missing: "drop" (got "hold")'),
        ({"channel": {"delay": STEP}}, "channel.delay: 0.0 (got 0.033)"),
        ({"channel": {"noise": {"position": 0.1}}}, "channel.noise: none (got"),
        ({"channel": {"quantisation": 0.1}}, "channel.quantisation: 0 (got 0.1)"),
        ({"sensing": {"position": 0.1}}, "sensing: no errors (got"),
        ({"vehicle": {"kind": "robotarium", "base": 0.105}}, "vehicle.base: 0.11 (got 0.105)"),
        ({"vehicle": {"kind": "robotarium", "limits": {"wheel_rate": 5.0}}}, "(got {"),
        ({"gain": [[[1.0, 0.0], [0.0, 2.0]]]}, "gain: one number (got"),
        ({"vehicles": 60}, "vehicles: at most 50 (got 60)"),
        (
            {"topology": {"kind": "switching", "every": 0.33, "networks": ["complete", "path"]}},
            "topology: one network (got",
        ),
    ],
)
def test_other_kinds_are_refused_by_name(keys, message):
    (cell,) = jaxnet.load({**BASE, **keys}).cells
    with pytest.raises(FolderError, match="cell 0 cannot be exported to the arena") as refused:
        arena.refuse_unable(cell, "lane.py")
    assert message in str(refused.value)


def test_what_the_arena_cannot_start_is_refused(tmp_path):
    results = simulated({"initial": {"position": [[0.1 * i, 1.02] for i in range(6)]}})
    with pytest.raises(FolderError, match=r"robot 1 starts at \(0, 1.02\) m, outside the arena"):
        write_robotarium(results, 0, 0, tmp_path / "lane.py")
    with pytest.raises(FolderError, match=r"ends in \.py \(got lane\.txt\)"):
        write_robotarium(results, 0, 0, "lane.txt")
    with pytest.raises(FolderError, match=r"cells 0 to 0 and samples 0 to 1 \(got cell 3"):
        write_robotarium(results, 3, 0, "lane.py")
    assert [*tmp_path.iterdir()] == []
