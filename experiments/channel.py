"""What does an attack add to what the channel does anyway, and which defence is worth its price?

Reads results of `configs/channel.yaml`: for each network, defence and channel the mean error over
the tail without and with attack, and draws docs/figures/channel.png.

Run it with `jaxnet run configs/channel.yaml`, then `python experiments/channel.py results/channel`.
"""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import pandas as pd

import jaxnet
from jaxnet.store.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "channel.png"
FLOOR = 1e-3  # [m], least value of the figure's axis
NETWORK = ["topology", "topology.navigator_weight"]
COLUMNS = [*NETWORK, "defence", "channel", "attack.magnitude"]
NAMES = {"cyclic": "ring", "random_regular": "random, degree 4"}
WORDS = {
    "none": "no defence",
    "trusted_trim": "trimming",
    "w_msr": "W-MSR",
    "trusted_only": "trusted only",
}


def table(results: Results) -> pd.DataFrame:
    """Mean error over the tail [m] and half of its normal 95 % interval, 1.96 s.e.; a row a cell.

    `cells.csv` has an interval only where lanes are many for their skewness.
    """
    found: Any = results.cells[[*COLUMNS, "ok", "failed"]]
    lanes: Any = results.lanes.groupby("cell")["tail_mean"]
    return found.assign(mean=lanes.mean(), half=1.96 * lanes.sem())


def draw(found: pd.DataFrame) -> None:
    """A panel for each network, a row for each weight of the navigator."""
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    from jaxnet.view.figures import style

    channels, (kinds, weights) = (
        list(dict.fromkeys(found["channel"])),
        (found[each].unique() for each in NETWORK),
    )
    with mpl.rc_context(style.PRINT_STYLE):
        size = style.FIGURE_WIDTH, 1.75 * len(weights) + 0.6
        drawn, grid = plt.subplots(len(weights), len(kinds), sharex=True, sharey=True, figsize=size)
        drawn.set_layout_engine("constrained", rect=(0, 0, 1, 1 - 0.45 / size[1]))
        for (row, weight), (column, kind) in itertools.product(
            enumerate(weights), enumerate(kinds)
        ):
            panel = grid[row, column]
            mine: Any = found[(found[NETWORK[0]] == kind) & (found[NETWORK[1]] == weight)]
            draw_network(panel, mine, channels)
            panel.set_title(
                f"{NAMES.get(kind, kind)}, {weight:g} on the navigator", fontsize=7.5, pad=3
            )
        for panel in grid[:, 0]:
            panel.set_ylabel("mean error [m]")
        marks, labels = grid[0, 0].get_legend_handles_labels()
        note = f"full: attack of 10 m, open: none; below {FLOOR:g} m at the edge"
        drawn.legend(
            marks, labels, loc="upper center", ncols=len(labels), title=note, title_fontsize=7.5
        )
        drawn.savefig(FIGURE, format="png", dpi=150)


def draw_network(panel: "Axes", mine: pd.DataFrame, channels: list[str]) -> None:
    """Draw mean errors of one network, defences side by side; values under FLOOR at the edge."""
    from jaxnet.view.figures import style

    defences = mine.groupby("defence", sort=False)
    for n, ((defence, rows), look) in enumerate(zip(defences, style.SERIES_STYLES, strict=False)):
        for attacked, each in rows.groupby("attack.magnitude"):
            places = [channels.index(channel) + (n - 1.5) / 6 for channel in each["channel"]]
            label = WORDS.get(str(defence), str(defence)) if attacked else None
            marks = {"marker": "os^D"[n], "markersize": 3.5, "linestyle": "", "clip_on": False}
            marks |= {
                "color": look["color"],
                "markerfacecolor": look["color"] if attacked else "white",
            }
            panel.plot(places, each["mean"].clip(lower=FLOOR), label=label, **marks)
    panel.set_yscale("log")
    panel.set_ylim(FLOOR, 100.0)
    panel.set_xticks(
        range(len(channels)), channels, rotation=30, ha="right", rotation_mode="anchor"
    )
    panel.grid(True, axis="y", color="0.92", linewidth=0.5)


@click.command()
@click.argument("results", type=click.Path(exists=True, file_okay=False))
def main(results: str) -> None:
    """Print the table of RESULTS, and draw the figure."""
    found = table(jaxnet.open(results))
    found["words"] = [
        f"{mean:.3g} ± {half:.1g}" for mean, half in zip(found["mean"], found["half"], strict=True)
    ]
    wide = found.pivot(
        index=[*NETWORK, "defence"], columns=["channel", "attack.magnitude"], values="words"
    )
    click.echo(wide.to_string())
    click.echo(f"failed lanes: {found['failed'].sum():,}")
    draw(found)
    click.echo(f"wrote {FIGURE}")


if __name__ == "__main__":
    main()
