"""Do the two engines agree, lane by lane; and where they do not, why?

Without trimming nothing but the integrator's error is between them: at most 1e-5 m in tail_mean and
tail_max. With trimming they may part where two scores lie so near each other that this error
decides whom to drop; what follows may differ for good, or, among neighbours that have converged,
only in the count of switches. Of such lanes it is looked up where they parted: the first tick at
which a vehicle drops another source, and by how much each engine preferred its choice, found from
its own positions and what the attacks add. A distance between two positions changes by no more than
2 d, d the distance between the engines' positions, so the engines can differ on a knife's edge
alone: where both margins are under 4 d.

Then, by the exact engine, the share of lanes that trimming has not saved after 90 s
(theorems.md O6: 4 to 9 %).

Run it with `python experiments/agreement.py`, or with `--lanes 50`; a thousand lanes take a minute.
"""

import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import click
import jax
import jax.numpy as jnp
import numpy as np

import jaxnet
from jaxnet.engine.batch import Job, simulate
from jaxnet.engine.plan import Outcome
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import trimming
from jaxnet.runs.cache import enable

TOPOLOGIES = ("star", "path", "cyclic")
ENGINES = ("nonlinear", "exact")
ALLOWED = 1e-5  # [m]
TICK = 0.05  # [s]
LOOKED_AT = 20  # lanes, at most, of those that parted


@click.command()
@click.option("--lanes", default=1000, show_default=True)
def main(lanes: int) -> None:
    """All lines; status 1 if the engines disagree untrimmed."""
    enable()
    print("greatest difference [m]  lanes  ok in both  tail_mean  tail_max  over 1e-5")
    untrimmed = [
        agree(topology, lanes, topology=topology, defence="none") for topology in TOPOLOGIES
    ]
    outcomes, apart = agree("cyclic, trimmed", lanes)
    counted = outcomes[0].switches != outcomes[1].switches
    print(f"\n{counted.sum()} of the trimmed lanes count other switches")
    parted = np.flatnonzero((apart > ALLOWED) | counted)
    show(sorted(parted.tolist(), key=lambda sample: -apart[sample])[:LOOKED_AT], apart)
    print(
        f"\nunrecovered after 90 s, trimmed, ā = 10 m: {unrecovered(2000):.1%}"
        " of 2000 lanes (exact engine)"
    )
    sys.exit(int(any((apart > ALLOWED).any() for _, apart in untrimmed)))


def agree(what: str, lanes: int, **keys: Any) -> tuple[list[Outcome], np.ndarray]:
    """A line; outcomes and distances [m] between them lane by lane, NaN where one failed."""
    outcomes = [simulate(lanes_of(engine, range(lanes), **keys)) for engine in ENGINES]
    mine, theirs = (np.stack([o.metrics["tail_mean"], o.metrics["tail_max"]]) for o in outcomes)
    apart = np.abs(mine - theirs)
    (mean, greatest), both = np.nanmax(apart, axis=1), np.isfinite(apart).all(axis=0).sum()
    over = (apart.max(axis=0) > ALLOWED).sum()
    print(f"{what:23} {lanes:6} {both:11} {mean:10.1e} {greatest:9.1e} {over:10}", flush=True)
    return outcomes, apart.max(axis=0)


def lanes_of(engine: str, samples: Sequence[int], save: tuple[str, ...] = (), **keys: Any) -> Job:
    """Lanes of the default study with these keys."""
    (cell,) = jaxnet.load({"tick": TICK, "engine": engine, **keys}).cells
    return job(cell.scenario, Keyed(0), samples, save)


def show(samples: list[int], apart: np.ndarray) -> None:
    """A line per lane on where its engines parted, if there are any."""
    if not samples:
        return
    print("sample  apart [m]  parted at [s]         margins [m]    d [m]  knife's edge")
    jobs = [
        lanes_of(engine, samples, ("state", "kept", "attack"), output_step=TICK)
        for engine in ENGINES
    ]
    outcomes = [simulate(each) for each in jobs]
    for number, sample in enumerate(samples):
        tick, margins, distance = parting(jobs[0], outcomes, number)
        preferred = f"{margins[0]:.1e}, {margins[1]:.1e}"
        edge = "yes" if max(margins) <= 4 * distance else "NO"
        print(
            f"{sample:6} {apart[sample]:10.1e} {tick * TICK:14.2f} {preferred:>19}"
            f" {distance:8.1e}  {edge}"
        )


class Parting(NamedTuple):
    """Where the engines first decide differently in a lane."""

    tick: int
    margins: list[float]  # [m] by which each preferred its choice
    distance: float  # [m] between their positions, the greatest over vehicles


def parting(one: Job, outcomes: list[Outcome], number: int) -> Parting:
    """Of the lane with this number among them; raises if it never parts."""
    mine, theirs = (dropped(one, outcome, number) for outcome in outcomes)
    differs = (mine != theirs).any(axis=(1, 2))
    if not differs.any():
        raise AssertionError("the engines are apart though they decided alike")
    tick = int(np.argmax(differs))
    tolerance = one.inputs.lane.defence.tolerance[number]
    memory = mine[tick - 1] * tolerance  # a first decision has none: they agree there
    margins = []
    for outcome, ours, others in zip(outcomes, (mine, theirs), (theirs, mine), strict=True):
        score = scores(one, outcome, number, tick) + memory
        highest = np.where(ours[tick] & ~others[tick], score, -np.inf).max(axis=0)
        lowest = np.where(others[tick] & ~ours[tick], score, np.inf).min(axis=0)
        margins.append(float((highest - lowest).max()))
    places = [outcome.series["state"][number, tick, :, :2] for outcome in outcomes]
    return Parting(tick, margins, float(np.linalg.norm(places[0] - places[1], axis=1).max()))


def dropped(one: Job, outcome: Outcome, number: int) -> np.ndarray:
    """Slots of each listener that a lane's decisions drop: (ticks, slots, m)."""
    return (outcome.series["kept"][number] == 0) & (one.inputs.lane.weights[number] > 0)


def scores(one: Job, outcome: Outcome, number: int, tick: int) -> np.ndarray:
    """`Δ_ik` [m] by slot and listener, from the positions of a lane at a tick and the attacks."""
    network, weights = one.network, one.inputs.lane.weights[number]
    navigator = jax.tree.map(lambda leaf: leaf[number], one.inputs.lane.navigator)
    path = navigator.jets(np.array(tick * TICK))[0]
    sent = np.concatenate([path[:, None], outcome.series["state"][number, tick, :, :2].T], axis=1)
    with jax.enable_x64(True):
        arrays = map(jnp.asarray, (sent, outcome.series["attack"][number, tick].T))
        received = network.hearing.received(*arrays)[..., None]
        trusted = jnp.asarray((network.trusted & (weights > 0))[..., None])
        references: Any = jnp.asarray(network.shared.references)
        return np.asarray(trimming.deviation(received, trusted, references)[..., 0])


def unrecovered(lanes: int) -> float:
    """Share of trimmed lanes whose mean error is still over ā/100 at the end of 90 s."""
    attack = {"kind": "rotating", "magnitude": 10.0}
    outcome = simulate(lanes_of("exact", range(lanes), horizon=90.0, attack=attack))
    return float((np.asarray(outcome.metrics["tail_mean"]) > 0.01 * 10.0).mean())


if __name__ == "__main__":
    main()
