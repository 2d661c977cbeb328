"""Which defence holds where: attacks × defences × graphs × frequencies, and what each defence costs.

First configs/zoo.yaml, a share of lanes that do not recover for each of its cells; of each graph and defence
the greatest, with its exact 95 % interval, and where it is. Then attacks that have no frequency, the paper's
Fig. 1, and no attack at all: how long the fleet takes until its mean error is below 1 m, and what it costs on
the ring that all who judge do so with noise of 1 m.

Run it with `python experiments/zoo.py`; with `--samples 8` to try it.
"""

from pathlib import Path
from typing import Any

import click
import numpy as np

import jaxnet
from jaxnet.runs.cache import enable
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
def main(samples: int) -> None:
    """Run all four, and print a line for each graph and defence."""
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
    """The cell in which most lanes did not recover, of each graph and defence, and how many were failed."""
    print(f"\n{question}: the greatest share unrecovered, where, and failed lanes of all")
    groups: Any = results.cells.groupby(["topology", "defence"], sort=False)
    for (graph, defence), cells in groups:
        row = cells.loc[cells["unrecovered"].fillna(-1.0).idxmax()]
        share = f"{row['unrecovered']:6.1%} ({row['unrecovered_low']:.1%} to {row['unrecovered_high']:.1%})"
        where = " ".join(str(row[key]) for key in ("attack", "attack.frequency") if key in row)
        failed = f"{cells['failed'].sum():6} of {cells['lanes'].sum()}"
        print(f"{graph:10} {defence:18} {share:28} {where:26} {failed}")


def transient(results: Results) -> None:
    """Until when the mean error of lanes that do not fail is over a metre, where nobody is attacked."""
    print("\nno attack: the last time [s] with a mean error over 1 m, median and greatest; failed lanes")
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
    print("\nno attack, noise in judging: mean error [m] at the end, median and greatest; failed lanes")
    for row in results.cells.to_dict("records"):
        errors = f"{row['tail_mean_median']:9.1e} {row['tail_mean_max']:9.1e}"
        print(f"{row['defence']:18} {errors} {row['failed']:6} of {row['lanes']}")


if __name__ == "__main__":
    main()
