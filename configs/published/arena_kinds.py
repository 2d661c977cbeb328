"""Law and robot of the Robotarium's examples, for arena_formation.yaml and arena_leader.yaml."""

import math

import jax.numpy as jnp

from jaxnet.kinds.fields import Positive, setting
from jaxnet.kinds.laws import LinkLaw
from jaxnet.kinds.vehicles import directions
from jaxnet.kinds.vehicles.robotarium import Robotarium
from jaxnet.model.plane import dot, length


class Distances(LinkLaw):
    """`q_i = k0 Σ_j w_ij (‖Δ_ij‖² - d_ij²) Δ_ij`, at most `most`, so that links get their lengths.

    Δ_ij is the place that robot i hears from j, less its own.
    """

    lengths: list[list[float]] = setting(
        [[]], "[m], d_ij from each robot to each source, the navigator first"
    )
    most: Positive = setting(0.15, "[m/s], the greatest norm of q")

    def demand(self, apart, links):
        robots = jnp.arange(links.sources.shape[1])[None]
        wanted = jnp.asarray(self.lengths)[robots, links.sources][:, :, None]
        pull = (length(apart[0]) ** 2 - wanted**2)[None] * apart[0]
        asked = links.gain[0][None, None] * (links.weights * pull).sum(axis=1)
        size, most = length(asked), self.most[None]
        return asked * jnp.where(size > most, most / size, 1.0)[None]


class Turning(Robotarium):
    """A robot that turns towards q: `v = forward h·q`, `ω = turning atan2(n·q, h·q) / (π/2)`.

    Its output is the axle, not the point ahead.
    """

    forward: Positive = setting(1.0, "v over h·q")
    turning: Positive = setting(math.pi, "[rad/s], ω for a q to the left")

    def output_jets(self, state):
        return (state[:2],)

    def inputs_for(self, state, jerk):
        xp, (along, left) = state.__array_namespace__(), directions(state)
        ahead, aside = dot(along, jerk), dot(left, jerk)
        turn = self.turning[None] * xp.atan2(aside, ahead) / (math.pi / 2)
        return xp.stack([self.forward[None] * ahead, turn])
