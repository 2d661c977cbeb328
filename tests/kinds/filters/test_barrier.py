"""The barrier filter: the given pair, closed forms, an independent program, symmetry."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import nnls

import jaxnet
from jaxnet.kinds.filters.barrier import Barrier
from jaxnet.kinds.kind import as_pytree
from tests import systems

STEP = 0.033
PAIR = np.array([[-0.1, 0.1], [0.0, 0.03]])
ASKED = np.array([[0.15, -0.15], [0.0, 0.02]])
STEEP = {"kind": "barrier", "gain": 1e5}  # robots reach the distance within a few seconds


def barrier(lanes=1, **keys):
    """A filter whose numbers are drawn for lanes, as the engine has it."""
    given = Barrier(**keys)
    each = {key: getattr(given, key) for key in ("distance", "gain", "speed")}
    arrays = {k: None if v is None else jnp.full(lanes, v) for k, v in each.items()}
    return as_pytree(given.filled({**given.config_keys(), **arrays}))


compiled = jax.jit(lambda safety, velocity, place: safety.nearest(velocity, place, place))


def nearest(velocity, place, **keys):
    """The filter's velocities (2, m) of one lane in which nobody lies."""
    given = (jnp.asarray(each)[..., None] for each in (velocity, place))
    return np.asarray(compiled(barrier(**keys), *given))[..., 0]


@pytest.mark.parametrize("speed", [0.2, None])
@pytest.mark.parametrize(
    ("form", "expected"),
    [
        ("joint", [[0.005529279, -0.005529279], [-0.021670608, 0.041670608]]),
        ("halves", [[0.004062287, -0.006996272], [-0.021890657, 0.041450559]]),
    ],
)
def test_the_given_pair(form, speed, expected):
    assert nearest(ASKED, PAIR, form=form, speed=speed) == pytest.approx(
        np.array(expected), abs=6e-10
    )


@pytest.mark.parametrize("form", ["joint", "halves"])
def test_head_on_gaps(form):
    """From 1 m at 0.1 m/s each; the recursion `d ← d - h min(0.2, γ(d² - D²)³ / 2d)`."""
    asked, place = np.array([[0.1, -0.1], [0.0, 0.0]]), np.array([[-0.5, 0.5], [0.0, 0.0]])
    gaps = []
    for _ in range(301):
        gaps.append(place[0, 1] - place[0, 0])
        place = place + STEP * nearest(asked, place, form=form)
    expected = {100: 0.344704682, 150: 0.264495841, 200: 0.241633790, 300: 0.221041245}
    assert {step: gaps[step] for step in expected} == pytest.approx(expected, abs=6e-10)


def constraints(places, form, gain, speed, faces=8):
    """Rows c and limits b of `c · u ≤ b` for D = 0.15 and power 3, u all x, then all y."""
    m, rows, limits = places.shape[1], [], []
    for i in range(m):
        for j in range(m) if form == "halves" else range(i):
            if i == j:
                continue
            gap, row = places[:, i] - places[:, j], np.zeros((2, m))
            row[:, i] = -2 * gap
            if form == "joint":
                row[:, j] = 2 * gap
            rows.append(row.ravel())
            limits.append(gain * (gap @ gap - 0.0225) ** 3 / (2 if form == "halves" else 1))
        for k in range(faces if speed else 0):
            row, angle = np.zeros((2, m)), k * 2 * math.pi / faces
            row[:, i] = math.cos(angle), math.sin(angle)
            rows.append(row.ravel())
            limits.append(speed * math.cos(math.pi / 8))
    return np.array(rows), np.array(limits)


def least_distance(wanted, rows, limits):
    """The nearest point by Lawson and Hanson's program for least distances; None without any."""
    lengths = np.linalg.norm(rows, axis=1)
    rows, limits = rows / lengths[:, None], limits / lengths
    matrix = np.vstack([-rows.T, (rows @ wanted - limits)[None]])
    right = np.append(np.zeros(len(wanted)), 1.0)
    multipliers, _ = nnls(matrix, right, maxiter=10_000)
    rest = matrix @ multipliers - right
    return None if np.linalg.norm(rest) < 1e-9 else wanted - rest[:-1] / rest[-1]


def crowd(robots, size, seed):
    random = np.random.default_rng(seed)
    places = random.uniform(-size, size, (2, robots))
    return places, random.uniform(-0.15, 0.15, (2, robots))


