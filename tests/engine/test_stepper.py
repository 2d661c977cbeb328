"""The engine's own Runge-Kutta steps, lanes side by side, against diffrax's, lane by lane."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.engine import stepper
from jaxnet.engine.plan import Tolerances

SOLVERS = list(stepper.SOLVERS)
NORM = jax.jit(diffrax.PIDController(rtol=0.0, atol=1.0).norm)
VEHICLES, LANES = 3, 5


def signals(t):
    """What the field below needs of the time."""
    return jnp.cos(3.0 * t), t / (1.0 + t)


def field(now, state):
    """Smooth, nonlinear, time-dependent; the components of a lane are coupled, lanes are not."""
    wave, drift = (each[None, None] for each in now)
    around = jnp.roll(state, 1, axis=0) - jnp.roll(state, 1, axis=1)
    return wave * jnp.sin(around) - 0.5 * state + drift / (1.0 + state**2)


# The same of one lane.
TERM = diffrax.ODETerm(
    lambda t, y, args: field(signals(jnp.asarray(t)[None]), y[..., None])[..., 0]
)


def moments(seed):
    """Lanes at different times, with steps and states of different sizes."""
    rng = np.random.default_rng(seed)
    state = rng.normal(0.0, 1.0, (6, VEHICLES, LANES)) * 10.0 ** rng.uniform(-2, 1, LANES)
    start = rng.uniform(0.0, 20.0, LANES)
    end = start + rng.uniform(0.1, 1.0, LANES)
    return jnp.asarray(start), jnp.asarray(end), jnp.asarray(state)


def tolerances(rtol, atol):
    """The same for all lanes."""
    return Tolerances(jnp.full(LANES, rtol), jnp.full(LANES, atol), jnp.full(LANES, 1000))


@functools.partial(jax.jit, static_argnums=0)
def attempt(solver, start, end, state, tolerated):
    """A step of all lanes, its first slope evaluated."""
    rule, slope = stepper.method(solver), field(signals(start), state)
    return stepper.attempt(field, signals, rule, start, end, state, slope, tolerated)


@functools.partial(jax.jit, static_argnums=0)
@functools.partial(jax.vmap, in_axes=(None, 0, 0, -1), out_axes=-1)
def by_diffrax(solver, start, end, y0):
    """`y1`, its slope, the state's size and the error estimate of each lane's step, stacked."""
    method = stepper.SOLVERS[solver]()
    before = method.init(TERM, start, end, y0, None)
    y1, error, *_ = method.step(TERM, start, end, y0, None, before, made_jump=False)
    return jnp.stack([y1, TERM.vf(end, y1, None), jnp.maximum(jnp.abs(y0), jnp.abs(y1)), error])


@pytest.mark.parametrize("solver", SOLVERS)
@given(
    seed=st.integers(0, 2**32 - 1),
    tolerated=st.sampled_from([(1e-7, 1e-9), (1.0, 0.0), (0.0, 1.0)]).map(
        lambda pair: tolerances(*pair)
    ),
)
def test_a_step_is_diffraxs(solver, seed, tolerated):
    """State, slope at its end, and the norm of its error over what is tolerated."""
    start, end, state = moments(seed)
    trial = attempt(solver, start, end, state, tolerated)
    y1, slope, size, error = np.asarray(by_diffrax(solver, start, end, state))
    np.testing.assert_allclose(trial.state, y1, rtol=0, atol=1e-13)
    np.testing.assert_allclose(trial.slope, slope, rtol=0, atol=1e-13)
    scale = np.asarray(tolerated.atol) + np.asarray(tolerated.rtol) * size
    for lane in range(LANES):
        known, rounding = (float(NORM(each[..., lane])) for each in (error / scale, 1e-13 / scale))
        assert trial.error[lane] == pytest.approx(known, rel=1e-11, abs=rounding)
    assert trial.finite.all()


@functools.partial(jax.jit, static_argnums=0)
@functools.partial(jax.vmap, in_axes=(None, 0, 0))
def by_controller(solver, step, error):
    """What diffrax's controller makes of steps whose errors are so many times what is tolerated."""
    controller = diffrax.PIDController(rtol=0.0, atol=1.0)
    order = stepper.SOLVERS[solver]().error_order(TERM)
    y, first = jnp.zeros(()), (jnp.asarray(1.0), jnp.asarray(1.0), False)
    kept, begin, end, *_ = controller.adapt_step_size(
        jnp.zeros(()), step, y, y, None, error, order, first
    )
    return kept, end - begin


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_next_step_is_the_controllers(solver):
    """Over all sizes of error, at the limits of the factor and where a step is just not kept."""
    rule = stepper.method(solver)
    edges = [0.0, 1.0, np.nextafter(1.0, 0.0), 0.9**rule.order, np.inf]
    errors = jnp.asarray([*10.0 ** np.linspace(-12, 12, 97), *edges])
    steps = jnp.asarray(np.random.default_rng(0).uniform(1e-6, 0.5, len(errors)))
    ours = stepper.next_step(steps, errors, rule.order)
    kept, theirs = by_controller(solver, steps, errors)
    np.testing.assert_allclose(ours, theirs, rtol=1e-12)
    np.testing.assert_array_equal(kept, errors < 1.0)


@pytest.mark.long
@pytest.mark.parametrize("solver", SOLVERS)
def test_what_happens_in_a_lane_stays_there(solver):
    """Neither a lane that is not finite nor one with other numbers changes a bit of the others."""
    start, end, state = moments(0)
    clean = attempt(solver, start, end, state, tolerances(1e-7, 1e-9))
    state = state.at[2, 1, 1].set(jnp.nan).at[:, :, 3].set(1e308)
    start, end = start.at[0].set(7.0), end.at[0].set(70.0)
    dirty = attempt(solver, start, end, state, tolerances(1e-7, 1e-9))
    assert dirty.finite.tolist() == [True, False, True, False, True]
    assert np.isinf(dirty.error[jnp.array([1, 3])]).all()
    assert dirty.error[0] != clean.error[0]
    for ours, theirs in zip(jax.tree.leaves(dirty), jax.tree.leaves(clean), strict=True):
        np.testing.assert_array_equal(ours[..., jnp.array([2, 4])], theirs[..., jnp.array([2, 4])])
