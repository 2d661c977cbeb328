"""Every state and input of every vehicle, by programs as users compile them."""

import os
import subprocess
import sys

import numpy as np
import pytest

import jaxnet
from jaxnet.kinds import registry

VEHICLES = registry.kind_names("vehicle")
KEYS = {
    "vehicles": 3,
    "topology": "complete",
    "samples": 2,
    "attack": {"kind": "rotating", "magnitude": 3.0, "vehicles": [2]},
    "defence": "none",
    "horizon": 4.0,
    "tail": 1.0,
    "save": {"trajectories": "all"},
    "sweep": {"engine": ["exact", "nonlinear"]},
}
SCRIPT = f"""
import sys, jaxnet
for name in sys.argv[2:]:
    vehicle = {{"kind": name, "limits": {{}}}}
    jaxnet.run(jaxnet.load({KEYS} | {{"vehicle": vehicle}}), out=f"{{sys.argv[1]}}/{{name}}")
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """All vehicles by the exact and the nonlinear engine, with users' compiler options.

    Other tests run programs that are not optimised, which hides a compiler's faults.
    """
    out = tmp_path_factory.mktemp("vehicles")
    optimised = {key: value for key, value in os.environ.items() if key != "XLA_FLAGS"}
    subprocess.run([sys.executable, "-c", SCRIPT, str(out), *VEHICLES], env=optimised, check=True)
    return out


def agree(results):
    """To 1e-5 of the greatest value that each state and input has at any output time."""
    assert (results.lanes["status"] == "ok").all()
    for name, axis in (("states", "state"), ("inputs", "input")):
        exact, nonlinear = results.trajectories[name].transpose("cell", ..., axis).values
        assert np.isfinite(exact).all()
        size = np.abs(exact).max(axis=(0, 1, 2))
        np.testing.assert_allclose(nonlinear / size, exact / size, rtol=0, atol=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_engines_agree_on_every_state_and_input(folder, vehicle):
    agree(jaxnet.open(folder / vehicle))


@pytest.mark.long
@pytest.mark.parametrize("vehicle", ["look_ahead", "car"])
def test_engines_agree_by_programs_that_are_not_optimised(vehicle):
    """A vehicle whose outputs leave a state open, and one with six states."""
    keys = KEYS | {"vehicle": vehicle, "horizon": 2.0}
    agree(jaxnet.simulate(keys, progress=False))
