"""What engines presume of a vehicle is tried; an engine that does not know a limit refuses it."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from jaxnet.kinds import registry
from jaxnet.kinds.fields import Number
from jaxnet.kinds.kind import KindError
from jaxnet.kinds.vehicles.two_wheeled import TwoWheeled
from jaxnet.lanes.draws import Draw
from jaxnet.lanes.jobs import job
from jaxnet.lanes.proofs import prove_vehicle
from jaxnet.lanes.uniforms import Keyed

KEYS = {"vehicles": 3, "horizon": 1.0, "tail": 0.5, "attack": "none", "defence": "none"}


class Limited(TwoWheeled):
    """Two-wheeled, whose inputs end at a limit."""

    limit: Number = 0.5

    def motion(self, state, inputs):
        return super().motion(
            state, jnp.clip(inputs, -self.limit[None, None], self.limit[None, None])
        )


class Forgetful(TwoWheeled):
    """Its jets tell another turn rate than it has."""

    def state_of(self, jets):
        found = super().state_of(jets)
        return found * np.array([1.0, 1.0, 1.0, 1.0, 1.01, 1.0])[:, None, None]


@pytest.mark.parametrize("name", registry.kind_names("vehicle"))
def test_every_vehicle_is_what_engines_presume(name):
    vehicle = registry.find("vehicle", name)()
    prove_vehicle(vehicle.drawn(Draw(Keyed(0), [0, 1], 3), "vehicle"), 3, True, "exact")


@pytest.mark.parametrize(
    ("vehicle", "engine", "message"),
    [
        (
            Limited(),
            "exact",
            r"Limited.motion: derivative 3 .* exact engine .*: give engine: nonlinear(\n|$)",
        ),
        (Limited(limit={"uniform": [5.0, 9.0]}), "exact", r"Limited.motion: derivative 3"),
        (Limited(), "nonlinear", None),
        (Forgetful(), "exact", r"Forgetful.state_of: derivative 2 .* is asked for"),
        (
            Forgetful(),
            "nonlinear",
            r"the nonlinear .*: give engine: {kind: nonlinear, solver: dopri5}(\n|$)",
        ),
        (Forgetful(), {"kind": "nonlinear", "solver": "dopri5"}, None),
    ],
)
def test_an_engine_refuses_a_vehicle_that_it_does_not_know(vehicle, engine, message):
    """Before anything compiles; the engine that the message names takes the vehicle."""
    (cell,) = jaxnet.load({**KEYS, "vehicle": vehicle, "engine": engine}).cells
    if message is None:
        assert job(cell.scenario, Keyed(0), [0]).size == 1
        return
    with pytest.raises(KindError, match=message):
        job(cell.scenario, Keyed(0), [0])
