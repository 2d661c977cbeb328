"""Does a certified vehicle fail? Random digraphs, trust, ϑ, attackers, attacks, gains and ticks.

Eight vehicles. A batch has a rule with its keys, a world (gains, vehicles, law, channel), an
attack, attackers, trusted pairs, ϑ and a tick, drawn by its number; keys that exclude each other
are left out. Each of its lanes has a digraph with weights, gains, starts and an attack of its own.
Of every lane `safe` says which vehicles end on the navigator, and why; one of them fails that is
over a hundredth of ā off after 56 to 60 s. Of the start less than a millionth of ā is left then;
what an attack does within a tick (theorems.md O11) is next to nothing, for none of these is made to
announce just what passes.

A lane that ends because somebody is cut off fails for who is certified if nobody can be; else it is
stopped. Somebody can be cut off with sybils counted as sources of their own, or without them.

Run it with `python experiments/safe.py`; it goes on where it was stopped. With `--batches 4` to try
it.
"""

import json
from pathlib import Path
from typing import Any

import click
import numpy as np

import jaxnet
from jaxnet.config.scenario import safe_in, with_sybils
from jaxnet.engine import batch
from jaxnet.kinds.graphs import Graph
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import graph, hearing, safety
from jaxnet.runs.cache import enable

VEHICLES, LANES = 8, 500
MOST_OFF = 0.01  # of ā
COLUMNS = ("scenarios", "certified", "failed", "worst", "stopped")
TURN = {"uniform": [0.0, 6.283]}
RATE = {"uniform": [0.1, 4.0]}
ATTACKS: list[dict[str, Any]] = [
    {"kind": "bias", "direction": TURN},
    {"kind": "rotating", "frequency": RATE},
    {"kind": "rotating", "frequency": RATE, "threat": "replaces"},
    {"kind": "rotating", "frequency": RATE, "orders": [0]},
    {"kind": "rotating", "frequency": RATE, "listeners": "each"},
    {"kind": "rotating", "frequency": RATE, "sybils": 1},
    {"kind": "sinusoid", "frequency": RATE, "direction": TURN},
    {"kind": "chirp", "rate": {"uniform": [0.01, 0.2]}},
    {"kind": "multisine", "frequency": {"uniform": [0.1, 1.0]}},
    {
        "kind": "envelope",
        "of": {"kind": "rotating", "frequency": RATE},
        "start": {"uniform": [0.0, 40.0]},
    },
    {"kind": "spoof", "direction": TURN},
    {"kind": "spoof", "orders": [3], "direction": TURN},
    {"kind": "replay"},
    {"kind": "freeze"},
    {"kind": "mimic"},
    {"kind": "greedy"},
]
ANNOUNCES = ["consistent"] * 5 + [
    "zero",
    "honest",
    {"kind": "free", "size": {"uniform": [0.0, 10.0]}},
]
BLURS: list[dict[str, Any]] = [
    *[{}] * 6,
    {"noise": {"uniform": [0.0, 1.0]}},
    {"tolerance": {"uniform": [0.0, 5.0]}},
    {"filter": {"uniform": [0.1, 2.0]}},
    {"first_announcement": 100.0},
    {"isolated": "coast"},
    {"drop_trusted": True},
]
ROBOT = {"gain": [{"uniform": [0.8, 1.5]}, 3.0, {"uniform": [2.5, 4.0]}]}
WORLDS: list[dict[str, Any]] = [  # gains, vehicles, and what breaks a premise of every certificate
    *[ROBOT] * 10,
    {"gain": [[1.0, 3.0, 3.0], [2.0, 5.0, 4.0]]},
    {"gain": [[[1.0, 0.3], [-0.3, 1.0]], [[3.0, 0.0], [0.0, 3.0]], [[3.0, 0.0], [0.0, 3.0]]]},
    {"gain": {"vehicles": [[1.0, 3.0, 3.0], [27.0, 27.0, 9.0]] * 4}, "engine": "nonlinear"},
    {"gain": [1.0], "vehicle": "single_integrator"},
    {
        "gain": [1.0],
        "vehicle": "single_integrator",
        "attack": {"threat": "replaces", "moves": "as_told"},
    },
    {"gain": [1.0, 2.0], "vehicle": "double_integrator"},
    {"gain": [1.0, 4.0, 6.0, 4.0], "vehicle": "planar_quadrotor"},
    {**ROBOT, "law": "rounds"},
    {**ROBOT, "law": "local"},
    {**ROBOT, "sensing": {"position": 0.1}},
    {**ROBOT, "channel": {"noise": {"position": 0.1}}},
    {**ROBOT, "channel": {"loss": {"kind": "bernoulli", "probability": 0.1}}},
    {**ROBOT, "channel": {"quantisation": 1.0}},
    {**ROBOT, "channel": {"delay": 0.1}},
]
RULES: list[dict[str, Any]] = [
    *[{"kind": "trusted_trim", "score": "announced", "label": "announced"}] * 5,
    *[{"kind": "trusted_only"}] * 2,
    *({"kind": kind} for kind in ("trusted_trim", "w_msr", "clipping", "coordinate_median")),
]


