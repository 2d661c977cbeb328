"""How often, and in how many rounds, must robots talk?

The law couples all vehicles at one instant. Here they solve it by exchanges with their neighbours,
so many rounds at each tick, and hold the jerk between ticks. First theory, for graphs of 6 to 96
vehicles: the spectral radius, the least rounds that are stable, and the greatest stable tick. Then
configs/rounds.yaml: what is left of the tracking error, for the fleet is late for a navigator that
moves. At last the trimmed ring, attacked, behind a slow navigator: does trimming work as it does
with the law solved exactly?

Run it with `python experiments/rounds.py`, which draws docs/figures/rounds.png; with `--samples 8`
to try it.
"""

from pathlib import Path
from typing import Any

import click
import numpy as np

import jaxnet
from jaxnet.engine.batch import Job, simulate
from jaxnet.kinds import registry
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model.graph import dense
from jaxnet.runs.cache import enable
from jaxnet.theory import rounds

CONFIG = Path(__file__).parents[1] / "configs" / "rounds.yaml"
FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "rounds.png"
RESULTS = Path("results")
GAIN = np.array([1.0, 3.0, 3.0])
ONE = {"navigator": [1]}
GRAPHS: dict[str, tuple[str, dict[str, Any]]] = {
    "path": ("path", {}),
    "lattice of four": ("lattice", {}),
    "ring": ("cyclic", {}),
    "lattice, 1 hears 0": ("lattice", ONE),
    "ring, 1 hears 0": ("cyclic", ONE),
}
SIZES = (6, 12, 24, 48, 96)
TICKS = (0.02, 0.05, 0.1, 0.2)
ROUNDS = (1, 2, 5)
APART = 1e6  # [m], so that nothing else that a lane does matters by its rounding
LEAST_TICK, MOST_TICK = 1e-6, 10.0  # [s], between which the greatest stable tick is sought
RATIO = 1.05  # of a tick to the one before it in the search
LOOKED = 20  # ticks by which growth is measured
SIMULATED = np.arange(0.04, 0.3, 0.04)  # [s], ticks at which it is
NAMED = {
    1: (0.075, 1.33),
    2: (0.29, 0.25),
    3: (0.215, 1.33),
    5: (0.265, 1.2),
}  # rounds, and their curve's name
SLOW = {"kind": "lissajous", "frequency": [0.01, 0.02]}
LAWS = ["exact", *({"kind": "rounds", "rounds": n} for n in (2, 5, 20))]
SCORES = [
    {"kind": "trusted_trim", "label": "position"},
    {"kind": "trusted_trim", "score": "announced", "label": "announced"},
    {"kind": "none", "label": "none"},
]


@click.command()
@click.option(
    "--samples", default=1000, show_default=True, help="Lanes of each cell of the trimmed ring."
)
def main(samples: int) -> None:
    """Theory, the figure, and two studies."""
    enable()
    tables()
    draw()
    late(jaxnet.run(jaxnet.load(CONFIG), RESULTS / "rounds", progress=True))
    trimmed(samples)


def spectral_radius(weights: np.ndarray, gain: np.ndarray, tick: float, number: int) -> float:
    """Growth factor at each tick for a graph and a number of rounds."""
    return rounds.growth(rounds.eigenvalues(weights) ** number, gain, tick)


def lateness(weights: np.ndarray, tick: float, number: int) -> np.ndarray:
    """Delay [s] of each vehicle's held jerk behind the navigator's, `h (1/2 + (1 - T)⁻¹T 1)`.

    Behind a slow navigator E tends to this delay times `-d⁴y_0/dt⁴ / k0`.
    """
    left, one = np.linalg.matrix_power(weights[:, 1:], number), np.ones(len(weights))
    return tick * (0.5 + np.linalg.solve(np.eye(len(weights)) - left, left @ one))


