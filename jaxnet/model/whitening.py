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
    noisy = variances > 0
    scale = jnp.where(noisy, 1.0 / jnp.sqrt(jnp.where(noisy, variances, 1.0)), 0.0)
    return scale[:, None] * residuals, noisy.sum(axis=0)