class Digraph(Graph):
    """Each lane has its own: some hear the navigator, and anybody may hear anybody."""

    def drawn_one(self, random: np.random.Generator, vehicles: int) -> graph.Digraph:
        """One that the navigator reaches."""
        while True:
            heard = random.random((vehicles, vehicles + 1)) < random.uniform(0.3, 1.0)
            heard[:, 0] = random.random(vehicles) < random.uniform(0.2, 1.0)
            heard[range(vehicles), range(1, vehicles + 1)] = False
            drawn = graph.normalised(graph.of_matrix(heard * random.uniform(0.2, 1.0, heard.shape)))
            if not graph.unreachable(drawn):
                return drawn

    def weights(self, vehicles: int) -> graph.Digraph:
        """One like those."""
        return self.drawn_one(np.random.default_rng(0), vehicles)

    def links(self, vehicles: int) -> np.ndarray:
        """Everybody may hear everybody else."""
        return ~np.eye(vehicles, vehicles + 1, 1, dtype=bool)

    def differs(self) -> bool:
        """From lane to lane."""
        return True

    def lane_weights(self, draw: Any, vehicles: int, sources: Any) -> np.ndarray:
        """Of each lane, by slot."""
        drawn = (self.drawn_one(random, vehicles) for random in draw.generators("topology"))
        return np.stack([hearing.by_slot(each, each.weights, sources) for each in drawn])


def study_of(number: int) -> jaxnet.Study | None:
    """The study of a batch, None where its keys exclude each other."""
    random = np.random.default_rng(number)
    everyone = np.arange(1, VEHICLES + 1)
    trusts = {int(i): int(random.integers(0, 3)) for i in everyone} | {
        int(random.integers(1, VEHICLES + 1)): 2
    }
    trusted = {
        i: random.choice(everyone[everyone != i], n, replace=False).tolist()
        for i, n in trusts.items()
    }
    rule = {**RULES[random.integers(len(RULES))], "trusted": trusted}
    if rule["kind"] == "trusted_trim":
        rule["theta"] = {int(i): int(random.choice([0, 1, 1, 2])) for i in everyone}
        rule |= BLURS[random.integers(len(BLURS))]
    world = WORLDS[random.integers(len(WORLDS))]
    liars = random.choice(everyone, random.integers(1, 3), replace=False)
    attack = {
        **ATTACKS[number % len(ATTACKS)],
        "magnitude": 10.0,
        "vehicles": sorted(liars.tolist()),
        "announces": ANNOUNCES[random.integers(len(ANNOUNCES))],
        **world.get("attack", {}),
    }
    keys = {
        "name": "safe",
        "seed": number,
        "vehicles": VEHICLES,
        "topology": Digraph(),
        "engine": "exact",
        **world,
        "attack": attack,
        "defence": rule,
        "tick": float(random.choice([0.02, 0.05, 0.1])),
        "horizon": 60.0,
        "output_step": 1.0,
    }
    try:
        return jaxnet.load(keys)
    except jaxnet.ConfigError:
        return None


