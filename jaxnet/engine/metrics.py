"""Metrics of a lane, gathered at output times, so that memory does not grow with time; saved series."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.kinds.metrics import CONTRACT, Metric
from jaxnet.model.hearing import Hearing
from jaxnet.model.plane import length


class Observation(NamedTuple):
    """State of the fleet at one output time, after the decision of that tick."""

    error: Float[Array, "2 m *lanes"]  # y_i - y_0 [m]
    speed: Float[Array, "m *lanes"]
    turn_rate: Float[Array, "m *lanes"]
    state: Float[Array, "n m *lanes"]
    attack: Float[Array, "2 m *lanes"]  # [m]
    weights: Float[Array, "axes slots m *lanes"]  # in force
    hearing: Hearing

    def errors(self) -> Float[Array, "m *lanes"]:
        """Return `‖y_i - y_0‖` [m] of each vehicle."""
        return length(self.error)

    def disagreements(self) -> Float[Array, "m *lanes"]:
        """Return `‖y_i - Σ_j w_ij y_j‖` [m] with the weights in force and the true outputs.

        The disagreement of a vehicle that hears nobody is 0.
        """
        sources = jnp.concatenate([jnp.zeros_like(self.error[:, :1]), self.error], axis=1)
        apart = self.error - self.hearing.mean_sent(self.weights, sources)
        return length(jnp.where((self.weights == 0).all(axis=1), 0.0, apart))


Series = dict[str, Float[Array, "..."]]  # stacked over output times, lanes last

# Arrays that can be saved at every output time, with a last axis over lanes (docs/results-folder.md).
SERIES: dict[str, Callable[[Observation], Float[Array, "..."]]] = {
    "tracking": lambda seen: seen.errors().mean(axis=0),
    "disagreement": lambda seen: seen.disagreements().mean(axis=0),
    "state": lambda seen: seen.state.swapaxes(0, 1),
    "attack": lambda seen: seen.attack.swapaxes(0, 1),
    "kept": lambda seen: seen.weights.mean(axis=0),
}


def series(save: Sequence[str], seen: Observation) -> Series:
    """Return the saved arrays of an observation, by name, lanes last."""
    return {name: SERIES[name](seen) for name in save}


def empty_series(save: Sequence[str], rows: int, seen: Callable[[], Observation]) -> Series:
    """Return stacks of the saved arrays over `rows` output times, filled with not-a-number."""
    if not save:
        return {}  # tracing an observation for nothing takes a tenth of all tracing
    shapes = jax.eval_shape(lambda: series(save, seen()))
    return {name: jnp.full((rows, *one.shape), jnp.nan) for name, one in shapes.items()}


NEUTRAL = {"mean": 0.0, "max": -jnp.inf, "min": jnp.inf}
STEP_OVER_TIME = {"mean": jnp.add, "max": jnp.maximum, "min": jnp.minimum}
OVER_VEHICLES = {"mean": jnp.mean, "max": jnp.max, "min": jnp.min}

Gathered = Mapping[str, Float[Array, "m *lanes"]]  # by metric and vehicle, before any sum over vehicles


def nothing(metrics: Sequence[Metric], shape: tuple[int, ...]) -> Gathered:
    """Return the metrics before the first output time, for the shape (m, lanes)."""
    return {metric.name: jnp.full(shape, NEUTRAL[metric.time]) for metric in metrics}


def add(
    metrics: Sequence[Metric],
    gathered: Gathered,
    seen: Observation,
    there: Bool[Array, "*lanes"],
    in_tail: Bool[Array, "*some"],
) -> Gathered:
    """Return the metrics with one more output time, in the lanes where `there` holds.

    Metrics over the tail change only where `in_tail` holds too.
    """
    run, tail = ([metric for metric in metrics if metric.over == over] for over in ("run", "tail"))
    counts = there & in_tail
    before = {metric.name: gathered[metric.name] for metric in tail}
    after = jax.lax.cond(counts.any(), lambda: reduce_over_time(tail, gathered, seen, counts), lambda: before)
    return reduce_over_time(run, gathered, seen, there) | after


def reduce_over_time(
    metrics: Sequence[Metric], gathered: Gathered, seen: Observation, there: Bool[Array, "*lanes"]
) -> dict[str, Float[Array, "m *lanes"]]:
    """Return these metrics with the observation added, in the lanes where `there` holds."""
    found = {}
    for metric in metrics:
        known = gathered[metric.name]
        step = STEP_OVER_TIME[metric.time](known, jnp.broadcast_to(metric.of(seen), known.shape))
        found[metric.name] = jnp.where(there[None], step, known)
    return found


def finite(gathered: Gathered) -> Bool[Array, "*lanes"]:
    """Return the lanes in which every metric of the contract is finite for every vehicle."""
    return jnp.isfinite(jnp.stack([gathered[metric.name] for metric in CONTRACT])).all(axis=(0, 1))


def fleet_values(
    metrics: Sequence[Metric],
    gathered: Gathered,
    outputs: Int[Array, ""],
    tail_outputs: Int[Array, ""],
    ok: Bool[Array, "*lanes"],
) -> dict[str, Float[Array, "*lanes"]]:
    """Return the metrics of the whole fleet; not-a-number where a lane is not ok."""
    times = {"run": outputs + 1, "tail": tail_outputs}
    found = {}
    for metric in metrics:
        value = OVER_VEHICLES[metric.vehicles](gathered[metric.name], axis=0)
        value = value / times[metric.over].astype(float) if metric.time == "mean" else value
        found[metric.name] = jnp.where(ok, value, jnp.nan)
    return found
