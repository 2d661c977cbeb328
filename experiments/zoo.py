"""Which defence holds where, and at what cost: attacks × defences × graphs × frequencies.

First configs/zoo.yaml, a share of lanes that do not recover for each of its cells; of each graph
and defence the greatest, with an interval, and where it is. Then attacks that have no frequency,
the paper's Fig. 1, and no attack at all: how long the fleet takes until its mean error is below 1
m, and what it costs on the ring that all who judge do so with noise of 1 m.

The greatest of k shares has no exact interval of its own. Each of the k exact intervals has an
error of 5 % / k here, so all of them hold at once with 95 % confidence (Bonferroni), that of the
greatest included. The lanes of a sample have the same drawn graph in every cell. Failures are
therefore counted as graphs: a graph counts once if a lane on it failed in any cell.

Run it with `python experiments/zoo.py`; with `--samples 8` to try it; with `--table results/zoo` to
print the table of docs/findings.md from a folder that `jaxnet run configs/zoo.yaml` has written.
"""

from pathlib import Path
from typing import Any

import click
import numpy as np

import jaxnet
from jaxnet.runs.cache import enable
from jaxnet.statistics.intervals import CONFIDENCE, clopper_pearson
from jaxnet.store.results import Results

CONFIG = Path(__file__).parents[1] / "configs" / "zoo.yaml"
RESULTS = Path("results")
ON = {"magnitude": 10, "vehicles": [2, 7]}
STEADY = [
    {"kind": "bias", **ON},
    {"kind": "spoof", **ON},
    {"kind": "spoof", **ON, "orders": [3], "label": "third derivative alone"},
    {"kind": "multisine", **ON},
    {"kind": "replay", **ON},
    {"kind": "mimic", **ON},
    {"kind": "greedy", **ON},
]
PERIODIC = [
    {"kind": "rotating", **ON, "vehicles": [4]},
    {"kind": "sinusoid", **ON, "vehicles": [4]},
]
CLOSE = 1.0  # [m]
NOISE = 1.0  # [m]


@click.command()
@click.option("--samples", default=256, show_default=True, help="Lanes of each cell.")
@click.option("--table", help="Print the table of this results folder, and run nothing.")
def main(samples: int, table: str | None) -> None:
    """Run all four, and print a line for each defence, with a column for each graph."""
    if table is not None:
        worst(table, jaxnet.open(table))
        return
    enable()
    study = jaxnet.load(CONFIG, {"samples": samples})
    sweep: dict[str, Any] = dict(study.config.sweep)
    fixed = {key: sweep[key] for key in ("topology", "defence")}
    worst("frequencies from 0.1 to 16 rad/s", simulate(study, "zoo"))
    steady = {**fixed, "attack": STEADY}
    worst("without a frequency", simulate(varied(samples, steady), "zoo-steady"))
    periodic = {
        "defence": fixed["defence"],
        "attack": PERIODIC,
        "attack.frequency": sweep["attack.frequency"],
    }
    fig1 = varied(samples, {"topology": ["figure1"], **periodic}, vehicles=5)
    worst("Fig. 1, vehicle 4 attacked", simulate(fig1, "zoo-figure1"))
    quiet = varied(samples, fixed, attack="none", recovery=None, **{"save.errors": True})
    transient(simulate(quiet, "zoo-quiet"))
    noisy = {
        "topology": ["cyclic"],
        "defence": [with_noise(each) for each in fixed["defence"] if each != "none"],
    }
    ends(simulate(varied(samples, noisy, attack="none", recovery=None), "zoo-noise"))


def with_noise(defence: str | dict[str, Any]) -> dict[str, Any]:
    """A defence that judges with noise, under its own name."""
    known = {"kind": defence, "label": defence} if isinstance(defence, str) else defence
    return {**known, "noise": NOISE}


def varied(samples: int, sweep: dict[str, Any], **keys: Any) -> jaxnet.Study:
    """The study with another sweep."""
    return jaxnet.load(CONFIG, {"samples": samples, **keys, "sweep": sweep})


def simulate(study: jaxnet.Study, name: str) -> Results:
    """Run a study into a folder of that name."""
    return jaxnet.run(study, RESULTS / name, progress=True)


def worst(question: str, results: Results) -> None:
    """The greatest share over cells by graph and defence, its interval, and failed graphs."""
    cells, graphs = results.cells, list(dict.fromkeys(results.cells["topology"]))
    many = max(len(each) for _, each in cells.groupby(["topology", "defence"]))
    print(
        f"\n{question}: greatest share unrecovered of {many} cells, in %, where;"
        " graphs with a failed lane"
    )
    print(
        f"| defence | {' | '.join(graphs)} | {' | '.join(f'failed, {graph}' for graph in graphs)} |"
    )
    print("|---" * (1 + 2 * len(graphs)) + "|")
    for defence in dict.fromkeys(cells["defence"]):
        groups = [
            cells[(cells["topology"] == graph) & (cells["defence"] == defence)] for graph in graphs
        ]
        columns = [
            *(greatest(group) for group in groups),
            *(failed(results, group) for group in groups),
        ]
        print(f"| {defence} | {' | '.join(columns)} |")


def greatest(cells: Any) -> str:
    """The greatest share [%] of some cells, where, and the interval that holds for all at once."""
    if cells["unrecovered"].isna().all():
        return "none ended"
    row = cells.loc[cells["unrecovered"].idxmax()]
    over = np.array([round(row["unrecovered"] * row["ok"])])
    ends = clopper_pearson(over, np.array([row["ok"]]), 1 - (1 - CONFIDENCE) / len(cells))
    low, high = (f"{100 * end[0]:.3g}" for end in ends)
    share = f"{100 * row['unrecovered']:.3g} ({low} to {high})"
    where = [str(row[key]) for key in ("attack", "attack.frequency") if key in row]
    return f"{share}, {' '.join(where)}" if row["unrecovered"] else share


def failed(results: Results, cells: Any) -> str:
    """Samples, and so graphs, of which a lane failed in any of these cells; of how many."""
    lanes = [rows for _, rows in results.by_cell("sample", "status", cells=cells.index)]
    bad = {sample for rows in lanes for sample in rows.loc[rows["status"] != "ok", "sample"]}
    return f"{len(bad)} of {cells['lanes'].max()}"


def transient(results: Results) -> None:
    """Until when the mean error of lanes that do not fail exceeds a metre, with nobody attacked."""
    print(
        "\nno attack: the last time [s] with a mean error over 1 m,"
        " median and greatest; failed lanes"
    )
    errors = results.errors["tracking"]
    time = np.concatenate([[0.0], errors["time"].values])
    for cell in results.study.cells:
        values = errors.sel(cell=cell.number).values
        whole = values[np.isfinite(values).all(axis=1)]
        last = time[((whole > CLOSE) * np.arange(1, len(time))).max(axis=1)]
        spread = f"{np.median(last):6.1f} {last.max():6.1f}" if len(last) else f"{'none left':>13}"
        failed = f"{len(values) - len(last):6} of {len(values)}"
        print(f"{cell.labels['topology']:10} {cell.labels['defence']:18} {spread} {failed}")


def ends(results: Results) -> None:
    """How far off the fleet ends where nobody is attacked."""
    print(
        "\nno attack, noise in judging: mean error [m] at the end,"
        " median and greatest; failed lanes"
    )
    for row in results.cells.to_dict("records"):
        errors = f"{row['tail_mean_median']:9.1e} {row['tail_mean_max']:9.1e}"
        print(f"{row['defence']:18} {errors} {row['failed']:6} of {row['lanes']}")


if __name__ == "__main__":
    main()
