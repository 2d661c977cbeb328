"""How many lanes do Sobol's sequences save?

The paper's ring, attacked in four phases that are drawn: the mean over lanes of tail_mean,
estimated by random draws and by sixteen scrambled sequences, from one seed after another. The
variance of the estimate over seeds, random over sobol, is how many times as many random lanes it
takes for the same accuracy. Beside it stand the same with ā and the frequency drawn too, and where
a defence decides, by which the error jumps.

Run it with `python experiments/quasi.py`, which draws docs/figures/quasi.png; with `--seeds 3
--most 64` to try it.
"""

from pathlib import Path
from typing import Any

import click
import pandas as pd

import jaxnet
from jaxnet.runs.cache import enable

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "quasi.png"
SAMPLES = [64, 256, 1024, 4096]
QUICK = {"engine": "exact", "tick": 0.5, "output_step": 0.5, "horizon": 20.0}
MORE = {"magnitude": {"uniform": [1.0, 10.0]}, "frequency": {"uniform": [0.3, 1.0]}}
STUDIES: dict[str, dict[str, Any]] = {
    "no defence": {"defence": "none"},
    "no defence, ā and frequency drawn": {"defence": "none", "attack": MORE},
    "trusted_trim": {"defence": "trusted_trim"},
}


def estimate(name: str, samples: int, seed: int, draws: str) -> float:
    """The mean that one study comes to [m]."""
    study = QUICK | STUDIES[name] | {"samples": samples, "seed": seed, "draws": draws}
    return jaxnet.simulate(study, progress=False).cells["tail_mean_mean"].iloc[0]


def compared(seeds: int, most: int) -> pd.DataFrame:
    """Standard deviations of the estimate, their ratio squared, by study and number of lanes."""
    rows = []
    for name in STUDIES:
        for samples in (each for each in SAMPLES if each <= most):
            found = {
                draws: pd.Series([estimate(name, samples, seed, draws) for seed in range(seeds)])
                for draws in ("random", "sobol")
            }
            row = {"study": name, "lanes": samples, "mean": found["random"].mean()}
            row |= {draws: each.std(ddof=1) for draws, each in found.items()}
            rows.append(row | {"times": (row["random"] / row["sobol"]) ** 2})
            print(
                {
                    key: value if isinstance(value, str) else f"{value:.4g}"
                    for key, value in rows[-1].items()
                }
            )
    return pd.DataFrame(rows)


def draw(table: pd.DataFrame) -> None:
    """Standard deviations of the estimate against lanes."""
    import matplotlib as mpl

    from jaxnet.view.figures import multiples, style

    with mpl.rc_context(style.PRINT_STYLE):
        labels = [{"study": name} for name in STUDIES]
        drawn, panels = multiples.panel_grid(
            labels, "lanes", "standard deviation of the mean [m]", style.FIGURE_WIDTH, 1.9
        )
        for panel, (name, mine) in zip(panels, table.groupby("study", sort=False), strict=True):
            panel.set_title(str(name), fontsize=7.5)
            for draws, look in zip(("random", "sobol"), style.SERIES_STYLES, strict=False):
                panel.loglog(
                    mine["lanes"], mine[draws], marker="o", markersize=3, label=draws, **look
                )
        panels[0].set_xticks(SAMPLES, map(str, SAMPLES))
        panels[0].minorticks_off()
        drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
        drawn.savefig(FIGURE, format="png", dpi=150)


@click.command()
@click.option("--seeds", default=20, show_default=True, help="Studies of each kind and size.")
@click.option("--most", default=SAMPLES[-1], show_default=True, help="Lanes of a study.")
def main(seeds: int, most: int) -> None:
    """Estimate, compare, draw."""
    enable()
    table = compared(seeds, most)
    if most == SAMPLES[-1]:
        draw(table)


if __name__ == "__main__":
    main()