@pytest.mark.parametrize("form", ["joint", "halves"])
@pytest.mark.parametrize("robots", [3, 5, 8, 12])
def test_crowds_by_an_independent_program(form, robots):
    """Of all sizes, also overrun; halves without a limit of speed, as their limit is a disc."""
    speed, solvable = (0.2 if form == "joint" else None), []
    for seed in range(12):
        size, gain = (0.05, 0.1, 0.2, 0.4)[seed % 4], (1e4, 100.0, 100.0, 100.0)[seed % 4]
        places, wanted = crowd(robots, size * math.sqrt(robots / 3), seed)
        found = nearest(wanted, places, form=form, speed=speed, gain=gain)
        rows, limits = constraints(places, form, gain, speed)
        alone = [[i, robots + i] for i in range(robots)]
        for part in alone if form == "halves" else [np.arange(2 * robots)]:
            mine = rows[:, part].any(axis=1)
            expected = least_distance(wanted.ravel()[part], rows[mine][:, part], limits[mine])
            solvable.append(expected is not None)
            answer = np.full(len(part), np.nan) if expected is None else expected
            assert found.ravel()[part] == pytest.approx(answer, abs=1e-9, nan_ok=True)
    assert any(solvable)
    assert robots == 3 or not all(solvable)


def test_speeds_of_halves_are_within_the_disc():
    """Enough faces make a polygon of the disc."""
    for seed in range(12):
        places, wanted = crowd(3, 0.3, seed)
        found = nearest(10 * wanted, places, form="halves")
        rows, limits = constraints(places, "halves", 100.0, 0.2 / math.cos(math.pi / 8), faces=720)
        expected = least_distance(10 * wanted.ravel(), rows, limits)
        assert (np.hypot(*found) < 0.2 + 1e-12).all()
        assert found.ravel() == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("form", ["joint", "halves"])
def test_a_new_order_and_a_turn_change_nothing(form):
    places, wanted = crowd(7, 0.6, 3)
    found = nearest(wanted, places, form=form)
    order, turn = np.random.default_rng(0).permutation(7), np.array([[0.0, -1.0], [1.0, 0.0]])
    again = nearest(wanted[:, order], places[:, order], form=form)
    assert again == pytest.approx(found[:, order], abs=1e-12)
    assert nearest(turn @ wanted, turn @ places, form=form) == pytest.approx(
        turn @ found, abs=1e-12
    )


def swapping(**keys):
    """Two agents at (-0.5, 0) and (0.5, 0) that want to change places, fast."""
    fixed = {
        "vehicles": 2,
        "topology": {"kind": "circulant", "offsets": [1]},
        **systems.AGENTS,
        "gain": [10.0],
        **systems.QUIET,
        "formation": {"kind": "offsets", "offsets": [[5.0, 0.0], [-5.0, 0.0]]},
        "initial": {"position": [[-5.5, 0.0], [5.5, 0.0]]},
        "engine": {"kind": "sampled", "move": "euler"},
        **systems.clock(STEP, 300 * STEP),
        "metrics": ["min_separation"],
    }
    results = jaxnet.simulate({**fixed, **keys}, progress=False)
    assert (results.lanes["status"] == "ok").all()
    return results


