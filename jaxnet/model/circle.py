"""Cosine and sine of one angle together, and a vector's angle, in arithmetic that vectorises.

On CPUs, the double precision functions of XLA handle one number at a time and are an order of
magnitude slower. Quarter turns reduce the angle to [-π/4, π/4] (Cody and Waite, 1980). The
reduction splits π/2 into three parts; the first two parts are short, so that their multiples are
exact. In that interval the polynomials of fdlibm are accurate to half a unit in the last place (Sun
Microsystems, `k_sin.c` and `k_cos.c`). The error is at most 1.8e-16 for angles up to 1e8 rad. The
arc tangent has fdlibm's polynomial too (`s_atan.c`), with an error under 2.5 units in the last
place.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from jaxnet.model.shapes import Numbers

QUARTER = (1.570796251296997, 7.549789415861596e-08, 5.390302858158119e-15)  # the sum is π/2
COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
ARC = (
    3.33333333333329318027e-01,
    -1.99999999998764832476e-01,
    1.42857142725034663711e-01,
    -1.11111104054623557880e-01,
    9.09088713343650656196e-02,
    -7.69187620504482999495e-02,
    6.66107313738753120669e-02,
    -5.83357013379057348645e-02,
    4.97687799461593236017e-02,
    -3.65315727442169155270e-02,
    1.62858201153657823623e-02,
)


def circle(angle: Numbers) -> tuple[Numbers, Numbers]:
    """`(cos, sin)` of an array of angles [rad], for NumPy and JAX."""
    if isinstance(angle, np.ndarray):
        return by_polynomials(angle)
    return differentiable()(angle)


@functools.cache
def differentiable() -> Callable[[Numbers], tuple[Numbers, Numbers]]:
    """The function for JAX, whose derivative is that of the cosine and the sine."""
    import jax

    function = jax.custom_jvp(by_polynomials)

    @function.defjvp
    def along(angle: tuple[Numbers], rate: tuple[Numbers]) -> tuple[Any, Any]:
        cosine, sine = function(*angle)
        return (cosine, sine), (-sine * rate[0], cosine * rate[0])

    return jax.jit(function)  # traced and lowered once for all angles of a shape


def angle(across: Numbers, up: Numbers) -> Numbers:
    """The angle [rad] of vectors, `atan2(up, across)`, for NumPy and JAX.

    With t the smaller over the greater component, `atan t = π/4 + atan((t - 1) / (t + 1))`.
    """
    xp = across.__array_namespace__()
    wide, high = xp.abs(across), xp.abs(up)
    small, great = xp.minimum(wide, high), xp.maximum(wide, high)
    steep = small > 0.4142135623730951 * great
    part = xp.where(steep, small - great, small) / xp.where(steep, small + great, great)
    square = part * part
    near = part - part * square * polynomial(ARC, square)
    turned = xp.where(steep, 0.7853981633974483, 0.0) + near
    turned = xp.where(high > wide, 1.5707963267948966 - turned, turned)
    turned = xp.where(across < 0, 3.141592653589793 - turned, turned)
    return xp.where(up < 0, -turned, turned)


def by_polynomials(angle: Numbers) -> tuple[Numbers, Numbers]:
    xp = angle.__array_namespace__()
    turns = xp.round(angle * 0.6366197723675814)
    rest = angle - turns * QUARTER[0]
    rest = (rest - turns * QUARTER[1]) - turns * QUARTER[2]
    square = rest * rest
    cosine = 1.0 - 0.5 * square + square * square * polynomial(COSINE, square)
    sine = rest + rest * square * polynomial(SINE, square)
    quadrant = turns - 4.0 * xp.floor(turns * 0.25)
    odd = (quadrant == 1.0) | (quadrant == 3.0)
    across, up = xp.where(odd, sine, cosine), xp.where(odd, cosine, sine)
    left, down = (quadrant == 1.0) | (quadrant == 2.0), quadrant >= 2.0
    # A choice of signs would change the last bits of the nonlinear engine.
    return across / xp.where(left, -1.0, 1.0), up / xp.where(down, -1.0, 1.0)


def polynomial(coefficients: tuple[float, ...], x: Numbers) -> Numbers:
    """`c_0 + c_1 x + c_2 x² …` by Horner's rule."""
    total = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        total = total * x + coefficient
    return total
