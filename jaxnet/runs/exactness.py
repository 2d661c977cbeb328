"""Distance of simulated lanes from the exact solution of the closed loop with the same kept sets."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxnet.config.keys import Scenario
from jaxnet.engine import batch
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import signal
from jaxnet.model.hearing import Hearing
from jaxnet.theory import exact


def lanes_at_ticks(scenario: Scenario, seed: int, samples: Sequence[int]) -> batch.Job:
    """Return lanes of a cell with an output at every tick, so that `deviations` misses no decision."""
    attack = scenario.attack
    known = scenario.tick > 0 and attack.consistent() and scenario.law.solves()
    if not known or attack.strategic or attack.replaces() or attack.periods():
        raise ValueError(
            "the exact solution is known of decisions at ticks, attacks that add a given path, and the law"
            " solved at every instant"
        )
    return job(
        scenario.model_copy(update={"output_step": scenario.tick}),
        Keyed(seed),
        samples,
        ("state", "kept"),
    )


def deviations(lanes: batch.Job) -> Float[np.ndarray, " lanes"]:
    """Return the greatest distance [m] of each lane from the solution (theorems.md O1 and O2).

    The maximum is over ticks and vehicles. The lanes come from `lanes_at_ticks`. Failed lanes have
    not-a-number.
    """
    outcome = batch.simulate(lanes)
    with jax.enable_x64(True):
        return np.array(
            [
                greatest_distance(
                    jax.tree.map(lambda leaf, n=n: jnp.asarray(leaf[n]), lanes.inputs),
                    lanes.network.hearing,
                    float(lanes.clock.interval),
                    {name: values[n] for name, values in outcome.series.items()},
                )
                for n in range(lanes.size)
            ]
        )


def greatest_distance(
    one: batch.Inputs, hearing: Hearing, interval: float, series: dict[str, np.ndarray]
) -> float:
    """Return the greatest distance [m] of one lane."""
    lane = one.lane
    times = np.arange(len(series["kept"])) * interval
    signals = [np.stack(signal.jets(lane.vectors, lane.signal.basis(np.asarray(t)))) for t in times]
    navigator = np.stack([np.asarray(lane.navigator.jets(np.asarray(t))) for t in times], axis=-1)
    own = lane.vehicle.output_jets(lane.initial)
    start = np.stack(
        [(np.asarray(y) - y_0[:, :1]).T for y, y_0 in zip(own, navigator, strict=False)]
    )
    slots = [np.asarray(each) for each in (hearing.sources, hearing.attacked, hearing.signals)]
    listeners = np.arange(slots[0].shape[1])

    def corruption(t: float, weights: np.ndarray) -> np.ndarray:
        mixing = np.zeros((len(listeners), lane.vectors.shape[1]))
        for slot, added, carries in zip(*slots, strict=True):
            mixing[listeners[added], carries[added]] += weights[listeners[added], slot[added]]
        return np.stack([mixing @ jet.T for jet in signals[round(t / interval)]])

    by_slot = jnp.asarray(np.moveaxis(series["kept"], 0, -1))
    kept = np.moveaxis(np.asarray(hearing.retained(by_slot[None])), -1, 0)
    known = exact.tracking_errors(start, corruption, kept, np.asarray(lane.gain), interval)
    ours = series["state"][:, :, :2] - navigator[0].T[:, None]
    return float(np.linalg.norm(ours - known, axis=2).max())
