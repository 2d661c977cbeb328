"""How far simulated lanes are from the exact solution of the closed loop, given their own kept sets."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxnet.engine import batch
from jaxnet.model import attack, robot
from jaxnet.study.config import Scenario
from jaxnet.study.lanes import job
from jaxnet.theory import exact


def ticked(scenario: Scenario, seed: int, samples: Sequence[int]) -> batch.Job:
    """Lanes of a cell with an output at every tick, so that `deviations` misses no decision."""
    if scenario.tick == 0:
        raise ValueError("the exact solution needs kept sets that are held between ticks")
    return job(scenario.model_copy(update={"output_step": scenario.tick}), seed, samples, ("state", "kept"))


def deviations(lanes: batch.Job) -> Float[np.ndarray, " lanes"]:
    """Greatest distance [m] over ticks and vehicles from the solution (SCIENCE, O1 and O2), lane by lane.

    The lanes are `ticked` ones. A failed lane's is not-a-number.
    """
    outcome = batch.simulate(lanes)
    with jax.enable_x64(True):
        return np.array(
            [
                worst(jax.tree.map(lambda leaf, n=n: jnp.asarray(leaf[n]), lanes.inputs), outcome.series, n)
                for n in range(lanes.size)
            ]
        )


def worst(one: batch.Inputs, series: dict[str, Any], number: int) -> float:
    """Greatest distance of one lane."""
    lane, interval = one.lane, float(one.clock.interval)
    times = np.arange(len(series["kept"][number])) * interval
    signals = np.asarray(jax.vmap(lane.attack.jets)(jnp.asarray(times)))
    navigator = type(lane.navigator)(*map(np.asarray, lane.navigator)).jets(times)
    start = np.asarray(robot.output_jets(lane.initial)) - navigator[0, :3, None]

    def corruption(t: float, weights: Any) -> np.ndarray:
        signal = jnp.asarray(signals[round(t / interval)])
        return np.asarray(mixed(signal, lane.attack.links, jnp.asarray(weights)))

    known = exact.tracking_errors(start, corruption, series["kept"][number], np.asarray(lane.gain), interval)
    ours = series["state"][number, :, :, :2] - navigator[:, None, 0]
    return float(np.linalg.norm(ours - known, axis=2).max())


mixed = jax.jit(attack.corruption)
