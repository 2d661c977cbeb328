"""Restarted BiCGSTAB (van der Vorst) for `L x = b`, slot by slot without a matrix.

L is not symmetric, and its spectrum is not known beforehand. Each column of each axis and lane
stops as soon as its own residual is small enough. No result therefore depends on the other lanes of
the batch.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxnet.model.hearing import AxisWeights, Hearing
from jaxnet.model.shapes import LoopIndex

STARTS = 8
ROUNDS = 4  # maximum number of steps of a start, in multiples of m

Unknowns = Float[Array, "m columns axes lanes"]
Sizes = Float[Array, "columns axes lanes"]
Going = Bool[Array, "..."]
Restart = tuple[LoopIndex, Unknowns, Unknowns, Sizes, Going]  # number, x, residual, its norm, going
InnerProducts = Float[Array, "1 columns axes lanes"]
Step = tuple[LoopIndex, Unknowns, Unknowns, Unknowns, InnerProducts, Going]  # see `stabilised`
Map = Callable[[Unknowns], Unknowns]
Allowance = Callable[[Sizes], Sizes]  # tolerated residual norm, by the norm of x


def of_vehicles(hearing: Hearing, weights: AxisWeights) -> AxisWeights:
    """The weights of links from vehicles, with 0 for links that carry the navigator's message."""
    return jnp.where((jnp.asarray(hearing.carried_sources) > 0)[None, :, :, None], weights, 0.0)


def apply_laplacian(hearing: Hearing, weights: AxisWeights) -> Map:
    """The function x → L x, from weights of vehicles only."""
    carried_sources, heard = (
        jnp.maximum(jnp.asarray(hearing.carried_sources) - 1, 0),
        jnp.moveaxis(weights, 0, 2),
    )

    def times(x: Unknowns) -> Unknowns:
        def less(slot: LoopIndex, total: Unknowns) -> Unknowns:
            return total - heard[slot][:, None] * x.at[carried_sources[slot]].get(
                mode="promise_in_bounds"
            )

        return jax.lax.fori_loop(0, len(carried_sources), less, x)

    return times


def iterated(
    times: Map, right: Unknowns, x: Unknowns, allowed: Allowance
) -> tuple[Unknowns, Sizes]:
    """Improve x by restarted BiCGSTAB, and return the best x and the norm of its residual.

    The iteration ends when `allowed` admits the residual, or after STARTS starts. Each start
    continues from the best solution with a different shadow vector. The shadow vector is dense,
    with components of both signs. The usual choice, the residual itself, fails in graphs without
    cycles such as trees: the residual can be orthogonal to its images.
    """

    def start(carry: Restart) -> Restart:
        number, x, left, size, going = carry
        shadow = jnp.cos(((number + 1) * jnp.arange(len(right)) ** 2).astype(float))
        shadow = jnp.broadcast_to(shadow[:, None, None, None], left.shape)
        found = stabilised(times, x, left, shadow, going, allowed)
        rest = right - times(found)
        better = going & (residual_norm(rest) < size)
        x, left = jnp.where(better[None], found, x), jnp.where(better[None], rest, left)
        size = jnp.where(better, residual_norm(rest), size)
        return number + 1, x, left, size, going & (size > allowed(residual_norm(x)))

    left = right - times(x)
    size = residual_norm(left)
    carry = jnp.asarray(0), x, left, size, size > allowed(residual_norm(x))
    _, x, _, size, _ = jax.lax.while_loop(
        lambda carry: (carry[0] < STARTS) & carry[4].any(), start, carry
    )
    return x, size


def stabilised(
    times: Map, x: Unknowns, left: Unknowns, shadow: Unknowns, going: Going, allowed: Allowance
) -> Unknowns:
    """Run BiCGSTAB from x in the columns `going`, until `allowed` admits the estimated residual.

    `left` is the residual of x, and `shadow` is the shadow vector.
    """

    def step(carry: Step) -> Step:
        number, x, left, direction, along, going = carry
        image = times(direction)
        alpha = jnp.where(going, along / inner_product(shadow, image), 0.0)
        half = left - alpha * image
        turned = times(half)
        square = inner_product(turned, turned)
        omega = jnp.where(going & (square > 0), inner_product(turned, half) / square, 0.0)
        x = jnp.where(going, x + alpha * direction + omega * half, x)
        left = half - omega * turned
        following = inner_product(shadow, left)
        beta = following / along * (alpha / omega)
        direction = left + beta * (direction - omega * image)
        going = (
            going
            & (residual_norm(left)[None] > allowed(residual_norm(x))[None])
            & jnp.isfinite(beta)
        )
        return number + 1, x, left, direction, following, going

    carry = jnp.asarray(0), x, left, left, inner_product(shadow, left), going[None]
    return jax.lax.while_loop(
        lambda carry: (carry[0] < ROUNDS * len(x)) & carry[5].any(), step, carry
    )[1]


def inner_product(x: Unknowns, y: Unknowns) -> InnerProducts:
    return (x * y).sum(axis=0, keepdims=True)


def residual_norm(x: Unknowns) -> Sizes:
    return jnp.abs(x).max(axis=0)
