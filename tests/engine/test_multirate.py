"""Vehicles that take a step of their fleet in shorter ones, against what is known of them and of fleets."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from jaxnet.engine import batch, multirate, stepper
from jaxnet.engine.multirate import SlowVehicles
from jaxnet.engine.plan import Tolerances
from jaxnet.kinds.fields import FULL_TURN, Angle
from jaxnet.kinds.pytree import as_pytree
from jaxnet.kinds.vehicles import HEADING, Vehicle
from jaxnet.kinds.vehicles.car import Car
from jaxnet.kinds.vehicles.two_wheeled import FORCE, TwoWheeled
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model.control import feedback
from jaxnet.solvers import choice
from tests import systems
from tests.engine.test_exactness import navigator_at

GAIN = np.array([1.0, 3.0, 3.0])
COMPANION = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], -GAIN])
FEW, START, END = 5, 0.3, 0.35  # [s]
VEHICLES, CALM, SOME, MANY = 32, 0, 1, 2  # and lanes
STOP = 0.5  # [s]
STEPS = {"engine": {"solver": "dopri5"}}
STOPPING = {SOME: 8, MANY: 9}  # vehicles, of which a quarter are few
ROBOT = TwoWheeled()
KINDS = {
    kind.kind: as_pytree(kind.drawn(Draw(Keyed(0), range(FEW), 1), "vehicle"))
    for kind in (ROBOT, Car(wheelbase={"uniform": [0.2, 3.0]}))
}


def turning(rng, many):
    """Jets (3, 2, many) of vehicles that hardly move but accelerate."""
    angle, size = rng.uniform(-np.pi, np.pi, (2, many)), [[0.4], [2.0]] * rng.uniform(0.5, 2.0, (2, many))
    velocity, acceleration = size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.stack([rng.uniform(-5.0, 5.0, (2, many)), velocity, acceleration])


def told(time, rate):
    """What each of a few vehicles hears at each of some times (…, few), (…, 2, few)."""
    phase = rate * time + np.arange(float(FEW))
    return 30.0 * jnp.stack([jnp.sin(phase), jnp.cos(0.7 * phase)], axis=-2)


@functools.partial(jax.jit, static_argnums=0)
def step(solver, kind, jets, rate):
    """A step of vehicles alone in their lanes, taken as it is and in shorter ones."""
    rule, (start, end) = stepper.method(solver), (jnp.full(FEW, time) for time in (START, END))
    tolerances = Tolerances(jnp.full(FEW, 1e-7), jnp.full(FEW, 1e-9), jnp.full(FEW, 1000))
    gain = jnp.broadcast_to(GAIN[:, None], (3, FEW))

    def field(now, state):
        jerk = now[:, None] - feedback(gain, kind.output_jets(state))
        return kind.motion(state, kind.inputs_for(state, jerk))

    state = kind.state_of(jets[:, :, None])
    signals = functools.partial(told, rate=rate)
    trial = stepper.attempt(field, signals, rule, start, end, state, field(signals(start), state), tolerances)
    few, everybody = SlowVehicles(kind, gain, start, end, tolerances), jnp.ones(FEW, bool)
    state, slopes = state[:, 0], trial.slopes[:, :, 0]
    there, slope, arrived = multirate.by_themselves(few, state, slopes, trial.error, everybody, rule)
    known = field(signals(end), there[:, None])[:, 0]
    return trial.error, kind.output_jets(there[:, None]), (slope, known), arrived


@pytest.mark.parametrize(
    ("vehicle", "solver"), [*(("two_wheeled", solver) for solver in stepper.SOLVERS), ("car", "dopri5")]
)
def test_who_goes_alone_arrives_where_its_linear_equation_leads(solver, vehicle):
    """`y‴ = z - P(y)` by SciPy, though the step of the fleet is far from what is tolerated."""
    middle = turning(np.random.default_rng(0), FEW)  # of the step

    def motion(time, jets):
        jets = jets.reshape(3, 2, FEW)
        jerk = np.asarray(told(jnp.full(FEW, time), 1.3)) - np.tensordot(GAIN, jets, axes=1)
        return np.stack([jets[1], jets[2], jerk]).ravel()

    def at(time):
        found = solve_ivp(motion, (0.325, time), middle.ravel(), method="DOP853", rtol=1e-12, atol=1e-12)
        return found.y[:, -1].reshape(3, 2, FEW)

    error, jets, (slope, known), arrived = step(solver, KINDS[vehicle], jnp.asarray(at(START)), 1.3)
    assert error.max() > 1e3
    assert arrived.all()
    for ours, theirs in zip(jets, at(END), strict=True):
        np.testing.assert_allclose(ours[:, 0], theirs, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(slope, known, rtol=1e-6)


def test_who_hears_what_no_polynomial_tells_does_not_go():
    """At 80 rad/s a step takes in two thirds of a turn."""
    jets = turning(np.random.default_rng(0), FEW)
    jets[1] += 10.0
    for rate, expected in ((1.3, True), (80.0, False)):
        assert (step("dopri5", KINDS["two_wheeled"], jnp.asarray(jets), rate)[-1] == expected).all()


class Pushed(TwoWheeled):
    """A robot with a jerk that the law is not told of."""

    kind = "pushed"

    def motion(self, state, inputs):
        rates = super().motion(state, inputs)
        return rates.at[FORCE].add(0.01)


def test_who_does_not_move_as_asked_does_not_go():
    """What it hears cannot be read off its motion."""
    pushed = as_pytree(Pushed().drawn(Draw(Keyed(0), range(FEW), 1), "vehicle"))
    jets = turning(np.random.default_rng(0), FEW)
    jets[1] += 10.0
    for kind, expected in ((KINDS["two_wheeled"], True), (pushed, False)):
        assert (step("dopri5", kind, jnp.asarray(jets), 1.3)[-1] == expected).all()


@pytest.mark.parametrize("solver", stepper.SOLVERS)
def test_between_stages_a_polynomial_misses_no_more_than_is_told(solver):
    """The integral of `x⁵` less its fit, from the step's start, on a grid of its own."""
    rule = stepper.method(solver)
    fit = np.polynomial.Polynomial.fit(rule.nodes, rule.nodes**5, 4)
    past = np.linspace(0.0, 1.0, 20_001)
    integral = np.cumsum(past**5 - fit(past)) / 20_000
    told = multirate.hidden(rule) * np.abs(rule.nodes**5 - fit(rule.nodes)).max()
    assert np.abs(integral).max() < 1.01 * told
    assert (multirate.hidden(rule) > 4) == (solver == "tsit5")


