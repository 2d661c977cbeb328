"""Engines, laws, vehicles and channels against the plain fleet (tests/reference.py), cell by cell.

What is drawn at random puts all features into one lane at once.
"""

from typing import Any

import numpy as np
import pytest

from jaxnet.engine.status import Status
from tests import systems
from tests.reference import TICKS, Hashed, Humming, Swinging, compared, reached

H = 0.1
LAWS: list[dict[str, Any]] = [{"kind": "exact"}, {"kind": "exact"}, {"kind": "rounds", "rounds": 1}]
LAWS += [{"kind": "local", "hold": hold} for hold in (True, False)]
VEHICLES = {1: "single_integrator", 2: "double_integrator", 3: "two_wheeled", 4: "planar_quadrotor"}


def drawn(seed, engine, h=H):
    """Keys of a study with four vehicles of orders 1 to 4, whose ticks last h seconds."""
    draw = np.random.default_rng(seed)

    def pick(*choices):
        return choices[draw.integers(len(choices))]

    def some(low, high, *shape):
        return draw.uniform(low, high, shape).round(3).tolist()

    r, law = int(draw.integers(1, 5)), pick(*LAWS)
    topology = network(draw, 4)
    if draw.uniform() < 0.25:
        every = round(h * int(draw.integers(2, 7)), 9)
        topology = {"kind": "switching", "networks": [topology, network(draw, 4)], "every": every}
    defence = {"kind": pick("none", "w_msr", "trusted_trim", "ms_norm")}
    if defence["kind"] != "none":
        theta = "theta" if defence["kind"] == "trusted_trim" else "F"
        defence |= {theta: pick(1, 1, 2), "isolated": pick("fail", "coast", "coast")}
    sensing = (
        Swinging(size=some(0.05, 0.4), pace=some(1, 9)) if draw.uniform() < 0.6 else "gaussian"
    )
    figure = {
        "amplitude": some(10, 30, 2),
        "frequency": some(0.4, 1, 2),
        "phase": some(0.5, 1.0, 2),
    }
    start = {"position": some(-20, 20, 4, 2), "heading": some(0, 6), "speed": some(5, 9)}
    return {
        **systems.clock(h, round(h * TICKS, 9), round(h * TICKS / 2, 9)),
        "vehicles": 4,
        "vehicle": VEHICLES[r],
        "gain": np.poly(-draw.uniform(0.6, 2.0, r))[:0:-1].round(3).tolist(),
        "law": law,
        "topology": topology,
        "navigator": figure,
        "initial": start,
        "attack": attack(r, pick, some),
        "defence": defence,
        "channel": channel(r, law["kind"], h, pick, some),
        "sensing": sensing,
        "engine": engine,
    }


def network(draw, m):
    """A weighted digraph in which the navigator reaches everybody."""
    hears = np.zeros((m, m + 1), bool)
    while len(reached(hears, set())) < m:
        hears = draw.uniform(size=(m, m + 1)) < 0.6
        hears[np.arange(m), np.arange(m) + 1] = False
    edges = [[int(i) + 1, int(j), round(draw.uniform(0.5, 2.0), 3)] for i, j in np.argwhere(hears)]
    return {"kind": "edges", "edges": edges}


def attack(r, pick, some):
    """Keys of an attack on one or two vehicles."""
    kind, vehicles = (
        pick("none", "rotating", "sinusoid", "bias", "spoof", "own_path"),
        pick([1], [4], [2, 3]),
    )
    if kind == "none":
        return {"kind": kind}
    links = pick("neighbour", "neighbour", "navigator")
    keys: dict[str, Any] = {"kind": kind, "vehicles": vehicles, "links": links}
    if kind == "own_path":
        keys |= {"threat": "replaces", "centre": some(-9, 9, 2), "swing": some(-9, 9, 2)}
        return keys | {"frequency": some(0.3, 2), "phase": some(0, 6)}
    keys |= {"threat": pick("adds", "adds", "replaces"), "magnitude": some(1, 8)}
    if r == 3 and keys["threat"] == "adds":
        keys["orders"] = pick(
            [0, 1, 2, 3], [0], [0, 1], [0, 2], [0, 3] if kind == "bias" else [1, 3]
        )
    if kind in ("rotating", "sinusoid"):
        keys |= {"frequency": some(0.3, 2, len(vehicles)), "phase": some(0, 6, len(vehicles))}
    return keys if kind == "rotating" else keys | {"direction": some(0, 6, len(vehicles))}


