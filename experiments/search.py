"""Does the search find the worst? Exact optima, and a trimmed ring beside as many random lanes.

Untrimmed, the worst of a constant attack is known: star, ring and path end 1, 90/29 and 4 ā off
where all directions are the same; a spoof of all orders eight times as far; an attack that replaces
what is sent 9/11 and 1; and of all sets of four vehicles the exact solution tells the worst. Of the
trimmed ring, under rotating attacks of any phases and one frequency, nothing is known: each seed
has starts of its own, and a search is held against the best of as many random lanes.

Run it with `python experiments/search.py`; with `--seeds 2` to try it.
"""

import itertools
import math
import time
from typing import Any

import click
import numpy as np

import jaxnet
from jaxnet.engine import batch
from jaxnet.engine.plan import Outcome
from jaxnet.explore.box import Box, places_of
from jaxnet.explore.search import Trials, search_box
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.runs.cache import enable
from jaxnet.theory import bounds
from jaxnet.theory.spread import scenario_gain

BASE: dict[str, Any] = {"engine": "exact", "output_step": 0.5, "horizon": 40, "tail": 5}
BIAS = {"kind": "bias", "magnitude": 10}
SPOOF = {"kind": "spoof", "magnitude": 10}
REPLACES = BIAS | {"threat": "replaces"}
DIRECTIONS = {"attack.direction": "each"}
KNOWN = {
    "constant, star": ("star", BIAS, DIRECTIONS, 1.0),
    "constant, ring": ("cyclic", BIAS, DIRECTIONS, 90 / 29),
    "constant, path": ("path", BIAS, DIRECTIONS, 4.0),
    "spoof, star": ("star", SPOOF, DIRECTIONS, 8.0),
    "spoof, ring": ("cyclic", SPOOF, DIRECTIONS, 8 * 90 / 29),
    "spoof, path": ("path", SPOOF, DIRECTIONS, 32.0),
    "replaces, ring": ("cyclic", REPLACES, DIRECTIONS, 9 / 11),
    "replaces, path": ("path", REPLACES, DIRECTIONS, 1.0),
}
TURNING = {"kind": "rotating", "magnitude": 10}
OVER = {"attack.phase": "each", "attack.frequency": [0.1, 4.0]}
IN_PHASE = BIAS | {"direction": 0.0}
SETS = {"attack.vehicles": {"choose": 4}}
ENOUGH = 4000  # lanes, where the worst is known


def study_of(
    over: dict[str, Any], seed: int, budget: int, starts: int, **keys: Any
) -> jaxnet.Study:
    """A study that searches."""
    search = {"over": over, "budget": budget, "starts": starts, "seed": seed}
    return jaxnet.load({**BASE, **keys, "seed": seed, "search": search})


def largest(outcome: Outcome) -> np.ndarray:
    """The greatest tail error of each lane [m], not a number where it failed."""
    return np.where(outcome.status == 0, outcome.metrics["tail_max"], math.nan)


def found(study: jaxnet.Study) -> tuple[Trials, float]:
    """The end of the search in a study's one cell, and how much time was not the engine's."""
    asked, (cell,), source = study.config.search, study.cells, Keyed(study.config.seed)
    assert asked is not None
    drawn = [place for place in places_of(cell.scenario, source) if place.name in asked.over]
    engine = 0.0

    simulate = batch.simulate

    def timed(*given: Any) -> Outcome:
        nonlocal engine
        begun = time.perf_counter()
        try:
            return simulate(*given)
        finally:
            engine += time.perf_counter() - begun

    trials = Trials(Box(cell.scenario, source, drawn), asked.starts, largest, batch.EVERYTHING)
    begun, batch.simulate = time.perf_counter(), timed
    try:
        for _ in search_box(trials, asked.budget, asked.seed):
            pass
    finally:
        batch.simulate = simulate
    return trials, (time.perf_counter() - begun - engine) / engine


def random_best(study: jaxnet.Study) -> float:
    """The best of as many random lanes [m]."""
    assert study.config.search is not None
    budget, best = study.config.search.budget, 0.0
    for first in range(0, budget, 4096):
        samples = range(first, min(budget, first + 4096))
        lanes = job(study.cells[0].scenario, Keyed(study.config.seed), samples)
        best = max(best, float(np.nanmax(largest(batch.simulate(lanes)))))
    return best


def best_set() -> float:
    """What four vehicles of the ring in phase do to the worst of it, per ā; each set is tried."""
    ring = BASE | {"topology": "cyclic"}
    sets = itertools.combinations(range(1, 13), 4)
    return max(static_bound(ring | {"attack": IN_PHASE | {"vehicles": [*few]}}) for few in sets)


def static_bound(keys: dict[str, Any]) -> float:
    """By the exact solution, of a study without a defence."""
    reach = scenario_gain(jaxnet.load(keys | {"defence": "none"}).cells[0].scenario)
    assert reach is not None
    return bounds.static(reach).worst


def known(seeds: int, budget: int, starts: int) -> None:
    """Print what was found where the worst is known."""
    print(f"{'case':18} {'exact / ā':>9} {'least found':>11} {'reached 99 %':>12} {'overhead':>8}")
    sets = {"constant, any four": ("cyclic", IN_PHASE, SETS, best_set())}
    for name, (topology, attack, over, exact) in (KNOWN | sets).items():
        every = [
            found(
                study_of(
                    over, seed, budget, starts, topology=topology, attack=attack, defence="none"
                )
            )
            for seed in range(seeds)
        ]
        values = np.array([trials.best / 10 for trials, _ in every])
        reached, overhead = (
            np.count_nonzero(values >= 0.99 * exact),
            np.median([part for _, part in every]),
        )
        print(
            f"{name:18} {exact:9.4f} {values.min():11.4f} {reached:9}/{seeds} {overhead:8.0%}",
            flush=True,
        )


def trimmed(seeds: int, budget: int, starts: int) -> None:
    """Print what was found on the trimmed ring, beside random lanes."""
    print(f"\n{'trimmed ring, seed':18} {'found / ā':>9} {'random':>7} {'overhead':>8}")
    pairs = []
    for seed in range(seeds):
        study = study_of(
            OVER, seed, budget, starts, topology="cyclic", attack=TURNING, horizon=60, tail=10
        )
        trials, overhead = found(study)
        pairs.append((trials.best / 10, random_best(study) / 10))
        print(f"{seed:18} {pairs[-1][0]:9.3f} {pairs[-1][1]:7.3f} {overhead:8.0%}", flush=True)
    for name, middle in (("least", np.min), ("median", np.median), ("greatest", np.max)):
        print("{:18} {:9.3f} {:7.3f}".format(name, *middle(pairs, axis=0)))
    better = sum(search > random for search, random in pairs)
    print(f"better than as many random lanes: {better} of {seeds}")


@click.command()
@click.option("--seeds", default=20, show_default=True, help="Searches of each case.")
@click.option(
    "--budget", default=10_000, show_default=True, help="Lanes of each search on the trimmed ring."
)
@click.option("--starts", default=1, show_default=True, help="Initial conditions of each choice.")
def main(seeds: int, budget: int, starts: int) -> None:
    """Run all, and print a line for each case."""
    enable()
    known(seeds, min(budget, ENOUGH), starts)
    trimmed(seeds, budget, starts)


if __name__ == "__main__":
    main()
