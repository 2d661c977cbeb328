"""Vehicles of every order: static gains, gains that follow the order, stability as `check` says."""

import numpy as np
import pytest

import jaxnet
from jaxnet.view.text.check import check_text

VEHICLES = {1: "single_integrator", 2: "double_integrator"}
LIARS = [2, 5, 8, 11]


@pytest.mark.long  # short: order 3, tests/engine/test_exactness.py
def test_static_gains_do_not_depend_on_the_order():
    """3.0000 in the mean and 3.1034 for the worst on the ring."""
    keys = {"vehicle": "planar_quadrotor", "defence": "none", "horizon": 60.0, "samples": 2}
    keys["attack"] = {"kind": "bias", "vehicles": LIARS, "magnitude": 5.0}
    rows = jaxnet.simulate({"engine": "exact", "topology": "cyclic", **keys}, progress=False).lanes
    np.testing.assert_allclose(
        rows[["tail_mean", "tail_max"]].max() / 5.0, [3.0, 3.1034], atol=5e-5
    )


def test_gains_follow_the_order():
    """Binomial gains cell by cell; other lengths are refused."""
    keys = {"engine": "exact", "attack": "none", "sweep": {"vehicle": [*VEHICLES.values(), "car"]}}
    study = jaxnet.load(keys)
    assert [cell.scenario.gain for cell in study.cells] == [[1], [1, 2], [1, 3, 3]]
    again = jaxnet.load(study, {"samples": 2})
    assert [cell.scenario.gain for cell in again.cells] == [[1], [1, 2], [1, 3, 3]]
    with pytest.raises(jaxnet.ConfigError, match="gain: single_integrator needs 1 gain, k0"):
        jaxnet.load({"engine": "exact", "vehicle": "single_integrator", "gain": [1, 3, 3]})
    with pytest.raises(jaxnet.ConfigError, match=r"gain: unstable: eigenvalues 1\+0j"):
        jaxnet.load({"engine": "exact", "vehicle": "single_integrator", "gain": [-1]})
    with pytest.raises(jaxnet.ConfigError, match="a choice of orders needs a vehicle of order 3"):
        jaxnet.load({"vehicle": "double_integrator", "engine": "exact", "attack": {"orders": [0]}})
    for gain in ([10, 4, 6, 4], [1, 4, 6, {"uniform": [0.1, 4]}]):
        with pytest.raises(jaxnet.ConfigError, match="gain: unstable"):
            jaxnet.load({"vehicle": "planar_quadrotor", "gain": gain})


def test_check_tells_whether_the_local_law_is_stable():
    """Single integrators that step too far do not agree."""
    keys = {"vehicle": "single_integrator", "engine": "exact", "law": "local", "attack": "none"}
    keys |= {"topology": "cyclic", "tick": 0.1}
    told = {gain: check_text(jaxnet.load({**keys, "gain": [gain]})) for gain in (10.0, 30.0)}
    assert "stable, deviations times 0.9000 at each tick of 0.1 s" in told[10.0]
    assert "UNSTABLE" in told[30.0]
