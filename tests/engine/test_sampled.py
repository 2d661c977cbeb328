"""The sampled engine and limits: exact answers, and the order of convergence.

The arena's own figures: tests/test_published.py.
"""

import math

import numpy as np
import pytest

import jaxnet
from jaxnet.kinds.losses import Loss
from jaxnet.kinds.vehicles.robotarium import Robotarium
from jaxnet.view.text.check import check_text
from jaxnet.view.text.tables import failures_text
from tests import systems

STEP = 0.033


def states_of(results):
    return results.trajectories["states"].values[0, 0]


def test_clipped_wheels_change_the_curvature():
    """(v, ω) = (0.2, 1) becomes (0.1725, 0.5) at wheel rates of 12.5 rad/s."""
    robot = jaxnet.load({"vehicle": "robotarium"}).config.vehicle
    keys = {key: np.array([getattr(robot, key)]) for key in ("wheel_radius", "base")}
    robot = robot.filled({**keys, "limits": {"wheel_rate": np.array([12.5])}})
    clipped = robot.within_limits(np.array([0.2, 1.0]).reshape(2, 1, 1))
    assert clipped.ravel() == pytest.approx([0.1725, 0.5], abs=1e-12)


def gap_after(time, place, engine):
    """Distance of one agent, at most 0.2 m/s on an axis, to a navigator with 0.1 m/s."""
    keys = {
        "vehicles": 1,
        "topology": {"kind": "star"},
        "navigator": {"kind": "driven", "speed": [0.1, 0.1], "turn_rate": [0.0, 0.0]},
        "vehicle": {"kind": "single_integrator", "limits": {"input": 0.2}},
        **systems.QUIET,
        "gain": [1.0],
        "initial": {"position": [[place, 0.0]]},
        "engine": engine,
        "horizon": time,
        "tail": 0.0,
        "output_step": time / 10,
        "tick": time / 1000,
    }
    return jaxnet.simulate(keys, samples=1, progress=False).lanes.iloc[0]


@pytest.mark.parametrize(("place", "speed"), [(-3.0, 0.1), (3.0, 0.3)])
def test_agent_with_limits_reaches_a_navigator(place, speed):
    """At its limit it nears by `speed` until the law asks for that, then as e^-t.

    1 cm away after 29 s + ln 10 = 31.302585 s where it is behind, 12.401 s where it is ahead.
    """
    time = (3 - speed) / speed + math.log(speed / 0.01)
    row = gap_after(time, place, {"kind": "nonlinear", "rtol": 1e-12, "atol": 1e-12})
    assert row["tail_mean"] == pytest.approx(0.01, abs=1e-8)
    assert row["saturated"] > 0.5


def ends(engine, tick, **keys):
    fixed = {
        "horizon": 2.0,
        "tail": 0.0,
        "output_step": 0.4,
        "tick": tick,
        "engine": engine,
        "defence": "none",
        "attack": {"magnitude": 1.0},
        "initial": {
            "position": {"uniform": [-2.0, 2.0]},
            "speed": {"uniform": [26.0, 30.0]},
            "heading": {"uniform": [0.7, 0.9]},
        },
        "save": {"trajectories": "all"},
    }
    results = jaxnet.simulate({**fixed, **keys}, samples=2, progress=False)
    assert (results.lanes["status"] == "ok").all()
    return results.trajectories["states"].values[0, :, -1, :, :2]


@pytest.mark.parametrize(
    ("keys", "move"),
    [
        pytest.param({"vehicle": "unicycle"}, "euler", id="unicycle", marks=pytest.mark.long),
        pytest.param(
            {"vehicle": "double_integrator", "law": {"kind": "local", "hold": False}},
            "exact",
            id="local",
        ),
        *[
            pytest.param(keys, move, id=f"{name}-{move}", marks=pytest.mark.long)
            for name, keys in {
                "two_wheeled": {},
                "unicycle": {"vehicle": "unicycle"},
                "look_ahead": {"vehicle": {"kind": "look_ahead", "ahead": 3.0}},
                "delay": {"vehicle": "unicycle", "channel": {"delay": 0.2}},
                "linearised": {"law": "linearised"},
            }.items()
            for move in ("euler", "exact")
        ],
    ],
)
def test_order_of_convergence_is_one(keys, move):
    ticks = np.array([0.01, 0.005, 0.0025])
    engine = {"kind": "sampled", "move": move}
    known = "exact" if "hold" in keys.get("law", {}) else "nonlinear"
    apart = [
        np.abs(ends(engine, tick, **keys) - ends(known, tick, **keys)).max()
        for tick in ticks.tolist()
    ]
    order = np.polyfit(np.log(ticks), np.log(apart), 1)[0]
    assert order == pytest.approx(1.0, abs=0.1)


