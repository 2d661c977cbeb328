"""Lanes in a batch do not know of each other, and a failed one is named."""

import math
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from experiments import faults
from jaxnet.engine import batch
from jaxnet.engine.status import Status
from jaxnet.kinds import registry
from tests import systems

SHORT = {"horizon": 2.0, "tail": 1.0}
SHORTEST = {"horizon": 1.0, "tail": 0.2}


@pytest.mark.parametrize("engine", ["nonlinear", "exact"])
def test_a_failed_lane_is_named_and_spoils_no_other(engine):
    """Of 60 lanes three fail, and the others are the same to the last bit."""
    given = systems.study(engine=engine, **SHORTEST)
    clean, faulty = (
        systems.lanes(given, 60),
        zip((17, 40, 59), faults.FAULTS.values(), strict=True),
    )
    failed = {n: status for n, status in faulty if faults.fits(engine, status)}
    before, after = systems.simulate(clean), systems.simulate(faults.with_faults(clean, failed))
    assert (before.status == Status.ok).all()
    assert before.switches.any()
    assert faults.changed(before, after) == set(failed)
    for number, status in failed.items():
        assert after.status[number] == status
        assert all(np.isnan(metric[number]) for metric in after.metrics.values())
        assert np.isnan(after.series["tracking"][number, -1])
        assert (status == Status.max_steps) == (after.steps[number] == faults.STEPS)


@pytest.mark.parametrize("solver", ["gauss", pytest.param("dopri5", marks=pytest.mark.long)])
def test_the_step_limit_is_a_limit(solver):
    """Also where one step ends one interval; the step to the horizon may be the last allowed."""
    easy = {"solver": solver, "rtol": 1e-3, "atol": 1e-3}
    keys = {**systems.QUIET, "initial": {"speed": 20.0}, "horizon": 20.0, "tail": 1.0}
    needed = int(systems.outcome(1, (), engine=easy, **keys).steps[0])
    assert needed > 2
    for limit, status in (
        (needed, Status.ok),
        (needed - 1, Status.max_steps),
        (1, Status.max_steps),
    ):
        given = systems.study(engine={"max_steps": limit, **easy}, **keys)
        outcome = systems.simulate(systems.lanes(given, 1, ()))
        assert (outcome.status[0], outcome.steps[0]) == (status, limit)


@pytest.mark.parametrize("engine", ["nonlinear", "exact"])
def test_a_lane_is_the_same_alone_and_among_others(engine):
    """Whatever the number of lanes, its place among them, and how many cores share the work."""
    given = systems.study(engine=engine, **SHORTEST)
    lanes = 2 * registry.find("engine", engine).chunk + 3
    one, three = systems.lanes(given, lanes), systems.lanes(given, 3)
    many = systems.simulate(one)
    alone = systems.by_source(one, batch.simulate(one, batch.Machine(devices=1)))
    few = systems.by_source(three, batch.simulate(three))
    for ours, theirs, same in zip(*map(jax.tree.leaves, (few, many, alone)), strict=True):
        np.testing.assert_array_equal(ours, theirs[:3])
        np.testing.assert_array_equal(same, theirs)


@pytest.mark.parametrize("chunk", [16, 64, 256])
@pytest.mark.parametrize(("decides", "cached"), [(False, 40_000), (True, 8_000)])
def test_larger_fleets_have_fewer_lanes_side_by_side(decides, cached, chunk, monkeypatch):
    """A power of two, from the engine's own chunk on; all lanes' vehicles fit a core's cache."""
    plan = systems.lanes(systems.study(engine="exact", **SHORTEST), 1, ()).plan._replace(
        decides=decides
    )
    monkeypatch.setattr(plan.engine, "chunk", chunk)
    fleets = [1, 12, 13, 50, 100, 300, 1_000, 3_000, 10_000, 100_000]
    widths = [batch.EVERYTHING.width(plan, vehicles) for vehicles in fleets]
    assert widths[:2] == [chunk] * 2
    assert widths == sorted(widths, reverse=True)
    assert all(math.log2(width).is_integer() for width in widths)
    assert all(
        width == 2 or width * m < 2 * cached for width, m in zip(widths, fleets, strict=True)
    )
    assert widths[-1] == 2
    assert batch.Machine(chunk=5).width(plan, 300) == 5
    assert batch.Machine(chunk=10**9).width(plan, 12, lanes=3) == chunk
    assert batch.Machine(chunk=10**9).width(plan, 12, lanes=1000) == 1024


