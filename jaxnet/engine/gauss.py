"""Gauss collocation of `y^(r) = q(t, y, ẏ, …)` in a window of time, for many lanes side by side.

In a window the derivative q of order r, the jerk for r = 3, is a polynomial, given by its values at
the Gauss nodes. Its integrals give the r jets y, ẏ, … exactly. The method is the Kuntzmann–Butcher
method of order 16 (Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, II.7);
the polynomial serves every time in the window.

The values at the nodes are implicit. `linear` solves the equation whose q is affine, `q = z -
P(y)`. For any other q, it serves as the approximate Jacobian of Newton's method.

The nodes are the first axis, the lanes the last axis of every array.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import Legendre, Polynomial

from jaxnet.engine.moment import PerAxis
from jaxnet.engine.stepper import Times
from jaxnet.kinds.vehicles import MOST_ORDER
from jaxnet.model import control, polynomial
from jaxnet.model.elimination import eliminated
from jaxnet.model.plane import Jets
from jaxnet.model.polynomial import scaled
from jaxnet.model.shapes import LoopIndex

STAGES = 8  # 6, 7 and 10 measured slower
INTEGRALS = range(1, MOST_ORDER + 1)  # how often the r-th derivative of a vehicle may be integrated
PLACES = np.linspace(0, 1, 25)  # of a window of length 1, ends included

Jerks = Float[Array, "nodes 2 m lanes"]
JetsAtNodes = tuple[Jerks, ...]
AtNodes = Float[Array, "nodes lanes"]
Inverse = Float[Array, "nodes nodes lanes"]


class Rule(NamedTuple):
    """Constants of the method on a window from 0 to 1: each polynomial is 1 at one node."""

    nodes: Float[np.ndarray, " nodes"]
    # From 0 to node k of polynomial l, once to four times.
    integrals: Float[np.ndarray, "4 nodes nodes"]
    terms: Float[np.ndarray, "nodes nodes"]  # coefficients of polynomial l (`model.polynomial`)
    highest: Float[np.ndarray, "4 nodes"]  # from values to the highest Legendre coefficients
    reach: Float[np.ndarray, " 4"]  # greatest integrals of the last Legendre polynomial
    between: Float[np.ndarray, "places nodes"]  # values of polynomial l at PLACES
    lebesgue: float  # greatest sum of the absolute polynomials


def gauss_rule(nodes: int) -> Rule:
    places, shares = np.polynomial.legendre.leggauss(nodes)
    degrees = np.arange(nodes)
    values = np.polynomial.legendre.legvander(places, nodes - 1)
    legendre = (degrees + 0.5)[:, None] * (values * shares[:, None]).T  # by degree, node
    cardinal = [Legendre(column, domain=[0, 1]) for column in legendre.T]
    times, fine = (places + 1) / 2, np.linspace(0, 1, 1001)
    integrals = [[one.integ(order, lbnd=0)(times) for one in cardinal] for order in INTEGRALS]
    monomials = [one.convert(kind=Polynomial, domain=[-1, 1], window=[-1, 1]) for one in cardinal]
    factorials = np.array([math.factorial(k) for k in degrees])
    highest = Legendre.basis(nodes - 1, domain=[0, 1])
    return Rule(
        times,
        np.swapaxes(integrals, 1, 2),
        factorials[:, None] * np.stack([one.coef for one in monomials], axis=1),
        legendre[-4:],
        np.array([np.abs(highest.integ(order, lbnd=0)(fine)).max() for order in INTEGRALS]),
        np.stack([one(PLACES) for one in cardinal], axis=1),
        float(np.abs([one(fine) for one in cardinal]).sum(axis=0).max()),
    )


RULE = gauss_rule(STAGES)


class Window(NamedTuple):
    """Motion in a window of time: y as a polynomial of the share of the window that has passed."""

    start: Times
    length: Times  # 0 before the first window
    motion: polynomial.Polynomial

    @property
    def order(self) -> int:
        return len(self.motion.terms) - len(RULE.nodes)

    def derivative(self, time: Times, order: int) -> PerAxis:
        """Derivative of y at a time [s] in the window."""
        length = jnp.where(self.length > 0, self.length, 1.0)
        found = polynomial.Polynomial(self.motion.terms[order:]).at((time - self.start) / length)
        return scaled(found, length**-order)

    def jets_at(self, time: Times) -> Jets:
        return tuple(self.derivative(time, order) for order in range(self.order))

    def jerk_at(self, time: Times) -> PerAxis:
        return self.derivative(time, self.order)

    def greatest_jerk(self) -> Float[Array, "m lanes"]:
        """A bound on the norm of the jerk in the window."""
        times = self.start[None] + jnp.asarray(RULE.nodes)[:, None] * self.length[None]
        jerks = jax.vmap(self.jerk_at)(times)
        return RULE.lebesgue * jnp.sqrt((jerks**2).sum(axis=1)).max(axis=0)


def window_of(start: Times, length: Times, jets: Jets, jerks: Jerks) -> Window:
    """The window from a time [s] on, with jets at its start and the jerk at the nodes."""
    known = [scaled(jet, length**order) for order, jet in enumerate(jets)]
    moved = scaled(jnp.tensordot(jnp.asarray(RULE.terms), jerks, axes=1), length ** len(jets))
    return Window(start, length, polynomial.Polynomial(jnp.concatenate([jnp.stack(known), moved])))


def linear(gain: control.Gain, length: Times) -> Inverse:
    """The matrix from `z - P(y)` of motion without q to q at the nodes, where `q = z - P(y)`.

    Of gains that are matrices the equations take the mean of the axes.
    """
    gain = (gain[:, 0, 0] + gain[:, 1, 1]) / 2 if control.is_matrix(gain) else gain
    identity = jnp.broadcast_to(jnp.eye(STAGES)[..., None], (STAGES, STAGES, len(length)))
    matrix = identity
    for order, each in zip(range(len(gain), 0, -1), gain, strict=True):
        by = (each * length**order)[None, None]
        matrix = matrix + by * jnp.asarray(RULE.integrals[order - 1])[..., None]
    return eliminated(jnp.concatenate([matrix, identity], axis=1)[:, :, None])[:, :, 0]


def times(inverse: Inverse, right: Jerks) -> Jerks:
    """A matrix of the nodes times values at them, lane by lane."""

    def add(node: LoopIndex, total: Jerks) -> Jerks:
        column = jax.lax.dynamic_index_in_dim(inverse, node, axis=1, keepdims=False)
        return total + column[:, None, None] * jax.lax.dynamic_index_in_dim(right, node)

    return jax.lax.fori_loop(0, STAGES, add, jnp.zeros_like(right))


def coasted(jets: Jets, times: AtNodes) -> JetsAtNodes:
    """Jets after some times [s] of motion without jerk."""

    def after(time: Times) -> Jets:
        each = (polynomial.Polynomial(jnp.stack(jets[order:])) for order in range(len(jets)))
        return tuple(one.at(time) for one in each)

    return jax.vmap(after)(times)


def integrated(length: Times, jerks: Jerks, order: int) -> JetsAtNodes:
    """The jerk at the nodes, integrated as often as the order, and down to once."""
    return tuple(
        (length**times)[None, None, None]
        * jnp.einsum("kl,lcmn->kcmn", jnp.asarray(RULE.integrals[times - 1]), jerks)
        for times in range(order, 0, -1)
    )


def next_degrees(jerks: Jerks) -> Float[Array, "2 m lanes"]:
    """An estimate of the Legendre coefficients that the polynomial of the jerk leaves out.

    The greater of the two highest coefficients falls once more as it fell over two degrees. Two
    neighbours are taken together, because one alone may be small by chance.
    """
    found = jnp.abs(jnp.tensordot(jnp.asarray(RULE.highest), jerks, axes=1))
    below, top = jnp.maximum(found[0], found[1]), jnp.maximum(found[2], found[3])
    return top * top / jnp.maximum(jnp.maximum(below, top), jnp.finfo(float).tiny)


def unresolved(known: Float[Array, "nodes_and_places many lanes"]) -> Float[Array, "many lanes"]:
    """How far functions of time, at the nodes and PLACES, are from their polynomials, at most."""
    at_nodes, between = known[:STAGES], known[STAGES:]
    resolved = jnp.tensordot(jnp.asarray(RULE.between), at_nodes, axes=1)
    return jnp.abs(between - resolved).max(axis=0)


def effect(length: Times, jerk: Float[Array, "2 m lanes"], order: int) -> Jets:
    """The greatest effect on the jets of a jerk of this size that varies as the highest degree."""
    return tuple(
        (length**times * RULE.reach[times - 1])[None, None] * jerk for times in range(order, 0, -1)
    )
