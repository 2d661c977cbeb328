"""A centerpoint of points in the plane, and weights with that centerpoint as their mean.

Each closed half-plane that contains a centerpoint of n points contains at least n/3 of the points.
The set of all centerpoints is a convex polygon and never empty. It is the intersection of the
half-planes `u·x ≤ h(u)` over all directions u. Here h(u) is the ⌈n/3⌉-th greatest of `u·y_j`.

The order of the points along u changes only at directions normal to a line through two points.
Between two such directions h belongs to one point. Therefore the normals of all pairs determine the
polygon. The four directions of the axes cover the case of points on one line.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.model import elimination
from jaxnet.model.hearing import SlotWeights
from jaxnet.model.plane import dot, length
from jaxnet.model.shapes import LoopIndex

NEAR = 1e-9  # [m], margin added to half-planes against rounding
SAME = 1e-9  # [m] between offsets, and sine between normals, below which two sides are one
PARALLEL = 1e-12  # sine of the angle below which two lines are parallel
CLOSE = 1e-8  # [m], tolerated distance between the weighted mean and the wanted point
CENTERPOINT_ROUNDS = 40  # maximum of Newton's iterations; about 6 suffice
SHORTER = tuple(8.0**-number for number in range(1, 11))  # step lengths tried besides the full step
CENTERPOINT_ROUNDING = 1e-12  # least decrease of the cost that counts
RIDGE = 1e-11  # relative, added to the curvature, which is singular if few points count
TRIFLE = 1e-4  # weight below which the second solution omits a position
TINY = 1e-14  # absolute, added to the curvature where it is 0, and to the length of each side

Points = Float[Array, "2 slots m lanes"]
Point = Float[Array, "2 m lanes"]
OfVehicles = Float[Array, "m lanes"]
Multipliers = Float[Array, "3 m lanes"]
BoundaryMoment = tuple[Point, OfVehicles]


class HalfPlanes(NamedTuple):
    """Half-planes `u·x ≤ h`. The normal u is a unit vector, or 0 for an unused entry."""

    normal: Float[Array, "2 sides m lanes"]
    offset: Float[Array, "sides m lanes"]

    def beyond(self, point: Point) -> Float[Array, "sides m lanes"]:
        """The distance of a point outside each half-plane [m], negative inside."""
        return dot(self.normal, point[:, None]) - self.offset


def weights(position: Points, of: SlotWeights) -> SlotWeights:
    """Weights with a centerpoint of the positions as weighted mean.

    Only slots with positive weight in `of` count. The chosen centerpoint is the mean of the
    boundary of the polygon of centerpoints, and therefore an interior point. Vehicles that move to
    a centerpoint on the boundary need not meet. For three points or fewer, every point between them
    is a centerpoint, and the function returns `of`, normalised.

    The returned weights λ minimise `Σ λ²/w`: they are as near as possible to the given w.
    """
    of = of / of.sum(axis=0, keepdims=True)
    many = (of > 0).sum(axis=0) > 3

    def moved(_: None) -> SlotWeights:
        mean = (of[None] * position).sum(axis=1)
        point = jnp.where(many[None], middle(half_planes(position, of > 0), mean), mean)
        return jnp.where(many[None], least_value(position, of, point), of)

    return jax.lax.cond(many.any(), moved, lambda _: of, None)


def half_planes(position: Points, heard: Bool[Array, "slots m lanes"]) -> HalfPlanes:
    """The half-planes with the set of all centerpoints as intersection."""
    slots = len(heard)
    both = (heard[:, None] & heard[None])[None]
    apart = jnp.where(both, position[:, None] - position[:, :, None], 0.0)
    across = jnp.stack([-apart[1], apart[0]]).reshape(2, slots**2, *heard.shape[1:])
    axes = jnp.asarray([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
    axes = jnp.broadcast_to(axes[:, :, None, None], (2, 4, *heard.shape[1:]))
    normal = jnp.concatenate([across, axes], axis=1)
    size = length(normal)
    normal = normal / jnp.where(size > 0, size, 1.0)[None]
    rank = (heard.sum(axis=0) + 2) // 3  # ⌈n/3⌉; rank 1 is the greatest
    along = dot(normal[:, :, None], position[:, None])
    along = jnp.where(heard[None], along, -jnp.inf)
    above = (along[:, :, None] >= along[:, None]).sum(axis=1)
    offset = jnp.where(above >= rank[None, None], along, -jnp.inf).max(axis=1)
    return HalfPlanes(normal, offset)


def middle(sides: HalfPlanes, beside: Point) -> Point:
    """Mean of the boundary of a convex polygon, an interior point if the polygon has an interior.

    On the line of each side, the other sides leave an interval. The mean weighs the midpoint of
    each interval by its length. The function measures each line from its point nearest to `beside`,
    which is any point.
    """
    numbers = jnp.arange(sides.offset.shape[0])

    def add(
        carry: BoundaryMoment, side: tuple[LoopIndex, Point, OfVehicles, OfVehicles]
    ) -> tuple[BoundaryMoment, None]:
        moment, total = carry
        number, normal, offset, gap = side
        foot, along = beside - gap[None] * normal, jnp.stack([-normal[1], normal[0]])
        rate, room = dot(sides.normal, along[:, None]), NEAR - sides.beyond(foot)
        limit = room / jnp.where(jnp.abs(rate) > PARALLEL, rate, 1.0)
        most = jnp.where(rate > PARALLEL, limit, jnp.inf).min(axis=0)
        fewest = jnp.where(rate < -PARALLEL, limit, -jnp.inf).max(axis=0)
        same = (dot(sides.normal, normal[:, None]) > 0) & (jnp.abs(rate) < SAME)
        same = same & (jnp.abs(sides.offset - offset[None]) < SAME)
        same = same & (numbers < number)[:, None, None]
        fits = (fewest <= most) & ((jnp.abs(rate) > PARALLEL) | (room >= 0)).all(axis=0)
        fits = fits & ~same.any(axis=0) & (dot(normal, normal) > 0)
        size = jnp.where(fits, most - fewest + TINY, 0.0)
        half = jnp.where(fits, (most + fewest) / 2, 0.0)
        return (moment + size[None] * (foot + half[None] * along), total + size), None

    none = jnp.zeros_like(beside), jnp.zeros(beside.shape[1:])
    each = numbers, jnp.moveaxis(sides.normal, 1, 0), sides.offset, sides.beyond(beside)
    moment, total = jax.lax.scan(add, none, each)[0]
    return jnp.where((total > 0)[None], moment / jnp.where(total > 0, total, 1.0)[None], beside)


def least_value(position: Points, of: SlotWeights, point: Point) -> SlotWeights:
    """The weights λ with `Σ λ = 1` and `Σ λ y = point` that minimise `Σ λ²/w`.

    The solution is `λ_j = w_j max(0, a + b·(y_j - point))`. Here a and b minimise the convex,
    piecewise quadratic function `½ Σ w_j max(0, a + b·(y_j - point))² - a`. The solver is Newton's
    method with a line search over a few step lengths.

    If the point lies on an edge of the convex hull, positions off that edge keep weights near 0.
    Rounding hides these weights from Newton's method. A second solution omits these positions. It
    replaces the first solution if its mean is nearer to the point.
    """
    apart = position - point[:, None]
    size = jnp.where(of > 0, length(apart), 0.0).max(axis=0)
    unit = apart / jnp.where(size > 0, size, 1.0)[None, None]
    features = jnp.concatenate([jnp.ones_like(of)[None], unit])

    def shares(factors: Multipliers) -> SlotWeights:
        return jnp.maximum(0.0, (factors[:, None] * features).sum(axis=0))

    def gradient(factors: Multipliers) -> Multipliers:
        return ((of * shares(factors))[None] * features).sum(axis=1).at[0].add(-1.0)

    def cost(factors: Multipliers) -> OfVehicles:
        return (of * shares(factors) ** 2).sum(axis=0) / 2 - factors[0]

    def solved(counted: SlotWeights, right: Multipliers) -> Multipliers:
        curvature = (counted[None, None] * features[:, None] * features[None]).sum(axis=2)
        diagonal = jnp.eye(3)[:, :, None, None]
        damped = curvature + diagonal * (TINY + RIDGE * curvature)
        return elimination.eliminated(jnp.concatenate([damped, right[:, None]], axis=1))[:, 0]

    def off(state: tuple[LoopIndex, Multipliers]) -> Bool[Array, ""]:
        number, factors = state
        left = jnp.abs(gradient(factors)) * size[None] > CLOSE
        return (number < CENTERPOINT_ROUNDS) & left.any()

    def better(state: tuple[LoopIndex, Multipliers]) -> tuple[LoopIndex, Multipliers]:
        number, factors = state
        step = solved(jnp.where(shares(factors) > 0, of, 0.0), gradient(factors))
        best = factors - step
        for share in SHORTER:
            trial = factors - share * step
            best = jnp.where((cost(trial) < cost(best) - CENTERPOINT_ROUNDING)[None], trial, best)
        return number + 1, best

    first = jnp.zeros_like(features[:, 0]).at[0].set(1.0)
    found = of * shares(jax.lax.while_loop(off, better, (jnp.asarray(0), first))[1])
    found = found / found.sum(axis=0, keepdims=True)
    counted = jnp.where(found > TRIFLE, of, 0.0)
    start = jnp.zeros_like(first).at[0].set(1.0)
    linear = (solved(counted, start)[:, None] * features).sum(axis=0)
    again = jnp.maximum(0.0, counted * linear)
    again = again / again.sum(axis=0, keepdims=True)
    missed, less = (length((each[None] * apart).sum(axis=1)) for each in (found, again))
    return jnp.where(((missed > CLOSE) & (less < missed))[None], again, found)
