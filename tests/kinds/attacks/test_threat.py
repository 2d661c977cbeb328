"""Links that replace what is sent: exact answers, bounds that hold and are attained."""

import numpy as np
import pandas as pd
import pytest

from jaxnet.statistics import limits
from jaxnet.statistics.reach import scenario_gain
from tests import reference, systems
from tests.kinds.attacks import by_hand
from tests.reference import march, navigator_at

CONSTANT = {"kind": "bias", "magnitude": 2.0, "threat": "replaces"}
ATTACKED = {2, 5, 8, 11}


@pytest.fixture(scope="module")
def settled():
    """Rings and paths under a constant attack in phase, after a minute."""
    sweep = {"topology": ["cyclic", "path"]}
    keys = {"defence": "none", "horizon": 60.0, "tail": 5.0, "output_step": 0.2}
    study = systems.study(engine="exact", attack=CONSTANT, sweep=sweep, **keys)
    one = systems.lanes(study, 2)
    outcome = systems.simulate(one)
    assert (outcome.status == 0).all()
    return study, one, outcome


def errors_at_the_end(one, outcome, lane):
    """Each vehicle's error [m]."""
    navigator = navigator_at(one, lane)(60.0)[0]
    return outcome.series["state"][lane, -1, :, :2] - navigator


def test_a_constant_in_phase_ends_where_threats_say(settled):
    """9/11 ā at honest vehicles of the ring, 1 ā at those of the path behind an attacked one."""
    _, one, outcome = settled
    ring = [0.9 * 9 / 11 if i in ATTACKED else 9 / 11 for i in range(1, 13)]
    path = [float(i >= 3) for i in range(1, 13)]
    for lane, known in ((0, ring), (1, ring), (2, path), (3, path)):
        expected = 2.0 * np.stack([known, np.zeros(12)], axis=1)
        np.testing.assert_allclose(
            errors_at_the_end(one, outcome, lane), expected, rtol=0, atol=1e-5
        )


def test_the_static_bound_is_attained_and_no_lane_violates(settled):
    """Vehicle by vehicle; on the ring and on the path."""
    study, one, outcome = settled
    for cell, lane in zip(study.cells, (0, 2), strict=True):
        slopes = limits.bounds_of(cell.scenario)["static"].vehicles
        attained = np.linalg.norm(errors_at_the_end(one, outcome, lane), axis=1) / 2.0
        np.testing.assert_allclose(attained, slopes, rtol=0, atol=1e-5)


def rows_of(study, outcome, samples):
    """A frame of rows as `violations_table` reads them."""
    cell, sample = np.divmod(np.arange(len(study.cells) * samples), samples)
    errors = outcome.metrics["tail_max"]
    return pd.DataFrame({"cell": cell, "sample": sample, "status": "ok", "tail_max": errors})


def test_no_lane_is_over_a_bound(settled):
    """Neither of these, nor trimmed ones under a rotating attack; a lane 1 mm farther off would be."""
    study, _, outcome = settled
    rows = rows_of(study, outcome, 2)
    assert limits.unchecked_cells(study.cells) == {}
    assert limits.violations_table(systems.results_of(study, rows)).empty
    beyond = rows.assign(tail_max=rows["tail_max"] + 1e-3)
    assert (
        len(limits.violations_table(systems.results_of(study, beyond)).query("bound == 'static'"))
        == 4
    )


def test_no_trimmed_lane_is_over_the_peak_gain():
    """Constant and rotating."""
    attacks = [CONSTANT, {"kind": "rotating", "frequency": 1.3, "threat": "replaces"}]
    study = systems.study(engine="exact", horizon=20.0, sweep={"attack": attacks})
    outcome = systems.simulate(systems.lanes(study, 4, ()))
    assert (outcome.status == 0).all()
    assert limits.unchecked_cells(study.cells) == {}
    assert limits.violations_table(systems.results_of(study, rows_of(study, outcome, 4))).empty
    reach = scenario_gain(study.cells[0].scenario)
    retains_an_attacked_one = 0.45 / (0.1 + 0.45)
    assert reach.gains.max() == pytest.approx(retains_an_attacked_one)


def test_a_rotating_lane_moves_as_the_plain_program():
    """`E = (I − A_H)⁻¹ W_r (r − y₀)` and what is free of it, at all times; the ring with its own phases."""
    attack = {"kind": "rotating", "magnitude": 3.0, "frequency": 0.9, "threat": "replaces"}
    keys = {"defence": "none", "horizon": 12.0, "tail": 1.0}
    study = systems.study(engine="exact", attack=attack, **keys)
    one = systems.lanes(study, 2)
    outcome, drawn = systems.simulate(one), by_hand.attack_of(study, 2)
    times = np.arange(121) * 0.1
    for number in range(2):
        lane, navigator = systems.lane(one, number), navigator_at(one, number)
        jets = {j: 3.0 * by_hand.unit_jets(drawn, number, j, times)[:3] for j in ATTACKED}

        def added(t, lane=lane, jets=jets):
            found = np.zeros((3, 12, 13, 2))
            for j in ATTACKED:
                found[:, lane.weights[:, j] > 0, j] = jets[j][:, None, round(t / 0.1)]
            return found

        carried = np.ones((12, 13), bool)
        carried[:, list(ATTACKED)] = False
        start = reference.flat_jets(lane.initial.T) - navigator(0.0)[:3, None]
        weights = np.stack([lane.weights] * 2)
        held = weights, added
        known = march(lambda *_, held=held: held, carried, lane.gain, start, 0.1, 120)
        path = np.stack([navigator(t)[0] for t in times])
        ours = outcome.series["state"][number, :, :, :2] - path[:, None]
        assert np.abs(ours - known[:, 0]).max() <= 1e-9
