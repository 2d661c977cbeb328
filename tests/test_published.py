"""Others' studies repeated: configs/published/ gives what was published (docs/published.md)."""

from pathlib import Path

import numpy as np
import pytest

import jaxnet
from jaxnet.theory.robustness import pairs, percolated_nodes
from tests import rescue

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "configs" / "published"
CONFIGS = sorted(FOLDER.glob("*.yaml"))

# Lee and Panagou, 2025: [i, j] means that agent i hears agent j, from 1; agents 1 to 3 lead.
FIRST = [[4, 1], [6, 1], [6, 3], [6, 5], [6, 7], [6, 9], [7, 1], [7, 2], [7, 3], [7, 9]]
FIRST += [[8, 4], [8, 5], [8, 9]]
SECOND = [[4, 9], [5, 2], [5, 4], [5, 9], [6, 9], [7, 5], [7, 9], [8, 1], [8, 2], [8, 3]]
BYZANTINE = 10

CHUNK = 32  # lanes side by side


@pytest.fixture
def simulated(tmp_path):
    """A function that runs a config with few lanes."""

    def run(name, samples=1, **keys):
        study = jaxnet.load(FOLDER / f"{name}.yaml", {"samples": samples} | keys)
        return jaxnet.run(study, tmp_path / name, progress=False, chunk=CHUNK)

    return run


def swept(name, key):
    """The values of a key in the sweep of a config."""
    return jaxnet.load(FOLDER / f"{name}.yaml").config.sweep[key]


def links(topology):
    """The links between two vehicles of an edge list, or of all networks that take turns."""
    networks = topology.get("networks", [topology])
    return [[i, j] for network in networks for i, j, _ in network["edges"] if i != j]


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_config_says_its_command_source_claim_and_page(path):
    first, second, *lines = path.read_text().splitlines()
    assert first.split(" --")[0] == f"# jaxnet run configs/published/{path.name}"
    assert second == "# yaml-language-server: $schema=../schema.json"
    for word in ("# Source:", "# Claim:", "# Ours:"):
        assert any(word in line for line in lines), word
    assert jaxnet.load(path).config.name == path.stem
    assert f"configs/published/{path.name}" in (ROOT / "docs" / "published.md").read_text()


def test_w_msr_agrees_inside_the_range_whoever_lies(simulated):
    """LeBlanc et al., 2013, Fig. 6: (2, 2)-robust; each of the 14 lies in some of 64 lanes."""
    keys = {"sweep": {}, "attack.vehicles": {"random": 1}, "horizon": 200.0, "output_step": 200.0}
    results = simulated("leblanc_2013", 64, **keys)
    heard = links(results.study.config.topology.model_dump())
    assert len(heard) == 62
    assert pairs(heard, 14)[1] == 2
    assert (results.lanes["spread"] < 0.05).all()
    assert (results.lanes["outside"] < 1e-9).all()


def ends_apart(heard, liar, steps):
    """The spread of honest agents by a plain program of the rule published in 2016."""
    x = np.array([60.0, 75, 2, 85, 66, 83, 20])
    for t in range(steps):
        x[liar] = 45 + 55 * np.cos(0.031 * t)
        new = x.copy()
        for i in set(range(7)) - {liar}:
            values = np.sort([x[j - 1] for k, j in heard if k == i + 1])
            below, above = values[values < x[i]][1:], values[values > x[i]][:-1]
            new[i] -= 0.02 * (x[i] - np.concatenate([below, above])).sum()
        x = new
    return np.ptp(np.delete(x, liar))


@pytest.mark.long
def test_a_laman_network_splits_as_published_and_a_triangular_one_does_not(simulated):
    """Saldaña et al., 2016, Fig. 6: 52.5376 and 62.9368 are the ends that the published program
    gives.

    Vehicle 4 lies. The Laman network is 1-robust alone, the others are (2, 2)-robust.
    """
    networks = swept("saldana_2016", "topology")
    assert [pairs(links(each), 7) for each in networks] == [[7], [4, 2], [7, 2]]
    keys = {"sweep": {"topology": networks[:2]}, "attack.vehicles": [4]}
    published = simulated("saldana_2016", **keys).lanes
    assert published["spread"][0] == pytest.approx(62.9368 - 52.5376, abs=1e-4)
    for found, network in zip(published["spread"], networks, strict=False):
        assert found == pytest.approx(ends_apart(links(network), 3, 599), abs=1e-9)
    drawn = simulated("saldana_2016_starts", CHUNK, horizon=599.0, output_step=599.0, **keys).lanes
    spread = drawn.groupby("topology")["spread"]
    assert spread.median()["laman"] > 5.0 > spread.median()["triangular"]
    assert (drawn["outside"] < 1e-9).all()


