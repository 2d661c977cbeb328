"""What is kept of a lane: numbers gathered at output times, so that memory does not grow with time."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.model.hearing import Hearing


class Observation(NamedTuple):
    """The fleet at one output time, after that tick's decision."""

    error: Float[Array, "2 m *lanes"]  # y_i - y_0 [m]
    speed: Float[Array, "m *lanes"]
    turn_rate: Float[Array, "m *lanes"]
    state: Float[Array, "6 m *lanes"]
    attack: Float[Array, "2 m *lanes"]  # [m]
    weights: Float[Array, "slots m *lanes"]  # in force

    def errors(self) -> Float[Array, "m *lanes"]:
        """`‖y_i - y_0‖` [m] of each vehicle."""
        return length(self.error)

    def disagreements(self, hearing: Hearing) -> Float[Array, "m *lanes"]:
        """`‖y_i - Σ_j w_ij y_j‖` [m] with the weights in force and the true outputs."""
        sources = jnp.concatenate([jnp.zeros_like(self.error[:, :1]), self.error], axis=1)
        return length(self.error - jnp.sum(self.weights[None] * hearing.told(sources), axis=1))


# What can be kept of every output time, its last axis over lanes (DESIGN, section 5).
SERIES: dict[str, Callable[[Observation, Hearing], Any]] = {
    "tracking": lambda seen, hearing: seen.errors().mean(axis=0),
    "disagreement": lambda seen, hearing: seen.disagreements(hearing).mean(axis=0),
    "state": lambda seen, hearing: seen.state.swapaxes(0, 1),
    "attack": lambda seen, hearing: seen.attack.swapaxes(0, 1),
    "kept": lambda seen, hearing: hearing.matrix(seen.weights),
}


class Metrics(NamedTuple):
    """Contract metrics of a lane (DESIGN, section 5)."""

    tail_mean: Float[Array, "*lanes"]
    tail_max: Float[Array, "*lanes"]
    tail_disagreement: Float[Array, "*lanes"]
    peak_error: Float[Array, "*lanes"]
    min_speed: Float[Array, "*lanes"]
    peak_turn_rate: Float[Array, "*lanes"]


class Gathered(NamedTuple):
    """The metrics under way, vehicle by vehicle: then gathering them is free of sums over vehicles."""

    tail_sum: Float[Array, "m *lanes"]
    tail_max: Float[Array, "m *lanes"]
    disagreement_sum: Float[Array, "m *lanes"]
    peak_error: Float[Array, "m *lanes"]
    min_speed: Float[Array, "m *lanes"]
    peak_turn_rate: Float[Array, "m *lanes"]

    @classmethod
    def start(cls, shape: tuple[int, ...]) -> "Gathered":
        """Before the first output time, for this shape (m, lanes)."""
        zero = jnp.zeros(shape)
        return cls(zero, zero, zero, zero, jnp.full(shape, jnp.inf), zero)

    def add(
        self,
        seen: Observation,
        hearing: Hearing,
        there: Bool[Array, "*lanes"],
        in_tail: Bool[Array, "*some"],
    ) -> "Gathered":
        """With one more output time of the lanes that are `there`; tails count where it is `in_tail`."""
        counts, errors = (there & in_tail)[None], seen.errors()

        def tail() -> tuple[jax.Array, jax.Array, jax.Array]:
            apart = seen.disagreements(hearing)
            return (
                jnp.where(counts, self.tail_sum + errors, self.tail_sum),
                jnp.where(counts, jnp.maximum(self.tail_max, errors), self.tail_max),
                jnp.where(counts, self.disagreement_sum + apart, self.disagreement_sum),
            )

        tails, here = (self.tail_sum, self.tail_max, self.disagreement_sum), there[None]
        speed, turn_rate = jnp.abs(seen.speed), jnp.abs(seen.turn_rate)
        sums, greatest, apart = jax.lax.cond(counts.any(), tail, lambda: tails)
        return Gathered(
            sums,
            greatest,
            apart,
            jnp.where(here, jnp.maximum(self.peak_error, errors), self.peak_error),
            jnp.where(here, jnp.minimum(self.min_speed, speed), self.min_speed),
            jnp.where(here, jnp.maximum(self.peak_turn_rate, turn_rate), self.peak_turn_rate),
        )

    def finite(self) -> Bool[Array, "*lanes"]:
        """Lanes of which every number is one."""
        return jnp.isfinite(jnp.stack(self)).all(axis=(0, 1))

    def metrics(self, tail_outputs: Int[Array, ""], ok: Bool[Array, "*lanes"]) -> Metrics:
        """What a row shows: of the whole fleet, and not-a-number where a lane is not ok."""
        outputs = tail_outputs.astype(float)
        whole = Metrics(
            self.tail_sum.mean(axis=0) / outputs,
            self.tail_max.max(axis=0),
            self.disagreement_sum.mean(axis=0) / outputs,
            self.peak_error.max(axis=0),
            self.min_speed.min(axis=0),
            self.peak_turn_rate.max(axis=0),
        )
        return Metrics(*(jnp.where(ok, value, jnp.nan) for value in whole))


def length(vectors: Float[Array, "2 m *lanes"]) -> Float[Array, "m *lanes"]:
    """Euclidean length."""
    return jnp.sqrt(vectors[0] ** 2 + vectors[1] ** 2)