def stopping(given):
    """Lanes of a fleet without attacks: in one all follow the navigator, in others so many nearly stop."""
    one, rng = systems.lanes(given, 3, ("state",)), np.random.default_rng(0)
    path, vehicle = navigator_at(one, 0), one.inputs.lane.vehicle
    errors = np.tile(rng.uniform(-1.0, 1.0, (3, 2, VEHICLES)), (3, 1, 1, 1))
    for lane, many in STOPPING.items():
        then = turning(rng, many) - path(STOP)[:3, :, None]
        errors[lane, :, :, :many] = np.tensordot(expm(-COMPANION * STOP), then, axes=1)
    jets = np.moveaxis(errors, 0, -1) + path(0.0)[:3, :, None, None]
    initial = np.moveaxis(np.asarray(vehicle.state_of(jets)), -1, 0)
    return errors, one._replace(inputs=one.inputs._replace(lane=one.inputs.lane._replace(initial=initial)))


@pytest.fixture
def anew():
    """A program compiled with what a test changes, which no other uses."""
    batch.program.cache_clear()
    yield
    batch.program.cache_clear()


def test_a_few_who_nearly_stop_hold_up_nobody(anew, monkeypatch):
    """All move as is known, in less than half the steps, and in fewer where they are a few too many.

    A lane is the same to the last bit without others. Where nobody arrives, lanes step as if nobody had gone.
    """
    keys = {"vehicles": VEHICLES, "topology": "lattice", "attack": "none", "defence": "none", **STEPS}
    errors, one = stopping(systems.study(**keys, horizon=1.0, tail=0.5))
    found = systems.simulate(one)
    known = np.einsum("l,nlxm->nmx", expm(COMPANION)[0], errors) + navigator_at(one, 0)(1.0)[0]
    np.testing.assert_allclose(found.series["state"][:, -1, :, :2], known, rtol=0, atol=1e-5)
    alone = systems.simulate(one._replace(inputs=batch.part(one.inputs, SOME, MANY)))
    for ours, theirs in zip(*map(jax.tree.leaves, (alone, found)), strict=True):
        np.testing.assert_array_equal(ours, theirs[SOME:MANY])
    monkeypatch.setattr(multirate, "ATTEMPTS", 0)
    batch.program.cache_clear()
    refused = systems.simulate(one)
    monkeypatch.setattr(choice, "LEAST_MULTIRATE", VEHICLES + 1)
    batch.program.cache_clear()
    never = systems.simulate(one)
    assert found.steps[CALM] == never.steps[CALM]
    assert found.steps[SOME] < never.steps[SOME] / 2
    assert found.steps[MANY] < never.steps[MANY]
    np.testing.assert_array_equal(refused.steps, never.steps)
    np.testing.assert_allclose(refused.series["state"], never.series["state"], rtol=0, atol=1e-9)


