"""Vectors in the plane, with components in the first axis, and motion along jets; NumPy and JAX."""

from typing import Any

from jaxtyping import Float

from jaxnet.model.shapes import Flags, Numbers, OrderedJets, PlaneArray

Plane = Float[Any, "2 m *lanes"]
Jets = tuple[Plane, ...]  # a signal and its derivatives, as many as the order of the vehicles


def dot(a: PlaneArray, b: PlaneArray) -> Numbers:
    return a[0] * b[0] + a[1] * b[1]


def cross(a: PlaneArray, b: PlaneArray) -> Numbers:
    """`a_x b_y - a_y b_x`, positive if b points to the left of a."""
    return a[0] * b[1] - a[1] * b[0]


def length(vectors: Numbers) -> Numbers:
    squares = vectors[0] ** 2
    for component in vectors[1:]:
        squares = squares + component**2
    return squares.__array_namespace__().sqrt(squares)


def plus(jets: OrderedJets, others: OrderedJets) -> tuple[Numbers, ...]:
    """The sum of two signals, with the derivatives that both have."""
    return tuple(jet + other for jet, other in zip(jets, others, strict=False))


def relative(jets: OrderedJets, origin: OrderedJets) -> Jets:
    """A path's jets (2, m, *lanes) minus those of one other path (2, *lanes), which has more."""
    return tuple(jet - there[:, None] for jet, there in zip(jets, origin, strict=False))


def replaced(vehicles: Flags, jets: OrderedJets, others: OrderedJets) -> Jets:
    """The jets of some vehicles (m, *lanes), and those of the others."""
    xp = vehicles.__array_namespace__()
    return tuple(xp.where(vehicles[None], *both) for both in zip(jets, others, strict=True))


def pace(jets: OrderedJets) -> tuple[Numbers, Numbers]:
    """Speed [m/s] and turn rate [rad/s] (undefined at rest) of forward motion along jets."""
    _, velocity, acceleration = jets
    square = dot(velocity, velocity)
    return square.__array_namespace__().sqrt(square), cross(velocity, acceleration) / square