@pytest.mark.long  # the union's network in tests/engine/test_leaderless.py
def test_a_robust_union_agrees_whichever_two_lie(simulated):
    """Ten agents: with the union not (3, 3)-robust some pairs of liars part the others."""
    robust, other = (pairs(links(each), 10) for each in swept("jia_union", "topology"))
    assert robust[2] >= 3 > other[2]
    keys = {"attack.vehicles": {"random": 2}, "horizon": 400.0, "output_step": 400.0}
    results = simulated("jia_union", 32, sweep={"topology": swept("jia_union", "topology")}, **keys)
    spread = results.lanes.groupby("topology")["spread"].max()
    assert spread["robust"] < 0.05
    assert spread["not robust"] > 0.1
    assert (results.lanes["outside"] < 1e-9).all()


@pytest.mark.long  # complete networks: tests/theory/test_agreement.py
def test_half_of_a_complete_network_may_lie_if_f_says_so(simulated):
    """LeBlanc et al., 2013, with 7 agents in place of 101 for the test's sake; 3 lie."""
    few = {"vehicles": 7, "initial.position": [{"uniform": [0, 50]}] * 7}
    few |= {"attack.vehicles": [5, 6, 7]}
    results = simulated("complete_101", 4, **few, **{"sweep.defence.F": [2, 3]})
    assert (results.lanes["spread"] < 1e-6).all()
    outside = results.lanes.groupby("defence.F")["outside"]
    assert outside.min()[2] > 40
    assert outside.max()[3] < 1e-9


def active(heard):
    """The agents that percolation with F = 1 activates."""
    return set(percolated_nodes(heard, 9, [1, 2, 3], F=1))


def test_percolated_followers_reach_the_leaders_and_others_do_not(simulated):
    """Lee and Panagou, 2025: published activations in 100 steps, the two networks in turn."""
    counts = [50 * (i in active(FIRST)) + 50 * (i in active(SECOND)) for i in range(1, 10)]
    assert counts == [100, 100, 100, 0, 0, 50, 50, 50, 0]
    networks = [links(each) for each in swept("lee_panagou_2025", "topology")]
    honest = [{(i, j) for i, j in each if BYZANTINE not in (i, j)} for each in networks]
    told = {(i, j) for heard in (FIRST, SECOND) for i, j in heard if {i, j} <= active(heard)}
    assert honest == [told, {*map(tuple, FIRST + SECOND)}]
    states = simulated("lee_panagou_2025", 8).trajectories["states"]
    ends = np.abs(states.isel(time=-1).values[..., 0])
    assert ends[0][:, [5, 6, 7]].max() < 1e-6
    assert ends[0][:, [3, 4, 8]].min() > 1e-3
    assert ends[1][:, 3:9].max(axis=1).min() > 1.0


@pytest.mark.long
def test_centerpoints_meet_where_coordinate_medians_do_not(simulated):
    """Shabbir et al., 2020, with ten robots in place of 28; each hears two liars among seven."""
    starts = [[-0.5, -0.3]] * 3 + [[0.3, 0.5]] * 3 + [[-1.4, -1.2]] * 2 + [[1.2, 1.4]] * 2
    position = [[{"uniform": ends}, {"uniform": [-0.1, 0.1]}] for ends in starts]
    heard = [(i, j) for i in range(1, 7) for j in range(1, 7) if i != j]
    heard += [(i, j) for i in range(1, 7) for j in ((7, 8) if i <= 3 else (9, 10))]
    few = {"vehicles": 10, "initial.position": position, "attack.vehicles": [7, 8, 9, 10]}
    results = simulated("li_2020", 4, **few, **{"topology.edges": [[i, j, 1] for i, j in heard]})
    lanes = results.lanes.groupby("defence")
    assert lanes["spread"].max()["centerpoint"] < 1e-3
    assert lanes["outside"].max()["centerpoint"] < 1e-9
    assert lanes["spread"].min()["coordinate_median"] > 0.5


