"""How exact is the nonlinear engine? Every line is held against a closed form of the closed loop.

Prints the greatest distance between simulated and exact positions over all lanes, vehicles and
ticks of 0.1 s, 30 s long: without attack (O1), under every attack without trimming (O2), and with
trimming, given the kept sets (O2 tick by tick); then the errors that a constant attack leaves,
against the static gains (O3).

Run it with `python experiments/accuracy.py`; it takes a minute or two.
"""

from typing import Any

import jaxnet
from experiments.exactness import deviations, lanes_at_ticks
from jaxnet.config.cells import Cell
from jaxnet.engine.batch import simulate
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.runs.cache import enable

TOPOLOGIES = ["star", "path", "cyclic"]
DIGRAPH = [
    [i, j, 1 + (5 * i + 3 * j) % 7] for i in range(1, 13) for j in {0, i % 12 + 1, 5 * i % 13} - {i}
]
GAINS = [[1, 3, 3], [6, 11, 6]]
STATIC = {"star": (1 / 3, 1 / 3), "path": (11 / 6, 1 / 3), "cyclic": (3.0, 0.3)}


def main() -> None:
    """All lines."""
    enable()
    print(f"{'lanes against the exact solution':52} {'lanes':>5}  greatest distance [m]")
    graphs = [*TOPOLOGIES, {"kind": "edges", "edges": DIGRAPH, "label": "digraph"}]
    against(
        "no attack: star, path, cyclic",
        20,
        attack="none",
        defence="none",
        sweep={"topology": TOPOLOGIES},
    )
    for kind in ("bias", "sinusoid", "rotating"):
        swept = {"topology": graphs, "gain": GAINS}
        against(
            f"{kind}: star, path, cyclic, digraph; two gains",
            4,
            attack=kind,
            defence="none",
            sweep=swept,
        )
        fig1 = {"kind": kind, "vehicles": [1, 4]}
        against(f"{kind}: Fig. 1", 4, attack=fig1, defence="none", vehicles=5, topology="figure1")
    for kind in ("bias", "sinusoid", "rotating"):
        against(f"{kind}, trimmed: cyclic", 16, attack=kind)
    print(
        f"\n{'constant in-phase attack':24} {'tail mean/ā':>12} {'exact':>8}"
        f" {'disagr./ā':>15} {'exact':>8}"
    )
    for defence in ("none", "trusted_trim"):
        for name, (error, apart) in STATIC.items():
            static_gain(name, defence, error, apart)


def cells(**keys: Any) -> tuple[Cell, ...]:
    """Cells of a study of these keys."""
    return jaxnet.load({"tick": 0.1, **keys}).cells


def against(what: str, samples: int, **keys: Any) -> None:
    """A line: the worst lane of some cells."""
    lanes = [lanes_at_ticks(cell.scenario, 0, range(samples)) for cell in cells(**keys)]
    worst = max(deviations(job).max() for job in lanes)
    print(f"{what:52} {sum(job.size for job in lanes):5}  {worst:.1e}", flush=True)


def static_gain(name: str, defence: str, error: float, apart: float) -> None:
    """A line: what a constant attack of 2 m leaves after 60 s, over ā."""
    (cell,) = cells(
        topology=name, defence=defence, attack={"kind": "bias", "magnitude": 2}, horizon=60
    )
    metrics = simulate(job(cell.scenario, Keyed(0), [0])).metrics
    if (name, defence) == ("cyclic", "trusted_trim"):
        error = apart = 0.0
    what = name if defence == "none" else f"{name}, trimmed"
    ours = metrics["tail_mean"][0] / 2, metrics["tail_disagreement"][0] / 2
    print(f"{what:24} {ours[0]:12.6f} {error:8.4f} {ours[1]:15.6f} {apart:8.4f}", flush=True)


if __name__ == "__main__":
    main()
