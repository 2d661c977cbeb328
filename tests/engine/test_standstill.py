"""Vehicles that turn round on a line stand still between ticks: all engines, and closed form."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import jaxnet
from jaxnet.engine import standstill
from jaxnet.engine.status import Status
from jaxnet.theory.solution import companion
from tests import systems
from tests.reference import navigator_at

LANES, TICK, HORIZON = 16, 0.1, 3.0
PATH = {"kind": "lissajous", "amplitude": [100.0, 0.0], "frequency": [0.2, 0.2]}
KEYS = {"navigator": PATH, "horizon": HORIZON, "tail": 1.0, "tick": TICK, **systems.QUIET}


def on_a_line(engine, reach=75.0, **keys):
    """Lanes with vehicles on the navigator's line that head along it and begin at any speed."""
    one = systems.lanes(systems.study(engine=engine, **{**KEYS, **keys}), LANES, ())
    rng, lane = np.random.default_rng(0), one.inputs.lane
    initial = np.zeros_like(lane.initial)
    initial[:, 0] = rng.uniform(-reach, reach, initial[:, 0].shape)
    initial[:, 3] = rng.uniform(15.0, 35.0, initial[:, 3].shape)
    return one._replace(inputs=one.inputs._replace(lane=lane._replace(initial=initial)))


def least_speed(one, number):
    """The least velocity along the line after its first sign, by `expm(A_c t) E(0)` at each ms."""
    lane, navigator = systems.lane(one, number), navigator_at(one, number)
    times, error = np.arange(0.0, HORIZON + 5e-4, 1e-3), np.zeros((len(lane.gain), 12))
    error[:2] = lane.initial[[0, 3]]
    error -= navigator(0.0)[: len(error), :1]
    flows = expm(companion(lane.gain) * times[:, None, None])
    velocity = navigator(times)[1, 0, :, None] + np.einsum("tl,lm->tm", flows[:, 1], error)
    return (velocity * np.sign(velocity[0])).min()


@pytest.mark.parametrize(
    ("vehicle", "engine", "reach"),
    [
        ("two_wheeled", "exact", 75.0),
        pytest.param("two_wheeled", "stacked", 75.0, marks=pytest.mark.long),
        pytest.param("car", "nonlinear", 75.0, marks=pytest.mark.long),
        pytest.param("unicycle", "exact", 60.0, marks=pytest.mark.long),  # whose acceleration jumps
    ],
)
def test_who_turns_round_on_a_line_is_singular(engine, vehicle, reach):
    """As the closed form says, lane by lane, whether or not a tick is near the turn."""
    one = on_a_line(engine, reach, vehicle=vehicle)
    known = np.array([least_speed(one, number) for number in range(LANES)])
    assert np.abs(known).min() > 0.02
    assert {*np.sign(known)} == {-1.0, 1.0}
    status = systems.simulate(one).status
    assert (status == np.where(known < 0, Status.singular, Status.ok)).all()


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


# Behind a navigator at 1 m/s, with poles at -1, a vehicle that starts D ahead at 1 m/s has
# E = D (1 + t + …) e^-t, so its speed is 1 - D t^(r-1) / (r-1)! e^-t.
AHEAD = 5.0
STOPPING = {
    "vehicles": 3,
    "topology": {"kind": "edges", "edges": [[1, 0, 1.0], [2, 0, 1.0], [3, 1, 1.0], [3, 0, 1.0]]},
    "navigator": {"kind": "driven", "speed": [1.0, 1.0], "turn_rate": [0.0, 0.0]},
    **systems.QUIET,
    **systems.clock(TICK, 8.0, 1.0),
    "save": {"trajectories": "all"},
}
ORDERS = {"unicycle": 2, "two_wheeled": 3, "car": 3}
DOPRI5 = {"kind": "nonlinear", "solver": "dopri5", "rtol": 1e-10, "atol": 1e-12}


