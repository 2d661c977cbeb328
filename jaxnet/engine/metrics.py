"""What is kept of a lane: numbers gathered at output times, so that memory does not grow with time."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxnet.model import robot


class Observation(NamedTuple):
    """The fleet at one output time, after that tick's decision."""

    state: Float[Array, "m 6"]
    navigator: Float[Array, "2"]
    attack: Float[Array, "m 2"]
    kept: Float[Array, "m sources"]  # weights in force

    def errors(self) -> Float[Array, " m"]:
        """`‖y_i - y_0‖` [m] of each vehicle."""
        return length(self.state[:, :2] - self.navigator[None])

    def disagreements(self) -> Float[Array, " m"]:
        """`‖y_i - Σ_j w_ij y_j‖` [m] with the weights in force and the true outputs."""
        sources = jnp.concatenate([self.navigator[None], self.state[:, :2]])
        return length(self.state[:, :2] - self.kept @ sources)

    def tracking(self) -> Float[Array, ""]:
        """`ẽ`, the mean error over vehicles [m]."""
        return self.errors().mean()

    def disagreement(self) -> Float[Array, ""]:
        """`ε̃`, the mean disagreement over vehicles [m]."""
        return self.disagreements().mean()


class Metrics(NamedTuple):
    """Contract metrics of one lane (DESIGN, section 5), gathered up to some output time."""

    tail_mean: Float[Array, ""]
    tail_max: Float[Array, ""]
    tail_disagreement: Float[Array, ""]
    peak_error: Float[Array, ""]
    min_speed: Float[Array, ""]
    peak_turn_rate: Float[Array, ""]

    @classmethod
    def start(cls) -> "Metrics":
        """Before the first output time."""
        zero = jnp.zeros(())
        return cls(zero, zero, zero, zero, jnp.asarray(jnp.inf), zero)

    def gather(self, seen: Observation, in_tail: Bool[Array, ""], tail_outputs: Int[Array, ""]) -> "Metrics":
        """With one more output time, which counts for the tail or not; means are built up as they go."""
        errors = seen.errors()
        share = jnp.where(in_tail, 1.0, 0.0) / tail_outputs.astype(float)
        return Metrics(
            tail_mean=self.tail_mean + share * errors.mean(),
            tail_max=jnp.maximum(self.tail_max, jnp.where(in_tail, errors.max(), 0.0)),
            tail_disagreement=self.tail_disagreement + share * seen.disagreement(),
            peak_error=jnp.maximum(self.peak_error, errors.max()),
            min_speed=jnp.minimum(self.min_speed, jnp.abs(seen.state[:, robot.SPEED]).min()),
            peak_turn_rate=jnp.maximum(self.peak_turn_rate, jnp.abs(seen.state[:, robot.TURN_RATE]).max()),
        )

    def blank_unless(self, ok: Bool[Array, ""]) -> "Metrics":
        """These numbers if the lane is ok, else not-a-number."""
        return Metrics(*(jnp.where(ok, value, jnp.nan) for value in self))


def length(vectors: Float[Array, "m 2"]) -> Float[Array, " m"]:
    """Euclidean length of each row."""
    return jnp.hypot(vectors[:, 0], vectors[:, 1])