# --- the Robotarium's examples -------------------------------------------------------------------

STEP, LEFT = 0.033, np.pi / 2


def ends_of(results):
    """Poses of the first lane at the last output, (robots, 3), headings from -π to π."""
    poses = results.trajectories["states"].values[0, 0, -1]
    return np.concatenate([poses[:, :2], (poses[:, 2:] + np.pi) % (2 * np.pi) - np.pi], axis=1)


def mean_ahead(poses):
    """The mean of the points 0.05 m ahead of the robots."""
    along = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
    return (poses[:, :2] + 0.05 * along).mean(axis=0)


def test_the_arena_s_robots_meet(simulated):
    """After 100 and 1,000 steps, and what the steps count."""
    results = simulated("arena_consensus")
    row, ends = results.lanes.iloc[0], ends_of(results)
    states = results.trajectories["states"].values[0, 0]
    assert states[100, 0] == pytest.approx([0.411336738, 0, 0], abs=6e-10)
    assert states[100, 1] == pytest.approx([0.451326470, 0.226286340, -2.613441755], abs=6e-10)
    assert row["saturated"] * 12 * 1001 == pytest.approx(427)
    assert mean_ahead(states[1000]) == pytest.approx([0.065513238, 0], abs=6e-10)
    assert ends[0] == pytest.approx([0.015646697, 0, -6e-9], abs=8e-10)
    assert ends[1] == pytest.approx([0.108731764, 0.025408357, -2.610114648], abs=6e-10)
    assert row["spread"] == pytest.approx(2.718254e-4, abs=6e-11)
    counts = ["saturated_steps", "collisions", "outside_arena"]
    assert row[counts].tolist() == [50, 47_713, 0]


@pytest.mark.parametrize(("steps", "collisions"), [(100, 0), (300, 2_523)])
def test_collisions_of_the_arena(steps, collisions, simulated):
    """Each pair counts in each step; the pose after the last move does not."""
    row = simulated("arena_consensus", horizon=steps * STEP, save={}).lanes.iloc[0]
    assert row[["collisions", "outside_arena"]].tolist() == [collisions, 0]


def test_without_a_limit_the_wheels_move_the_consensus_elsewhere(simulated):
    results = simulated("arena_consensus", **{"vehicle.limits": {"wheel_rate": 1e6}})
    states = results.trajectories["states"].values[0, 0]
    assert mean_ahead(states[-1])[0] == pytest.approx(0.048045590, abs=6e-10)


def test_the_arena_s_robots_form_a_hexagon(simulated):
    results = simulated("arena_formation")
    row, ends = results.lanes.iloc[0], ends_of(results)
    assert ends[0] == pytest.approx([0.546192992, 0.032826782, -1.936904091], abs=6e-10)
    assert ends[1] == pytest.approx([0.274380533, 0.450901176, 2.217697354], abs=6e-10)
    assert row[["saturated_steps", "collisions", "outside_arena"]].tolist() == [8, 0, 0]


def behind_a_leader(poses, leads, steps):
    """Poses (3, 3) of followers after some steps of the arena, by a plain program.

    `leads` gives the leader's place at a time. Followers hear each other, the first the leader.
    """
    poses = poses.copy()
    for step in range(steps):
        commands = []
        for i, pose in enumerate(poses):
            heard = [other[:2] for j, other in enumerate(poses) if j != i]
            heard += [leads(step * STEP)] * (i == 0)
            apart = [place - pose[:2] for place in heard]
            q = 10 * np.sum([(each @ each - 0.2**2) * each for each in apart], axis=0)
            q *= min(1.0, 0.15 / max(np.linalg.norm(q), 1e-30))
            along = np.array([np.cos(pose[2]), np.sin(pose[2])])
            ahead, aside = along @ q, along[0] * q[1] - along[1] * q[0]
            v, turn = 0.8 * ahead, np.pi * np.arctan2(aside, ahead) / LEFT
            wheels = np.clip((v + np.array([-0.055, 0.055]) * turn) / 0.016, -12.5, 12.5)
            commands.append((0.016 * wheels.mean(), 0.016 * np.ptp(wheels) / 0.11 * np.sign(turn)))
        for pose, (v, turn) in zip(poses, commands, strict=True):
            pose += STEP * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), turn])
    return poses


