"""Does trimming at ticks approach trimming in the vector field (the paper's) as the tick shrinks?

Two lanes of the cyclic graph: one whose kept sets settle, so that it recovers, and one that
chatters for ever. For the first, positions approach those of `tick: 0`. For the second no limit is
claimed: between two neighbours that lie equally far off the field is discontinuous, and an adaptive
method may not even pass. Then the share of lanes that does not recover, the same 200 draws by ticks
and in the vector field.

Run it with `python experiments/tick.py`; it takes a few minutes.
"""

from typing import Any

import numpy as np

import jaxnet
from jaxnet.engine.batch import simulate
from jaxnet.engine.status import Status
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.runs.cache import enable

TICKS = (0.1, 0.05, 0.025, 0.0125)
HORIZON = 30.0
SAMPLES = 200


def main() -> None:
    """A table per lane."""
    enable()
    recovering = {"kind": "rotating", "magnitude": 5.0}
    chattering = {"kind": "sinusoid", "magnitude": 5.0, "phase": 0.0}
    for what, attack in (
        ("recovers (rotating)", recovering),
        ("does not recover (sinusoid)", chattering),
    ):
        limit = lane(0, attack)
        status = Status(int(limit.status[0])).name
        print(f"\n{what}; tick 0: {status}, tail mean {limit.metrics['tail_mean'][0]:.3g} m")
        print(
            f"{'tick [s]':>9} {'distance to tick 0 [m]':>23} {'tail mean [m]':>14} {'switches':>9}"
        )
        for tick in TICKS:
            ours = lane(tick, attack)
            apart = np.linalg.norm(positions(ours) - positions(limit), axis=2)
            farthest = np.nanmax(apart)
            mean = ours.metrics["tail_mean"][0]
            print(f"{tick:9} {farthest:23.3g} {mean:14.3g} {ours.switches[0]:9}", flush=True)
    shares()


def shares() -> None:
    """The share unrecovered after 90 s, of attacks with phases of their own at two frequencies."""
    study = {"horizon": 90.0, "output_step": 0.5, "recovery": {"tau": 0.01}}
    attacks = [{"kind": kind, "magnitude": 10.0} for kind in ("rotating", "sinusoid")]
    sweep = {"attack": attacks, "attack.frequency": [0.7, 1.4], "tick": [0.05, 0]}
    results = jaxnet.simulate({**study, "sweep": sweep}, samples=SAMPLES)
    columns = ["unrecovered", "unrecovered_low", "unrecovered_high", "failed"]
    print(f"\nunrecovered of {SAMPLES} lanes, with 95 % intervals")
    print(results.cells[[*sweep, *columns]].to_string(index=False))


def lane(tick: float, attack: dict[str, Any]) -> Any:
    """The lane of sample 0 with this tick."""
    keys = {
        "tick": tick,
        "attack": attack,
        "horizon": HORIZON,
        "engine": {"max_steps": 20000},
    }
    (cell,) = jaxnet.load(keys).cells
    return simulate(job(cell.scenario, Keyed(0), [0], ("state",)))


def positions(outcome: Any) -> np.ndarray:
    """Positions of the lane: (times, vehicles, 2)."""
    return outcome.series["state"][0, :, :, :2]


if __name__ == "__main__":
    main()