def channel(r, law, h, pick, some):
    """Keys of a channel."""
    late, missing = pick("link", "message", 0, 0, 0, 1, 2, 3), pick("drop", "hold", "extrapolate")
    keys = {
        "loss": "none",
        "noise": "gaussian",
        "quantisation": 0.0,
        "missing": missing,
        "extrapolate": "none",
    }
    if isinstance(late, int):
        keys |= {"delay": round(late * h, 9), "delay_of": "link"}
    else:
        keys |= {"delay": {"uniform": [h, 3 * h]}, "delay_of": late}
    if late:
        keys["missing"] = "hold" if missing == "extrapolate" else missing
        keys["extrapolate"] = pick("none", "jets", "jets" if law == "local" else "jerk")
    if some(0, 1) < 0.8:
        factors = [pick(*range(1, 29)) for _ in range(4)]
        of = pick("link", "link", "transmitter", "all")
        keys["loss"] = Hashed(of=of, factors=factors, share=pick(5, 9, 13))
    if some(0, 1) < 0.6:
        orders = "lower" if law == "local" else pick("all", "lower")
        keys["noise"] = Humming(size=some(0.05, 0.4), pace=some(1, 9), orders=orders)
    if some(0, 1) < 0.5:
        keys["quantisation"] = [pick(0.0, 0.1, 0.2, 0.3) for _ in range(r)]
    return keys


EXACT, ROUNDS, HELD, LOCAL = LAWS[1:]
LOSS = {"loss": Hashed(of="link", factors=[3, 7, 11, 5], share=9)}
NOISE = {"noise": Humming(size=0.3, pace=4.0, orders="all")}
LOWER_NOISE = {"noise": Humming(size=0.3, pace=4.0, orders="lower")}
ERRS = {"sensing": Swinging(size=0.2, pace=3.0)}
W_MSR = {"defence": {"kind": "w_msr", "F": 1, "isolated": "coast"}}
TRIM = {"defence": {"kind": "trusted_trim", "theta": 1, "isolated": "coast"}}
VOTE = {"defence": {"kind": "vote", "theta": {4: 1}, "trusted": "none", "isolated": "coast"}}
TWO_VOTE = {"defence": VOTE["defence"] | {"theta": {3: 1, 4: 1}}}
INPUT = {"moves": "input"}
OWN_DELAY = {"own_delay": True}
TURNS = {"every": 0.4}
LATE = {"missing": "drop", "delay": 0.2}
BY_MESSAGE = {"delay": {"uniform": [0.1, 0.3]}, "delay_of": "message", "missing": "hold"}
DAMPED, DAMPED_HELD = ({**each, "damping": "absolute"} for each in (LOCAL, HELD))
THREE_ROUNDS = {"kind": "rounds", "rounds": 3}

