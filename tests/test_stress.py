"""The stress script: 2,000 lanes of random cells break no bound, and it would tell if one did."""

import numpy as np
import pytest

import jaxnet
from experiments import stress
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed

pytestmark = pytest.mark.usefixtures("many_side_by_side")


@pytest.mark.long
def test_no_lane_is_over_a_bound_that_holds_for_it():
    """Eight cells; static is attained, or nearly, and so tested against a smaller one."""
    held, failed = stress.stress(8, seed=0)
    assert held["peak_gain"].lanes >= 1500
    assert held["static"].lanes >= 500
    assert failed < 500
    assert held["harmonic"].lanes >= 500
    assert [count.violations for count in held.values()] == [0, 0, 0]
    assert 0.9 < held["static"].ratio <= 1


def test_a_bound_that_does_not_hold_is_told(monkeypatch):
    """With limits of half the size."""
    whole = stress.limits_of
    monkeypatch.setattr(
        stress, "limits_of", lambda *given: {b: x / 2 for b, x in whole(*given).items()}
    )
    (cell,) = jaxnet.load(stress.keys(np.random.default_rng(0))).cells
    found, _ = stress.check(cell.scenario, 0)
    assert found["peak_gain"].violations > 0


def test_cells_share_two_programs():
    """Whatever is drawn, each hears as many sources."""
    rng = np.random.default_rng(0)
    scenarios = [jaxnet.load(stress.keys(rng)).cells[0].scenario for _ in range(20)]
    networks = [job(scenario, Keyed(0), [0]).network for scenario in scenarios]
    assert {network.hearing.sources.shape for network in networks} == {
        (stress.HEARD, stress.VEHICLES)
    }
    trimming = [network.shared for network in networks if network.shared is not None]
    assert 0 < len(trimming) < 20
    assert {len(shared.references) for shared in trimming} == {stress.HEARD}