@pytest.mark.parametrize(
    ("memory", "vehicles", "lanes", "width", "saving"),
    [
        (139 * 2**30, 12, 10**6, 2**17, 2**13),
        (139 * 2**30, 12, 5_000, 2**13, 2**13),
        (139 * 2**30, 1_000, 10**6, 2**14, 2**6),
        (None, 12, 10**6, 2**16, 2**9),
        (2**20, 1_000, 10**6, 2, 2),
    ],
)
def test_an_accelerator_has_all_lanes_side_by_side(
    memory, vehicles, lanes, width, saving, monkeypatch
):
    """As far as half of its memory goes; saved series take their part."""
    stats = memory and {"bytes_limit": memory}
    chip = SimpleNamespace(platform="gpu", memory_stats=lambda: stats)
    monkeypatch.setattr(batch.Machine, "each", lambda self: [chip])
    plan = systems.lanes(systems.study(engine="exact", **SHORTEST), 1, ()).plan
    assert batch.EVERYTHING.width(plan, vehicles, lanes) == width
    assert batch.Machine(chunk=4).width(plan, vehicles, lanes) == min(4, width)
    plan = plan._replace(save=("state",), rows=10_001)
    assert batch.EVERYTHING.width(plan, vehicles, lanes) == saving


def test_an_engine_says_how_many_vehicles_stay_in_a_cache(monkeypatch):
    """Large fleets have no more: 1,200 in the nonlinear engine, in a power of two of lanes."""
    plan = systems.lanes(systems.study(engine="nonlinear", **SHORTEST), 1, ()).plan
    monkeypatch.setattr(plan.engine, "chunk", 64)
    assert [batch.EVERYTHING.width(plan, vehicles) for vehicles in (150, 300, 600, 1_000)] == [
        8,
        4,
        2,
        2,
    ]


@pytest.mark.parametrize("engine", ["nonlinear", "exact"])
def test_numbers_never_compile_anew(engine):
    """Not gains, magnitudes, tolerances, horizons, ticks or tails, nor another kind of attack."""
    keys = {"gain": [2, 4, 4], "horizon": 3.0, "tail": 0.5, "tick": 0.025, "output_step": 0.05}
    attack = {"kind": "sinusoid", "magnitude": {"normal": [3, 0]}}
    defence = {"kind": "trusted_trim", "tolerance": 1e-6}
    first, *others = (
        systems.lanes(systems.study(engine=engine, **changed), 2)
        for changed in (SHORT, {"attack": attack, **keys}, {"defence": defence, **SHORT})
    )
    systems.simulate(first)
    compiled = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda name, *_, **__: compiled.append(name)
    )
    for lanes in others:
        assert systems.simulate(lanes).status.tolist() == [0, 0]
    assert not [name for name in compiled if "backend_compile" in name]


@pytest.mark.long
def test_metrics_are_those_of_the_stored_trajectory():
    """Each number by its definition, from states and weights at output times."""
    one = systems.lanes(systems.study(**SHORT), 4)
    outcome = systems.simulate(one)
    for number in range(4):
        lane = systems.lane(one, number)
        path = lane.navigator.jets(np.arange(21) * 0.1)[0].T
        states, kept = outcome.series["state"][number], outcome.series["kept"][number]
        errors = np.linalg.norm(states[:, :, :2] - path[:, None], axis=2)
        sources = np.concatenate([path[:, None], states[:, :, :2]], axis=1)
        apart = np.linalg.norm(states[:, :, :2] - kept @ sources, axis=2)
        known = {
            "tail_mean": errors[10:].mean(),
            "tail_max": errors[10:].max(),
            "tail_disagreement": apart[10:].mean(),
            "peak_error": errors.max(),
            "min_speed": np.abs(states[:, :, 3]).min(),
            "peak_turn_rate": np.abs(states[:, :, 4]).max(),
        }
        for name, value in known.items():
            np.testing.assert_allclose(outcome.metrics[name][number], value, rtol=1e-12)
        np.testing.assert_allclose(
            outcome.series["tracking"][number], errors.mean(axis=1), rtol=1e-12
        )
        np.testing.assert_allclose(
            outcome.series["disagreement"][number], apart.mean(axis=1), rtol=1e-12
        )


@pytest.mark.parametrize("engine", ["nonlinear", "exact"])
def test_numbers_beyond_all_bounds_are_nonfinite(engine):
    """An attack that overflows leaves no lane that calls itself ok."""
    attack = {"kind": "rotating", "magnitude": 1e308}
    given = systems.study(engine=engine, attack=attack, defence="none", **SHORT)
    outcome = systems.simulate(systems.lanes(given, 2, ()))
    assert outcome.status.tolist() == [Status.nonfinite] * 2
    assert np.isnan(outcome.metrics["tail_mean"]).all()