# engine, law, order of the vehicles, channel, other keys
CELLS = {
    "lost and dropped": ("exact", EXACT, 3, LOSS | NOISE, ERRS),
    "lost and held, trimmed": ("exact", EXACT, 2, LOSS | NOISE | {"missing": "hold"}, TRIM),
    "lost and continued": ("exact", EXACT, 3, LOSS | {"missing": "extrapolate"}, ERRS | W_MSR),
    "late and extrapolated": ("exact", EXACT, 3, LATE | {"extrapolate": "jerk"}, W_MSR),
    "late by message": ("exact", EXACT, 4, BY_MESSAGE | LOSS, ERRS),
    "rounds, held": ("exact", ROUNDS, 3, LOSS | NOISE | {"missing": "hold"}, ERRS),
    "three rounds, trimmed": ("exact", THREE_ROUNDS, 3, {}, TRIM),
    "three rounds, replaced": ("nonlinear", THREE_ROUNDS, 3, {}, {"threat": "replaces"} | W_MSR),
    "rounds, late": ("exact", ROUNDS, 2, LATE | {"quantisation": 0.2}, W_MSR),
    "local and held, late": ("exact", HELD, 1, LATE | LOSS, W_MSR),
    "local, continued": ("exact", LOCAL, 2, LOSS | {"missing": "extrapolate"}, ERRS),
    "local, late": ("exact", LOCAL, 3, LATE | {"extrapolate": "jets"}, {}),
    "damped": ("exact", DAMPED, 3, LOSS | {"missing": "extrapolate"}, ERRS),
    "damped and held, late": ("exact", DAMPED_HELD, 2, LATE | LOSS | LOWER_NOISE, ERRS | W_MSR),
    "damped, late": ("exact", DAMPED, 3, LATE | {"extrapolate": "jets"}, ERRS),
    "damped, held messages": ("exact", DAMPED_HELD, 4, LOSS | {"missing": "hold"}, W_MSR),
    "nonlinear, damped": ("nonlinear", DAMPED, 2, LOSS | {"missing": "hold"}, ERRS),
    "stacked, damped": ("stacked", DAMPED, 3, LOSS, ERRS),
    "misused": ("exact", DAMPED, 2, LOSS | {"missing": "extrapolate"}, ERRS | INPUT),
    "misused, held and late": ("exact", HELD, 2, LATE | LOSS | LOWER_NOISE, ERRS | W_MSR | INPUT),
    "nonlinear, misused": ("nonlinear", LOCAL, 3, LOSS, ERRS | INPUT),
    "stacked, misused": ("stacked", DAMPED, 2, LOSS, ERRS | INPUT),
    "own delay, held": ("exact", HELD, 1, LATE | LOSS | LOWER_NOISE | OWN_DELAY, ERRS | W_MSR),
    "own delay": ("exact", DAMPED, 3, LATE | {"extrapolate": "jets"} | OWN_DELAY, ERRS),
    "own delay by message": ("exact", LOCAL, 2, BY_MESSAGE | LOSS | OWN_DELAY, ERRS),
    "nonlinear, own delay": ("nonlinear", LOCAL, 2, LATE | OWN_DELAY, ERRS),
    "networks that take turns": ("exact", EXACT, 3, {"quantisation": 0.2}, TURNS | W_MSR),
    "vote": ("exact", EXACT, 3, NOISE, VOTE | ERRS),
    "vote, lost": ("exact", EXACT, 2, LOSS, VOTE | ERRS),
    "vote, lost and held": ("exact", EXACT, 1, LOSS | NOISE | {"missing": "hold"}, VOTE | ERRS),
    "vote, continued": ("exact", EXACT, 3, LOSS | {"missing": "extrapolate"}, TWO_VOTE),
    "vote, late": ("exact", EXACT, 3, LATE | LOSS | {"extrapolate": "jerk"}, VOTE),
    "vote, late by message": ("exact", EXACT, 3, BY_MESSAGE | LOSS, VOTE | ERRS),
    "vote, rounds": ("exact", ROUNDS, 3, NOISE, VOTE | ERRS),
    "vote, three rounds": ("exact", THREE_ROUNDS, 2, {"quantisation": 0.2}, TWO_VOTE),
    "vote, local and held": ("exact", HELD, 1, LOWER_NOISE | LOSS, VOTE | ERRS),
    "vote, local": ("exact", LOCAL, 2, {"quantisation": 0.2}, TWO_VOTE | {"threat": "replaces"}),
    "vote, local, late": ("exact", LOCAL, 3, LATE | {"extrapolate": "jets"}, VOTE),
    "vote, in turn": ("exact", EXACT, 3, {}, TURNS | VOTE),
    "vote, nonlinear": ("nonlinear", EXACT, 3, LOSS, VOTE | ERRS),
    "vote, stacked": ("stacked", EXACT, 3, {}, TWO_VOTE),
    "nonlinear, lost": ("nonlinear", EXACT, 3, LOSS, ERRS),
    "nonlinear, late": ("nonlinear", EXACT, 4, LATE | NOISE, W_MSR),
    "nonlinear, local": ("nonlinear", LOCAL, 2, LOSS | {"missing": "hold"}, ERRS),
    "stacked": ("stacked", EXACT, 3, LOSS | NOISE, ERRS | W_MSR | {"vehicle": "car"}),
    "stacked, replaced": ("stacked", EXACT, 3, LOSS, W_MSR | {"threat": "replaces"}),
}
LONG = {"late by message", "rounds, late", "local, late", "nonlinear, late", "nonlinear, local"}
LONG |= {"three rounds, replaced", "stacked", "stacked, replaced", "lost and dropped"}
LONG |= {each for each in CELLS if each.startswith("vote")} - {"vote, lost", "vote, local and held"}
LONG |= {"damped", "damped, late", "damped, held messages", "damped and held, late"}
LONG |= {"misused, held and late", "nonlinear, misused", "stacked, misused"}
LONG |= {"own delay", "own delay by message", "nonlinear, own delay"}
LONG |= {"nonlinear, damped", "stacked, damped"}
LONG |= {"lost and held, trimmed", "local and held, late", "misused"}
LONG |= {"rounds, held", "vote, local and held"}


