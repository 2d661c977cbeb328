"""Every rule in both engines."""

import numpy as np
import pytest

from jaxnet.kinds import registry
from tests import systems

NAMES = [name for name in registry.names("defence") if name != "none"]


@pytest.mark.parametrize("name", NAMES)
def test_both_engines_agree_on_every_rule(name):
    """Positions to 1e-6 m and weights in force to 1e-8, on a ring of six where one transmits falsely."""
    keys = {"vehicles": 6, "attack": {"kind": "rotating", "vehicles": [2]}, "defence": name, "tick": 0.1}
    keys |= {"horizon": 2.0, "tail": 1.0, "output_step": 0.1}
    exact, nonlinear = (
        systems.simulate(systems.lanes(systems.study(engine=engine, **keys), 2))
        for engine in ("exact", {"kind": "nonlinear", "rtol": 1e-10, "atol": 1e-12})
    )
    assert exact.status.tolist() == nonlinear.status.tolist() == [0, 0]
    positions = (outcome.series["state"][..., :2] for outcome in (exact, nonlinear))
    assert np.abs(np.subtract(*positions)).max() <= 1e-6
    np.testing.assert_allclose(exact.series["kept"], nonlinear.series["kept"], rtol=0, atol=1e-8)