def greatest_tick(weights: np.ndarray, gain: np.ndarray, number: int) -> float:
    """Tick [s] up to which all ticks are stable.

    The tick is infinite if all ticks up to MOST_TICK are stable.
    """
    left = rounds.eigenvalues(weights) ** number
    low = LEAST_TICK
    while rounds.growth(left, gain, low * RATIO) < 1:
        low *= RATIO
        if low > MOST_TICK:
            return np.inf
    high = low * RATIO
    for _ in range(rounds.HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if rounds.growth(left, gain, middle) < 1 else (low, middle)
    return low


def least_rate(eigenvalue: float, gain: np.ndarray) -> float:
    """Exchange rate [1/s] above which a real eigenvalue 0 < λ < 1 of A is stable for short ticks.

    For short ticks `q̇ = -c (q + P(E))` with c = (1 - λ^r)/h, approximately r (1 - λ)/h. By Routh's
    criterion stability needs `c > k1² / (k1 k2 - k0)`.
    """
    k0, k1, k2 = gain
    return float(k1**2 / (k1 * k2 - k0) / (1 - eigenvalue))


def weights_of(graph: str, vehicles: int) -> Any:
    """Those of one of the graphs."""
    kind, keys = GRAPHS[graph]
    return dense(registry.find("topology", kind)(**keys).normalised_rows(vehicles))


def tables() -> None:
    """Spectral radii of twelve vehicles; of each size the least rounds and the greatest ticks."""
    print("spectral radius a tick, twelve vehicles, of 1, 2, 3, 5 rounds and infinitely many")
    for graph in GRAPHS:
        weights = weights_of(graph, 12)
        for tick in TICKS:
            radii = [spectral_radius(weights, GAIN, tick, n) for n in (1, 2, 3, 5)]
            told = " ".join(f"{radius:.4f}" for radius in [*radii, rounds.growth(0.0, GAIN, tick)])
            print(f"  {graph:18} {tick:5.2f} s  {told}")
    print(
        f"\nleast rounds (all from) at ticks of {TICKS} s; greatest tick [s] for {ROUNDS} rounds;"
    )
    print("  greatest eigenvalue, and exchanges a second that it asks for")
    for graph in GRAPHS:
        for vehicles in SIZES:
            weights = weights_of(graph, vehicles)
            least = (rounds.least_rounds(weights, GAIN, tick) for tick in TICKS)
            few = " ".join(f"{f'{n} ({m})':>10}" for n, m in filter(None, least))
            most = " ".join(f"{greatest_tick(weights, GAIN, n):8.5f}" for n in ROUNDS)
            slow = float(np.real(rounds.eigenvalues(weights)).max())
            print(
                f"  {graph:18} {vehicles:3}  {few}  {most}  {slow:.5f}"
                f" {least_rate(slow, GAIN):8.4g}"
            )


def parted(one: Job, vectors: Any) -> Job:
    """Lanes of the first one's start, but that each further one is APART along an eigenvector of A.

    What such a lane does and the first does not is linear, free of the navigator, and along that
    eigenvector for good: a complex number, its parts the two axes.
    """
    lane = one.inputs.lane
    initial = np.repeat(np.asarray(lane.initial)[:1], one.size, axis=0)
    initial[1:, 0] += APART * vectors.T.real
    initial[1:, 1] += APART * vectors.T.imag
    return one._replace(inputs=one.inputs._replace(lane=lane._replace(initial=initial)))


def slowest(states: Any, vectors: Any) -> Any:
    """The factor of the slowest motion along each eigenvector from one output time to the next."""
    positions = states[..., 0] + 1j * states[..., 1]
    paths = np.einsum("lti,il->lt", positions[1:] - positions[:1], vectors.conj())
    windows = np.lib.stride_tricks.sliding_window_view(paths, 4, axis=1)  # of at most four motions
    scale = np.abs(windows[:, :-1]).max(axis=2, keepdims=True)
    steps = np.linalg.pinv(windows[:, :-1] / scale, rcond=1e-11) @ (windows[:, 1:] / scale)
    return np.abs(np.linalg.eigvals(steps)).max(axis=1)


def seen(tick: float, number: int) -> float:
    """The spectral radius of the paper's ring as simulated."""
    keys = {
        "tick": tick,
        "output_step": tick,
        "horizon": LOOKED * tick,
        "tail": tick,
        "engine": "exact",
    }
    law = {"kind": "rounds", "rounds": number}
    (cell,) = jaxnet.load({**keys, "law": law, "attack": "none", "defence": "none"}).cells
    vectors = np.linalg.eig(weights_of("ring", 12)[:, 1:])[1]
    lanes = parted(job(cell.scenario, Keyed(0), range(13), ("state",)), vectors)
    return slowest(simulate(lanes).series["state"], vectors).max()


def draw() -> None:
    """Rates against the tick, and greatest stable ticks against rounds and vehicles."""
    import matplotlib as mpl

    from jaxnet.view.figures import style

    with mpl.rc_context(style.PRINT_STYLE):
        figure = style.Figure(figsize=(style.FIGURE_WIDTH, 2.9))
        rates, by_rounds, by_size = figure.subplots(1, 3)
        draw_rates(rates, style.SERIES_STYLES)
        numbers = range(1, 11)
        for (graph, marker), look in zip(
            zip(GRAPHS, "os^Dv", strict=True), style.SERIES_STYLES, strict=False
        ):
            shown: Any = {**look, "marker": marker, "markersize": 3, "label": graph}
            of_twelve = [greatest_tick(weights_of(graph, 12), GAIN, n) for n in numbers]
            by_rounds.semilogy(numbers, of_twelve, **shown)
            of_two = [greatest_tick(weights_of(graph, m), GAIN, 2) for m in SIZES]
            by_size.loglog(SIZES, of_two, **shown)
        by_rounds.set(
            title="(b) twelve vehicles",
            xlabel="rounds at each tick",
            ylabel="greatest stable tick [s]",
        )
        by_rounds.set_xticks(numbers)
        by_size.set(title="(c) two rounds", xlabel="vehicles", ylabel="greatest stable tick [s]")
        by_size.set_xticks(SIZES, map(str, SIZES))
        by_size.minorticks_off()
        figure.legend(*by_size.get_legend_handles_labels(), loc="outside lower right", ncols=5)
        figure.savefig(FIGURE, format="png", dpi=150)
    print(f"\nwrote {FIGURE}")


def draw_rates(panel: Any, looks: Any) -> None:
    """The rate of the slowest motion of the paper's ring: theory as lines, simulated as points."""
    ring, ticks = weights_of("ring", 12), np.linspace(0.004, 0.3, 149)
    for (number, place), look in zip(NAMED.items(), looks, strict=False):
        radii = [spectral_radius(ring, GAIN, tick, number) for tick in ticks]
        panel.plot(ticks, np.log(radii) / ticks, color="black", linestyle=look["linestyle"])
        points = [np.log(seen(tick, number)) / tick for tick in SIMULATED]
        panel.plot(SIMULATED, points, "o", color="black", markerfacecolor="white", markersize=3)
        panel.text(*place, f"{number}", ha="center")
    endless = [np.log(rounds.growth(0.0, GAIN, tick)) / tick for tick in ticks]
    panel.plot(ticks, endless, color="grey")
    panel.text(0.28, -0.89, "∞", color="grey", ha="center")
    panel.axhline(0.0, color="grey", linewidth=0.5)
    panel.set(title="(a) the paper's ring, by rounds", xlabel="tick [s]")
    panel.set(ylabel="rate of the slowest motion [1/s]", ylim=(-1.0, 1.5))


def late(results: Any) -> None:
    """What is left of the tracking error, and by how much vehicles are late on average."""
    print("\nmean error of the tail [m], the median lane; late [s]; lanes of 8 that failed")
    for cell, row in zip(results.study.cells, results.cells.to_dict("records"), strict=True):
        weights = dense(cell.scenario.topology.normalised_rows(12))
        by = lateness(weights, row["tick"], row["law.rounds"]).mean()
        named = f"{row['topology']:8} {row['tick']:5.2f} s {row['law.rounds']} rounds"
        print(f"  {named}  {row['tail_mean_median']:10.4g}  {by:.4f}  {row['failed']}")


def trimmed(samples: int) -> None:
    """The share unrecovered on the ring, by how the law is solved and what the trimming judges."""
    sweep = {"law": LAWS, "defence": SCORES, "attack": ["rotating", "sinusoid"]}
    keys = {"horizon": 90.0, "output_step": 0.5, "navigator": SLOW, "recovery": {"tau": 0.01}}
    study = jaxnet.load(
        {"name": "rounds-trimmed", "samples": samples, "engine": "exact", **keys, "sweep": sweep}
    )
    results = jaxnet.run(study, RESULTS / "rounds-trimmed", progress=True)
    columns = ["unrecovered", "unrecovered_low", "unrecovered_high", "tail_mean_median", "failed"]
    print(f"\nthe ring at 0.05 s, {samples} lanes each, 5 m")
    print(results.cells[[*sweep, *columns]].to_string(index=False))


if __name__ == "__main__":
    main()
