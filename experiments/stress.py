"""Do the bounds hold, whatever the graph, the attack, the defence and the gain?

Cells drawn at random: a graph of eight vehicles that each hear five sources with random weights; a
random set of attacked vehicles on either channel, constant, sinusoidal or rotating, of random size,
frequency, direction and phase; nobody or some trimming, with random ϑ and trusted sources; random
stable gains. Every vehicle's error at every output time is held against the bounds that hold for
its lane, its transient allowed for (theorems.md O5), and so is each lane's row, as `jaxnet fit`
does it: there must be no violation.

The ratios shown are those of a lane's greatest error in the tail to its limit there, where the
attack and not the start has caused it. Of static it reaches 1, for constant attacks in phase attain
it.

Run it with `python experiments/stress.py`, or with `--lanes 2000`; 100,000 lanes take minutes.
"""

import sys
from typing import Any, NamedTuple

import click
import numpy as np

import jaxnet
from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import outputs_of
from jaxnet.engine.batch import Machine, simulate
from jaxnet.engine.status import Status
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import graph
from jaxnet.runs.cache import enable
from jaxnet.statistics.limits import limits_of, tail_of

VEHICLES, HEARD = 8, 5
LANES = 256  # of a cell
TRANSIENT = 0.1  # [m], more than what is left of any start in the tail


class Count(NamedTuple):
    """Lanes that were held against a bound, and how they did."""

    lanes: int
    violations: int  # lanes in which a vehicle at some output time, or the row, is over its limit
    ratio: float  # greatest error in the tail over the limit, of lanes where the attack causes it

    def plus(self, other: "Count") -> "Count":
        """Both together."""
        return Count(
            self.lanes + other.lanes,
            self.violations + other.violations,
            max(self.ratio, other.ratio),
        )


@click.command()
@click.option("--lanes", default=100_000, show_default=True)
@click.option("--seed", default=0, show_default=True)
def main(lanes: int, seed: int) -> None:
    """A line per bound; status 1 if any lane is over one."""
    enable()
    cells = -(-lanes // LANES)
    held, failed = stress(cells, seed)
    print(f"{cells * LANES:,} lanes in {cells:,} cells, of which {failed:,} lanes failed\n")
    print(
        f"{'bound':10} {'lanes held to it':>17} {'violations':>11} {'greatest error / limit':>23}"
    )
    for bound, count in held.items():
        print(f"{bound:10} {count.lanes:17,} {count.violations:11,} {count.ratio:23.6f}")
    sys.exit(int(any(count.violations for count in held.values())))


def stress(cells: int, seed: int) -> tuple[dict[str, Count], int]:
    """Counts by bound over random cells, and how many lanes failed."""
    rng, failures = np.random.default_rng(seed), 0
    held = {bound: Count(0, 0, 0.0) for bound in ("static", "harmonic", "peak_gain")}
    for number in range(cells):
        (cell,) = jaxnet.load(keys(rng)).cells
        found, failed = check(cell.scenario, number)
        held |= {bound: held[bound].plus(count) for bound, count in found.items()}
        failures += failed
    return held, failures


def check(scenario: Scenario, seed: int) -> tuple[dict[str, Count], int]:
    """Counts by bound over lanes of one scenario, and how many failed."""
    lanes, times = range(LANES), np.arange(outputs_of(scenario) + 1) * scenario.output_step
    outcome = simulate(job(scenario, Keyed(seed), lanes, ("state",)), Machine(chunk=LANES // 2))
    path = scenario.navigator.jets(times)[0].T
    errors = np.linalg.norm(outcome.series["state"][..., :2] - path[:, None], axis=-1)
    greatest, ok = outcome.metrics["tail_max"], outcome.status == Status.ok
    counts = {}
    for bound, limits in limits_of(scenario, Keyed(seed), lanes, times).items():
        limit = limits[-len(tail_of(scenario)) :].max(axis=(0, 1))
        over = (np.moveaxis(errors, 0, -1) > limits).any(axis=(0, 1)) | (greatest > limit)
        held = ok & np.isfinite(limit)
        caused = held & (greatest > TRANSIENT)
        ratio = (greatest[caused] / limit[caused]).max(initial=0.0)
        counts[bound] = Count(int(held.sum()), int((ok & over).sum()), float(ratio))
    return counts, int((~ok).sum())


def keys(rng: np.random.Generator) -> dict[str, Any]:
    """A study of one random cell."""
    return {
        "vehicles": VEHICLES,
        "horizon": 40.0,
        "tick": 0.1,
        "output_step": 0.5,
        "engine": "exact",
        "topology": {"kind": "edges", "edges": edges(rng)},
        "gain": gain(rng),
        "attack": attack(rng),
        "defence": "none" if rng.random() < 0.4 else defence(rng),
    }


def edges(rng: np.random.Generator) -> list[list[Any]]:
    """Links of a random graph in which the navigator reaches everybody."""
    while True:
        links: list[list[Any]] = []
        for i in range(1, VEHICLES + 1):
            others = [j for j in range(VEHICLES + 1) if j != i]
            links += [
                [i, j, rng.uniform(0.05, 1)]
                for j in rng.choice(others, HEARD, replace=False).tolist()
            ]
        if not graph.unreachable(graph.weighted(VEHICLES, [tuple(link) for link in links])):
            return links


def gain(rng: np.random.Generator) -> list[float]:
    """A stable gain, of three real poles or of one and a pair."""
    real, turn = -rng.uniform(0.5, 3, 3), rng.uniform(0, 4) * 1j
    poles = real if rng.random() < 0.3 else [real[0], real[1] + turn, real[1] - turn]
    return np.poly(poles).real[:0:-1].tolist()


def attack(rng: np.random.Generator) -> dict[str, Any]:
    """Of some vehicles; half of the cells share directions and phases, others have one each."""
    angle = {"uniform": [0, 2 * np.pi]} if rng.random() < 0.5 else rng.uniform(0, 2 * np.pi)
    direction, moving = {"direction": angle}, {"phase": angle, "frequency": {"uniform": [0, 3]}}
    kind = str(rng.choice(["bias", "sinusoid", "rotating"]))
    numbers = {"bias": direction, "sinusoid": direction | moving, "rotating": moving}[kind]
    attacked = rng.choice(VEHICLES, rng.integers(1, 5), replace=False) + 1
    return {
        "kind": kind,
        "magnitude": {"uniform": [0, 20]},
        "vehicles": sorted(attacked.tolist()),
        "links": str(rng.choice(["neighbour", "navigator"])),
        **numbers,
    }


def defence(rng: np.random.Generator) -> dict[str, Any]:
    """Random ϑ and trust; somebody trusts everyone, so that all cells have one program."""
    vehicles, share = range(1, VEHICLES + 1), rng.choice([0.0, 0.3, 0.8])
    trusted = {i: [j for j in vehicles if rng.random() < share] for i in vehicles}
    trusted[int(rng.integers(1, VEHICLES + 1))] = list(vehicles)
    return {
        "kind": "trusted_trim",
        "theta": {i: int(rng.integers(0, 3)) for i in vehicles},
        "trusted": trusted,
    }


if __name__ == "__main__":
    main()
