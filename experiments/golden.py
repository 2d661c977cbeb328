"""Rows of small studies that use all there is, to compare the engines before and after a change.

Engines, laws, drawn graphs and gains, strategic attacks, sybils, rules by axis, large fleets.
`--write FILE` stores their rows; `--against FILE` prints the greatest difference of each study from
stored ones, and how many steps, switches and statuses differ. Positions and errors are in metres.

Run it with `python experiments/golden.py --write results/golden.csv`, then, after the change, with
`--against results/golden.csv`.
"""

from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

import jaxnet
from jaxnet.runs.cache import enable

BASE = {"horizon": 20.0, "tail": 5.0, "output_step": 0.5, "samples": 16, "engine": "exact"}
LOSSY = {"loss": {"kind": "bernoulli", "probability": 0.4}}
TURNING = {"kind": "rotating", "magnitude": 10, "frequency": 0.7}
DRAWN = {"kind": "rotating", "magnitude": 10, "frequency": {"uniform": [0.3, 3.0]}}
ANNOUNCED = {"kind": "trusted_trim", "score": "announced"}
RANDOM = {"kind": "erdos_renyi", "probability": 0.4, "navigator": {"share": 0.5}}
LATTICE = {"kind": "lattice", "neighbours": 6}
GAIN = [1.0, {"uniform": [2.8, 3.5]}, {"uniform": [2.8, 3.5]}]
COUNTS = ["steps", "switches"]
STUDIES: dict[str, dict[str, Any]] = {
    "plain": {"attack": "none", "defence": "none", "topology": "path"},
    "attacked": {"attack": TURNING, "defence": "none", "gain": GAIN},
    "trimmed": {"attack": TURNING},
    "filtered": {
        "attack": DRAWN,
        "defence": {"kind": "trusted_trim", "score": "feedback", "filter": 1.0},
    },
    "announced": {
        "attack": {**DRAWN, "announces": {"kind": "free"}},
        "defence": {**ANNOUNCED, "noise": 0.1},
    },
    "random": {"attack": DRAWN, "topology": RANDOM, "defence": ANNOUNCED, "gain": GAIN},
    "inconsistent": {"attack": {**TURNING, "orders": [0]}, "tick": 0.1},
    "greedy": {
        "attack": {"kind": "greedy", "magnitude": 10, "vehicles": [2, 7]},
        "defence": "w_msr",
    },
    "mimic": {"attack": {"kind": "mimic", "magnitude": 10, "vehicles": [2]}},
    "sybils": {"attack": {**TURNING, "vehicles": [2, 7], "sybils": 1, "listeners": "each"}},
    "replaced": {"attack": {**TURNING, "threat": "replaces"}, "defence": "trusted_only"},
    "by axis": {"attack": DRAWN, "defence": "coordinate_median"},
    "weighed": {"attack": DRAWN, "defence": "geometric_median", "topology": RANDOM},
    "clipped": {"attack": DRAWN, "defence": {"kind": "clipping"}},
    "freeze": {
        "attack": {"kind": "freeze", "magnitude": 10, "links": "navigator"},
        "topology": "star",
    },
    "rounds": {
        "attack": TURNING,
        "law": {"kind": "rounds", "rounds": 3},
        "tick": 0.02,
        "horizon": 8.0,
    },
    "lossy": {"attack": TURNING, "channel": LOSSY, "sensing": {"position": 0.1}},
    "lossy, rounds": {
        "attack": TURNING,
        "channel": LOSSY,
        "law": "rounds",
        "tick": 0.02,
        "horizon": 8.0,
    },
    "lossy, local": {"attack": TURNING, "channel": LOSSY, "law": "local", "defence": "w_msr"},
    "nonlinear, lossy": {"engine": "nonlinear", "attack": TURNING, "channel": LOSSY},
    "exact 200": {"vehicles": 200, "topology": LATTICE, "attack": {**TURNING, "vehicles": [2, 90]}},
    "nonlinear": {"engine": "nonlinear", "attack": TURNING},
    "nonlinear, car": {
        "engine": {"kind": "nonlinear", "solver": "dopri8"},
        "vehicle": "car",
        "attack": TURNING,
        "defence": "none",
    },
    "nonlinear, in the field": {
        "engine": "nonlinear",
        "attack": TURNING,
        "tick": 0,
        "horizon": 6.0,
    },
    "nonlinear, rounds": {
        "engine": "nonlinear",
        "law": {"kind": "rounds", "rounds": 3},
        "tick": 0.02,
        "attack": TURNING,
        "horizon": 6.0,
    },
    "nonlinear, weighed": {"engine": "nonlinear", "attack": DRAWN, "defence": "geometric_median"},
    "nonlinear 48": {"engine": "nonlinear", "vehicles": 48, "topology": LATTICE, "attack": TURNING},
    "nonlinear 200": {
        "engine": "nonlinear",
        "vehicles": 200,
        "topology": LATTICE,
        "attack": TURNING,
        "samples": 4,
        "horizon": 8.0,
    },
    "failed, cut off": {"attack": TURNING, "topology": "path", "defence": "w_msr"},
    "failed, cut off, nonlinear": {
        "engine": "nonlinear",
        "attack": TURNING,
        "topology": "path",
        "defence": "w_msr",
    },
    "failed, steps": {"engine": {"kind": "nonlinear", "max_steps": 25}, "attack": TURNING},
    "stacked": {"engine": "stacked", "attack": TURNING, "horizon": 4.0, "tail": 2.0, "samples": 4},
    "stacked, lossy": {
        "engine": "stacked",
        "attack": TURNING,
        "channel": LOSSY,
        "horizon": 4.0,
        "tail": 2.0,
        "samples": 4,
    },
    "stacked, in the field": {
        "engine": "stacked",
        "attack": TURNING,
        "tick": 0,
        "horizon": 2.0,
        "tail": 1.0,
        "samples": 2,
    },
}


