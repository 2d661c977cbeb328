"""Is a small share told as plain lanes tell it, by fewer of them?

Two rings under rotating attacks, without a defence and trimmed, each with a τ so great that few
lanes end over τ ā: the share counted by plain lanes with its exact interval, and by subset
simulation with its own, beside how many plain lanes have an interval as narrow.

Run it with `python experiments/rare.py`; with `--lanes 20000` to try it.
"""

from pathlib import Path
from typing import Any

import click
import pandas as pd

import jaxnet
from jaxnet.runs.cache import enable

ATTACK = {"kind": "rotating", "magnitude": 10, "frequency": 0.7}
RING: dict[str, Any] = {
    "engine": "exact",
    "attack": ATTACK,
    "output_step": 0.5,
    "horizon": 60,
    "tail": 10,
    "seed": 1,
}
CASES: dict[str, dict[str, Any]] = {
    "no defence": {"defence": "none", "recovery": {"tau": 2.992}},
    "trimmed": {"defence": "trusted_trim", "recovery": {"tau": 1.88}},
}
LANES = {"no defence": 1_000_000, "trimmed": 200_000}
POINTS = 500  # of each of ten repeats
ENDS = {"": "", "_low": " from", "_high": " to"}


def told(name: str, lanes: int, points: int, out: Path) -> dict[str, Any]:
    """The share of a case by plain lanes and by subset simulation, each with its interval."""
    study = jaxnet.load({"name": "rare", **RING, **CASES[name], "samples": lanes})
    cell = jaxnet.run(study, out / "plain", progress=True).cells.iloc[0]
    (row,) = jaxnet.rare(study, points, out / "subset").to_dict("records")
    plain = {f"plain{words}": cell[f"unrecovered{end}"] for end, words in ENDS.items()}
    subset = {
        f"subset{words}": row[f"share{end}".removeprefix("share_")] for end, words in ENDS.items()
    }
    spent = {"lanes": row["lanes"], "worth plain lanes": row["plain_lanes"]}
    return {"case": name, "plain lanes": lanes, **plain, **subset, **spent}


@click.command()
@click.option(
    "--lanes", type=int, help="Plain lanes of each case [default: 10⁶ and, trimmed, 2·10⁵]."
)
def main(lanes: int | None) -> None:
    """Count both ways, and print a row a case."""
    enable()
    folder = Path("results") / ("rare" if lanes is None else f"rare-{lanes}")
    rows = [
        told(name, lanes or LANES[name], POINTS, folder / name.replace(" ", "_")) for name in CASES
    ]
    print(pd.DataFrame(rows).to_string(index=False, float_format="{:.3g}".format))


if __name__ == "__main__":
    main()
