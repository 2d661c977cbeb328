"""The nearest point of a polyhedron, a quadratic program: exact, for many lanes side by side.

    minimise ‖x - x̂‖²  where  c_k · x ≤ b_k  for all k,  ‖c_k‖ = 1

`in_plane` solves many problems in the plane, `in_space` one problem of each lane in more
dimensions. Both give not-a-number where no point satisfies all constraints. Lanes are last.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from jaxtyping import Bool, Float

from jaxnet.lazy import jax, jnp
from jaxnet.model.plane import dot, length

NEAR_ENOUGH = 1e-12  # distance [of x] beyond a constraint that counts as none
NO_PART = 1e-18  # square of a unit vector's part that counts as none
MOST_STEPS_EACH = 50  # for each dimension; the tests' problems take fewer than 3

PlanePoints = Float[Any, "2 *lanes"]
PlaneNormals = Float[Any, "2 constraints *lanes"]
SpaceVectors = Float[Any, "n lanes"]
SpaceMatrices = Float[Any, "n n lanes"]
OfLanes = Bool[Any, " lanes"]
Violated = Callable[[SpaceVectors], tuple[Float[Any, " lanes"], SpaceVectors]]


def in_plane(
    wanted: PlanePoints,
    normals: PlaneNormals,
    limits: Float[Any, "constraints *lanes"],
    most: Float[Any, "*lanes"] | None,
) -> PlanePoints:
    """The point nearest to the wanted one under all constraints, and within the disc ‖x‖ ≤ most.

    The constraints come one after the other. Where the point breaks the next one, the new point
    lies on its line: there each constraint before it leaves a ray. Source: van den Berg, Guy, Lin,
    Manocha, Reciprocal n-body collision avoidance, 2011, as Seidel's linear programs.
    """
    first = wanted
    if most is not None:
        first = wanted * jnp.minimum(1.0, most / jnp.maximum(length(wanted), most))[None]
    number = jnp.arange(len(limits)).reshape(-1, *[1] * (limits.ndim - 1))

    def next_broken(point: PlanePoints, after: Any) -> tuple[Any, Any]:
        """Number of the next constraint that a point breaks, and whether there is one."""
        broken = (dot(normals, point[:, None]) > limits + NEAR_ENOUGH) & (number > after[None])
        return broken.argmax(axis=0), broken.any(axis=0)

    def under_way(carry: tuple[PlanePoints, Any, Any]) -> Any:
        return carry[2].any()

    def with_next(carry: tuple[PlanePoints, Any, Any]) -> tuple[PlanePoints, Any, Any]:
        point, k, going = carry
        normal = jnp.take_along_axis(normals, k[None, None], axis=1)[:, 0]
        limit = jnp.take_along_axis(limits, k[None], axis=0)[0]
        foot, along = limit[None] * normal, jnp.stack([-normal[1], normal[0]])
        end = jnp.full_like(limit, jnp.inf)
        if most is not None:
            end = jnp.sqrt(jnp.maximum(most**2 - limit**2, 0.0))
        slope, left = dot(normals, along[:, None]), limits - dot(normals, foot[:, None])
        before, crosses = number < k[None], slope**2 > NO_PART
        place = left / jnp.where(crosses, slope, 1.0)
        upper = jnp.where(before & crosses & (slope > 0), place, jnp.inf).min(axis=0)
        lower = jnp.where(before & crosses & (slope < 0), place, -jnp.inf).max(axis=0)
        upper, lower = jnp.minimum(upper, end), jnp.maximum(lower, -end)
        apart = (before & ~crosses & (left < -NEAR_ENOUGH)).any(axis=0)
        apart = apart | (lower > upper + NEAR_ENOUGH) | (normal == 0).all(axis=0)
        if most is not None:
            apart = apart | (abs(limit) > most)
        on_line = foot + jnp.clip(dot(along, wanted), lower, upper)[None] * along
        found = jnp.where(apart[None], jnp.nan, on_line)
        point = jnp.where(going[None], found, point)
        k, more = next_broken(point, k)
        return point, k, going & more  # a solved problem waits for its neighbours

    start = first, *next_broken(first, jnp.full(limits.shape[1:], -1))
    return jax.lax.while_loop(under_way, with_next, start)[0]


class Search(NamedTuple):
    """A step of `in_space`: constraints that are active, and one more that is to become active."""

    point: SpaceVectors
    inverse: (
        SpaceMatrices  # row k is 1 along active constraint k, 0 along the others; rows may be empty
    )
    free: SpaceMatrices  # projection on what is normal to all active constraints
    forces: SpaceVectors  # multipliers of the active constraints
    force: Float[Any, " lanes"]  # multiplier of the one more
    normal: SpaceVectors  # of the one more
    excess: Float[Any, " lanes"]  # by which the point breaks it
    going: OfLanes
    solvable: OfLanes


def in_space(wanted: SpaceVectors, worst: Violated) -> SpaceVectors:
    """The point nearest to the wanted one, by the dual active sets of Goldfarb and Idnani (1983).

    `worst(x)` gives the constraint that x breaks most: by how much, c · x - b, and its normal c.
    A problem with a solution takes a finite number of steps. One that takes more than
    `MOST_STEPS_EACH` for each dimension counts as one without.
    """
    n = len(wanted)
    excess, normal = worst(wanted)
    zero, nothing = jnp.zeros_like(wanted), jnp.zeros((n, *wanted.shape))
    everywhere, going = jnp.ones(excess.shape, bool), excess > NEAR_ENOUGH
    free = jnp.broadcast_to(jnp.eye(n)[..., None], nothing.shape)
    start = Search(
        wanted, nothing, free, zero, jnp.zeros_like(excess), normal, excess, going, everywhere
    )

    def under_way(carry: tuple[Search, Any]) -> Any:
        now, steps = carry
        return now.going.any() & (steps < MOST_STEPS_EACH * n)

    def one(carry: tuple[Search, Any]) -> tuple[Search, Any]:
        now, steps = carry
        return stepped(now, worst), steps + 1

    found, _ = jax.lax.while_loop(under_way, one, (start, jnp.asarray(0)))
    return jnp.where((found.solvable & ~found.going)[None], found.point, jnp.nan)


def mapped(matrix: SpaceMatrices, vector: SpaceVectors) -> SpaceVectors:
    return (matrix * vector[None]).sum(axis=1)


def stepped(now: Search, worst: Violated) -> Search:
    """One step: towards the constraint, until it is active or an active one ceases to be."""
    rows = jnp.arange(len(now.point))[:, None]
    toward, less = mapped(now.free, now.normal), mapped(now.inverse, now.normal)
    square = (toward**2).sum(axis=0)
    moves = square > NO_PART
    square = jnp.where(moves, square, 1.0)
    until_active = jnp.where(moves, now.excess / square, jnp.inf)
    until_drop = jnp.where(less > 0, now.forces / jnp.where(less > 0, less, 1.0), jnp.inf)
    first_drop = until_drop.min(axis=0)
    step, adds = jnp.minimum(until_active, first_drop), until_active <= first_drop
    unsolvable = jnp.isinf(step)
    going, step = now.going & ~unsolvable, jnp.where(unsolvable, 0.0, step)
    dropped = (rows == until_drop.argmin(axis=0)[None]) & ~adds[None]
    empty = (now.inverse == 0).all(axis=1).argmax(axis=0)
    added = (rows == empty[None]) & adds[None]

    old = jnp.where(dropped[:, None], now.inverse, 0.0).sum(axis=0)
    old_square = jnp.where(adds, 1.0, (old**2).sum(axis=0))
    way = jnp.where(adds[None], toward, old)
    kept_shares = less / square[None], mapped(now.inverse, old) / old_square[None]
    shares = jnp.where(added, -1.0 / square[None], jnp.where(adds[None], *kept_shares))
    inverse = now.inverse - shares[:, None] * way[None]
    inverse = jnp.where(dropped[:, None], 0.0, inverse)
    weight = jnp.where(adds, -1.0 / square, 1.0 / old_square)
    free = now.free + (weight[None] * way)[:, None] * way[None]
    point = now.point - jnp.where(moves, step, 0.0)[None] * toward
    forces, force = now.forces - step[None] * less, now.force + step
    forces = jnp.where(added, force[None], jnp.where(dropped, 0.0, forces))
    excess = now.excess - jnp.where(moves, step * square, 0.0)
    next_excess, next_normal = worst(point)
    after = Search(
        point,
        inverse,
        free,
        forces,
        jnp.where(adds, 0.0, force),
        jnp.where(adds[None], next_normal, now.normal),
        jnp.where(adds, next_excess, excess),
        going & ~(adds & (next_excess <= NEAR_ENOUGH)),
        now.solvable,
    )

    def chosen(new: Any, old: Any) -> Any:
        return jnp.where(going.reshape(*[1] * (new.ndim - 1), -1), new, old)

    kept, stuck = jax.tree.map(chosen, after, now), now.going & unsolvable
    return kept._replace(going=kept.going & ~stuck, solvable=kept.solvable & ~stuck)