def rows(name: str) -> pd.DataFrame:
    """Rows of a study, its last positions with them."""
    config = {"name": "golden", "seed": 7, **BASE, **STUDIES[name], "save": {"trajectories": "all"}}
    results = jaxnet.simulate(jaxnet.load({"vehicles": 12, **config}))
    table = results.lanes.reset_index(drop=True)
    last = results.trajectories["states"].sel(state=["x", "y"]).isel(time=-1)
    table["last"] = last.sum(["vehicle", "state"], skipna=False).values.ravel()
    table.insert(0, "study", name)
    return table


@click.command()
@click.option("--write", type=Path, help="Store the rows in this file.")
@click.option("--against", type=Path, help="Compare with the rows in this file.")
@click.option("--only", help="Only the studies whose names begin so.")
def main(write: Path | None, against: Path | None, only: str | None) -> None:
    """Store rows, or compare with stored ones."""
    enable()
    names = [name for name in STUDIES if name.startswith(only or "")]
    if write is not None:
        write.parent.mkdir(parents=True, exist_ok=True)
        pd.concat([rows(name) for name in names]).to_csv(write, index=False, float_format="%.17g")
        print(f"wrote {write}")
    if against is None:
        return
    stored = pd.read_csv(against)
    print(
        f"{'study':26}{'lanes':>6}{'ok':>5}{'difference':>12}{'steps':>7}{'switches':>9}{'status':>8}"
    )
    for name in names:
        now, then = rows(name), stored[stored["study"] == name].reset_index(drop=True)
        if then.empty:
            print(f"{name:26}not in {against}")
            continue
        numbers = [
            key
            for key in now.columns
            if key in then and pd.api.types.is_float_dtype(now[key]) and key not in COUNTS
        ]
        apart = np.nanmax(
            np.abs(np.asarray(now[numbers], float) - np.asarray(then[numbers], float)), initial=0.0
        )
        others = [np.count_nonzero(now[key] != then[key]) for key in [*COUNTS, "status"]]
        ok = np.count_nonzero(now["status"] == "ok")
        print(
            f"{name:26}{len(now):6}{ok:5}{apart:12.1e}{others[0]:7}{others[1]:9}{others[2]:8}",
            flush=True,
        )


if __name__ == "__main__":
    main()