def tally_of(number: int) -> dict[str, list[float]]:
    """By certificate of a batch: scenarios, vehicles certified, failed, worst [ā], stopped."""
    if (study := study_of(number)) is None:
        return {}
    (cell,) = study.cells
    scenario = cell.scenario
    lanes = job(scenario, Keyed(number), range(LANES), ("state",))
    outcome, (sources, *_) = batch.simulate(lanes), lanes.network.hearing
    path = scenario.navigator.jets(np.arange(56, 61) * 1.0)[0].T
    off = (
        np.linalg.norm(outcome.series["state"][:, -5:, :, :2] - path[None, :, None], axis=-1).max(
            axis=1
        )
        / 10
    )
    found: dict[str, list[float]] = {}
    for lane in range(LANES):
        heard = hearing.graph_of(np.asarray(sources), np.asarray(lanes.inputs.lane.weights[lane]))
        count(found, scenario, heard, off[lane], bool(outcome.status[lane] == 0))
    return found


def count(
    found: dict[str, list[float]], scenario: Any, heard: graph.Digraph, off: Any, ended: bool
) -> None:
    """Count one lane, each vehicle under the strongest reason for which it is safe."""
    attacked, trusted = scenario.attack.attacked_links(heard), scenario.defence.trusts(heard)
    networks = [(heard, trusted)]
    if scenario.attack.identities() > 1:
        wider, _, also = with_sybils(heard, attacked, trusted, scenario.attack.identities() - 1)
        networks.append((wider, also))
    joined = all(
        safety.stay_joined(
            scenario.defence.may_drop(each, spared), np.ones(each.vehicles, bool)
        ).all()
        for each, spared in networks
    )
    left = np.ones(VEHICLES, bool)
    for why, vehicles, *_ in [
        *safe_in(scenario, heard, attacked),
        safety.Safe("not known", left),
    ]:
        these, left = vehicles & left, left & ~vehicles
        if not these.any():
            continue
        stopped = not ended and not joined
        failed = 0 if stopped else int((~(off[these] < MOST_OFF)).sum())
        worst = float(np.nan_to_num(off[these]).max())
        key = f"{scenario.defence.label or scenario.defence.kind} {why.partition(',')[0]}"
        before = found.get(key, [0, 0, 0, 0.0, 0])
        now = [1, 0 if stopped else int(these.sum()), failed, worst, int(stopped)]
        found[key] = [
            max(a, b) if i == 3 else a + b for i, (a, b) in enumerate(zip(before, now, strict=True))
        ]


@click.command()
@click.option("--batches", default=200, show_default=True, help="Of 500 scenarios each.")
@click.option(
    "--out", default="results/safe.jsonl", show_default=True, help="A line for each batch done."
)
def main(batches: int, out: str) -> None:
    """Print by rule and certificate how many vehicles were certified and how many failed."""
    enable()
    file = Path(out)
    file.parent.mkdir(parents=True, exist_ok=True)
    done = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    for number in sorted({*range(batches)} - {each["batch"] for each in done}):
        done.append({"batch": number, "found": tally_of(number)})
        with file.open("a") as lines:
            print(json.dumps(done[-1]), file=lines)
    print(f"{len(done) * LANES:,} scenarios")
    print(f"{'rule, certificate':36}" + "".join(f"{column:>12}" for column in COLUMNS))
    for key in sorted({key for each in done for key in each["found"]}):
        rows = np.array([each["found"][key] for each in done if key in each["found"]])
        scenarios, certified, failed, _, stopped = rows.sum(axis=0).astype(int).tolist()
        print(
            f"{key:36}{scenarios:12,}{certified:12,}{failed:12,}"
            f"{rows[:, 3].max():12.1e}{stopped:12,}"
        )


if __name__ == "__main__":
    main()
