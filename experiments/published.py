"""How many starts of a configs/published/ study end apart, and how far outside (docs/published.md).

One line for each network, rule and liar: the starts, the share in which honest agents end more than
`--over` apart with its exact 95 % interval, the median and greatest spread, and the greatest way
outside the hull of the honest starts. Where a study stores trajectories, a line for each network
says how far single agents end from the first one.

Run it with `python experiments/published.py results/jia_union`, after `jaxnet run` has written the
folder.
"""

import click
import numpy as np
import pandas as pd

import jaxnet
from jaxnet.statistics.intervals import CONFIDENCE, clopper_pearson
from jaxnet.store.results import Results

LIARS = "attack.vehicles"


@click.command()
@click.argument("folder")
@click.option(
    "--over", default=0.1, show_default=True, help="Spread [m] over which agents are apart."
)
@click.option("--together", is_flag=True, help="One line for all liars.")
def main(folder: str, over: float, together: bool) -> None:
    """Print all lines."""
    results = jaxnet.open(folder)
    keys = [key for key in results.study.config.sweep if not (together and key == LIARS)]
    lanes = results.lanes
    groups = lanes.groupby(keys, sort=False) if keys else [("all", lanes)]
    for named, group in groups:
        print(line(named, group, over))
    if results.study.config.save.trajectories != "none":
        single_agents(results)


def line(named: object, lanes: pd.DataFrame, over: float) -> str:
    """The line of a group of lanes."""
    spread = lanes["spread"].to_numpy(dtype=float)
    apart = int(np.count_nonzero(spread > over))
    low, high = clopper_pearson(np.array([apart]), np.array([len(lanes)]), CONFIDENCE)
    words = f"{named}: {apart} of {len(lanes)} apart, {apart / len(lanes):.2%}"
    words += f" ({low[0]:.2%} to {high[0]:.2%})"
    words += f"; spread median {np.median(spread):.3g}, greatest {spread.max():.6g}"
    return words + f"; outside {lanes['outside'].max():.3g}"


def single_agents(results: Results) -> None:
    """The greatest distance of each vehicle from the first one at the end, by cell."""
    states = results.trajectories["states"].isel(time=-1).values
    apart = np.linalg.norm(states[..., :2] - states[..., :1, :2], axis=-1)
    for cell, each in enumerate(apart):
        print(
            f"cell {cell}: greatest distance from vehicle 1"
            f" {np.round(each.max(axis=0), 6).tolist()}"
        )
        print(f"cell {cell}: median {np.round(np.median(each, axis=0), 6).tolist()}")


if __name__ == "__main__":
    main()
