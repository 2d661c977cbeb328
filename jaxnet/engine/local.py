"""The local law in the exact engine, solved from tick to tick by the power series of the motion.

From one tick to the next, `y^(r) = s (a0 y_0^(r) - P(ε))` is linear with constant coefficients, and
its forcing is made of functions of time. Polynomials stand for these functions within a tick. Every
derivative of the motion then follows from the one before it:

    y^(r+n) = D(y^(n), …, y^(n+r-1), n-th derivatives of the functions),

where D is the right-hand side of the law. No matrix is formed, so that the cost grows with the
number of links. The series stops at rounding. A long tick is cut into pieces, because terms of a
long series cancel.
"""

import dataclasses
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine import standstill, vehicles
from jaxnet.engine.demand import Signals, local_jerk
from jaxnet.engine.moment import Instants, PerAxis
from jaxnet.engine.propagation import Held, PropagationState
from jaxnet.engine.stages.known import KnownDrive
from jaxnet.engine.subset import picked, select
from jaxnet.engine.tick import DecisionState, Drive
from jaxnet.model import control, plane, polynomial
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets
from jaxnet.model.polynomial import Polynomial

COEFFICIENTS = 10  # of a polynomial
LONGEST = 4.0  # a piece times the greatest rate: terms then cancel to e⁴ times rounding
MOST_TERMS = 60  # of a series; it needs about 40 for the longest piece
LEAST_TERM = 2.0**-56  # relative size at which a series stops

Moved = tuple[Jets, Float[Array, "m lanes"]]  # jets, and a bound on the norm of y^(r) on the way

INVERSE_FACTORIALS = np.array([1.0 / math.factorial(n) for n in range(MOST_TERMS + 1)])


class Local(Held):
    """Motion under the local law at every instant."""

    def hold(self, state, decided, at):
        """The state unchanged: the law has a solution whoever is retained."""
        return state, jnp.zeros_like(at.here)

    def drive_now(self, state, decided):
        """`y^(r) + P(ŷ)`, with y^(r) of the law."""
        lane, drive = self.lane, decided.drive(self.lane)
        own, navigator = decided.sensed.of(state.jets), self.navigator(state)
        inputs = self.lane.inputs(state.time)
        now = signals_alone(state.time, navigator, state.basis, inputs)
        demand = local_jerk(lane, self.network, drive, own, now)
        return demand + control.feedback(lane.gain, own)

    def next(self, state, decided, time):
        return self.by_span(state, decided, time, time - state.time)

    def later(self, state, decided, span, since):
        return self.by_span(state, decided, state.time + span, span)

    def by_span(
        self, state: PropagationState, decided: DecisionState, time: Instants, span: Instants
    ) -> PropagationState:
        """The state at a time, a span [s] later."""
        drive = self.drive(state, decided)
        jets, _ = after_span(self.lane, self.network, drive, state.jets, state.time, span)
        return state._replace(jets=jets, time=time, basis=self.lane.basis(time))

    def stood(self, before, now, decided, few):
        """The search goes back from now."""
        given = self.lane, self.drive(now, decided), now.jets, now.time, now.time - before.time
        lane, drive, jets, time, span = jax.tree.map(lambda leaf: picked(leaf, few), given)
        _, highest = after_span(lane, self.network, drive, jets, time, -span)
        nobody = jnp.zeros(highest.shape, bool)  # stops under this law
        bound = vehicles.highest_in_formation(lane, highest)

        def pace(state: tuple[Jets, Instants]) -> standstill.Pace:
            own = vehicles.in_formation(lane, *state)
            return standstill.backwards(lane.vehicle, own, bound, nobody)

        def go_back(state: tuple[Jets, Instants], step: Instants) -> tuple[Jets, Instants]:
            jets, time = state
            return after_span(lane, self.network, drive, jets, time, -step)[0], time - step

        return standstill.stands(pace, go_back, (jets, time), span, span)[0]


def after_span(
    lane: Lane, network: Network, drive: Drive, jets: Jets, time: Instants, span: Instants
) -> Moved:
    """The jets a span later, and a bound on the norm of y^(r) on the way.

    `span` may be negative, or 0. `jets` are those of the outputs at `time`. A row of the law's
    matrix sums to `2 s Σ k` at most in absolute value, plus the gains of damping, which bounds the
    rates.
    """
    strength = drive.strength.greatest(lane)
    rate = jnp.maximum(1.0, 2 * strength * control.norms(lane.gain).sum(axis=0))
    if lane.damping is not None:
        rate = rate + control.norms(lane.damping).sum(axis=0)
    needed = jnp.ceil(jnp.abs(span) * rate / LONGEST)
    pieces = jnp.maximum(1, jnp.where(jnp.isfinite(needed), needed, 1.0).max().astype(int))
    piece = span / pieces.astype(float)

    def one(number: Int[Array, ""], carry: Moved) -> Moved:
        begin = time + number.astype(float) * piece
        there, highest = by_series(lane, network, drive, carry[0], begin, piece)
        return there, jnp.maximum(carry[1], highest)

    return jax.lax.fori_loop(0, pieces, one, (jets, jnp.zeros_like(jets[0][0])))


