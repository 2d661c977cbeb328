"""Numbers with a known covariance, made independent with variance 1; lanes are last."""

from typing import Any

from jaxtyping import Float, Int

from jaxnet.lazy import jnp

SINGULAR = 1e-10  # of a variance: what is left of it once the orders before are known counts as 0

Covariance = Float[Any, "orders orders *links"]
Factor = list[list[Any]]  # rows of a triangular matrix; a row with 0 on its diagonal is unknown


def whitened(
    residuals: Float[Any, "orders 2 *links"], covariance: Float[Any, "..."] | None
) -> tuple[Float[Any, "orders 2 *links"], Int[Any, "*links"]]:
    """Residuals with variance 1, and the number of orders that have any variance.

    `covariance` has the shape (orders, orders, *links), or (orders, *links) where orders are
    independent. An order without variance is 0; so is every order where nothing is known.
    """
    if covariance is None:
        return jnp.zeros_like(residuals), jnp.zeros(residuals.shape[2:], int)
    if covariance.ndim == residuals.ndim:
        factor = cholesky(covariance)
        noisy = sum((row[-1] > 0).astype(int) for row in factor)
        return from_factor(factor, residuals), noisy
    noisy = covariance > 0
    scale = jnp.where(noisy, 1.0 / jnp.sqrt(jnp.where(noisy, covariance, 1.0)), 0.0)
    return scale[:, None] * residuals, noisy.sum(axis=0)


def cholesky(covariance: Covariance) -> Factor:
    """The factor L of `L L'`; an order that follows from those before has a row that ends in 0."""
    factor: Factor = []
    for i, row in enumerate(covariance):
        own: list[Any] = []
        for j in range(i):
            rest = row[j] - sum(a * b for a, b in zip(own, factor[j][:-1], strict=False))
            own.append(quotient(rest, factor[j][-1]))
        left = row[i] - sum(each**2 for each in own)
        own.append(jnp.sqrt(jnp.where(left > SINGULAR * row[i], left, 0.0)))
        factor.append(own)
    return factor


def from_factor(factor: Factor, right: Float[Any, "orders n *links"]) -> Any:
    """`L⁻¹` of a right-hand side, (orders, n, *links); 0 in an order that is unknown."""
    found: list[Any] = []
    for row, given in zip(factor, right, strict=True):
        rest = given - sum(a[None] * b for a, b in zip(row, found, strict=False))
        found.append(quotient(rest, row[-1][None]))
    return jnp.stack(found)


def quotient(number: Any, by: Any) -> Any:
    """A number over another one, 0 over 0."""
    return jnp.where(by > 0, number / jnp.where(by > 0, by, 1.0), 0.0)
