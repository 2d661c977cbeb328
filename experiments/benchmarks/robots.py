"""Robots of the arena, sampled: lanes per second beside a NumPy loop; what limits and filters cost.

`python experiments/benchmarks/robots.py`: 12 robots on a ring, 300 steps of Euler's method. The
loop advances one lane after the other, with all robots of a step in one array, as users do.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

import jaxnet
from jaxnet.engine import batch
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed

Clock = Callable[[], float]
STEP, STEPS, ROBOTS, AHEAD, RADIUS, BASE, MOST = 0.033, 300, 12, 0.05, 0.016, 0.11, 12.5
STUDY = {
    "navigator": "none",
    "vehicles": ROBOTS,
    "topology": {"kind": "circulant", "offsets": [1, -1]},
    "law": "local",
    "gain": [2.0],
    "attack": "none",
    "defence": "none",
    "engine": {"kind": "sampled", "move": "euler"},
    "tick": STEP,
    "output_step": STEP,
    "horizon": STEPS * STEP,
    "tail": 0.0,
    "initial": {"position": {"uniform": [-1.0, 1.0]}},
}
WITHOUT = {"kind": "look_ahead", "ahead": AHEAD}
# Robots that meet in the middle of a circle, and robots that stay 1 m apart
MEETING = {
    "initial": {"position": [[0.9 * np.cos(a), 0.9 * np.sin(a)] for a in np.arange(12) * np.pi / 6]}
}
APART = {
    "formation": {"kind": "circle", "radius": 2.0},
    "gain": [0.05],
    "initial": {"position": {"uniform": [-0.1, 0.1]}},
}


def moved_by_numpy(place: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """The points (2, m) that one lane's robots agree on, after all steps."""
    for _ in range(STEPS):
        along = np.stack([np.cos(heading), np.sin(heading)])
        left = np.stack([-along[1], along[0]])
        point = place + AHEAD * along
        asked = np.roll(point, 1, axis=1) + np.roll(point, -1, axis=1) - 2 * point
        speed, turn = (along * asked).sum(axis=0), (left * asked).sum(axis=0) / AHEAD
        wheels = [(2 * speed + side * BASE * turn) / (2 * RADIUS) for side in (-1, 1)]
        slow, fast = (np.clip(each, -MOST, MOST) for each in wheels)
        speed, turn = RADIUS * (slow + fast) / 2, RADIUS * (fast - slow) / BASE
        place, heading = place + STEP * speed * along, heading + STEP * turn
        heading = np.arctan2(np.sin(heading), np.cos(heading))
    return place + AHEAD * np.stack([np.cos(heading), np.sin(heading)])


def seconds_of(
    lanes: int, rounds: int, clock: Clock = time.perf_counter, **keys: object
) -> tuple[float, np.ndarray, batch.Job]:
    """Least time to simulate lanes whose numbers are drawn, their spread, and their batch."""
    (cell,) = jaxnet.load({**STUDY, **keys}).cells
    drawn = job(cell.scenario, Keyed(0), range(lanes))
    found, least = batch.simulate(drawn), np.inf
    for _ in range(rounds):
        begin = clock()
        found = batch.simulate(drawn)
        least = min(least, clock() - begin)
    return least, np.asarray(found.metrics["spread"]), drawn


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lanes", type=int, default=10_000)
    parser.add_argument("--by-loop", type=int, default=20, help="lanes of the loop")
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    free, _, _ = seconds_of(asked.lanes, asked.rounds, vehicle=WITHOUT)
    limited, spread, drawn = seconds_of(asked.lanes, asked.rounds, vehicle="robotarium")
    initial = np.asarray(drawn.inputs.lane.initial)
    begin = time.perf_counter()
    ends = [moved_by_numpy(lane[:2], lane[2]) for lane in initial[: asked.by_loop]]
    loop = (time.perf_counter() - begin) / asked.by_loop
    apart = [np.hypot(*(end[:, :, None] - end[:, None])).max() for end in ends]
    error = np.abs(np.array(apart) - spread[: asked.by_loop]).max()
    print(f"loop in NumPy        {1 / loop:12,.0f} lanes/s")
    print(f"jaxnet, limits       {asked.lanes / limited:12,.0f} lanes/s", end="")
    print(f"   {loop * asked.lanes / limited:.0f} times; spreads differ by {error:.1e} m")
    print(f"jaxnet, no limits    {asked.lanes / free:12,.0f} lanes/s", end="")
    print(f"   limits cost {limited / free:.2f} times")
    few = asked.lanes // 10
    for name, start in {"robots stay apart": APART, "robots meet": MEETING}.items():
        plain, _, _ = seconds_of(few, asked.rounds, time.process_time, vehicle=WITHOUT, **start)
        for form in ("halves", "joint"):
            safety = {"kind": "barrier", "form": form}
            keys = {"vehicle": WITHOUT, "filter": safety, **start}
            least, _, _ = seconds_of(few, asked.rounds, time.process_time, **keys)
            print(f"filter {form:7s} {few / least:12,.0f} lanes/CPU s   ", end="")
            print(f"{least / plain:.2f} times, {name}")


if __name__ == "__main__":
    main()
