"""Numbers of known variance, made numbers with variance 1; lanes are last."""

from typing import Any

from jaxtyping import Float, Int

from jaxnet.lazy import jnp


def whitened(
    residuals: Float[Any, "orders 2 *links"], variances: Float[Any, "orders *links"] | None
) -> tuple[Float[Any, "orders 2 *links"], Int[Any, "*links"]]:
    """Residuals with variance 1, and the number of orders that have any variance.

    An order without variance is 0; so is every order where nothing is known.
    """
    if variances is None:
        return jnp.zeros_like(residuals), jnp.zeros(residuals.shape[2:], int)
    noisy, white = [each > 0 for each in variances], []
    for some, variance, each in zip(noisy, variances, residuals, strict=True):
        scale = 1.0 / jnp.sqrt(jnp.where(some, variance, 1.0))
        white.append(jnp.where(some[None], scale[None] * each, 0.0))  # no work without any errors
    return jnp.stack(white), sum(some.astype(int) for some in noisy)


def squared_lengths(residuals: Float[Any, "orders 2 *links"]) -> Float[Any, "*links"]:
    """Sum of the squares of both axes of all orders, term by term: XLA makes no array of them."""
    return sum(axis**2 for order in residuals for axis in order)
