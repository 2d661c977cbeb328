"""Models of δ̂(ā): proportional, affine, power.

The fits compare u(x) = f(x)/x, the error per ā, with the data. Every model is `u = offset + scale·growth`. A
number called shape bends offset and growth; for a given shape only the scale is left to fit. The shape of the
affine model is b, that of the power log(u at the smallest x / u at the greatest).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

PerMagnitude = Float[Array, " j"]
Number = Float[Array, ""]
Pairs = Float[Array, "j j"]

STEEPEST = 100.0  # greatest |shape| of a power: far beyond data, and without overflow


class CurveFamily(NamedTuple):
    """A family of curves f(x), x > 0."""

    parameters: tuple[str, ...]
    bent: Callable[[PerMagnitude, Number], tuple[PerMagnitude, PerMagnitude]]  # offset and growth
    through: Callable[
        [PerMagnitude, PerMagnitude], Pairs
    ]  # shapes through (x_i, u_i) and (x_j, u_j)
    read: Callable[
        [PerMagnitude, Number, Number], tuple[Number, ...]
    ]  # parameters, of shape and scale


def affine_growth(x: PerMagnitude, shape: Number) -> tuple[PerMagnitude, PerMagnitude]:
    """Return offset and growth of `u = b/x + s`."""
    return shape / x, jnp.ones_like(x)


def affine_shapes(x: PerMagnitude, u: PerMagnitude) -> Pairs:
    """Return the b of the lines through pairs of points."""
    return pairwise_differences(u) / pairwise_differences(1 / x)


def power_growth(x: PerMagnitude, shape: Number) -> tuple[PerMagnitude, PerMagnitude]:
    """Return offset and growth of `u ∝ x^(p − 1)`; growth is 1 at the geometric centre of x."""
    return jnp.zeros_like(x), jnp.exp(-shape * (jnp.log(x) - log_centre(x)) / log_span(x))


def power_shapes(x: PerMagnitude, u: PerMagnitude) -> Pairs:
    """Return the shapes of the powers through pairs of points; 0 (proportional) where both errors are 0."""
    shapes = -log_span(x) * pairwise_differences(jnp.log(u)) / pairwise_differences(jnp.log(x))
    return jnp.clip(jnp.where(jnp.isnan(shapes), 0.0, shapes), -STEEPEST, STEEPEST)


def power_parameters(x: PerMagnitude, shape: Number, scale: Number) -> tuple[Number, Number]:
    """Return c and p for a shape and scale."""
    rise = -shape / log_span(x)
    return scale * jnp.exp(-rise * log_centre(x)), 1 + rise


def pairwise_differences(values: PerMagnitude) -> Pairs:
    """Return the differences of all pairs."""
    return values[:, None] - values[None, :]


def log_span(x: PerMagnitude) -> Number:
    """Return the range of log x; 1 if all x are equal."""
    width = jnp.log(x.max() / x.min())
    return jnp.where(width > 0, width, 1.0)


def log_centre(x: PerMagnitude) -> Number:
    """Return the centre of the range of log x."""
    return (jnp.log(x.max()) + jnp.log(x.min())) / 2


CURVE_FAMILIES: dict[str, CurveFamily] = {
    "affine": CurveFamily(("b", "s"), affine_growth, affine_shapes, lambda x, b, s: (b, s)),
    "power": CurveFamily(("c", "p"), power_growth, power_shapes, power_parameters),
}

MODELS = {
    "proportional": ("s",),
    **{model: curve.parameters for model, curve in CURVE_FAMILIES.items()},
}


def model_value(
    model: str,
    x: Float[np.ndarray, " n"],
    parameters: Sequence[float] | Float[np.ndarray, " parameters"],
) -> Float[np.ndarray, " n"]:
    """Return f(x) of a model by name."""
    first, second = (*parameters, 0.0)[:2]
    match model:
        case "power":
            return first * x**second
        case "affine":
            return first + second * x
        case "constant":
            return np.full_like(x, first)
    return first * x
