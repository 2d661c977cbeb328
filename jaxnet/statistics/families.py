"""What δ̂(ā) may look like: proportional, affine, power, saturating.

All is said of u(x) = f(x)/x, the error per ā, because that is what the fits compare with the data. Every
curve is `u = offset + scale·growth`; a number called shape bends offset and growth, and what is best for a
given shape is a matter of the scale alone. The shape of affine is b; that of power and saturating is
log(u at the smallest x / u at the greatest).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

PerMagnitude = Float[Array, " j"]
Number = Float[Array, ""]
Pairs = Float[Array, "j j"]

STEEPEST = 100.0  # of power, either way: far beyond data, near enough that nothing overflows
LEAST_SATURATION = 1e-3  # least a0, in smallest magnitudes: f is constant there but for a thousandth


class CurveFamily(NamedTuple):
    """A family f(x), x > 0."""

    parameters: tuple[str, ...]
    bent: Callable[[PerMagnitude, Number], tuple[PerMagnitude, PerMagnitude]]  # offset and growth
    through: Callable[
        [PerMagnitude, PerMagnitude], Pairs
    ]  # shape of the curves through (x_i, u_i) and (x_j, u_j)
    read: Callable[[PerMagnitude, Number, Number], tuple[Number, ...]]  # parameters, of shape and scale


def affine_growth(x: PerMagnitude, shape: Number) -> tuple[PerMagnitude, PerMagnitude]:
    """`u = b/x + s`; b = 0 where there is but the scale."""
    return shape / x, jnp.ones_like(x)


def affine_shapes(x: PerMagnitude, u: PerMagnitude) -> Pairs:
    """The b of lines through pairs of points."""
    return pairwise_differences(u) / pairwise_differences(1 / x)


def power_growth(x: PerMagnitude, shape: Number) -> tuple[PerMagnitude, PerMagnitude]:
    """`u ∝ x^(p − 1)`, 1 at the geometric middle."""
    return jnp.zeros_like(x), jnp.exp(-shape * (jnp.log(x) - log_centre(x)) / log_span(x))


def power_shapes(x: PerMagnitude, u: PerMagnitude) -> Pairs:
    """Shapes of the powers through pairs of points; proportional where both errors are 0."""
    shapes = -log_span(x) * pairwise_differences(jnp.log(u)) / pairwise_differences(jnp.log(x))
    return jnp.clip(jnp.where(jnp.isnan(shapes), 0.0, shapes), -STEEPEST, STEEPEST)


def power_parameters(x: PerMagnitude, shape: Number, scale: Number) -> tuple[Number, Number]:
    """The c and p of a shape and scale."""
    rise = -shape / log_span(x)
    return scale * jnp.exp(-rise * log_centre(x)), 1 + rise


def saturating_growth(x: PerMagnitude, shape: Number) -> tuple[PerMagnitude, PerMagnitude]:
    """`u ∝ 1/(1 + x/a0)`."""
    return jnp.zeros_like(x), 1 / (1 + saturation_rate(x, shape) * x)


def saturation_rate(x: PerMagnitude, shape: Number) -> Number:
    """1/a0."""
    return jnp.expm1(shape) / (x.max() - jnp.exp(shape) * x.min())


def saturating_shapes(x: PerMagnitude, u: PerMagnitude) -> Pairs:
    """Shapes of the saturating curves through pairs of points: none if u rises, the shortest if x·u falls."""
    order = jnp.sign(-pairwise_differences(x))
    bend, rise = order * pairwise_differences(u), -order * pairwise_differences(u * x)
    rates = jnp.where(bend <= 0, 0.0, jnp.where(rise <= 0, jnp.inf, bend / rise))
    rates = jnp.minimum(rates, 1 / (LEAST_SATURATION * x.min()))
    return jnp.log1p(rates * x.max()) - jnp.log1p(rates * x.min())


def pairwise_differences(values: PerMagnitude) -> Pairs:
    """Of all pairs."""
    return values[:, None] - values[None, :]


def log_span(x: PerMagnitude) -> Number:
    """Of log x; 1 where all are one."""
    width = jnp.log(x.max() / x.min())
    return jnp.where(width > 0, width, 1.0)


def log_centre(x: PerMagnitude) -> Number:
    """Of log x."""
    return (jnp.log(x.max()) + jnp.log(x.min())) / 2


CURVE_FAMILIES: dict[str, CurveFamily] = {
    "affine": CurveFamily(("b", "s"), affine_growth, affine_shapes, lambda x, b, s: (b, s)),
    "power": CurveFamily(("c", "p"), power_growth, power_shapes, power_parameters),
    "saturating": CurveFamily(
        ("c", "a0"),
        saturating_growth,
        saturating_shapes,
        lambda x, shape, c: (c, 1 / saturation_rate(x, shape)),
    ),
}

MODELS = {"proportional": ("s",), **{model: curve.parameters for model, curve in CURVE_FAMILIES.items()}}


def model_value(model: str, x: Any, parameters: Any) -> Any:
    """f(x) of a model by name."""
    first, second = (*parameters, 0.0)[:2]
    match model:
        case "power":
            return first * x**second
        case "saturating":
            return first * x / (1 + x / second)
        case "affine":
            return first + second * x
    return first * x