def test_the_arena_s_robots_follow_a_leader(simulated):
    """The leader is on a circle of 0.8 m about 0, at 0.1 m/s."""
    results = simulated("arena_leader")
    starts = results.trajectories["states"].values[0, 0, 0]
    angle = lambda time: 0.125 * time - LEFT  # noqa: E731
    leads = lambda time: 0.8 * np.array([np.cos(angle(time)), np.sin(angle(time))])  # noqa: E731
    expected = behind_a_leader(starts, leads, 1500)
    expected[:, 2] = (expected[:, 2] + np.pi) % (2 * np.pi) - np.pi
    ends = ends_of(results)
    np.testing.assert_allclose(ends, expected, atol=1e-8)
    assert np.linalg.norm(ends[0, :2] - leads(49.5)) < 0.6


@pytest.mark.long
def test_liars_among_the_arena_s_robots_are_outvoted_up_to_f(simulated):
    """The spread of honest robots does not depend on the formation, in which starts are apart."""
    found = simulated("arena_attacked", 16, **{"sweep.attack.magnitude": [0.4]}).lanes
    assert (found["status"] == "ok").all()
    outvoted = found.groupby(["defence", "attack.vehicles", "formation"])[["spread", "outside"]]
    for (defence, liars, _), ends in outvoted.max().iterrows():
        number, most = int(str(liars)[-2]), int(str(defence)[-2]) if "F=" in str(defence) else 0
        assert (ends["spread"] < 1e-4) == (number <= most), (defence, liars)
        assert (ends["outside"] < 0.1) == (number <= most), (defence, liars)
    lies = found.pivot_table("collisions", ["defence", "attack.vehicles"], "formation", "median")
    assert (lies["circle"] < lies["none"] / 20).all()


def test_liars_who_misuse_their_inputs_are_cut_off_as_published():
    """Bahrami and Jafarnejadsani, experiment 1: detection times, ends, and each step.

    A step that differs by one alarm is 1e-4 m off and more. An alarm comes at the tick after the
    published time, from which it acts in both.
    """
    honest = [i for i in range(rescue.AGENTS) if i not in rescue.LIARS]
    places, alarms = rescue.run(10.0, honest)
    published = [5.65945374, 5.40606368, 5.45636368, 5.41601277, 5.53259439, 5.44578597]
    assert places[-1, honest] == pytest.approx(published, abs=6e-9)
    fast = [(2.47, 0, 5), (2.47, 1, 5), (2.93, 6, 5), (2.93, 7, 5)]
    assert alarms == [*fast, *((3.85, i, 4) for i in (1, 2, 6, 7)), (4.39, 0, 4)]
    last, i, j = alarms[-1]
    asked = [{"kind": "first_alarm", "listener": i + 1, "source": j + 1}]
    study = jaxnet.load(FOLDER / "rescue.yaml", {"metrics": asked})
    networks = study.config.topology.model_dump()["networks"]
    for network, edges in zip(networks, (rescue.FIRST, rescue.SECOND), strict=True):
        listed = {(i - 1, j - 1) for i, j, _ in network["edges"]}
        assert listed == {*edges, *((j, i) for i, j in edges)}
    undetected = jaxnet.load(FOLDER / "rescue.yaml", {"detector": "none"})
    for each, plain in ((study, places), (undetected, rescue.run(10.0)[0])):
        results = jaxnet.simulate(each, progress=False)
        found = results.trajectories["states"].values[0, 0]
        assert found[..., 0] == pytest.approx(plain, abs=1e-12)
        if each is study:
            assert results.lanes["first_alarm"][0] == pytest.approx(last + 0.01)