def test_held_single_integrators_move_exactly():
    """Agents that hold their q anyway move as those of the exact engine, by either move."""
    keys = {"vehicle": "single_integrator", "law": "local", "horizon": 2.0, "tail": 1.0}
    exact = jaxnet.simulate({**keys, "engine": "exact"}, samples=4, progress=False).lanes
    for move in ("euler", "exact"):
        engine = {"kind": "sampled", "move": move}
        lanes = jaxnet.simulate({**keys, "engine": engine}, samples=4, progress=False).lanes
        for column in ("tail_mean", "peak_error", "tail_disagreement"):
            assert lanes[column].to_numpy() == pytest.approx(exact[column].to_numpy(), rel=1e-12)


def test_nothing_is_proved_of_sampled_or_limited_fleets():
    limited = {"kind": "unicycle", "limits": {"turn_rate": 1.0}}
    asked = {"defence": "none", "vehicle": "unicycle", "engine": "nonlinear"}
    assert "nothing is proved" not in check_text(jaxnet.load(asked))
    sampled = check_text(jaxnet.load({**asked, "engine": "sampled"}))
    assert "nothing is proved; since the sampled engine holds inputs" in sampled
    told = check_text(jaxnet.load({**asked, "vehicle": limited}))
    assert "since unicycle may" in told


class Driven(Robotarium):
    """A robot whose inputs are constant, whatever the law asks for."""

    def inputs_for(self, state, jerk):
        xp = state.__array_namespace__()
        return xp.stack([xp.full_like(state[0], 0.1), xp.full_like(state[0], 0.5)])


def test_circle_of_constant_inputs():
    """3,000 steps from the origin at 0.1 m/s and 0.5 rad/s; the arena wraps the heading."""
    keys = {"vehicles": 1, "topology": "star", "vehicle": Driven(), "law": "local", "gain": [1.0]}
    keys |= {"attack": "none", "defence": "none", "engine": {"kind": "sampled", "move": "euler"}}
    keys |= {"initial": {"position": 0.0, "heading": 0.0}, "save": {"trajectories": "all"}}
    keys |= {"tick": STEP, "output_step": 100 * STEP, "horizon": 3000 * STEP, "tail": 0.0}
    x, y, heading = states_of(jaxnet.simulate(keys, samples=1, progress=False))[-1, 0]
    wrapped = math.atan2(math.sin(heading), math.cos(heading))
    assert (x, y, wrapped) == pytest.approx((-0.138113576, 0.056932364, -0.765482457), abs=6e-10)


def test_a_slow_start_that_a_held_input_spoils_is_told_with_what_helps():
    """A robot at 0.5 m/s turns at a rate proportional to 1/speed; with limits it comes to rest."""
    keys = {"vehicle": "two_wheeled", "initial": {"speed": 0.5}, "horizon": 5.0, "tail": 1.0}
    keys |= {"engine": {"kind": "sampled", "move": "euler"}, "vehicles": 6, "defence": "none"}
    failed = jaxnet.simulate(keys, 4, progress=False)
    assert (failed.lanes["status"] != "ok").all()
    told = " ".join(failures_text(failed).split())
    assert "try vehicle.standstill: stop, vehicle.limits, a shorter tick" in told
    assert "next: results.replay(0, 0)" in told
    assert "WARNING: lanes may fail; engine: sampled" in check_text(jaxnet.load(keys))
    stopping = keys | {"vehicle": {"kind": "two_wheeled", "standstill": "stop"}}
    told = " ".join(check_text(jaxnet.load(stopping)).split())
    assert "try vehicle.limits, a shorter tick" in told  # not what is set
    limits = {"force_rate": 50.0, "angular_acceleration": 5.0}
    vehicle = {"kind": "two_wheeled", "limits": limits}
    keys |= {"vehicle": vehicle | {"standstill": "stop"}}
    assert (jaxnet.simulate(keys, 4, progress=False).lanes["status"] == "ok").all()
    assert "lanes may fail" not in check_text(jaxnet.load(keys))


class LostAfter(Loss):
    """Every message after a time [s] is lost."""

    after: float

    def lost(self, messages, memory):
        return messages.present & (messages.time > self.after)[None, None], memory


