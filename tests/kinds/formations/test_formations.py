"""Formations: errors stay what they are without one, places are where the formation says."""

import math

import numpy as np
import pytest

import jaxnet
from jaxnet.view.text.tables import summary_text
from tests import systems
from tests.engine import test_stopping
from tests.engine.test_isolated import LastDrops

PLACES = {
    "offsets": {"offsets": [[3.0 * n, -2.0 * n**2] for n in range(12)]},
    "circle": {"radius": 4.0, "phase": 0.3},
    "line": {"spacing": 2.0, "heading": 1.1},
    "grid": {"spacing": 2.0, "columns": 5},
}
TURNING = {"kind": "circle", "radius": 4.0, "turn_rate": 0.5}


def simulated(**keys):
    fixed = {
        "engine": "exact",
        "horizon": 2.0,
        "tail": 1.0,
        "save": {"trajectories": "all"},
        "metrics": ["min_separation"],
    }
    results = jaxnet.simulate({**fixed, **keys}, samples=3, progress=False)
    assert (results.lanes["status"] == "ok").all()
    return results


def offsets(kind, time=0.0):
    """δ of twelve vehicles (2, m), by the formulas of docs/keys.md."""
    number = np.arange(12)
    match kind:
        case "offsets":
            return np.array(PLACES[kind]["offsets"]).T
        case "circle":
            angle = 0.3 + 2 * np.pi * number / 12
            return 4.0 * np.stack([np.cos(angle), np.sin(angle)])
        case "line":
            along = 2.0 * (number - 5.5)
            return np.stack([along * math.cos(1.1), along * math.sin(1.1)])
        case "grid":
            return 2.0 * np.stack([number % 5 - 2.0, number // 5 - 1.0])
    angle = 0.5 * time + 2 * np.pi * number / 12
    return 4.0 * np.stack([np.cos(angle), np.sin(angle)])


def positions(results):
    return results.trajectories["states"].values[0, ..., :2]  # samples, times, vehicles, 2


@pytest.mark.parametrize(
    ("vehicle", "kinds"),
    [
        ("single_integrator", ["line"]),
        *[
            pytest.param(each, [*PLACES], marks=pytest.mark.long)
            for each in ("two_wheeled", "double_integrator")
        ],
    ],
)
def test_errors_are_those_without_a_formation_to_the_last_bit(vehicle, kinds):
    shapes = [{"kind": kind, **PLACES[kind]} for kind in kinds]
    results = simulated(vehicle=vehicle, sweep={"formation": ["none", *shapes]})
    columns = ["tail_mean", "tail_max", "peak_error", "tail_disagreement", "switches"]
    rows = results.lanes[columns].to_numpy().reshape(len(shapes) + 1, 3, -1)
    np.testing.assert_array_equal(rows[1:], np.broadcast_to(rows[0], rows[1:].shape))
    places = results.trajectories["states"].values[..., :2]
    for kind, moved in zip(kinds, places[1:] - places[0], strict=True):
        assert moved == pytest.approx(np.broadcast_to(offsets(kind).T, moved.shape), abs=1e-10)


@pytest.mark.parametrize(
    "engine",
    ["exact", *[pytest.param(each, marks=pytest.mark.long) for each in ("nonlinear", "stacked")]],
)
@pytest.mark.parametrize(
    "vehicle",
    [
        {"kind": "look_ahead", "ahead": 2.0},
        *[
            pytest.param(each, marks=pytest.mark.long)
            for each in ("double_integrator", "unicycle", "two_wheeled")
        ],
    ],
)
def test_circle_that_turns(vehicle, engine):
    """The true outputs turn, the errors do not."""
    plain = simulated(vehicle=vehicle, engine=engine, defence="none")
    shaped = simulated(vehicle=vehicle, engine=engine, defence="none", formation=TURNING)
    expected = plain.lanes["tail_mean"].to_numpy()
    assert shaped.lanes["tail_mean"].to_numpy() == pytest.approx(expected, rel=1e-7)
    places = [places_of(results, vehicle) for results in (plain, shaped)]
    moved = (places[1] - places[0])[:, -1]
    assert moved == pytest.approx(np.broadcast_to(offsets("", 2.0).T, moved.shape), abs=1e-5)


@pytest.mark.parametrize(
    ("law", "engine"),
    [
        ("linearised", "sampled"),
        *[
            pytest.param(*each, marks=pytest.mark.long)
            for each in (("linearised", "nonlinear"), ("exact", "sampled"))
        ],
    ],
)
def test_other_laws_and_engines_lead_each_vehicle_to_its_place(law, engine):
    """A linearised law is linearised about the navigator's path in each vehicle's place."""
    keys = {"vehicle": "unicycle", "law": law, "engine": engine, "attack": "none"}
    keys |= {"defence": "none", "tick": 0.01, "initial": {"speed": 28.0, "heading": 0.8}}
    keys["initial"]["position"] = {"uniform": [-2.0, 2.0]}
    plain = simulated(**keys)
    shaped = simulated(**keys, formation={"kind": "grid", **PLACES["grid"]})
    expected = plain.lanes["tail_mean"].to_numpy()
    assert shaped.lanes["tail_mean"].to_numpy() == pytest.approx(expected, rel=1e-6)
    moved = positions(shaped) - positions(plain)
    assert moved == pytest.approx(np.broadcast_to(offsets("grid").T, moved.shape), abs=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("engine", ["exact", "nonlinear"])
def test_a_vehicle_that_stops_stands_in_its_place(engine):
    """Vehicles 3 and 4, cut off at once, come to rest where they are in the formation."""
    stops = {**test_stopping.KEYS, "engine": engine, "gain": test_stopping.GAINS[3][0]}
    stops["defence"] = {"kind": f"{LastDrops.__module__}:LastDrops", "isolated": "coast"}
    plain = simulated(**stops)
    line = {"kind": "line", "spacing": 50.0}
    shaped = simulated(**stops, formation=line)
    assert (plain.lanes["stopped"] > 0).all()
    for column in ("tail_mean", "peak_error", "stopped"):
        expected = plain.lanes[column].to_numpy()
        assert shaped.lanes[column].to_numpy() == pytest.approx(expected, rel=1e-6), column
    moved = positions(shaped) - positions(plain)
    along = 50.0 * (np.arange(4) - 1.5)
    places = np.stack([along, np.zeros(4)], axis=1)
    assert moved == pytest.approx(np.broadcast_to(places, moved.shape), abs=1e-5)


def test_the_vector_field_starts_in_formation():
    keys = {"defence": "none", "formation": {"kind": "grid", **PLACES["grid"]}}
    plain, shaped = (
        jaxnet.load({"name": "one", **keys, "formation": each})
        for each in ("none", keys["formation"])
    )
    starts = [np.asarray(jaxnet.field(study)[1]) for study in (plain, shaped)]
    assert (starts[1] - starts[0])[:2] == pytest.approx(offsets("grid"), abs=1e-10)
    with pytest.raises(ValueError, match="the sampled engine"):
        jaxnet.field(jaxnet.load({"name": "one", "defence": "none", "engine": "sampled"}))


def places_of(results, vehicle):
    states = results.trajectories["states"].values[0]
    if isinstance(vehicle, str):
        return states[..., :2]
    heading = states[..., 2]
    return states[..., :2] + 2.0 * np.stack([np.cos(heading), np.sin(heading)], axis=-1)


def test_least_separation_is_that_of_true_places():
    """Twelve vehicles that agree on a point, on a circle of radius 1: a regular 12-gon."""
    keys = {
        **systems.AGENTS,
        **systems.QUIET,
        "initial": {"position": 0.0},
        "formation": {"kind": "circle", "radius": 1.0},
    }
    lanes = simulated(**keys).lanes
    assert lanes["min_separation"].to_numpy() == pytest.approx(0.517638, abs=5e-7)
    assert lanes["spread"].to_numpy() == pytest.approx(0.0, abs=1e-12)
    assert lanes["outside"].to_numpy() == pytest.approx(0.0, abs=1e-12)


def test_tables_say_that_errors_leave_out_places():
    line = {"kind": "line", "spacing": 2.0}
    told = [
        summary_text(simulated(vehicle="single_integrator", formation=each))
        for each in ("none", line)
    ]
    assert ["places in the formation" in text for text in told] == [False, True]


def test_messages_are_lost_by_true_distance():
    """Vehicles that agree on a point hear nobody whose place in the formation is out of range."""
    keys = {
        **systems.AGENTS,
        **systems.QUIET,
        "initial": {"position": 0.0},
        "topology": "complete",
        "channel": {"loss": {"kind": "range", "radius": 3.0}},
        "save": {"trajectories": "all"},
    }
    near = simulated(**keys, formation={"kind": "line", "spacing": 2.0})
    far = simulated(**keys, formation={"kind": "line", "spacing": 4.0})
    assert (near.lanes["unheard"] == 0).all()
    assert (far.lanes["unheard"] == 12 * 41).all()


def test_attacker_lies_about_its_place_in_the_formation():
    """A lie is added to y - δ: by minus the difference of two places it claims the other one."""
    keys = {
        "vehicle": "single_integrator",
        "defence": "none",
        "formation": {"kind": "line", "spacing": 2.0},
    }
    lie = {"kind": "bias", "vehicles": [2], "magnitude": 2.0, "direction": 0.0}
    lanes = simulated(**keys, attack=lie).lanes
    plain = simulated(**{**keys, "formation": "none"}, attack=lie).lanes
    assert (lanes["tail_mean"] > 0.1).all()
    assert (lanes["tail_mean"] == plain["tail_mean"]).all()


def test_places_of_a_file(tmp_path):
    (tmp_path / "places.csv").write_text("# x, y\n" + "\n".join(f"{n}, {-n}" for n in range(12)))
    (tmp_path / "study.yaml").write_text("name: one\nformation: {kind: file, path: places.csv}\n")
    formation = jaxnet.load(tmp_path / "study.yaml").config.formation
    assert formation.offsets == [[float(n), float(-n)] for n in range(12)]


@pytest.mark.parametrize("content", ["", "1, 2, 3\n", "1, nan\n", "a, b\n"])
def test_wrong_files_of_places_are_refused(tmp_path, content):
    (tmp_path / "places.csv").write_text(content)
    (tmp_path / "study.yaml").write_text("name: one\nformation: {kind: file, path: places.csv}\n")
    with pytest.raises(jaxnet.ConfigError, match=r"places\.csv"):
        jaxnet.load(tmp_path / "study.yaml")
