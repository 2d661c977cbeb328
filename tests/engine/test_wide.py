"""Fleets whose graph no order makes narrow, solved for by iteration and as one dense block."""

import jax
import numpy as np
import pytest

from jaxnet.engine import batch
from jaxnet.solvers import choice
from jaxnet.solvers.dense import Dense
from jaxnet.solvers.iterative import Iterative
from tests import systems

LANES = {
    "exact": {"vehicles": 400, "engine": "exact", "tick": 0.3, "horizon": 0.6},
    "nonlinear": {
        "vehicles": 150,
        "engine": {"rtol": 1e-4, "atol": 1e-6},
        "defence": "none",
        "tick": 0.05,
        "horizon": 0.05,
    },
}
FEW = batch.Machine(devices=1, chunk=2)
SAVED = ("state", "tracking")


@pytest.mark.long
@pytest.mark.parametrize("engine", LANES)
def test_iteration_leads_where_one_dense_block_does(engine, monkeypatch):
    """To 1e-8 m; three hear the navigator. A lane is the same to the last bit without the other."""
    keys = LANES[engine]
    graph = {"kind": "random_regular", "degree": 4, "navigator": [1, 2, 3]}
    given = systems.study(topology=graph, output_step=keys["tick"], tail=keys["tick"], **keys)
    one = systems.lanes(given, 2, SAVED)
    assert isinstance(one.network.solver, Iterative)
    iterated = batch.simulate(one, FEW)
    monkeypatch.setattr(choice, "LARGEST_BLOCK", 400)
    dense = systems.lanes(given, 2, SAVED)
    assert isinstance(dense.network.solver, Dense)
    known = batch.simulate(dense, FEW)
    assert (known.status == 0).all()
    assert known.switches.any() == (engine == "exact")
    np.testing.assert_array_equal(iterated.status, known.status)
    np.testing.assert_array_equal(iterated.switches, known.switches)
    for name in SAVED:
        np.testing.assert_allclose(iterated.series[name], known.series[name], rtol=0, atol=1e-8)
    alone = one._replace(inputs=batch.part(one.inputs, 0, 1))
    for ours, theirs in zip(
        *map(jax.tree.leaves, (batch.simulate(alone, FEW), iterated)), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs[:1])
