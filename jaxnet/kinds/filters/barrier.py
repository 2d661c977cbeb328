import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from jaxnet.kinds.fields import Positive, setting, value_range
from jaxnet.kinds.filters import Filter
from jaxnet.kinds.shapes import AnyNumbers, PlaneVectors
from jaxnet.lazy import jnp
from jaxnet.model.plane import dot, length
from jaxnet.solvers.nearest import in_plane, in_space

FACE_ANGLES = np.arange(8) * math.pi / 4
FACES = np.stack(
    [np.cos(FACE_ANGLES), np.sin(FACE_ANGLES)]
)  # normals of the joint program's octagon
FACE = math.cos(math.pi / 8)  # distance of a face of the octagon in a disc of radius 1
LEAST = 1e-300  # [m]


class Barrier(Filter):
    """A control barrier: `ζ̇ ≥ -γ ζ^p` for each pair, ζ = ‖Δ‖² - D², Δ = y_i - y_j.

    `joint`: one quadratic program of all vehicles, `-2Δ·(u_i - u_j) ≤ γ ζ^p`, knows what all
    transmit of their places; a speed is within an octagon in the disc. `halves`: each vehicle has a
    program of its own with a half of each constraint, `-2Δ·u_i ≤ γ ζ^p / 2`, knows its own place
    and what the others transmit; a speed is within the disc. Where a program has no solution, the
    vehicle stands still, or all vehicles for `joint`. Source: Wang, Ames, Egerstedt, Safety barrier
    certificates for collisions-free multirobot systems, 2017; defaults of the Robotarium.
    """

    form: Literal["joint", "halves"] = setting("joint", "who solves: one for all, or each vehicle")
    distance: Positive = setting(0.15, "[m], D, that vehicles keep")
    gain: Positive = setting(100.0, "[s⁻¹ m^(2 - 2p)], γ")
    power: Annotated[int, Field(ge=1, le=9)] = setting(3, "p; ζ^p keeps the sign of ζ")
    speed: Positive | None = setting(0.2, "[m/s], greatest speed; null: none")

    def asks(self):
        return value_range(self.distance)[1]

    def keeps(self, scenario):
        """D, if no pair can pass the barrier while it holds its velocity (theorems.md O18)."""
        (least, most), period = value_range(self.distance), scenario.tick
        if not scenario.engine.samples:
            return least
        if self.speed is None or not scenario.vehicle.holds_velocity:
            return None
        beyond = (most + 2 * period * value_range(self.speed)[1]) ** 2 - most**2
        passes = value_range(self.gain)[1] * period * beyond ** (self.power - 1) > 1
        return None if passes else least

    def breached(self, velocity, own, told):
        gaps, others = self.gaps(own, told)
        if self.form == "halves":
            closing = 2 * velocity[:, :, None]
        else:
            closing = velocity[:, :, None] - velocity[:, None]
        found = (others & (-2 * dot(gaps, closing) > self.room(gaps))).any(axis=1)
        if self.speed is None:
            return found
        if self.form == "halves":
            return found | (length(velocity) > self.speed[None])
        return found | (beyond_faces(velocity, self.speed).max(axis=0) > 0)

    def gaps(self, own: PlaneVectors, told: PlaneVectors) -> tuple[PlaneVectors, Any]:
        """Δ from each other (second axis) to each vehicle (first), and whether it is another."""
        places = told if self.form == "joint" else own
        others = ~np.eye(own.shape[1], dtype=bool)[:, :, None]
        return places[:, :, None] - told[:, None], others

    def room(self, gaps: PlaneVectors) -> AnyNumbers:
        """γ ζ^p [m²/s] of gaps."""
        beyond = dot(gaps, gaps) - (self.distance**2)[None, None]
        return self.gain[None, None] * beyond * abs(beyond) ** (self.power - 1)

    def nearest(self, velocity, own, told):
        gaps, others = self.gaps(own, told)
        apart = jnp.maximum(length(gaps), LEAST)
        toward, closing = -gaps / apart[None], self.room(gaps) / (2 * apart)
        if self.form == "halves":
            by_other = toward.swapaxes(1, 2), jnp.where(others, closing / 2, 1.0).swapaxes(0, 1)
            most = None if self.speed is None else jnp.broadcast_to(self.speed, own.shape[1:])
            return in_plane(velocity, *by_other, most)
        return self.of_all(velocity, toward, jnp.where(others, closing, jnp.inf))

    def of_all(
        self, velocity: PlaneVectors, toward: PlaneVectors, closing: AnyNumbers
    ) -> PlaneVectors:
        """The nearest velocities of all vehicles, closing at these speeds at most."""
        m, lanes = velocity.shape[1:]
        pairs = m * m

        def worst(point: Any) -> tuple[Any, Any]:
            now = point.reshape(2, m, lanes)
            excess = (dot(toward, now[:, :, None] - now[:, None]) - closing) / math.sqrt(2)
            excess = excess.reshape(pairs, lanes)
            if self.speed is not None:
                faces = beyond_faces(now, self.speed).reshape(-1, lanes)
                excess = jnp.concatenate([excess, faces])
            most = excess.argmax(axis=0)
            pair, face = jnp.minimum(most, pairs - 1), jnp.maximum(most - pairs, 0)
            along = jnp.take_along_axis(toward.reshape(2, pairs, lanes), pair[None, None], axis=1)
            is_pair = (most < pairs)[None, None]

            def of(vehicle: Any) -> Any:
                return (np.arange(m)[:, None] == vehicle[None]).astype(float)

            signs = of(pair // m) - of(pair % m)
            of_pair = along * signs[None] / math.sqrt(2)
            of_face = jnp.asarray(FACES.T)[face // m].T[:, None] * of(face % m)[None]
            normal = jnp.where(is_pair, of_pair, of_face)
            return excess.max(axis=0), normal.reshape(2 * m, lanes)

        return in_space(velocity.reshape(2 * m, lanes), worst).reshape(velocity.shape)


def beyond_faces(velocity: PlaneVectors, speed: Any) -> AnyNumbers:
    """How far velocities are beyond each face of the octagon [m/s], (8, m, lanes)."""
    return jnp.einsum("ak,a...->k...", FACES, velocity) - FACE * speed[None, None]
