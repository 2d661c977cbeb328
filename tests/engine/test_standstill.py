"""Vehicles that turn round on a line stand still between ticks: all engines, and closed form."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from jaxnet.engine import standstill
from jaxnet.engine.status import Status
from jaxnet.theory.solution import companion
from tests import reference, systems
from tests.reference import navigator_at

LANES, TICK, HORIZON = 16, 0.1, 3.0
PATH = {"kind": "lissajous", "amplitude": [100.0, 0.0], "frequency": [0.2, 0.2]}
KEYS = {
    "navigator": PATH,
    "horizon": HORIZON,
    "tail": 1.0,
    "tick": TICK,
    "attack": "none",
    "defence": "none",
}


def on_a_line(engine, reach=75.0, **keys):
    """Lanes with vehicles on the navigator's line that head along it and begin at any speed."""
    one = systems.lanes(systems.study(engine=engine, **{**KEYS, **keys}), LANES, ())
    rng, lane = np.random.default_rng(0), one.inputs.lane
    initial = np.zeros_like(lane.initial)
    initial[:, 0] = rng.uniform(-reach, reach, initial[:, 0].shape)
    initial[:, 3] = rng.uniform(15.0, 35.0, initial[:, 3].shape)
    return one._replace(inputs=one.inputs._replace(lane=lane._replace(initial=initial)))


def least_speed(one, number):
    """The least velocity along the line after its first sign, by closed form on a grid of 1 ms."""
    lane, navigator = systems.lane(one, number), navigator_at(one, number)
    times = np.arange(0.0, HORIZON + 5e-4, 1e-3)
    path = navigator(times)[1, 0]
    error = reference.flat_jets(lane.initial.T) - navigator(0.0)[:3, None]
    flows = reference._flows(*map(float, lane.gain), *map(float, times))
    velocity = path[:, None] + np.einsum("tl,lm->tm", flows[:, 1], error[..., 0])
    return (velocity * np.sign(velocity[0])).min()


@pytest.fixture(scope="module")
def known():
    """Least speeds of all lanes, none of them near 0."""
    one = on_a_line("exact")
    speeds = np.array([least_speed(one, number) for number in range(LANES)])
    assert (speeds < -0.05).sum() >= 4
    assert (speeds > 0.05).sum() >= 4
    return speeds


@pytest.mark.parametrize(
    ("vehicle", "engine"),
    [("two_wheeled", "exact"), ("two_wheeled", "stacked"), ("car", "nonlinear")],
)
def test_who_turns_round_on_a_line_is_singular(engine, vehicle, known):
    """As the closed form says, lane by lane, whether or not a tick is near the turn."""
    outcome = systems.simulate(on_a_line(engine, vehicle=vehicle))
    assert (outcome.status == np.where(known < 0, Status.singular, Status.ok)).all()


@pytest.mark.long
def test_a_unicycle_that_turns_round_on_a_line_is_singular():
    """As `E(t) = expm(A_c t) E(0)` says, whose acceleration jumps at t = 0."""
    one, times = on_a_line("exact", 60.0, vehicle="unicycle"), np.arange(0.0, HORIZON, 1e-3)
    flows = np.stack([expm(companion(np.array([1.0, 2.0])) * t) for t in times])
    least = []
    for number in range(LANES):
        state, navigator = systems.lane(one, number).initial, navigator_at(one, number)
        error = np.stack([state[0], state[3]]) - navigator(0.0)[:2, :1]
        velocity = navigator(times)[1, 0, :, None] + np.einsum("tl,lm->tm", flows[:, 1], error)
        least.append(velocity.min())
    assert min(np.abs(least)) > 0.02
    assert {*np.sign(least)} == {-1.0, 1.0}
    known = np.where(np.array(least) < 0, Status.singular, Status.ok)
    assert systems.simulate(one).status.tolist() == known.tolist()


@pytest.mark.long
def test_engines_agree_whoever_lies_or_decides():
    """Derivatives that do not fit together, and trimming: vehicle 3 drops one liar of two."""
    spoof = {"kind": "spoof", "vehicles": [2, 4], "magnitude": 1.0, "direction": 0.0}
    keys = {"attack": spoof, "defence": "trusted_trim"}
    ours, theirs = (
        systems.simulate(on_a_line(engine, **keys)).status for engine in ("exact", "nonlinear")
    )
    assert ours.tolist() == theirs.tolist()
    assert {*ours.tolist()} == {Status.ok, Status.singular}


def test_a_held_jerk_is_seen_to_turn_a_vehicle_round_within_a_tick():
    """By the roots of its velocity, a parabola; Runge–Kutta sees only who has turned at a step."""
    exact, gauss, steps = (
        on_a_line(engine, 40.0, law="rounds")
        for engine in ("exact", "nonlinear", {"solver": "dopri5"})
    )
    plan = steps.plan._replace(save=systems.EVERYTHING, rows=round(HORIZON / TICK) + 1)
    theirs = systems.simulate(steps._replace(plan=plan))
    speed, force = (theirs.series["state"][..., number] for number in (3, 5))
    jerk = np.diff(force, axis=1) / TICK
    turn = np.clip(-force[:, :-1] / jerk, 0.0, TICK)
    within = speed[:, :-1] + turn * force[:, :-1] + turn**2 / 2 * jerk
    unseen = (theirs.status == Status.ok) & (within < 0).any(axis=(1, 2))
    known = np.where(unseen, Status.singular, theirs.status)
    assert unseen.any()
    assert systems.simulate(exact).status.tolist() == known.tolist()
    assert systems.simulate(gauss).status.tolist() == known.tolist()
    assert {*known.tolist()} == {Status.ok, Status.singular}


@pytest.mark.parametrize("least", [0.0, 4e-10, 1.1e-9, 1e-6, 1e-3])
def test_a_speed_is_enclosed(least):
    """A parabola whose least speed lies inside a step and is known; down to half of 1e-9 m/s."""
    turn, slope = 0.0376543, 21.0

    def pace(time):
        velocity = jnp.stack([slope * (time - turn), least + 0.0 * time])[:, None]
        return (
            velocity,
            jnp.stack([slope + 0.0 * time, 0.0 * time])[:, None],
            jnp.full((1, 1), 300.0),
        )

    start = jnp.zeros(1)
    found, _ = standstill.stands(pace, lambda time, step: time + step, start, 0.1, start + 1.0)
    assert found.tolist() == [least < 1e-9]


def test_a_search_ends_where_squares_overflow():
    """How long a vehicle at 1 m/s does not stand still, at an acceleration or jerk of 1e200."""
    velocity, none = jnp.array([1.0, 0.0])[:, None, None], jnp.zeros((2, 1, 1))
    braking = -1e200 * velocity
    ahead = standstill.safe(velocity, braking, jnp.zeros((1, 1)))
    np.testing.assert_allclose(ahead, 1e-200, rtol=1e-8)
    ahead = standstill.safe(velocity, none, jnp.full((1, 1), 1e200))
    np.testing.assert_allclose(ahead, np.sqrt(2) * 1e-100, rtol=1e-8)