@pytest.mark.parametrize("delay", [pytest.param(0, marks=pytest.mark.long), 1])
@pytest.mark.parametrize(
    "law", [pytest.param("exact", marks=pytest.mark.long), {"kind": "local", "hold": False}]
)
def test_the_message_that_arrived_last_is_held(law, delay):
    """A plain loop: a vehicle goes on with what the navigator said at t = 0, not between ticks."""
    tick, gain = 0.1, 1.5
    lost = (delay + 0.5) * tick
    keys = {
        "vehicles": 1,
        "topology": "star",
        "vehicle": "single_integrator",
        "gain": [gain],
        "law": law,
        "navigator": {"kind": "driven", "speed": [1.0, 1.0], "turn_rate": [0.0, 0.0]},
        **systems.QUIET,
        "initial": {"position": [[2.0, 0.0]]},
        "channel": {"loss": LostAfter(after=lost), "missing": "hold", "delay": delay * tick},
        "engine": "sampled",
        **systems.clock(tick, 5 * tick, tick),
        "save": {"trajectories": "all"},
    }
    place, places = 2.0, []
    for number in range(6):
        places.append(place)
        place += tick * (1.0 - gain * place) * (number >= delay)
    found = states_of(jaxnet.simulate(keys, progress=False))[:, 0, 0]
    assert found == pytest.approx(places, abs=1e-12)


@pytest.mark.parametrize(
    ("law", "engine"),
    [
        ("exact", "sampled"),
        pytest.param({"kind": "local", "hold": False}, "sampled", marks=pytest.mark.long),
        pytest.param("rounds", "sampled", marks=pytest.mark.long),
        ("rounds", "nonlinear"),  # q is held in both
    ],
)
def test_delayed_motions_are_continued_over_ticks_of_any_length(law, engine):
    """A plain loop: vehicle 1 hears a navigator at 1 m/s, 2 hears 1, one tick (0.5 s) late.

    The tick is the law's fastest time constant, by which a power series would err. Vehicles tell
    the q that the law asks for, not what their limits leave of it; by exchanges, the q until now.
    """
    tick, (k0, k1), number, most = 0.5, (4.0, 4.0), 6, 0.5
    keys = {
        "vehicles": 2,
        "topology": "path",
        "vehicle": {"kind": "double_integrator", "limits": {"input": most}},
        "gain": [k0, k1],
        "law": law,
        "navigator": {"kind": "driven", "speed": [1.0, 1.0], "turn_rate": [0.0, 0.0]},
        **systems.QUIET,
        "initial": {"position": [[-0.8, 0.0], [0.6, 0.0]], "heading": 0.0, "speed": 0.7},
        "channel": {"delay": tick, "extrapolate": "jets"},
        "engine": engine,
        **systems.clock(tick, number * tick, tick),
        "save": {"trajectories": "all"},
    }
    jets, rates = np.array([[-0.8, 0.7], [0.6, 0.7]]), np.zeros(2)  # place and speed of each
    path, heard, clipped = [], None, False
    for n in range(number + 1):
        path.append(jets)
        until_now, rates = rates, np.zeros(2)
        if heard is not None:
            late = np.array([[(n - 1) * tick, 1.0], heard[0][0]]) @ [[1.0, 0.0], [tick, 1.0]]
            rates = np.append(0.0, heard[1][0]) + (late - jets) @ [k0, k1]
        heard = jets, {"exact": rates, "rounds": until_now}.get(str(law), np.zeros(2))
        moves = np.clip(rates, -most, most)
        clipped = clipped or moves[0] != rates[0]
        places = jets[:, 0] + tick * jets[:, 1] + tick**2 / 2 * moves
        jets = np.stack([places, jets[:, 1] + tick * moves], axis=1)
    assert clipped
    found = states_of(jaxnet.simulate(keys, progress=False))
    assert found[:, :, 0] == pytest.approx(np.array(path)[:, :, 0], abs=1e-12)
    assert found[:, :, 2] == pytest.approx(np.array(path)[:, :, 1], abs=1e-12)


def test_a_vehicle_that_passes_its_singular_set_within_a_period_fails():
    """It starts 5 m ahead of its navigator, at the same 1 m/s, and would go on backwards."""
    keys = {
        "vehicles": 1,
        "topology": "star",
        "vehicle": "unicycle",
        "navigator": {"kind": "driven", "speed": [1.0, 1.0], "turn_rate": [0.0, 0.0]},
        **systems.QUIET,
        "initial": {"position": [[5.0, 0.0]], "heading": 0.0, "speed": 1.0},
        "engine": "sampled",
        "horizon": 2.0,
        "tail": 1.0,
    }
    assert jaxnet.simulate(keys, progress=False).lanes["status"].to_list() == ["singular"]
