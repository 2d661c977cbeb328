"""The local law in the exact engine, solved from tick to tick by the power series of the motion.

From one tick to the next, `y^(r) = s (a0 y_0^(r) - P(ε))` is linear with constant coefficients, and its
forcing is made of functions of time. Polynomials stand for these functions within a tick. Every derivative of
the motion then follows from the one before it:

    y^(r+n) = D(y^(n), …, y^(n+r-1), n-th derivatives of the functions),

where D is the right-hand side of the law. No matrix is formed, so that the cost grows with the number of
links. The series stops at rounding. A long tick is cut into pieces, because terms of a long series cancel.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxnet.engine import between, standstill, tick
from jaxnet.engine.loop import LaneFlags, Tick, Ticks
from jaxnet.engine.propagation import Held, PropagationState
from jaxnet.engine.status import Code
from jaxnet.engine.subset import LaneIndices, picked, select
from jaxnet.engine.tick import DecisionState, Drive, Instants, KnownDrive, PerAxis
from jaxnet.model import control, plane
from jaxnet.model.lane import Lane, Network
from jaxnet.model.plane import Jets

COEFFICIENTS = 10  # of a polynomial
LONGEST = 4.0  # a piece times the greatest rate: terms then cancel to e⁴ times rounding
MOST_TERMS = 60  # of a series; it needs about 40 for the longest piece
LEAST_TERM = 2.0**-56  # relative size at which a series stops

CHEBYSHEV_ANGLES = (np.arange(COEFFICIENTS) + 0.5) * np.pi / COEFFICIENTS
CHEBYSHEV_POINTS = (1 - np.cos(CHEBYSHEV_ANGLES)) / 2  # Chebyshev's points in [0, 1]
TO_CHEBYSHEV = np.linalg.inv(
    np.polynomial.chebyshev.chebvander(2 * CHEBYSHEV_POINTS - 1, COEFFICIENTS - 1)
)
INVERSE_FACTORIALS = np.array([1.0 / math.factorial(n) for n in range(MOST_TERMS + 1)])


def derivatives_of_chebyshev() -> Float[np.ndarray, "derivatives coefficients"]:
    """Return the derivatives at 0 of Chebyshev's polynomials of 2x - 1, of each order."""
    polynomials = np.polynomial.Chebyshev.identity(domain=[0, 1])
    basis = [polynomials.basis(n, domain=[0, 1]) for n in range(COEFFICIENTS)]
    return np.array(
        [[each.deriv(n)(0.0) if n else each(0.0) for each in basis] for n in range(COEFFICIENTS)]
    )


DERIVATIVES = derivatives_of_chebyshev()


class Forcing(NamedTuple):
    """Derivatives at the start of a tick of the polynomials for the functions, by order of the jets.

    Time is counted in ticks: the derivative of order k + n is multiplied by the power k + n of the tick.
    """

    navigator: Float[Array, "derivatives jets 2 lanes"]
    basis: Float[Array, "derivatives jets functions lanes"]


class Local(Held):
    """Motion under the local law at every instant."""

    def hold(
        self, state: PropagationState, decided: DecisionState, at: Tick
    ) -> tuple[PropagationState, LaneFlags]:
        """Return the state unchanged: the law has a solution whoever is retained."""
        return state, jnp.zeros_like(at.here)

    def drive_now(self, state: PropagationState, decided: DecisionState) -> PerAxis:
        """Return `y^(r) + P(ŷ)`, with y^(r) of the law."""
        lane, drive = self.lane, self.drive(state, decided)
        own = tick.sensed(state.jets, decided.noise)
        navigator = self.navigator(state)
        demand = tick.followed_demand(
            lane, self.network, drive, own, navigator, state.basis, state.time
        )
        return demand + control.feedback(lane.gain, own)

    def later(
        self, state: PropagationState, decided: DecisionState, span: Instants, since: Instants
    ) -> PropagationState:
        """Return the state a span [s] later, in the tick that began at `since` [s]."""
        time, drive = state.time + span, self.drive(state, decided)
        jets, _ = after_span(self.lane, self.network, drive, state.jets, state.time, span)
        return state._replace(jets=jets, time=time, basis=self.lane.basis(time))

    def advance(
        self, state: PropagationState, decided: DecisionState, ticks: Ticks, status: Code
    ) -> tuple[PropagationState, Code, LaneFlags]:
        """Return the state at the next tick; lanes are singular where a vehicle stands still on the way."""
        lane, network, time = self.lane, self.network, self.instant(ticks + 1)
        drive, span = self.drive(state, decided), time - state.time
        jets, _ = after_span(lane, network, drive, state.jets, state.time, span)
        now = state._replace(jets=jets, time=time, basis=lane.basis(time))
        now, status = self.with_inner(state, decided, now, status)
        arrived = jnp.ones_like(state.straight)
        if not lane.vehicle.singular:
            return now, status, arrived

        def stood(few: LaneIndices) -> LaneFlags:
            some = jax.tree.map(lambda leaf: picked(leaf, few), (lane, drive, jets, time, span))
            return stood_in_tick(network, *some)

        status, straight = between.stopped(
            now.straight, status, lambda: self.lead(now, decided), stood
        )
        return now._replace(straight=straight), status, arrived