def stopping(engine, vehicle, ahead=AHEAD, **keys):
    """The row, and the states (times, 3, n), of a fleet whose vehicle 1 starts ahead."""
    places = [[ahead, 0.0], [-5.0, 0.3], [-7.0, 0.2]]
    start = {"position": places, "heading": [0.0] * 3, "speed": [1.0] * 3}
    kind = {"kind": vehicle, "standstill": "stop", **keys}
    given = {**STOPPING, "engine": engine, "vehicle": kind, "initial": start}
    results = jaxnet.simulate(given, samples=1, progress=False)
    return results.lanes.iloc[0], results.trajectories["states"].values[0, 0]


def rest_of(order):
    """Time and place at which vehicle 1 comes to rest, by closed form."""
    terms = [1 / math.factorial(k) for k in range(order)]

    def speed(time):
        return 1 - AHEAD * terms[-1] * time ** (order - 1) * math.exp(-time)

    time = brentq(speed, 0.0, order - 1.0, xtol=1e-15)
    return time, time + AHEAD * np.polyval(terms[::-1], time) * math.exp(-time)


def third_after(order, stands, place):
    """The place of vehicle 3 at 8 s, which starts 7 m behind at 1 m/s.

    It follows E = 0 until the tick from which it hears that vehicle 1 stands, then
    `y = (y_0 + p) / 2`, with the flow of one gain.
    """
    matrix, since = companion(np.array([math.comb(order, k) for k in range(order)], float)), 8.0
    error, told = np.zeros(order), stands * TICK
    error[0] = -7.0
    path = np.array([told, 1.0, 0.0][:order])
    jets = path + expm(matrix * told) @ error
    error = jets - (path + np.array([place, 0.0, 0.0][:order])) / 2
    return (since + place) / 2 + (expm(matrix * (since - told)) @ error)[0]


@pytest.mark.parametrize(
    ("engine", "vehicle", "allowed"),
    [
        ("exact", "unicycle", 1e-13),
        *[
            pytest.param(engine, vehicle, allowed, marks=pytest.mark.long)
            for engine, vehicle, allowed in [
                ("exact", "two_wheeled", 1e-13),
                ("nonlinear", "unicycle", 1e-7),
                ("nonlinear", "car", 1e-7),
                (DOPRI5, "unicycle", 1e-11),
                (DOPRI5, "two_wheeled", 1e-10),
            ]
        ],
    ],
)
def test_a_vehicle_that_comes_to_rest_stops_and_the_others_go_on(engine, vehicle, allowed):
    """When and where it stops, and how long it stands; the numbers of a vehicle that does not hear
    it are those of a fleet in which nobody stops; who hears it follows it from the next tick on.
    """
    row, states = stopping(engine, vehicle)
    time, place = rest_of(ORDERS[vehicle])
    stands = math.ceil(time / TICK)
    assert row["status"] == "ok"
    assert row["stopped"] == 1
    assert row["standing"] == pytest.approx((81 - stands) / (3 * 81))
    np.testing.assert_allclose(states[stands:, 0, :2] - [place, 0.0], 0.0, atol=allowed)
    assert (states[stands:, 0] == states[-1, 0]).all()
    assert not states[-1, 0, 3:].any()
    assert (states[stands - 1, 0, 3] > 0) & (states[stands:, 1:, 3] > 0).all()
    free, others = stopping(engine, vehicle, 0.5)
    assert free["stopped"] == free["standing"] == 0
    np.testing.assert_allclose(states[:, 1], others[:, 1], rtol=0, atol=allowed)
    np.testing.assert_allclose(
        states[-1, 2, 0], third_after(ORDERS[vehicle], stands, place), rtol=0, atol=allowed
    )


def plain_rest(order, euler, step=TICK):
    """Place of rest of vehicle 1 with held inputs: a plain loop over ticks."""
    gain = [math.comb(order, k) for k in range(order)]
    jets, time = np.array([AHEAD, 1.0, 0.0][:order]), 0.0
    while True:
        error = jets - np.array([time, 1.0, 0.0][:order])
        jerk, grid = -(np.array(gain) @ error), np.linspace(0.0, step, 200_001)
        rates = np.append(jets[1:], jerk)
        if euler:
            moved = jets[:, None] + grid * rates[:, None]
        else:
            all_jets = np.append(jets, jerk)
            moved = np.array(
                [
                    sum(all_jets[k + n] * grid**n / math.factorial(n) for n in range(order + 1 - k))
                    for k in range(order)
                ]
            )
        if (moved[1] <= 0).any():
            return moved[0, np.argmax(moved[1] <= 0)]
        jets, time = moved[:, -1], time + step