@pytest.mark.parametrize("form", ["joint", pytest.param("halves", marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        pytest.param(
            {"gain": 1.0, "power": 1},
            math.sqrt(0.0225 + 0.9775 * math.exp(-5)),
            marks=pytest.mark.long,
        ),
        ({}, math.sqrt(0.0225 + 0.9775 / math.sqrt(1 + 200 * 0.9775**2 * 5))),
    ],
)
def test_closed_forms_in_continuous_time(form, keys, expected):
    """0.170547 and 0.232607 m after 5 s."""
    engine = {"kind": "nonlinear", "solver": "dopri5", "rtol": 1e-12, "atol": 1e-12}
    given = {"kind": "barrier", "form": form, "speed": None, **keys}
    times = {"horizon": 5.0, "tick": 0.1, "output_step": 0.5}
    row = swapping(filter=given, engine=engine, **times).lanes.iloc[0]
    assert row["min_separation"] == pytest.approx(expected, abs=1e-9)
    assert row["infeasible"] == 0


def test_head_on_in_the_engine():
    """Limits after the filter: 0.1 m/s of each, so that the gaps are those of the arena."""
    vehicle = {"kind": "single_integrator", "limits": {"input": 0.1}}
    results = swapping(filter={"kind": "barrier", "speed": None}, vehicle=vehicle)
    assert results.lanes["min_separation"][0] == pytest.approx(0.221041245, abs=6e-10)


def test_robots_of_the_arena_keep_the_distance_of_the_points_ahead():
    """In a formation whose robots are 0.1 m apart."""
    angle = 2 * np.pi * np.arange(5) / 5
    keys = {
        "vehicles": 5,
        "vehicle": {"kind": "look_ahead", "ahead": 0.05},
        "formation": {"kind": "line", "spacing": 0.1},
        "gain": [3.0],
        "initial": {"position": (0.8 * np.stack([np.cos(angle), np.sin(angle)], axis=1)).tolist()},
    }
    assert 0.15 <= swapping(**keys, filter=STEEP).lanes["min_separation"].min() < 0.16


@pytest.mark.parametrize("form", [pytest.param("joint", marks=pytest.mark.long), "halves"])
def test_a_filter_that_has_nothing_to_do_changes_no_bit(form):
    loose = {"kind": "barrier", "form": form, "distance": 1e-3, "gain": 1e9, "speed": None}
    keys = {"formation": {"kind": "line", "spacing": 2.0}, "gain": [1.0], "vehicles": 4}
    keys |= {"initial": {"position": {"uniform": [-0.1, 0.1]}}, "samples": 3}
    plain, filtered = swapping(**keys), swapping(**keys, filter=loose)
    for column in ("tail_mean", "peak_error", "min_separation", "spread", "min_speed"):
        assert (plain.lanes[column] == filtered.lanes[column]).all(), column


@pytest.mark.parametrize(
    ("form", "share"), [pytest.param("joint", 1.0, marks=pytest.mark.long), ("halves", 2 / 3)]
)
def test_without_a_velocity_vehicles_stand_still(form, share):
    """Two far too near for their speed; the third, far off, moves if each solves for itself."""
    keys = {
        "vehicles": 3,
        "formation": {"kind": "offsets", "offsets": [[0.0, 0.0], [0.01, 0.0], [9.0, 0.0]]},
        "initial": {"position": [[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]]},
        "filter": {"kind": "barrier", "form": form, "gain": 1e9},
    }
    results = swapping(**keys, save={"trajectories": "all"})
    moved = np.ptp(results.trajectories["states"].values[0, 0], axis=0)
    assert results.lanes["infeasible"][0] == pytest.approx(share)
    assert (moved[:2] == 0).all()
    assert (moved[2, 0] > 0.1) == (form == "halves")


@pytest.mark.parametrize("form", ["joint", "halves"])
@pytest.mark.parametrize("apart", [0.0, 1e-200])
def test_no_velocity_parts_robots_that_coincide(form, apart):
    """`0 ≤ -γ D⁶` has no solution; by halves the robot that is far off moves as it asks."""
    places = np.array([[0.3, 0.3 + apart, 9.0], [apart, 0.0, 0.0]])
    found = nearest(np.full((2, 3), 0.1), places, form=form)
    assert np.isnan(found[:, :2]).all()
    assert np.isnan(found[:, 2]).all() if form == "joint" else (found[:, 2] == 0.1).all()


def test_a_filter_knows_what_others_transmit():
    """Under constant lies `joint` keeps the distances that are told, to 1 mm in 300 steps."""
    keys = {"vehicles": 3, "topology": {"kind": "circulant", "offsets": [1, -1]}, "gain": [1.0]}
    keys |= {
        "formation": {"kind": "line", "spacing": 0.05},
        "initial": {"position": [[-0.5, 0.0], [0.5, 0.1], [0.0, 0.6]]},
        "attack": {"kind": "bias", "vehicles": [2], "magnitude": 0.05, "direction": 0.4},
        "save": {"trajectories": "all"},
    }
    places = swapping(**keys, filter=STEEP).trajectories["states"].values[0, 0]
    told = places + np.array([[0, 0], [0.05 * math.cos(0.4), 0.05 * math.sin(0.4)], [0, 0]])
    least = [pairs_of(each).min() for each in (places, told)]
    assert 0.1 < least[0] < 0.15 < least[1] < 0.25


def pairs_of(places):
    apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1)
    return apart[:, ~np.eye(apart.shape[1], dtype=bool)]