def cell(engine, law, order, channel, keys):
    """Keys of a study: four vehicles with two liars; one lies to the navigator's listeners."""
    base = drawn(8, engine)
    start = {"position": [[-9.0, 4.0], [3.0, -12.0], [14.0, 6.0], [-2.0, 17.0]]}
    keys, attacked = dict(keys), {"kind": "rotating", "vehicles": [2, 3], "links": "neighbour"}
    attacked |= {"magnitude": 5.0, "frequency": [1.1, 0.7], "phase": [0.3, 2.0]}
    attacked["threat"] = keys.pop("threat", "adds")
    attacked["moves"] = keys.pop("moves", "by_law")
    ring = [[i, i - 1, 1.0] for i in range(1, 5)] + [[i, i % 4 + 1, 0.7] for i in range(1, 5)]
    topology = {"kind": "edges", "edges": [*ring, [2, 0, 0.4], [3, 0, 0.5], [4, 0, 0.3]]}
    if "every" in keys:
        line = {"kind": "edges", "edges": [[i, i - 1, 1.0] for i in range(1, 5)]}
        topology = {"kind": "switching", "networks": [topology, line], "every": keys.pop("every")}
    plain = {"loss": "none", "noise": "gaussian", "quantisation": 0.0, "missing": "drop"}
    plain |= {"extrapolate": "none", "delay": 0.0, "delay_of": "link"}
    return base | {
        "vehicle": VEHICLES[order],
        "gain": np.poly([-0.8, -1.1, -1.5, -1.9][:order])[:0:-1].round(3).tolist(),
        "law": law,
        "topology": topology,
        "initial": start | {"heading": 0.7, "speed": 6.0},
        "attack": attacked,
        "defence": {"kind": "none"},
        "channel": plain | channel,
        "sensing": "gaussian",
        **keys,
    }


def agree(keys, engine, h):
    """In the exact engine to 1e-7 m, in others to 1e-5 m, tick by tick; derivatives likewise."""
    apart, status, fleet = compared(keys)
    assert status == (Status.ok if fleet.fails_at is None else Status.disconnected)
    if engine != "exact":
        assert apart[:, 0].max() <= 1e-5
    else:
        assert apart.max() <= (1e-7 if h == H else 1e-12)
    return fleet


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=[pytest.mark.long] * (each in LONG)) for each in CELLS]
)
def test_a_cell_moves_as_the_plain_fleet(name):
    """Of each feature one."""
    agree(cell(*CELLS[name]), CELLS[name][0], H)


SEEDS = [(seed, "exact", H) for seed in (8, 24, 34, 43, 51, 54, 57, 58, 61, 69, 71)]
SEEDS += [(seed, "exact", 1e-4) for seed in (34, 51, 54, 58, 61, 71)]  # late, or continued
SEEDS += [(seed, "nonlinear", H) for seed in (8, 51, 61)]
FAST = [(51, "exact", 1e-4)]


@pytest.mark.parametrize(
    ("seed", "engine", "h"),
    [pytest.param(*each, marks=[pytest.mark.long] * (each not in FAST)) for each in SEEDS],
)
def test_a_drawn_lane_moves_as_the_plain_fleet(seed, engine, h):
    """Short ticks leave rounding alone: no digit is lost by a power of the tick."""
    agree(drawn(seed, engine, h), engine, h)