def by_series(
    lane: Lane, network: Network, drive: Drive, jets: Jets, time: Instants, span: Instants
) -> Moved:
    """`after_span` for one piece of a tick."""
    stays = span == 0
    span = jnp.where(stays, 1.0, span)
    order, forcing = len(jets), forcing_of(lane, time, span)
    powers = [span**k for k in range(order + 1)]
    lane = lane._replace(gain=control.gain_in_ticks(lane.gain, powers))
    if lane.damping is not None:
        lane = lane._replace(damping=control.gain_in_ticks(lane.damping, powers))
    still = tuple(jnp.zeros_like(jet) for jet in jets)
    noise = in_ticks(drive.sensed.of(still), powers)
    added = drive.known.derivatives(time, span, order, jets[0])
    factorials = jnp.asarray(INVERSE_FACTORIALS)
    first = in_ticks(jets, powers)

    def term(n: Int[Array, ""], window: Jets) -> PerAxis:
        """The derivative of order r + n from the r before it."""
        here = n < COEFFICIENTS

        def of_order(leaf: Array) -> Array:
            return jnp.where(here, jax.lax.dynamic_index_in_dim(leaf, n, keepdims=False), 0.0)

        navigator, basis, inputs = jax.tree.map(of_order, forcing)
        own = tuple(a + jnp.where(n == 0, b, 0.0) for a, b in zip(window, noise, strict=True))
        known = drive.known
        if isinstance(known, KnownDrive):
            constant = jnp.where(n < len(added), jax.lax.dynamic_index_in_dim(added, n), 0.0)
            known = dataclasses.replace(known, drive=Polynomial(constant))
        now = signals_alone(time, navigator, basis, inputs)
        return local_jerk(lane, network, drive._replace(known=known), own, now)

    def add(carry: tuple) -> tuple:
        n, window, sums, bound, _ = carry
        new, number = term(n, window), n + order
        sums = tuple(total + new * factorials[number - k] for k, total in enumerate(sums))
        bound = bound + plane.length(new) * factorials[n]
        last = jnp.abs(new) * factorials[n + 1]
        size = jnp.maximum(jnp.abs(sums[-1]).max(axis=(0, 1)), jnp.abs(sums[0]).max(axis=(0, 1)))
        more = (jnp.where(jnp.isfinite(last), last, 0.0).max(axis=(0, 1)) > LEAST_TERM * size).any()
        return n + 1, (*window[1:], new), sums, bound, more

    def under_way(carry: tuple) -> Bool[Array, ""]:
        n, *_, more = carry
        return ((n < COEFFICIENTS + order) | more) & (n + order < MOST_TERMS)

    sums = tuple(
        sum(first[m] / math.factorial(m - k) for m in range(k, order)) for k in range(order)
    )
    begin = jnp.asarray(0), first, sums, jnp.zeros_like(first[0][0]), jnp.asarray(True)
    _, _, sums, bound, _ = jax.lax.while_loop(under_way, add, begin)
    found = tuple(each / power[None, None] for each, power in zip(sums, powers, strict=False))
    return select(~stays, found, jets), bound / (jnp.abs(span) ** order)[None]


def in_ticks(jets: Jets, powers: list[Instants]) -> Jets:
    """Jets with time counted in ticks."""
    return tuple(jet * power[None, None] for jet, power in zip(jets, powers, strict=False))


def signals_alone(
    time: Instants,
    navigator: Float[Array, "derivatives 2 lanes"],
    basis: Float[Array, "derivatives functions lanes"],
    inputs: Float[Array, "functions lanes"] | None,
) -> Signals:
    """Signals of an instant, without R, which the local law does not need."""
    return Signals(time, navigator, basis, navigator[0], basis[0], inputs)


class Forcing(NamedTuple):
    """Derivatives, at the start of a tick, of polynomials through functions of time.

    Time is counted in ticks: the derivative of order k + n is times the power k + n of the tick.
    """

    path: Float[Array, "derivatives jets 2 lanes"]  # of the navigator's jets
    basis: Float[Array, "derivatives jets B lanes"]  # of the attacks' functions
    inputs: Float[Array, "derivatives B lanes"] | None  # of those that liars take as inputs


def forcing_of(lane: Lane, time: Instants, span: Instants) -> Forcing:
    points = jnp.asarray(polynomial.chebyshev_points(COEFFICIENTS))
    times = time[None] + points[:, None] * span[None]
    path, basis = (jax.vmap(one)(times) for one in (lane.path, lane.basis))
    inputs = jax.vmap(lane.inputs)(times)
    powers = jnp.stack([span**k for k in range(path.shape[1])])[None, :, None]
    if inputs is not None:
        inputs = polynomial.interpolated(inputs * powers[:, len(lane.gain)]).terms
    path, basis = (polynomial.interpolated(each * powers).terms for each in (path, basis))
    return Forcing(path, basis, inputs)
