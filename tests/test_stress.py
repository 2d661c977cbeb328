"""The stress script: no bound is broken by 2,000 lanes of random cells, and it would tell if one were."""

import numpy as np
import pytest

import jaxnet
from experiments import stress


def test_no_lane_is_over_a_bound_that_holds_for_it():
    """Eight cells; static is attained, or nearly, and so held against what would break a smaller one."""
    held, failed = stress.stress(8, seed=0)
    assert held["peak_gain"].lanes >= 1500
    assert held["static"].lanes >= 500
    assert failed < 500
    assert [count.violations for count in held.values()] == [0, 0]
    assert 0.9 < held["static"].ratio <= 1


def test_a_bound_that_does_not_hold_is_told(monkeypatch):
    """With limits of half the size."""
    whole = stress.limits_of
    monkeypatch.setattr(stress, "limits_of", lambda *given: {b: x / 2 for b, x in whole(*given).items()})
    (cell,) = jaxnet.load(stress.keys(np.random.default_rng(0))).cells
    found, _ = stress.check(cell.scenario, 0)
    assert found["peak_gain"].violations > 0


@pytest.mark.parametrize("seed", range(20))
def test_cells_share_a_program(seed):
    """Whatever is drawn, each hears as many sources, and one trusts all it hears where anybody trims."""
    (cell,) = jaxnet.load(stress.keys(np.random.default_rng(seed))).cells
    network = stress.job(cell.scenario, 0, [0]).network
    assert network.hearing.sources.shape == (stress.HEARD, stress.VEHICLES)
    references = getattr(network.defence, "references", np.empty((stress.HEARD, 0)))
    assert len(references) == stress.HEARD
