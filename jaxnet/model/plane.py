"""Vectors in the plane, axis first, and what a path's jets say of its pace: for NumPy and JAX."""

from typing import Any

from jaxtyping import Float

Plane = Float[Any, "2 m *lanes"]
Jets = tuple[Plane, Plane, Plane]  # a signal, its first and its second derivative


def dot(a: Any, b: Any) -> Any:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1]


def cross(a: Any, b: Any) -> Any:
    """`a_x b_y - a_y b_x`, positive where b is to the left of a."""
    return a[0] * b[1] - a[1] * b[0]


def length(vectors: Any) -> Any:
    """Euclidean length, of vectors of any number of components."""
    squares = vectors[0] ** 2
    for component in vectors[1:]:
        squares = squares + component**2
    return squares.__array_namespace__().sqrt(squares)


def pace(jets: Any) -> tuple[Any, Any]:
    """Speed [m/s] and turn rate [rad/s] of who moves forwards along these jets; undefined at rest."""
    _, velocity, acceleration = jets
    square = dot(velocity, velocity)
    return square.__array_namespace__().sqrt(square), cross(velocity, acceleration) / square
