"""Tests of an attack from outside the package before lanes run: shapes, norms and derivatives.

The test suite covers the attacks of the package. The module tests other attacks at a few instants, because an
exact engine with a wrong derivative would give a wrong result.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxnet.kinds.attacks import AnyAttack
from jaxnet.kinds.kind import KindError
from jaxnet.model.signal import ORDERS

INSTANTS = 65
FINITE_STEP = 1e-4  # [s], step of the difference quotients
CLOSE_ENOUGH = 1e-3  # relative, tolerance between a derivative and its difference quotient
PROOF_ROUNDING = 1e-9


def prove(
    attack: AnyAttack, basis: Any, vectors: np.ndarray | None, sizes: Any, horizon: float, count: int
) -> None:
    """Raise KindError if the functions, unit vectors or sizes of a drawn attack violate their contract.

    `count` is the number of lanes. Attacks of the package pass without a test.
    """
    if type(attack).__module__.startswith("jaxnet."):
        return
    name, sizes = type(attack).__name__, np.asarray(sizes)[: len(ORDERS)]
    first = np.asarray(basis(np.zeros(count)))
    if first.ndim != 3 or first.shape[::2] != (4, count):
        raise KindError(f"{name}.basis must have the shape (4, B, lanes = {count}) (got {first.shape})")
    if sizes.shape not in ((4, 1), (4, count)):
        raise KindError(f"{name}.sizes must have the shape (4, lanes = {count}) (got {sizes.shape})")
    if vectors is not None:
        prove_vectors(name, vectors, first.shape[1], count)
    times = np.linspace(FINITE_STEP, horizon - FINITE_STEP, INSTANTS)
    around = np.add.outer([-FINITE_STEP, 0.0, FINITE_STEP], times)
    before, now, after = np.asarray(jax.vmap(jax.vmap(lambda t: basis(jnp.full(count, t))))(around))
    if attack.derived:
        prove_derivatives(name, times, (after - before)[:, :3] / (2 * FINITE_STEP), now[:, 1:])
    greatest = np.linalg.norm(now, axis=2).max(axis=0)
    if not (greatest <= sizes * (1 + PROOF_ROUNDING) + PROOF_ROUNDING).all():
        order = int(np.argmax((greatest - sizes).max(axis=1)))
        raise KindError(
            f"{name}.sizes: the functions' derivative of order {order} comes to {greatest[order].max():.4g},"
            f" which is over {sizes[order].max():.4g}"
        )


def prove_vectors(name: str, vectors: np.ndarray, functions: int, count: int) -> None:
    """Raise KindError if vectors have a wrong shape or a spectral norm over 1.

    The shape must be (2, m or 1, B, lanes or 1).
    """
    shape = vectors.shape
    if len(shape) != 4 or shape[0] != 2 or shape[2] != functions or shape[3] not in (1, count):
        wanted = f"(2, vehicles, B = {functions}, lanes = {count})"
        raise KindError(f"{name}.vectors must have the shape {wanted} (got {shape})")
    norm = np.linalg.norm(vectors.transpose(1, 3, 0, 2), 2, axis=(2, 3)).max()
    if not norm <= 1 + PROOF_ROUNDING:
        raise KindError(f"{name}.vectors must have a spectral norm of at most 1 (got {norm:.4g})")


def prove_derivatives(
    name: str,
    times: Float[np.ndarray, " instants"],
    quotients: Float[np.ndarray, "instants 3 functions lanes"],
    given: Float[np.ndarray, "instants 3 functions lanes"],
) -> None:
    """Raise KindError if a derivative of order 1 to 3 differs from its difference quotient."""
    scale = np.abs(given).max(axis=(0, 2, 3)) + np.abs(quotients).max(axis=(0, 2, 3)) + PROOF_ROUNDING
    apart = np.abs(quotients - given).max(axis=(2, 3)) / scale
    if not (apart <= CLOSE_ENOUGH).all():
        instant, order = np.unravel_index(np.nanargmax(np.nan_to_num(apart, nan=np.inf)), apart.shape)
        raise KindError(
            f"{name}.basis: what stands at order {order + 1} is not the derivative of order {order}"
            f" (at t = {times[instant]:.4g} s)"
        )
