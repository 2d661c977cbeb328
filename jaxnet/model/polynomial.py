"""Polynomials of the share σ of a span, the only ones: `p(σ) = Σ_k p_k σ^k / k!`.

No coefficient is divided by a power of the span, so that nothing is lost over a short one. The
coefficients are the first axis, the lanes the last.
"""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxnet.model.shapes import Numbers

Shares = Float[Any, "*lanes"]
Coefficients = Float[Array, "degrees *some"]


class Polynomial(NamedTuple):
    """A polynomial by its coefficients `p_k`."""

    terms: Coefficients

    def at(self, share: Shares) -> Numbers:
        powers = powers_of(share, len(self.terms))
        higher = (scaled(self.terms[k], powers[k]) for k in range(1, len(powers)))
        return sum(higher, self.terms[0])

    def about(self, share: Shares) -> "Polynomial":
        """The same polynomial in powers of σ minus a share."""
        degrees = range(len(self.terms))
        return Polynomial(jnp.stack([Polynomial(self.terms[k:]).at(share) for k in degrees]))


def interpolated(values: Float[Array, "points *some"]) -> Polynomial:
    """Polynomial with these values at `chebyshev_points`, as many as there are values.

    It is made of differences from one value, for rounding grows with what is interpolated.
    """
    number = len(values)
    matrix = jnp.asarray(to_terms(number)).reshape(number, number, *[1] * (values.ndim - 1))
    found = (matrix[:, n] * (values[n] - values[0])[None] for n in range(1, number))
    return Polynomial(sum(found, jnp.zeros_like(values)).at[0].add(values[0]))


def chebyshev_points(number: int) -> Float[np.ndarray, " points"]:
    """Chebyshev's points in [0, 1]."""
    return (1 - np.cos((np.arange(number) + 0.5) * np.pi / number)) / 2


@functools.cache
def to_terms(number: int) -> Float[np.ndarray, "degrees points"]:
    """Matrix from values at Chebyshev's points to coefficients, by Chebyshev's polynomials."""
    points = 2 * chebyshev_points(number) - 1
    to_chebyshev = np.linalg.inv(np.polynomial.chebyshev.chebvander(points, number - 1))
    whole = np.polynomial.Chebyshev.identity(domain=[0, 1])
    each = [whole.basis(n, domain=[0, 1]) for n in range(number)]
    at_0 = [[one.deriv(n)(0.0) if n else one(0.0) for one in each] for n in range(number)]
    return np.array(at_0) @ to_chebyshev


def taylor(jets: Sequence[Numbers], span: Shares) -> Polynomial:
    """Taylor polynomial of jets over a span, in shares of it."""
    return Polynomial(jnp.stack([scaled(jet, span**k) for k, jet in enumerate(jets)]))


def powers_of(share: Numbers, number: int) -> Numbers:
    """`σ^k / k!` for k = 0, 1, … below a number."""
    xp = share.__array_namespace__()
    terms = [xp.ones_like(share)]
    for n in range(1, number):
        terms.append(terms[-1] * share / n)
    return xp.stack(terms)


def scaled(term: Numbers, factor: Numbers) -> Numbers:
    """Product of a term with a factor that has only the last of its axes."""
    return term * factor.reshape(*[1] * (term.ndim - factor.ndim), *factor.shape)
