"""What is the worst that two attackers can do to each defence, and how far is it from the bounds?

`jaxnet search configs/worst_case.yaml`, which is resumed where it was broken off: phases and one
frequency are chosen, on a ring, a lattice and a random digraph. Prints a line for each graph and
defence and draws docs/figures/worst_case.png. Errors are the greatest tail error of any vehicle,
per ā: `found` and `greatest` at the horizon, `late` of what was found at 1,000 s.

Run it with `python experiments/worst_case.py`; with `--budget 400` to try it, in a folder of its
own and without the figure.
"""

from pathlib import Path
from typing import Any

import click
import matplotlib as mpl
import pandas as pd

import jaxnet
from jaxnet.runs.cache import enable
from jaxnet.store.results import Results
from jaxnet.view.figures import multiples, style

CONFIG = Path(__file__).parents[1] / "configs" / "worst_case.yaml"
FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "worst_case.png"
PER_MAGNITUDE = ["found", "late", "greatest", "random", "bound", "fresh", "nonlinear"]
LEAST, MOST = 1e-4, 100.0  # of the axis, per ā: what is beyond stands at its end
SHOWN = {
    "random": {"marker": "o", "markersize": 6, "markerfacecolor": "none", "color": style.RED},
    "found": {"marker": "o", "markersize": 3, "color": style.BLUE},
    "late": {"marker": "x", "markersize": 5, "color": style.BLUE},
    "bound": {"marker": "|", "markersize": 9, "color": style.BLACK},
}
WORDS = {
    "random": "best of as many random lanes",
    "found": "found by search",
    "late": "the same at 1,000 s",
    "bound": "bound of theory",
}


def per_magnitude(results: Results) -> pd.DataFrame:
    """What was found in each cell, per ā, beside the frequency chosen."""
    table = results.worst
    table[PER_MAGNITUDE] = table[PER_MAGNITUDE].div(table["magnitude"], axis=0)
    table["ratio"] = table["bound"] / table["found"]
    table["frequency"] = [chosen(results, cell).frequency for cell in table["cell"]]
    return table


def chosen(results: Results, cell: int) -> Any:
    """The attack that was found the worst."""
    return jaxnet.load(results.path / "worst" / f"{cell}.yaml").cells[0].scenario.attack


def draw(table: pd.DataFrame) -> None:
    """A panel a graph, a row a defence."""
    names = list(dict.fromkeys(table["defence"]))
    with mpl.rc_context(style.PRINT_STYLE):
        labels = [{"topology": graph} for graph in dict.fromkeys(table["topology"])]
        height = multiples.ROW_HEIGHT * len(names)
        drawn, panels = multiples.panel_grid(
            labels, "greatest tail error / ā", "", style.FIGURE_WIDTH, height
        )
        for panel, label in zip(panels, labels, strict=True):
            rows = table[table["topology"] == label["topology"]].set_index("defence").loc[names]
            for column, look in SHOWN.items():
                panel.plot(
                    rows[column].clip(LEAST, MOST), range(len(names)), linestyle="none", **look
                )
        panels[0].set_xscale("log")
        panels[0].set_xlim(LEAST / 1.5, MOST * 1.5)
        panels[0].set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
        panels[0].set_ylim(len(names) - 0.4, -0.6)
        multiples.write_note(drawn, f"what is under {LEAST:g} or over {MOST:g} stands at that end")
        drawn.legend(panels[0].lines, WORDS.values(), loc="outside lower center", ncols=2)
        drawn.savefig(FIGURE, format="png", dpi=150)


@click.command()
@click.option("--budget", default=2000, show_default=True, help="Lanes of each search.")
def main(budget: int) -> None:
    """Search, print, draw."""
    enable()
    study = jaxnet.load(CONFIG, {"search.budget": budget})
    whole = study.config == jaxnet.load(CONFIG).config
    out = Path("results") / ("worst_case" if whole else f"worst_case-{budget}")
    table: Any = per_magnitude(jaxnet.search(study, out, progress=True))
    columns = [
        "topology",
        "defence",
        "found",
        "late",
        "greatest",
        "random",
        "bound",
        "ratio",
        "fresh",
    ]
    columns += ["nonlinear", "frequency", "lanes", "failed"]
    print(table[columns].to_string(index=False, float_format="{:.4g}".format))
    if whole:
        draw(table)


if __name__ == "__main__":
    main()
