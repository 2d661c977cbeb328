"""The stacked engine against the other two, with which it shares neither law nor stepping."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from jaxnet.engine.methods.stacked import Controller, known_solver
from jaxnet.engine.status import Status
from jaxnet.kinds.vehicles import SPEED
from tests import systems

SHORT = {"horizon": 2.0, "tail": 1.0}
RING = {"vehicles": 4, "attack": {"kind": "rotating", "magnitude": 30.0, "vehicles": [2]}, **SHORT}
COUNT = 3


def outcome(keys, **changes):
    """A few lanes of a study with some keys changed."""
    return systems.outcome(COUNT, **{**keys, **changes})


def agree(ours, known, within):
    """Positions, weights, switches and metrics of lanes that are all right."""
    assert (ours.status == Status.ok).all()
    assert (known.status == Status.ok).all()
    apart = (ours.series["state"] - known.series["state"])[..., :2]
    assert np.abs(apart).max() <= within
    np.testing.assert_allclose(ours.series["kept"], known.series["kept"], atol=1e-9)
    np.testing.assert_array_equal(ours.switches, known.switches)
    for name, values in known.metrics.items():
        np.testing.assert_allclose(ours.metrics[name], values, rtol=1e-4, atol=within)


@pytest.mark.long
def test_stepped_implicitly():
    keys = {"vehicles": 2, "topology": "path", "defence": "none", "horizon": 0.4, "tail": 0.2}
    keys["attack"] = {"magnitude": 4.0, "vehicles": [1]}
    ours = outcome(keys, engine={"kind": "stacked", "solver": "Kvaerno3"})
    agree(ours, outcome(keys, engine="exact"), 1e-5)


@pytest.mark.parametrize("name", ["Heun", "ReversibleHeun", "ImplicitEuler"])
def test_a_solver_of_low_order_adapts_its_step(name):
    """Too slow for a fleet; here on `ẏ = -y`."""
    solver, decay = getattr(diffrax, known_solver(name))(), diffrax.ODETerm(lambda t, y, args: -y)
    steps = {"stepsize_controller": Controller(1e-4, 1e-6), "max_steps": 10_000}
    solution = diffrax.diffeqsolve(decay, solver, 0.0, 2.0, None, jnp.ones(1), **steps)
    np.testing.assert_allclose(solution.ys[0], np.exp(-2.0), rtol=3e-2)


@pytest.fixture(scope="module")
def ring():
    """Trimmed lanes."""
    return systems.lanes(systems.study(engine="stacked", **RING), COUNT)


@pytest.fixture(scope="module")
def trimmed(ring):
    """Their outcome."""
    return systems.simulate(ring)


def test_trimmed(trimmed):
    """Decisions at ticks, held between them."""
    agree(trimmed, outcome(RING, engine="exact"), 1e-5)
    assert trimmed.switches.any()


@pytest.mark.long  # short: held decisions above; the field, tests/runs/test_field.py
def test_deciding_in_the_vector_field():
    """`tick: 0` as `jaxnet.field` has it, at all times; to the tolerances.

    The nonlinear engine's: tests/engine/test_exactness.py and tests/engine/test_generality.py.
    """
    ours = outcome(RING, tick=0.0, engine="stacked")
    assert (ours.status == Status.ok).all()
    assert ours.switches.any()
    field, start = jaxnet.field(systems.study(**RING, tick=0.0), sample=1)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        diffrax.Dopri5(),
        0.0,
        2.0,
        None,
        start,
        stepsize_controller=diffrax.PIDController(1e-7, 1e-9),
        saveat=diffrax.SaveAt(ts=jnp.arange(21.0) * 0.1),
    )
    places = np.asarray(solution.ys)[:, :2].swapaxes(1, 2)
    assert np.abs(places - ours.series["state"][1, :, :, :2]).max() <= 1e-5


def test_failed_lanes_are_named_and_spoil_no_other(ring, trimmed):
    """Each fails in its own way, at once or later; a lane beside them keeps its last bit."""
    given = jax.tree.map(lambda leaf: np.repeat(leaf[:1], 6, axis=0), ring.inputs)
    lane, limit = given.lane, given.numbers.max_steps
    initial, gain, weights = lane.initial.copy(), lane.gain.copy(), lane.weights.copy()
    initial[1, SPEED, 2] = 0.0
    initial[2, 0, 1] = np.nan
    gain[3] = np.nan  # the start is finite, the vector field is not
    limit = np.where(np.arange(6) == 4, 10, limit)
    weights[5] = np.where(
        ring.network.hearing.sources > 0, weights[5], 0.0
    )  # nobody hears the navigator
    lane = lane._replace(initial=initial, gain=gain, weights=weights)
    inputs = given._replace(lane=lane, numbers=given.numbers._replace(max_steps=limit))
    after = systems.simulate(ring._replace(inputs=inputs))
    s = Status
    expected = [s.ok, s.singular, s.nonfinite, s.nonfinite, s.max_steps, s.disconnected]
    assert after.status.tolist() == expected
    for name, values in after.metrics.items():
        assert values[0] == trimmed.metrics[name][0]
        assert np.isnan(values[1:]).all()
    np.testing.assert_array_equal(after.series["state"][0], trimmed.series["state"][0])
    assert np.isnan(after.series["state"][1:, -1]).all()
    assert np.isfinite(after.series["state"][[3, 4], 0, :, :2]).all()
    assert after.steps[1] == after.steps[2] == 0
    assert 10 <= after.steps[4] < trimmed.steps[0]


def wall(time, state, args):
    """Not finite after one second."""
    return jnp.where(time < 1.0, -state, jnp.nan)


def shaking(time, state, args):
    """Finite, and in no step that moves the time the same."""
    return jnp.cos(1e20 * time) * jnp.full_like(state, 1e30)


@pytest.mark.parametrize(
    ("field", "result"), [(wall, "dt_min_reached"), (shaking, "max_steps_reached")]
)
def test_a_step_too_small_and_a_field_that_is_not_finite_are_told_apart(field, result):
    """The first is out of steps, the second stands before a wall; neither is stepped on."""
    controller = Controller(1e-9, 1e-9, dtmin=1e-15, force_dtmin=False)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        diffrax.Dopri5(),
        0.0,
        2.0,
        2.0,
        jnp.ones(2),
        stepsize_controller=controller,
        max_steps=100_000,
        throw=False,
    )
    assert solution.result == getattr(diffrax.RESULTS, result)
    assert solution.stats["num_steps"] < 1000
