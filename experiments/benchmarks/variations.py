"""Do the nonlinear engine's solvers keep their accuracy where one thing is varied at a time?

Twelve vehicles, cyclic, rotating attack, no defence, 30 s, the defaults elsewhere. For each
variation and solver: the greatest difference of a lane's `peak_error` and `tail_max` from the exact
engine's, steps or windows a lane, lanes that failed in one engine alone, lanes per second of a
second run.

Run it with `python experiments/benchmarks/variations.py`; it takes about six minutes.
"""

import argparse
import os
import platform
import time
from typing import Any

import numpy as np
from row import shown

import jaxnet
from jaxnet.runs.cache import enable

BASE = {
    "vehicles": 12,
    "attack": "rotating",
    "defence": "none",
    "horizon": 30.0,
    "tail": 10.0,
    "seed": 3,
}
SOLVERS = ["gauss", "dopri5"]
VARIATIONS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "none attacked": {"attack": "none"},
    "trimming": {"defence": "trusted_trim"},
    "cars": {"vehicle": "car"},
    "gain (8, 12, 6)": {"gain": [8, 12, 6]},
    "drawn gains": {"gain": [1.0, {"uniform": [2.8, 3.5]}, {"uniform": [2.8, 3.5]}]},
    "random graph": {"topology": {"kind": "erdos_renyi", "probability": 0.4}},
    "attack of 100 rad/s": {"attack": {"kind": "rotating", "frequency": 100.0}},
    "attack of 1,000 m": {"attack": {"kind": "rotating", "magnitude": 1000}},
    "attack that starts late": {
        "attack": {"kind": "envelope", "of": "rotating", "start": 12.3, "rise": 2.0}
    },
    "near-singular starts": {"initial": {"speed": {"uniform": [1e-4, 1e-2]}}},
    "120 s": {"horizon": 120.0},
    "three rounds": {"law": {"kind": "rounds", "rounds": 3}},
    "rtol 1e-4": {"engine": {"rtol": 1e-4, "atol": 1e-6}},
    "rtol 1e-10": {"engine": {"rtol": 1e-10, "atol": 1e-12}},
    "48 vehicles": {"vehicles": 48},
}


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--lanes", type=int, default=256, help="lanes of a variation (default 256)")
    lanes = parser.parse_args().lanes
    enable()
    print(f"{os.cpu_count()} cores, {platform.machine()}\n")
    print(
        "| | "
        + " | ".join(f"{solver}: peak, tail [m]; steps; lanes/s" for solver in SOLVERS)
        + " |"
    )
    print("|---" * (len(SOLVERS) + 1) + "|")
    for name, keys in VARIATIONS.items():
        exact, _ = rows({**keys, "engine": "exact"}, lanes)
        cells = [cell(keys, solver, lanes, exact) for solver in SOLVERS]
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def rows(keys: dict[str, Any], lanes: int) -> tuple[Any, float]:
    """Rows of a study, and seconds of its second run."""
    study = jaxnet.load({**BASE, **keys, "samples": lanes})
    jaxnet.simulate(study)
    began = time.perf_counter()
    results = jaxnet.simulate(study)
    return results.lanes, time.perf_counter() - began


def cell(keys: dict[str, Any], solver: str, lanes: int, exact: Any) -> str:
    """What a solver does in a variation."""
    found, seconds = rows({**keys, "engine": {**keys.get("engine", {}), "solver": solver}}, lanes)
    peak, tail = (
        float(np.nanmax(np.abs(found[key] - exact[key]))) for key in ("peak_error", "tail_max")
    )
    failed = int((found["status"] != exact["status"]).sum())
    text = f"{peak:.1e}, {tail:.1e}; {found['steps'].mean():.0f}; {shown(lanes / seconds)}"
    return text + (f"; {failed} end otherwise" if failed else "")


if __name__ == "__main__":
    main()
