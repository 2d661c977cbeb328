"""A unicycle with a point ahead of its axle as output, usually steered as a single integrator.

The heading follows the point's velocity q by `θ̇ = n·q / l`. With complex numbers for vectors of
the plane and `u ∝ exp(iθ/2)`, this equation is linear:

    u̇ = q ū / (2l),      a matrix A(t) = [[q_x, q_y], [q_y, -q_x]] / (2l) of SL(2)'s Lie algebra.

`heading_after` solves it by Magnus' series of order six (Blanes, Casas, Ros 2000), exactly for a
constant q.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from jaxnet.kinds.fields import Positive, setting
from jaxnet.kinds.shapes import VehicleNumbers, VehicleVectors
from jaxnet.kinds.vehicles import Wheeled, directions
from jaxnet.model.circle import angle, circle
from jaxnet.model.plane import cross, dot, length


class LookAhead(Wheeled):
    """A unicycle of order 1 whose output is the point `y = p + l h`; never singular.

    The state is `[p_x, p_y, θ]` with the position p of the axle, the input is `u = [v, θ̇]`. The
    output does not determine the heading, which follows `θ̇ = n·ẏ / l`. A vehicle that is pushed
    back turns round. `initial.speed` has no effect.
    """

    order = 1
    singular = 0
    internal = True
    states = ("x", "y", "heading")
    units = ("m", "m", "rad")
    inputs = ("speed", "turn_rate")
    input_units = ("m/s", "rad/s")

    ahead: Positive = setting(0.1, "[m], l, from the axle to the output point")

    def start(self, position, heading, speed):
        return position.__array_namespace__().stack([position[0], position[1], heading])

    def output_jets(self, state):
        """The point `p + l h`."""
        along, _ = directions(state)
        return (state[:2] + self.ahead[None, None] * along,)

    def sideways(self, state):
        return self.ahead[None]

    def motion(self, state, inputs):
        """`[v cos θ, v sin θ, θ̇]`."""
        return self.moving(state, inputs[0], inputs[1])

    def inner(self, state):
        return state[2:]

    def state_with(self, jets, inner):
        """The axle `y - l h` and the heading."""
        xp = inner.__array_namespace__()
        along = xp.stack([*circle(inner[0])])
        return xp.concatenate([jets[0] - self.ahead[None, None] * along, inner])

    def inner_after(self, inner, jets, span):
        """The heading a span [s] later, and an estimate of its error [rad]."""
        scale = span / (2 * self.ahead)
        heading, error = heading_after(inner[0], [each[1] * scale[None, None] for each in jets])
        return heading[None], error

    def pace(self, state, inputs):
        """The absolute speed of the axle, and the turn rate."""
        return abs(inputs[0]), inputs[1]


class Generator(NamedTuple):
    """A matrix of SL(2)'s Lie algebra: it maps u to `s ū + i r u`, with s complex and r real."""

    s: VehicleVectors
    r: VehicleNumbers


def added(*terms: tuple[float, Generator]) -> Generator:
    parts = zip(*[(factor * each.s, factor * each.r) for factor, each in terms], strict=True)
    return Generator(*map(sum, parts))


def bracket(a: Generator, b: Generator) -> Generator:
    """The commutator `ab - ba`."""
    c, d = 2 * (a.r[None] * b.s - b.r[None] * a.s)
    return Generator(a.s.__array_namespace__().stack([-d, c]), 2 * cross(b.s, a.s))


def heading_after(
    heading: VehicleNumbers, velocities: Sequence[VehicleVectors]
) -> tuple[VehicleNumbers, VehicleNumbers]:
    """Headings [rad] after a step, and an estimate of their error: that of an order less by two.

    `velocities` are q times the step's length over 2l, at `OUTPUT_PLACES` in the step.
    """
    (start, first, middle, last, end), still = velocities, 0.0 * heading
    one = Generator(middle, still)
    two = Generator((math.sqrt(15) / 3) * (last - first), still)
    three = Generator((10 / 3) * (last - 2 * middle + first), still)
    outer = bracket(one, two)
    nested = added((-1 / 60, bracket(one, added((2.0, three), (1.0, outer)))))
    others = added((-20.0, one), (-1.0, three), (1.0, outer))
    sixth = bracket(others, added((1.0, two), (1.0, nested)))
    mean = added((1.0, one), (1 / 12, three))
    whole = added((1.0, mean), (1 / 240, sixth))
    apart = added((1.0, whole), (-1.0, mean), (1 / 12, outer))
    simpson = (start + 4 * middle + end) / 6
    return heading + turn(heading, whole), length(apart.s) + abs(apart.r) + length(simpson - mean.s)


def turn(heading: VehicleNumbers, by: Generator) -> VehicleNumbers:
    """The angle [rad] by which the exponential of a generator turns headings.

    The square of a generator is the number `|s|² - r²`. u is scaled to keep exponentials finite.
    """
    xp = heading.__array_namespace__()
    along = xp.stack([*circle(heading)])
    square = dot(by.s, by.s) - by.r**2
    root = xp.sqrt(xp.maximum(xp.abs(square), 1e-300))
    even = xp.where(square > 0, 1.0, xp.cos(root))
    odd = xp.where(square > 0, xp.tanh(root), xp.sin(root)) / root
    ahead, left = even + odd * dot(along, by.s), odd * (cross(along, by.s) + by.r)
    nowhere = (ahead == 0) & (left == 0)  # pushed straight back, for long: the heading stays
    return 2 * angle(xp.where(nowhere, 1.0, ahead), left)
