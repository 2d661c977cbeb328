"""The paper's simulation: does the fleet track its navigator, and what cost four attacked vehicles?

Twelve two-wheeled robots, three topologies, without attack and with vehicles 2, 5, 8 and 11
corrupted by ā = 5 m, everyone trimming who may. Writes results/paper with the eight-panel figure,
and prints a table in which every lane is held against the exact solution of the closed loop: its
trajectory is simulated once more with an output at every tick, and compared with E(t + h) = G(t +
h) + expm(A_c h)(E(t) - G(t)) for the kept sets of that lane (O2 in the documentation of the
science).

Run it with `make paper`, or `python experiments/paper.py`.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import jaxnet
from experiments.exactness import deviations, lanes_at_ticks
from jaxnet.runs.cache import enable
from jaxnet.view.figures import every as figures

CONFIG = Path(__file__).parents[1] / "configs" / "paper.yaml"


def main() -> None:
    """Run, draw, check, tell."""
    enable()
    study = jaxnet.load(CONFIG)
    results = jaxnet.run(study, progress=True)
    print(table(results).to_string(index=False, float_format=lambda value: f"{value:.4g}"))
    print(
        "\ntail: mean over vehicles and the last 5 s;"
        " exact: greatest distance from the exact solution"
    )
    for path in (results.path / "cells.csv", *figures.draw_figures(results)):
        print(f"wrote {path}")


def table(results: Any) -> pd.DataFrame:
    """A row per lane, with its distance from the exact solution."""
    rows = results.lanes[
        ["topology", "attack.magnitude", "tail_mean", "tail_disagreement", "switches"]
    ]
    rows = rows.set_axis(["topology", "ā [m]", "tail ẽ [m]", "tail ε̃ [m]", "switches"], axis=1)
    config = results.study.config
    lanes = [
        lanes_at_ticks(cell.scenario, config.seed, range(config.samples))
        for cell in results.study.cells
    ]
    return rows.assign(**{"exact [m]": np.concatenate([deviations(job) for job in lanes])})


if __name__ == "__main__":
    main()