@pytest.mark.parametrize(
    ("vehicle", "move"),
    [("unicycle", "euler"), pytest.param("two_wheeled", "exact", marks=pytest.mark.long)],
)
def test_a_held_input_brings_a_vehicle_to_rest_within_a_period(vehicle, move):
    row, states = stopping({"kind": "sampled", "move": move}, vehicle)
    place = plain_rest(ORDERS[vehicle], move == "euler")
    assert (row["status"], row["stopped"]) == ("ok", 1)
    np.testing.assert_allclose(states[-1, 0, 0], place, rtol=0, atol=2e-6)
    assert not states[-1, 0, 1:].any()


@pytest.mark.long
def test_limits_bring_vehicles_to_rest_on_any_course():
    """The sampled engine finds the same stops, and nears the nonlinear one with order 1."""
    keys = {
        "vehicles": 6,
        "topology": "star",
        **systems.QUIET,
        "horizon": 2.0,
        "tail": 1.0,
        "output_step": 0.1,
        "seed": 3,
        "initial": {"position": {"uniform": [-40.0, 40.0]}, "speed": {"uniform": [2.0, 10.0]}},
        "vehicle": {
            "kind": "unicycle",
            "limits": {"turn_rate": 1.0, "acceleration": 20.0},
            "standstill": "stop",
        },
        "save": {"trajectories": "all"},
    }
    runs = [("sampled", 0.004), ("sampled", 0.001), (DOPRI5, 0.1)]
    given = (keys | {"engine": engine, "tick": tick} for engine, tick in runs)
    *sampled, exact = (jaxnet.simulate(each, samples=4, progress=False) for each in given)
    places = exact.trajectories["states"].values[0, ..., :2]
    apart = []
    for each in sampled:
        assert each.lanes["stopped"].tolist() == exact.lanes["stopped"].tolist() == [3, 4, 3, 3]
        apart.append(np.abs(each.trajectories["states"].values[0, ..., :2] - places).max())
    assert math.log(apart[0] / apart[1], 4) == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
@pytest.mark.parametrize(
    "keys",
    [
        {"channel": {"loss": {"kind": "bernoulli", "probability": 0.4}}},
        {"law": "rounds"},
        {"law": "local"},
        {
            "defence": {"kind": "w_msr", "F": 1, "isolated": "coast"},
            "attack": {"kind": "bias", "magnitude": 3.0, "vehicles": [1], "direction": 0.0},
        },
    ],
)
def test_engines_agree_who_stops_under_losses_laws_and_defences(keys):
    links = [[1, 0], [2, 0], [2, 1], [3, 1], [3, 2], [4, 3], [4, 0]]
    given = STOPPING | {
        "vehicles": 4,
        "topology": {"kind": "edges", "edges": [[*link, 1.0] for link in links]},
        "vehicle": {"kind": "unicycle", "standstill": "stop"},
        "initial": {
            "position": [[5.0, 0.0], [-5.0, 0.0], [6.0, 0.0], [2.0, 0.1]],
            "heading": 0.0,
            "speed": 1.0,
        },
    }
    exact, gauss = (
        jaxnet.simulate(given | keys | {"engine": engine}, samples=2, progress=False)
        for engine in ("exact", "nonlinear")
    )
    assert (exact.lanes["stopped"] > 0).all()
    for column in ("status", "stopped", "standing"):
        assert exact.lanes[column].tolist() == gauss.lanes[column].tolist()
    places = [each.trajectories["states"].values[0, ..., :2] for each in (exact, gauss)]
    np.testing.assert_allclose(places[1], places[0], rtol=0, atol=1e-8)
