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

Values = Float[Array, " j"]
Number = Float[Array, ""]
Pairs = Float[Array, "j j"]

STEEPEST = 100.0  # of power, either way: far beyond data, near enough that nothing overflows
SHORTEST = 1e-3  # least a0, in smallest magnitudes: f is constant there but for a thousandth


class Curve(NamedTuple):
    """A family f(x), x > 0."""

    parameters: tuple[str, ...]
    bent: Callable[[Values, Number], tuple[Values, Values]]  # offset and growth
    through: Callable[[Values, Values], Pairs]  # shape of the curves through (x_i, u_i) and (x_j, u_j)
    read: Callable[[Values, Number, Number], tuple[Number, ...]]  # parameters, of shape and scale


def straight(x: Values, shape: Number) -> tuple[Values, Values]:
    """`u = b/x + s`; b = 0 where there is but the scale."""
    return shape / x, jnp.ones_like(x)


def intercepts(x: Values, u: Values) -> Pairs:
    """The b of lines through pairs of points."""
    return differences(u) / differences(1 / x)


def powers(x: Values, shape: Number) -> tuple[Values, Values]:
    """`u ∝ x^(p − 1)`, 1 at the geometric middle."""
    return jnp.zeros_like(x), jnp.exp(-shape * (jnp.log(x) - middle(x)) / span(x))


def exponents(x: Values, u: Values) -> Pairs:
    """Shapes of the powers through pairs of points; proportional where both errors are 0."""
    shapes = -span(x) * differences(jnp.log(u)) / differences(jnp.log(x))
    return jnp.clip(jnp.where(jnp.isnan(shapes), 0.0, shapes), -STEEPEST, STEEPEST)


def read_power(x: Values, shape: Number, scale: Number) -> tuple[Number, Number]:
    """The c and p of a shape and scale."""
    rise = -shape / span(x)
    return scale * jnp.exp(-rise * middle(x)), 1 + rise


def saturation(x: Values, shape: Number) -> tuple[Values, Values]:
    """`u ∝ 1/(1 + x/a0)`."""
    return jnp.zeros_like(x), 1 / (1 + rate(x, shape) * x)


def rate(x: Values, shape: Number) -> Number:
    """1/a0."""
    return jnp.expm1(shape) / (x.max() - jnp.exp(shape) * x.min())


def saturations(x: Values, u: Values) -> Pairs:
    """Shapes of the saturating curves through pairs of points: none if u rises, the shortest if x·u falls."""
    order = jnp.sign(-differences(x))
    bend, rise = order * differences(u), -order * differences(u * x)
    rates = jnp.where(bend <= 0, 0.0, jnp.where(rise <= 0, jnp.inf, bend / rise))
    rates = jnp.minimum(rates, 1 / (SHORTEST * x.min()))
    return jnp.log1p(rates * x.max()) - jnp.log1p(rates * x.min())


def differences(values: Values) -> Pairs:
    """Of all pairs."""
    return values[:, None] - values[None, :]


def span(x: Values) -> Number:
    """Of log x; 1 where all are one."""
    width = jnp.log(x.max() / x.min())
    return jnp.where(width > 0, width, 1.0)


def middle(x: Values) -> Number:
    """Of log x."""
    return (jnp.log(x.max()) + jnp.log(x.min())) / 2


BENT: dict[str, Curve] = {
    "affine": Curve(("b", "s"), straight, intercepts, lambda x, b, s: (b, s)),
    "power": Curve(("c", "p"), powers, exponents, read_power),
    "saturating": Curve(("c", "a0"), saturation, saturations, lambda x, shape, c: (c, 1 / rate(x, shape))),
}

MODELS = {"proportional": ("s",), **{model: curve.parameters for model, curve in BENT.items()}}


def value(model: str, x: Any, parameters: Any) -> Any:
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
