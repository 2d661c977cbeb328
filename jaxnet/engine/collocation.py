"""The nonlinear vehicles under the law, integrated by Gauss collocation in the jets of the outputs.

The r jets y, ẏ, … of the output and the state of a vehicle determine each other while the vehicle
moves (O4). In the jets the motion has no stiffness near standstill. At each node of a window
(`engine.gauss`)

    jets → state → received jets → y^(r) of the law → inputs → rates of the state → rates of the
    jets,

with the vehicle's own equations and the law solved from the received jets.

The first guess is the exact cancellation `q = z - P(y)` (theorems.md O2b). Newton's method goes on
from there, with `-P` as its Jacobian, until the rates of the jets are the derivatives of the jets.
Where the cancellation holds, one evaluation at the nodes confirms the guess. A window is refused,
and tried again with a shorter length, in these cases:

- Newton's method has not converged;
- the Legendre coefficients of the jerk do not fall fast enough;
- the signals of navigator and attacks differ from their polynomials between the nodes;
- the vehicle's equations do not return the jets and their derivatives;
- a vehicle stands still in the window, and the window goes on past the next tick.

A window serves ticks and outputs until a decision changes. Each lane has its own windows. The lanes
are the last axis of every array.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from jaxnet.engine import gauss, standstill, stepper, vehicles
from jaxnet.engine.demand import Signals, signals
from jaxnet.engine.following import Followed, Following, Scene
from jaxnet.engine.gauss import Jerks, Window
from jaxnet.engine.moment import Instants, LaneFlags, PerAxis
from jaxnet.engine.plan import Tolerances
from jaxnet.engine.stages import stopping
from jaxnet.engine.stages.stopping import Rest
from jaxnet.engine.status import Code, Status, fail
from jaxnet.engine.subset import LaneIndices, for_each, picked, put, run_if, select, side_by_side
from jaxnet.engine.tick import DecisionState
from jaxnet.engine.vehicles import States
from jaxnet.model import plane
from jaxnet.model.lane import Lane
from jaxnet.model.plane import Jets

FIRST = 0.7  # [s] length of the first window that is tried
PASSES = 10  # most evaluations at the nodes of a window
CONVERGED = 0.1  # change of a pass over the tolerance, below which another pass changes nothing
WIDTH = 8  # lanes whose windows are computed at once; 16: 0.9 times as fast, plain, 12 vehicles


class CollocationState(NamedTuple):
    """State of the lanes under way."""

    jets: Jets
    signals: Signals
    window: Window
    end: Instants  # [s] until then the motion is known
    length: Instants  # [s] proposed for the next window
    steps: Int[Array, " lanes"]  # windows so far, kept and refused
    followed: Followed
    rest: Rest | None  # None where vehicles do not stop


class Task(NamedTuple):
    """Lanes that need a window from now on."""

    lane: Lane
    tolerances: Tolerances
    decided: DecisionState
    state: CollocationState
    tick: Instants  # [s] the next one
    limit: Instants  # [s] no window goes on for longer
    status: Code


# Of lanes that tried a window: it, its end (now if it was refused), the next length, steps, status,
# and the vehicles at rest.
Attempt = tuple[Window, Instants, Instants, Int[Array, " lanes"], Code, Rest | None]


class Collocation(Following[CollocationState]):
    """Motion of the nonlinear vehicles, window by window. `numbers` are the tolerances."""

    @property
    def guesses(self) -> bool:
        """Return that each window starts from a guess."""
        return True

    def begin(self):
        lane, zero = self.lane, jnp.zeros_like(self.lane.attack_scale)
        jets = vehicles.first_outputs(lane)
        still = jax.lax.optimization_barrier(jnp.zeros((gauss.STAGES, *jets[0].shape)))
        return CollocationState(
            jets=jets,
            signals=signals(lane, zero),
            window=gauss.window_of(zero, zero, jets, still),
            end=zero,
            length=zero + FIRST,
            steps=jnp.zeros(zero.shape, int),
            followed=self.nothing_followed(),
            rest=stopping.first_rest(lane),
        )

    def errors(self, state):
        return plane.relative(state.jets, state.signals.navigator)

    def states(self, state):
        return vehicles.states_of(self.lane, state.jets, state.signals.time)

    def placed(self, state, which, states):
        rest = vehicles.outputs(self.lane, states, state.signals.time)
        return state._replace(jets=plane.replaced(which, rest, state.jets))

    def pace(self, state, decided):
        known = vehicles.pace_of_jets(self.lane, state.jets, state.signals.time)
        return super().pace(state, decided) if known is None else known

    def drive_now(self, state, decided):
        """`y‴ + P(ŷ)`, with y‴ of the window that has brought the vehicle here."""
        jerk = state.window.jerk_at(state.signals.time)
        return decided.sensed.drive(self.lane.gain, jerk, state.jets)

    def jerk(self, state, decided):
        """`y‴` [m/s³] after these decisions, by the law; the window ends where they change."""
        followed, now = state.followed, state.signals
        own = decided.sensed.of(state.jets)
        guess = followed.guess(self.lane, now, own)
        return followed.jerk(Scene(self.lane, self.network, decided, now), own, guess)

    @property
    def at_every_tick(self) -> bool:
        """Whether the jerk of vehicles changes at every tick."""
        lane = self.lane
        changing = lane.sensor is not None or not lane.exact_words or lane.delay is not None
        return lane.law.needs_ticks() or changing

    def hold(self, state, decided, at):
        """Factorise the Laplacian where a weight changed, and end the window there.

        Where the law holds a jerk, vehicles exchange the jerk at every tick instead.
        """

        def states() -> States:
            return decided.coasting.at_rest(self.states(state))

        flagged = at.here if self.at_every_tick else at.anew
        followed, cut_off = self.follow_anew(flagged, state, decided, states)
        now, length = state.signals.time, state.length
        if self.lane.lossy:  # of a long window that ends at once, each tick would keep the error
            used = jnp.maximum(now - state.window.start, self.clock.interval)
            length = jnp.where(flagged, jnp.minimum(length, 2 * used), length)
        end = jnp.where(flagged, now, state.end)
        return state._replace(followed=followed, end=end, length=length), cut_off

    def advance(self, state, decided, ticks, status):
        """Move lanes to the next tick or to the end of their window; lanes without one try windows.

        Lanes without a window wait until WIDTH of them are there, or until no other lane can move.
        """
        lane, clock, time = self.lane, self.clock, state.signals.time
        last = clock.outputs * clock.ticks
        going = (status == Status.ok) & (ticks < last)
        goal, horizon = clock.at(ticks + 1), clock.at(jnp.broadcast_to(last, ticks.shape))
        moving = going & (state.end > time)
        waiting, movable = going & ~moving, moving.any()
        width = side_by_side(WIDTH, waiting.size)
        ready = jnp.where(movable, waiting.sum() // width * width, waiting.sum())
        limit = goal if self.at_every_tick else horizon
        task = Task(lane, self.numbers, decided, state, goal, limit, status)

        def some(few: LaneIndices, known: Attempt) -> Attempt:
            found = self.attempt(jax.tree.map(lambda leaf: picked(leaf, few), task))
            return jax.tree.map(lambda every, theirs: put(every, few, theirs), known, found)

        known = state.window, state.end, state.length, state.steps, status, state.rest
        known = for_each(waiting & (jnp.cumsum(waiting) <= ready), width, some, known)
        window, end, length, steps, status, rest = known
        state = state._replace(window=window, end=end, length=length, steps=steps, rest=rest)

        def move(state: CollocationState) -> CollocationState:
            target = jnp.where(moving, jnp.minimum(goal, state.end), time)
            jets = select(moving, state.window.jets_at(target), state.jets)
            return state._replace(jets=jets, signals=signals(lane, target))

        state = run_if(movable, move, state)
        return state, status, moving & (state.signals.time == goal)

    def attempt(self, task: Task) -> Attempt:
        """Try a window of each lane.

        A window with a vehicle at a standstill is refused too, until it ends before the next tick.
        """
        state, now = task.state, task.state.signals.time
        end = stepper.towards(task.limit, now, state.length)
        spent = state.steps >= task.tolerances.max_steps
        jerks, error, finite = self.solve(task, end - now)
        window = gauss.window_of(now, end - now, state.jets, jerks)
        fits = ~spent & (error < 1.0)
        rest, new = state.rest, None
        if rest is None:
            stood = stood_in(task.lane, window, end, fits, task.decided)
        else:
            moves = ~stopping.at_rest(rest, task.decided.coasting.frozen(task.lane))
            new = stopping.rest_in(task.lane, window, moves & fits[None])
            stood = new.which.any(axis=0)
        kept = fits & ~(stood & (end > task.tick))
        if rest is not None and new is not None:
            rest = rest.plus(new._replace(which=new.which & kept[None]))
        length = stepper.next_step(window.length, error, gauss.STAGES)
        length = jnp.where(stood, window.length / 2, length)
        stuck = ~kept & (length <= stepper.LEAST_RELATIVE_STEP * jnp.maximum(end, 1.0))
        singular = stood & kept & (rest is None)
        status = fail(task.status, Status.singular, singular)
        status = fail(status, Status.nonfinite, ~spent & stuck & ~finite)
        status = fail(status, Status.max_steps, spent | stuck)
        steps = state.steps + (~spent).astype(int)
        return window, jnp.where(kept, end, now), length, steps, status, rest

    def solve(self, task: Task, length: Instants) -> tuple[Jerks, Instants, Bool[Array, " few"]]:
        """The jerk at the nodes, the error over the tolerance, and whether all numbers are finite.

        The error is infinite where the vehicle's equations do not return jets with derivatives.
        """
        lane, state, decided = task.lane, task.state, task.decided
        followed, order = state.followed, len(state.jets)
        places = np.concatenate([gauss.RULE.nodes, gauss.PLACES])
        times = jnp.asarray(places)[:, None] * length[None]
        known = jax.vmap(lambda time: signals(lane, time))(state.signals.time[None] + times)
        now = jax.tree.map(lambda leaf: leaf[: gauss.STAGES], known)
        coasted = gauss.coasted(state.jets, times[: gauss.STAGES])
        inverse = gauss.linear(lane.law.own_gain(lane.own_gain), length)
        at_start = tuple(jnp.abs(jet) for jet in state.jets)

        def over_tolerance(change: Sequence[PerAxis], size: Jets) -> Instants:
            sizes = jnp.concatenate(size)
            return stepper.error_norm(jnp.concatenate(change), sizes, task.tolerances)

        def guessed(now: Signals, jets: Jets) -> Any:
            return followed.guess(lane, now, decided.sensed.of(jets))

        def at_node(now: Signals, jets: Jets, jerk: PerAxis) -> tuple[PerAxis, Jets]:
            return self.rates(task, now, jets, jerk)

        def greatest(each: Jerks) -> PerAxis:
            return jnp.abs(each).max(axis=0)

        def one(carry: Any) -> Any:
            jerks, passes, *known = carry
            moved = gauss.integrated(length, jerks, order)
            jets = plane.plus(coasted, moved)
            found, missed = jax.vmap(at_node)(now, jets, jerks)
            change = gauss.times(inverse, found - jerks)
            sizes = tuple(jnp.maximum(a, greatest(b)) for a, b in zip(at_start, jets, strict=True))
            left = over_tolerance(
                [greatest(each) for each in gauss.integrated(length, change, order)], sizes
            )
            unlike = over_tolerance([each.max(axis=0) for each in missed], sizes)
            new = jerks + change, left, unlike, sizes
            jerks, *known = select(unfinished(carry), new, (jerks, *known))
            return jerks, passes + 1, *known

        def unfinished(carry: Any) -> LaneFlags:
            _, _, left, unlike, _ = carry
            return (left >= CONVERGED) & (unlike < 1.0)

        def under_way(carry: Any) -> Bool[Array, ""]:
            return unfinished(carry).any() & (carry[1] < PASSES)

        first = gauss.times(inverse, jax.vmap(guessed)(now, coasted))
        infinite, zero = jnp.full_like(length, jnp.inf), jnp.zeros_like(length)
        begin = first, jnp.asarray(0), infinite, zero, at_start
        jerks, _, left, unlike, sizes = jax.lax.while_loop(under_way, one, begin)
        # An attack that begins between nodes is seen, unless it is shorter than 2 / len(PLACES).
        path, drive = gauss.unresolved(known.path), gauss.unresolved(known.drive)
        misfit = jnp.maximum(gauss.next_degrees(jerks), followed.unresolved(path, drive))
        error = left + over_tolerance(gauss.effect(length, misfit, order), sizes)
        finite = jnp.isfinite(error)
        return jerks, jnp.where(finite & (unlike < 1.0), error, jnp.inf), finite

    def rates(self, task: Task, now: Signals, jets: Jets, guess: PerAxis) -> tuple[PerAxis, Jets]:
        """The jerk of the vehicles with these jets, by the law and the vehicles' equations.

        Return also by how much the states' jets, and the rates of lower jets, miss the jets.
        """
        lane, decided = task.lane, task.decided
        frozen = stopping.at_rest(task.state.rest, decided.coasting.frozen(lane))
        states = vehicles.states_of(lane, jets, now.time)
        own = plane.replaced(frozen, jets, vehicles.outputs(lane, states, now.time))
        own = decided.sensed.of(own)
        jerk = task.state.followed.jerk(Scene(lane, self.network, decided, now), own, guess)
        asked = vehicles.asked(lane, states, jerk, now.time)
        rates = vehicles.rates(lane, states, asked, now.time)
        found, (*lower, moved) = vehicles.output_rates(lane, states, rates, now.time)
        missed = [jnp.abs(a - b) for a, b in zip(found, jets, strict=True)]
        for k, rate in enumerate(lower, start=1):
            missed[k] = jnp.maximum(missed[k], jnp.abs(rate - jets[k]))
        missed = tuple(jnp.where(frozen[None], 0.0, each) for each in missed)
        return jnp.where(frozen[None], jerk, moved), missed  # no state describes a vehicle at rest


def stood_in(
    lane: Lane, window: Window, end: Instants, among: LaneFlags, decided: DecisionState
) -> LaneFlags:
    """The lanes, among some, in which a vehicle that may not stop is singular in the window.

    The search goes back from the end. Almost surely, vehicles stand still only on a straight line.
    """
    vehicle, apart = lane.vehicle, decided.coasting.may_stop(lane)
    if not vehicle.singular:
        return jnp.zeros_like(among)
    highest = window.greatest_jerk()
    among = among & jnp.isfinite(highest).all(axis=0)

    bound = vehicles.highest_in_formation(lane, highest)

    def jets_at(time: Instants) -> Jets:
        jets = (*window.jets_at(time), window.jerk_at(time))
        return vehicles.in_formation(lane, jets, time)

    def on_line(time: Instants) -> LaneFlags:
        return standstill.straight(*standstill.lead(vehicle, jets_at(time), apart))

    line = among & on_line(window.start) & on_line(end)

    def pace(time: Instants) -> standstill.Pace:
        return standstill.backwards(vehicle, jets_at(time)[:-1], bound, apart)

    def back(time: Instants, by: Instants) -> Instants:
        return time - by

    interval = jnp.where(line, window.length, 0.0)
    return line & standstill.stands(pace, back, end, interval, window.length)[0]
