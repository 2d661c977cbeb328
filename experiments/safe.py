"""Does anybody fail who is certified safe? Random digraphs, trusted links, attackers and attacks.

Every vehicle of eight hears five sources, trusts some of them, and trims what is announced (SCIENCE O11). Of
each random network some lanes are simulated; a vehicle fails that ends more than a hundredth of ā off.

Run it with `python experiments/safe.py`; with `--networks 12` to try it.
"""

from typing import Any

import click
import numpy as np

import jaxnet
from jaxnet.config.scenario import situation_of
from jaxnet.engine import batch
from jaxnet.lanes.jobs import job
from jaxnet.runs.cache import enable

VEHICLES, HEARD = 8, 5
LANES = 250  # of each network
ATTACKS: list[dict[str, Any]] = [
    {"kind": "rotating", "frequency": {"uniform": [0.1, 4.0]}},
    {"kind": "sinusoid", "frequency": {"uniform": [0.1, 4.0]}, "direction": {"uniform": [0.0, 6.283]}},
    {"kind": "rotating", "threat": "replaces", "frequency": {"uniform": [0.1, 4.0]}},
    {"kind": "spoof", "direction": {"uniform": [0.0, 6.283]}},
    {"kind": "spoof", "orders": [3], "direction": {"uniform": [0.0, 6.283]}},
    {"kind": "mimic"},
]


def network(seed: int) -> dict[str, Any]:
    """A study of one random network."""
    rng = np.random.default_rng(seed)
    edges, trusted = [], {}
    for i in range(1, VEHICLES + 1):
        others = [j for j in range(1, VEHICLES + 1) if j != i]
        sources = rng.choice(others, HEARD, replace=False).tolist()
        if rng.random() < 0.6:
            sources[0] = 0
        edges += [[i, j, float(rng.uniform(0.2, 1.0))] for j in sources]
        trusted[i] = [j for j in sources if j and rng.random() < 0.1]
    attacked = rng.choice(np.arange(1, VEHICLES + 1), rng.integers(1, 3), replace=False)
    return {
        "name": "safe",
        "seed": seed,
        "vehicles": VEHICLES,
        "topology": {"kind": "edges", "edges": edges},
        "attack": {**ATTACKS[seed % len(ATTACKS)], "magnitude": 10.0, "vehicles": sorted(attacked.tolist())},
        "defence": {"kind": "trusted_trim", "score": "announced", "theta": 1, "trusted": trusted},
        "engine": "exact",
        "horizon": 60.0,
        "output_step": 1.0,
    }


def errors(study: jaxnet.Study, lanes: int) -> np.ndarray:
    """Greatest error of each vehicle over ā in the tail: (lanes, m)."""
    (cell,) = study.cells
    one = job(cell.scenario, study.config.seed, range(lanes), ("state",))
    outcome = batch.simulate(one)
    path = cell.scenario.navigator.jets(np.arange(56, 61) * 1.0)[0].T
    apart = outcome.series["state"][:, -5:, :, :2] - path[None, :, None]
    return np.linalg.norm(apart, axis=-1).max(axis=1) / 10.0


@click.command()
@click.option("--networks", default=400, show_default=True, help="Random networks, of 250 lanes each.")
def main(networks: int) -> None:
    """Print, by attack, how many lanes of certified vehicles there were, and of these how many failed."""
    enable()
    tally = np.zeros((len(ATTACKS), 4), int)
    for seed in range(networks):
        try:
            study = jaxnet.load(network(seed))
        except jaxnet.ConfigError:  # the navigator does not reach everybody
            continue
        known = situation_of(study.cells[0].scenario)
        safe = study.config.defence.safe(known.weights, known.attacked, known.trusted).vehicles
        failed = ~(errors(study, LANES) < 0.01)
        of = failed[:, safe].size, failed[:, safe].sum(), failed[:, ~safe].size, failed[:, ~safe].sum()
        tally[seed % len(ATTACKS)] += of
    print(f"{'attack':24} safe: vehicles·lanes   failed   not known: vehicles·lanes   failed")
    for attack, (safe, lost, others, off) in zip(ATTACKS, tally.tolist(), strict=True):
        name = " ".join(str(attack[key]) for key in ("kind", "threat", "orders") if key in attack)
        print(f"{name:24} {safe:20,} {lost:8,} {others:25,} {off:9,}")


if __name__ == "__main__":
    main()
