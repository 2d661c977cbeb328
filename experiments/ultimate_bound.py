"""What does an attack cost, and what does theory say that it may cost?

Runs configs/bound.yaml: star, path and ring of twelve vehicles, without defence and with trimming,
four vehicles attacked by a constant signal in phase or rotating ones with phases of their own,
twelve sizes of it, 256 draws of everything random, 90 s. Fits the ultimate error against ā, holds
every lane against the bounds of theory, and writes the report. Then answers:

- do the simulated slopes of the constant attack meet the exact ones (theorems.md O3)?
- how conservative is each bound?
- is the ring the best topology, as the paper ranks them, and why?

Run it with `python experiments/ultimate_bound.py`; what it prints last is how long it took.
"""

import sys
import time
from pathlib import Path

import pandas as pd

import jaxnet
from jaxnet.runs.cache import enable
from jaxnet.statistics.curves import Curve, curves
from jaxnet.store.results import Results
from jaxnet.view.text import slopes

CONFIG = Path(__file__).parents[1] / "configs" / "bound.yaml"
EXACT = {"star": 1.0, "path": 4.0, "cyclic": 3.1034}  # tail_max per ā, untrimmed, the bias in phase
ALLOWED = 1e-3


def main() -> None:
    """Run, fit, report, answer; status 1 if a slope is off or a bound is broken."""
    enable()
    began = time.monotonic()
    results = jaxnet.run(jaxnet.load(CONFIG), progress=True)
    simulated = time.monotonic()
    page = results.report()
    ended = time.monotonic()
    print(slopes.fit_text(results))
    print(f"\n{ranking(results).to_string(index=False)}")
    off = {name: abs(slope(curves(results), name) - exact) for name, exact in EXACT.items()}
    print(
        f"\ngreatest distance from the exact slopes of the constant attack: {max(off.values()):.1e}"
    )
    print(
        f"{len(results.lanes):,} lanes: {simulated - began:.0f} s;"
        f" fits and report: {ended - simulated:.0f} s"
    )
    print(f"wrote {page}")
    sys.exit(int(max(off.values()) > ALLOWED or len(results.violations) > 0))


def slope(found: list[Curve], topology: str) -> float:
    """Of tail_max against ā by least squares, untrimmed, under the constant attack."""
    asked = {"topology": topology, "defence": "none", "attack": "bias"}
    (curve,) = (each for each in found if each.group.labels == asked)
    fit = curve.fit("tail_max")
    assert fit is not None
    return fit[0]


def ranking(results: Results) -> pd.DataFrame:
    """Mean error per ā by topology, attack and defence, and the share that does not recover."""
    rows = []
    for curve in curves(results):
        shares = 100 * curve.cells["unrecovered"]
        rows.append(
            {
                **curve.group.labels,
                "tail mean / ā": " ".join(slopes.slope_texts(curve)),
                "unrecovered": f"{shares.min():.1f} to {shares.max():.1f} %",
            }
        )
    return pd.DataFrame(rows).sort_values(["attack", "defence", "topology"])


if __name__ == "__main__":
    main()
