"""Does trimming at ticks approach trimming in the vector field, the paper's letter, as the tick shrinks?

Two lanes of the cyclic graph: one whose kept sets settle, so that it recovers, and one that chatters for
ever. For the first, positions approach those of `tick: 0`. For the second no limit is claimed: between two
neighbours that lie equally far off the field is discontinuous, and an adaptive method may not even pass.

Run it with `python experiments/tick.py`; it takes a few minutes.
"""

from typing import Any

import numpy as np

import jaxnet
from jaxnet.engine.batch import simulate
from jaxnet.engine.status import Status
from jaxnet.lanes.jobs import job
from jaxnet.runs.cache import enable

TICKS = (0.1, 0.05, 0.025, 0.0125)
HORIZON = 30.0


def main() -> None:
    """A table per lane."""
    enable()
    recovering = {"kind": "rotating", "magnitude": 5.0}
    chattering = {"kind": "sinusoid", "magnitude": 5.0, "phase": 0.0}
    for what, attack in (("recovers (rotating)", recovering), ("does not recover (sinusoid)", chattering)):
        limit = lane(0, attack)
        status = Status(int(limit.status[0])).name
        print(f"\n{what}; tick 0: {status}, tail mean {limit.metrics['tail_mean'][0]:.3g} m")
        print(f"{'tick [s]':>9} {'distance to tick 0 [m]':>23} {'tail mean [m]':>14} {'switches':>9}")
        for tick in TICKS:
            ours = lane(tick, attack)
            apart = np.linalg.norm(positions(ours) - positions(limit), axis=2)
            farthest = np.nanmax(apart)
            mean = ours.metrics["tail_mean"][0]
            print(f"{tick:9} {farthest:23.3g} {mean:14.3g} {ours.switches[0]:9}", flush=True)


def lane(tick: float, attack: dict[str, Any]) -> Any:
    """The lane of sample 0 with this tick."""
    keys = {
        "tick": tick,
        "attack": attack,
        "horizon": HORIZON,
        "engine": {"max_steps": 20000},
    }
    (cell,) = jaxnet.load(keys).cells
    return simulate(job(cell.scenario, 0, [0], ("state",)))


def positions(outcome: Any) -> np.ndarray:
    """Positions of the lane: (times, vehicles, 2)."""
    return outcome.series["state"][0, :, :, :2]


if __name__ == "__main__":
    main()