FLEETS = {
    "over links": {"vehicles": 100, "topology": {"kind": "random_regular", "degree": 4}},
    "in rounds": {"vehicles": 32, "law": {"kind": "rounds", "rounds": 3}, "engine": {"solver": "tsit5"}},
}


@pytest.mark.parametrize("fleet", FLEETS)
def test_fleets_go_as_the_exact_engine_says(fleet):
    """Trimming under rotating attacks."""
    keys = {"attack": "rotating", "horizon": 1.0, "tail": 0.5, **STEPS, **FLEETS[fleet]}

    def outcome(**others):
        return systems.simulate(systems.lanes(systems.study(**keys | others), 2, ("state", "kept")))

    ours, known = outcome(), outcome(engine="exact")
    np.testing.assert_array_equal(ours.switches, known.switches)
    np.testing.assert_allclose(ours.series["kept"], known.series["kept"], rtol=0, atol=1e-12)
    ours_at, known_at = (each.series["state"][..., :2] for each in (ours, known))
    np.testing.assert_allclose(ours_at, known_at, rtol=0, atol=1e-5)


class Askew(Vehicle):
    """The paper's robot, whose heading is told from a direction of each vehicle's own."""

    kind = "askew"
    states, units = TwoWheeled.states, TwoWheeled.units

    zero: Angle = FULL_TURN

    def straight(self, state, sign=1.0):
        """The state with its heading told from the x axis."""
        xp = state.__array_namespace__()
        return xp.stack([*state[:HEADING], state[HEADING] + sign * self.zero, *state[HEADING + 1 :]])

    def output_jets(self, state):
        return ROBOT.output_jets(self.straight(state))

    def drift(self, state):
        return ROBOT.drift(self.straight(state))

    def decoupling(self, state):
        return ROBOT.decoupling(self.straight(state))

    def inputs_for(self, state, jerk):
        return ROBOT.inputs_for(self.straight(state), jerk)

    def motion(self, state, inputs):
        return ROBOT.motion(self.straight(state), inputs)

    def state_of(self, jets):
        return self.straight(ROBOT.state_of(jets), -1.0)

    def pace(self, state, inputs):
        return ROBOT.pace(state, inputs)


def test_vehicles_that_differ_within_a_fleet_stay_together():
    keys = {"vehicles": VEHICLES, "vehicle": Askew(), "attack": "rotating", "horizon": 1.0, "tail": 0.5}
    ours, known = (
        systems.simulate(systems.lanes(systems.study(**keys, engine=engine), 2, ("state",)))
        for engine in (STEPS["engine"], "exact")
    )
    assert (known.status == 0).all()
    np.testing.assert_allclose(
        ours.series["state"][..., :2], known.series["state"][..., :2], rtol=0, atol=1e-5
    )
