"""How far the engines are apart on random configs, where experiments/accuracy.py has chosen ones.

Each config draws graph, vehicles, kind of vehicle, gain, attack, its frequency, ā, defence and
tick. The exact engine has no integrator, so the distance of the others from it is theirs: the
greatest over vehicles and output times.

Run it with `python experiments/fuzzed.py`; with `--configs 3` to try it.
"""

from typing import Any

import click
import numpy as np

import jaxnet
from jaxnet.runs.cache import enable

HORIZON = 20.0
LANES = 4


def config(number: int) -> dict[str, Any]:
    """A config by its number."""
    random = np.random.default_rng(number)
    vehicles = int(random.integers(2, 13))
    graphs = [
        "star",
        "path",
        "complete",
        {"kind": "erdos_renyi", "probability": 0.4, "seed": number},
    ]
    frequency = float(10 ** random.uniform(-1, 1))
    attacked = sorted(
        random.choice(np.arange(1, vehicles + 1), int(random.integers(1, 3)), replace=False)
    )
    kind = str(random.choice(["bias", "rotating", "sinusoid", "multisine"]))
    attack = {"kind": kind, "magnitude": float(10 ** random.uniform(-1, 2))}
    attack |= {"vehicles": [int(each) for each in attacked]}
    if kind != "bias":
        attack["frequency"] = frequency
    k0, damping = float(random.uniform(0.5, 4)), float(random.uniform(2.5, 5))
    return {
        "name": f"fuzzed-{number}",
        "vehicles": vehicles,
        "topology": graphs[random.integers(len(graphs))],
        "vehicle": str(random.choice(["two_wheeled", "car"])),
        "gain": [k0, damping * k0 ** (2 / 3), damping * k0 ** (1 / 3)],
        "attack": attack,
        "defence": str(random.choice(["none", "trusted_trim"])),
        "tick": float(random.choice([0.02, 0.05, 0.1])),
        "horizon": HORIZON,
        "save": {"trajectories": "all"},
        "seed": number,
    }


def apart(one: Any, other: Any) -> float:
    """Greatest distance of a vehicle's positions over lanes that end well in both [m]."""
    here, there = (
        each.trajectories["states"].sel(state=["x", "y"]).values for each in (one, other)
    )
    distance = np.hypot(*np.moveaxis(here - there, -1, 0))
    return float(distance[np.isfinite(distance)].max(initial=0.0))


@click.command()
@click.option("--configs", default=22, show_default=True)
def main(configs: int) -> None:
    """A line per config."""
    enable()
    print(f"{'config':70} {'least speed':>12} {'nonlinear':>10} {'stacked':>10}")
    for number in range(configs):
        keys = config(number)
        exact, nonlinear, stacked = (
            jaxnet.simulate(jaxnet.load(keys | {"engine": engine}), samples=LANES)
            for engine in ("exact", "nonlinear", "stacked")
        )
        words = f"{keys['vehicles']} {keys['topology']} {keys['attack']['kind']} {keys['defence']}"
        slow = nonlinear.lanes["min_speed"].min()
        print(
            f"{words[:70]:70} {slow:12.2g} {apart(nonlinear, exact):10.1e}"
            f" {apart(stacked, exact):10.1e}"
        )


if __name__ == "__main__":
    main()
