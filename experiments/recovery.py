"""How often does trimming not save the fleet, from which attacks, and what does that depend on?

Twelve vehicles on a ring, each trimming one neighbour, four of them attacked, so that Assumption 2
of the paper holds and theory promises recovery. A lane has not recovered if the mean error of its
tail is above ā/100. First configs/recovery.yaml: ten thousand lanes of two attacks after 90 s. Then
one thing at a time is varied: the kind of attack and its phases, its frequency (beside no defence
at all), its magnitude, the gain, the navigator's weight, who is attacked, the tick, the horizon.
The shares stand with their exact 95 % intervals. At last the worst lanes are simulated again by the
nonlinear engine, to see that they are no artefact of the exact one.

Run it with `python experiments/recovery.py`; with `--samples 200` to try it.
"""

from pathlib import Path
from typing import Any

import click

import jaxnet
from jaxnet.runs.cache import enable
from jaxnet.runs.replay import replay, worst_of
from jaxnet.store.results import Results

CONFIG = Path(__file__).parents[1] / "configs" / "recovery.yaml"
RESULTS = Path("results")
MAGNITUDE = 10.0  # ā [m]
PHASES = {"in phase": 0.0, "independent": {"uniform": [0.0, 6.283185307179586]}}
PAIR = [{"kind": kind, "magnitude": MAGNITUDE} for kind in ("rotating", "sinusoid")]
KINDS = [
    {"kind": kind, "magnitude": MAGNITUDE, angle: value, "label": f"{kind}, {name}"}
    for kind, angle in (("bias", "direction"), ("rotating", "phase"), ("sinusoid", "phase"))
    for name, value in PHASES.items()
]
QUESTIONS: dict[str, dict[str, Any]] = {
    "attack": {"attack": KINDS},
    "frequency": {
        "attack": PAIR,
        "defence": ["trusted_trim", "none"],
        "attack.frequency": [0.1, 0.35, 0.7, 0.75, 0.8, 1.0, 1.2, 1.25, 1.3, 1.4, 2.0, 2.8],
    },
    "gain": {"attack": PAIR, "gain": [[1, 3, 3], [2, 5, 4], [6, 11, 6]]},
    "weight": {"attack": PAIR, "topology.navigator_weight": [0.02, 0.05, 0.1, 0.2, 0.4]},
    "attacked": {"attack": PAIR, "attack.vehicles": [[2, 5, 8, 11], [1, 5, 9], [1, 7], [4]]},
    "magnitude": {"attack": PAIR, "attack.magnitude": [0.1, 1.0, 10.0, 100.0]},
    "tick": {"attack": PAIR, "tick": [0.25, 0.1, 0.05, 0.025, 0.0125]},
    "horizon": {"attack": PAIR, "horizon": [30.0, 60.0, 90.0, 180.0]},
}


@click.command()
@click.option(
    "--samples", default=10_000, show_default=True, help="Lanes of each attack of the main study."
)
def main(samples: int) -> None:
    """Run, vary, look at the worst."""
    enable()
    results = simulate(jaxnet.load(CONFIG, {"samples": samples}), "recovery")
    show("90 s", results)
    for question, varied in QUESTIONS.items():
        study = jaxnet.load(CONFIG, {"samples": samples // 5, "sweep": varied})
        show(question, simulate(study, f"recovery-{question}"))
    print("\nthe worst lanes by the nonlinear engine: tail mean [m] there, and by the exact engine")
    for cell, sample in worst_of(results):
        _, again = replay(results, cell, sample, "nonlinear")
        row = results.lanes.query("cell == @cell and sample == @sample").iloc[0]
        print(
            f"{row['attack']:10} sample {sample:5}  {again['tail_mean']:8.4g}"
            f"  {row['tail_mean']:8.4g}"
        )


def simulate(study: Any, name: str) -> Results:
    """Run a study into a folder of that name."""
    return jaxnet.run(study, RESULTS / name, progress=True)


def show(question: str, results: Results) -> None:
    """A line per cell."""
    print(
        f"\n{question}: share unrecovered with its 95 % interval;"
        " over ā: tail mean, its median and greatest,"
    )
    print("  and the greatest error of any vehicle")
    cells: Any = results.cells
    for cell, row in zip(results.study.cells, cells.to_dict("records"), strict=True):
        magnitude = cell.scenario.attack.magnitude  # pyright: ignore[reportAttributeAccessIssue]
        interval = f"({row['unrecovered_low']:.1%} to {row['unrecovered_high']:.1%})"
        share = f"{row['unrecovered']:6.1%} {interval}"
        named = ", ".join(
            label if key in ("attack", "defence") else f"{key} {label}"
            for key, label in cell.labels.items()
        )
        columns = ("tail_mean_mean", "tail_mean_median", "tail_mean_max", "tail_max_max")
        per_magnitude = " ".join(f"{row[column] / magnitude:8.1e}" for column in columns)
        print(f"  {named:60} {share:26} {per_magnitude}")


if __name__ == "__main__":
    main()
