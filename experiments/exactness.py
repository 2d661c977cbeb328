"""Distance of simulated lanes from the exact solution with the same kept sets (theorems.md O1, O2).

`E_i = y_i - y_0` obeys `E‴ + k2 Ë + k1 Ė + k0 E = 0` around `G = L⁻¹ d`, so from t to t + h

    E(t + h) = G(t + h) + expm(A_c h) (E(t) - G(t)).
"""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import expm

from jaxnet.config.keys import Scenario
from jaxnet.config.scenario import SOLUTION, broken_premise
from jaxnet.engine import batch
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import graph, signal
from jaxnet.model.axis import companion
from jaxnet.model.hearing import Hearing

ErrorJets = Float[np.ndarray, "r m 2"]


def lanes_at_ticks(scenario: Scenario, seed: int, samples: Sequence[int]) -> batch.Job:
    """Lanes of a cell with an output at every tick, so that `deviations` misses no decision.

    Raises ValueError if the scenario breaks a premise of the exact solution.
    """
    if why := broken_premise(scenario, SOLUTION):
        raise ValueError(f"the exact solution is not known: {why}")
    return job(
        scenario.model_copy(update={"output_step": scenario.tick}),
        Keyed(seed),
        samples,
        ("state", "kept"),
    )


def deviations(lanes: batch.Job) -> Float[np.ndarray, " lanes"]:
    """Greatest distance [m] of each lane from the solution (theorems.md O1 and O2).

    The maximum is over ticks and vehicles of `lanes_at_ticks`. Failed lanes have not-a-number.
    """
    outcome = batch.simulate(lanes)
    with jax.enable_x64(True):
        found = []
        for n in range(lanes.size):
            one = jax.tree.map(lambda leaf, n=n: jnp.asarray(leaf[n]), lanes.inputs)
            series = {name: values[n] for name, values in outcome.series.items()}
            interval = float(lanes.clock.interval)
            found.append(greatest_distance(one, lanes.network.hearing, interval, series))
    return np.array(found)


def greatest_distance(
    one: batch.Inputs, hearing: Hearing, interval: float, series: dict[str, np.ndarray]
) -> float:
    lane = one.lane
    times = np.arange(len(series["kept"])) * interval
    signals = [np.stack(signal.jets(lane.vectors, lane.signal.basis(np.asarray(t)))) for t in times]
    navigator = np.stack([np.asarray(lane.navigator.jets(np.asarray(t))) for t in times], axis=-1)
    own = lane.vehicle.output_jets(lane.initial)
    first = [(np.asarray(y) - y_0[:, :1]).T for y, y_0 in zip(own, navigator, strict=False)]
    start = np.stack(first)
    slots = [np.asarray(each) for each in (hearing.sources, hearing.attacked, hearing.signals)]
    listeners = np.arange(slots[0].shape[1])

    def corruption(t: float, weights: np.ndarray) -> np.ndarray:
        mixing = np.zeros((len(listeners), lane.vectors.shape[1]))
        for slot, added, carries in zip(*slots, strict=True):
            mixing[listeners[added], carries[added]] += weights[listeners[added], slot[added]]
        return np.stack([mixing @ jet.T for jet in signals[round(t / interval)]])

    by_slot = jnp.asarray(np.moveaxis(series["kept"], 0, -1))
    kept = np.moveaxis(np.asarray(hearing.retained(by_slot[None])), -1, 0)
    known = tracking_errors(start, corruption, kept, np.asarray(lane.gain), interval)
    ours = series["state"][:, :, :2] - navigator[0].T[:, None]
    return float(np.linalg.norm(ours - known, axis=2).max())


def tracking_errors(
    start: ErrorJets,
    corruption: Callable[[float, Float[np.ndarray, "m sources"]], ErrorJets],
    weights: Float[np.ndarray, "times m sources"],
    gain: Float[np.ndarray, "r"],
    interval: float,
) -> Float[np.ndarray, "times m 2"]:
    """Errors `E` [m] at times 0, interval, 2 interval …

    `weights[n]` is in force from the n-th time to the next. `start` contains E and its derivatives
    below the order r at time 0. `corruption(t, weights)` returns the jets of d.
    """
    step = expm(companion(gain) * interval)
    error, path = start, [start[0]]
    for n, in_force in enumerate(weights[:-1]):
        inverse = np.linalg.inv(graph.laplacian(in_force))
        now, then = (inverse @ corruption(t * interval, in_force)[: len(gain)] for t in (n, n + 1))
        error = then + np.einsum("kl,lmx->kmx", step, error - now)
        path.append(error[0])
    return np.stack(path)
