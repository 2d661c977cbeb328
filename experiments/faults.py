"""Does a lane that fails spoil any other?

A thousand lanes run twice. The second time one starts from a position that is not a number, one
with a vehicle at rest, and one, where the engine takes steps, may take ten. The three must be named
with what befell them, and the other 997 be the same to the last bit: metrics, steps, switches, and
ẽ over time.

Run it with `python experiments/faults.py`; it takes about a minute.
"""

import sys
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

import jaxnet
from jaxnet.engine.batch import Job, simulate
from jaxnet.engine.plan import Outcome
from jaxnet.engine.status import Status
from jaxnet.kinds.vehicles import SPEED
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.runs.cache import enable

LANES = 1000
FAULTS = {17: Status.nonfinite, 400: Status.singular, 999: Status.max_steps}
STEPS = 1  # all that the last may take


def main() -> None:
    """A line per engine and defence; status 1 if any lane was spoiled."""
    enable()
    print(f"{'engine':8} {'defence':13} {'faults':>6} {'named':>6} {'others':>7} {'changed':>8}")
    sound = [
        sole(engine, defence)
        for engine in ("nonlinear", "exact")
        for defence in ("none", "trusted_trim")
    ]
    sys.exit(0 if all(sound) else 1)


def sole(engine: str, defence: str) -> bool:
    """A line, and whether the faults were named and are all that changed."""
    clean = lanes(LANES, engine=engine, defence=defence)
    faults = {n: status for n, status in FAULTS.items() if fits(engine, status)}
    before, after = simulate(clean), simulate(with_faults(clean, faults))
    named = sum(int(after.status[n]) == status for n, status in faults.items())
    touched = len(changed(before, after) - set(faults))
    others = LANES - len(faults)
    print(f"{engine:8} {defence:13} {len(faults):6} {named:6} {others:7} {touched:8}", flush=True)
    return named == len(faults) and touched == 0


def fits(engine: str, fault: Status) -> bool:
    """Whether an engine can fail that way: the exact one takes no steps."""
    return engine == "nonlinear" or fault != Status.max_steps


def lanes(count: int, **keys: Any) -> Job:
    """Lanes of the default study with these keys."""
    (cell,) = jaxnet.load(keys).cells
    return job(cell.scenario, Keyed(0), range(count), ("tracking",))


def with_faults(given: Job, faults: Mapping[int, Status]) -> Job:
    """The same lanes, some of them, by number, bound to fail in the way that is given."""
    initial, numbers = given.inputs.lane.initial.copy(), given.inputs.numbers
    for n, fault in faults.items():
        if fault == Status.nonfinite:
            initial[n, 0, 4] = np.nan
        elif fault == Status.singular:
            initial[n, SPEED, 7] = 0.0
        else:
            limit = np.where(np.arange(given.size) == n, STEPS, numbers.max_steps)
            numbers = numbers._replace(max_steps=limit)
    lane = given.inputs.lane._replace(initial=initial)
    return given._replace(inputs=given.inputs._replace(lane=lane, numbers=numbers))


def changed(before: Outcome, after: Outcome) -> set[int]:
    """Numbers of the lanes of which any bit differs."""
    pairs = list(zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True))
    lanes = range(len(before.status))
    return {n for n in lanes if any(old[n].tobytes() != new[n].tobytes() for old, new in pairs)}


if __name__ == "__main__":
    main()
