"""From how far does a linearisation about the navigator fail, and the exact law not?

The share of lanes that end within 1 m of the navigator, against the half-width of the box in which
the vehicles of `configs/linearised.yaml` start. Headings and speeds are the paper's; `--matched`
gives vehicles the navigator's own heading and speed.

Run it with `python experiments/linearised.py`, which draws docs/figures/linearised.png; with
`--samples 20` to try it.
"""

from pathlib import Path

import click
import numpy as np
import pandas as pd
from scipy.stats import binomtest

import jaxnet
from jaxnet.runs.cache import enable

ROOT = Path(__file__).parents[1]
FIGURE = ROOT / "docs" / "figures" / "linearised.png"
NEAR = 1.0  # [m] of the navigator over the tail: a lane has converged


def shares(study: jaxnet.Study) -> pd.DataFrame:
    """Share of lanes that converge by law and half-width [m], with its exact 95 % interval."""
    lanes, rows = jaxnet.simulate(study).lanes, []
    for cell in study.cells:
        scenario, ends = (
            cell.scenario,
            lanes.loc[lanes["cell"] == cell.number, "tail_max"].to_numpy(),
        )
        converged = binomtest(int(np.sum(ends < NEAR)), len(ends))
        low, high = converged.proportion_ci()
        place = scenario.initial.position.uniform[1]
        row = {"law": scenario.law.kind, "half-width": place, "share": converged.statistic}
        rows.append(row | {"low": low, "high": high, "median end": np.median(ends)})
    return pd.DataFrame(rows)


def draw(table: pd.DataFrame) -> None:
    """Both laws side by side."""
    import matplotlib as mpl

    from jaxnet.view.figures import multiples, style

    with mpl.rc_context(style.PRINT_STYLE):
        across, up = "half-width of the box of starts [m]", "share of lanes that converge"
        drawn, (panel,) = multiples.panel_grid([{}], across, up, style.FIGURE_WIDTH / 2, 1.9)
        looks = zip(table.groupby("law", sort=False), style.SERIES_STYLES, strict=False)
        for (law, mine), look in looks:
            share, look = mine["share"], {"marker": "o", "markersize": 3, "label": law, **look}
            panel.errorbar(
                mine["half-width"], share, [share - mine["low"], mine["high"] - share], **look
            )
        panel.set_ylim(-0.02, 1.02)
        panel.legend(title="law")
        drawn.savefig(FIGURE, format="png", dpi=150)


@click.command()
@click.option("--samples", default=200, show_default=True, help="Lanes of each law and box.")
@click.option("--matched", is_flag=True, help="Start with the navigator's heading and speed.")
def main(samples: int, matched: bool) -> None:
    """Simulate, print, draw."""
    enable()
    start = (
        {"initial.heading": 0.7853981633974483, "initial.speed": 28.284271247461902}
        if matched
        else {}
    )
    table = shares(
        jaxnet.load(ROOT / "configs" / "linearised.yaml", overrides={"samples": samples, **start})
    )
    print(table.to_string(index=False, float_format="{:.3g}".format))
    if samples >= 200 and not matched:
        draw(table)


if __name__ == "__main__":
    main()