def after_span(
    lane: Lane, network: Network, drive: Drive, jets: Jets, time: Instants, span: Instants
) -> tuple[Jets, Float[Array, "m lanes"]]:
    """Return the jets a span later, and a bound on the norm of y^(r) on the way.

    `span` may be negative, or 0. `jets` are those of the outputs at `time`. A row of the law's matrix sums to
    `2 s Σ k` at most in absolute value, which bounds the rates.
    """
    strength = 1.0 if drive.strength is None else drive.strength.max(axis=(0, 1))
    rate = jnp.maximum(1.0, 2 * strength * control.norms(lane.gain).sum(axis=0))
    needed = jnp.ceil(jnp.abs(span) * rate / LONGEST)
    pieces = jnp.maximum(1, jnp.where(jnp.isfinite(needed), needed, 1.0).max().astype(int))
    piece = span / pieces.astype(float)

    def one(
        number: Int[Array, ""], carry: tuple[Jets, Float[Array, "m lanes"]]
    ) -> tuple[Jets, Float[Array, "m lanes"]]:
        jets, bound = carry
        there, highest = by_series(
            lane, network, drive, jets, time + number.astype(float) * piece, piece
        )
        return there, jnp.maximum(bound, highest)

    return jax.lax.fori_loop(0, pieces, one, (jets, jnp.zeros_like(jets[0][0])))


def by_series(
    lane: Lane, network: Network, drive: Drive, jets: Jets, time: Instants, span: Instants
) -> tuple[Jets, Float[Array, "m lanes"]]:
    """Return what `after_span` does, for one piece of a tick."""
    stays = span == 0
    span = jnp.where(stays, 1.0, span)
    order, forcing = len(jets), forcing_of(lane, time, span)
    powers = [span**k for k in range(order + 1)]
    gain = jnp.stack([lane.gain[k] * powers[order - k] for k in range(order)])
    lane = lane._replace(gain=gain)
    noise = None if drive.noise is None else scaled(drive.noise, powers)
    added = None if drive.known is None else known_derivatives(drive.known, time, span, order)
    factorials = jnp.asarray(INVERSE_FACTORIALS)
    first = scaled(jets, powers)

    def term(n: Int[Array, ""], window: Jets) -> PerAxis:
        """Return the derivative of order r + n from the r before it."""
        here = n < COEFFICIENTS
        functions = jax.tree.map(
            lambda leaf: jnp.where(
                here, jax.lax.dynamic_index_in_dim(leaf, n, keepdims=False), 0.0
            ),
            forcing,
        )
        own = window
        if noise is not None:
            own = tuple(a + jnp.where(n == 0, b, 0.0) for a, b in zip(window, noise, strict=False))
        now = drive
        if drive.known is not None and added is not None:
            here = n < len(added)
            constant = jnp.where(here, jax.lax.dynamic_index_in_dim(added, n, keepdims=False), 0.0)
            now = drive._replace(known=KnownDrive(drive.known.share, constant[:, None], span))
        return tick.followed_demand(
            lane, network, now, own, functions.navigator, functions.basis, time
        )

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


def scaled(jets: Jets, powers: list[Instants]) -> Jets:
    """Return jets with time counted in ticks."""
    return tuple(jet * power[None, None] for jet, power in zip(jets, powers, strict=False))


def known_derivatives(
    known: KnownDrive, time: Instants, span: Instants, order: int
) -> Float[Array, "degrees 2 m lanes"]:
    """Return the derivatives of order r, r + 1, … of what known words ask for at a time, counted in spans."""
    drive, share = known.drive, span / known.interval
    if known.time is not None:
        drive = tick.continued(drive, (time - known.time) / known.interval)
    scaled = [drive[:, n] * (span**order * share**n)[None, None] for n in range(drive.shape[1])]
    return jnp.stack(scaled)


def forcing_of(lane: Lane, time: Instants, span: Instants) -> Forcing:
    """Return the derivatives of the polynomials through the navigator's jets and the attacks' functions."""
    times = time[None] + jnp.asarray(CHEBYSHEV_POINTS)[:, None] * span[None]
    known = Forcing(jax.vmap(lane.path)(times), jax.vmap(lane.basis)(times))
    powers = jnp.stack([span**k for k in range(known.navigator.shape[1])])

    def of(
        values: Float[Array, "nodes jets functions lanes"],
    ) -> Float[Array, "nodes jets functions lanes"]:
        coefficients = jnp.tensordot(
            jnp.asarray(TO_CHEBYSHEV), values * powers[None, :, None], axes=1
        )
        return jnp.tensordot(jnp.asarray(DERIVATIVES), coefficients, axes=1)

    return Forcing(*map(of, known))


def stood_in_tick(
    network: Network, lane: Lane, drive: Drive, jets: Jets, now: Instants, span: Instants
) -> LaneFlags:
    """Return the lanes in which a vehicle stood still in the span before now. The search goes back."""
    _, highest = after_span(lane, network, drive, jets, now, -span)

    def pace(state: tuple[Jets, Instants]) -> standstill.Pace:
        return standstill.backwards(
            lane.vehicle, state[0], highest, None
        )  # nobody stops under this law

    def go_back(state: tuple[Jets, Instants], step: Instants) -> tuple[Jets, Instants]:
        jets, time = state
        return after_span(lane, network, drive, jets, time, -step)[0], time - step

    return standstill.stands(pace, go_back, (jets, now), span, span)[0]
