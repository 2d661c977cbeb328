"""What accelerators are told otherwise than CPUs comes to the same."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from jaxnet.engine import batch, programs, subset
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.model import xla


@pytest.mark.long
@pytest.mark.parametrize(("engine", "vehicles"), [("exact", 24), ("nonlinear", 12)])
@pytest.mark.usefixtures("traced_anew")
def test_lanes_end_as_they_do_where_xla_is_told_otherwise(monkeypatch, engine, vehicles):
    found = outcome(engine, vehicles)
    assert (found.switches > 0).any()
    told = []
    monkeypatch.setattr(
        xla, "on_cpus", lambda work, elsewhere: told.append(elsewhere) or elsewhere()
    )
    other = outcome(engine, vehicles)
    assert told
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9), found, other)


def outcome(engine, vehicles):
    """Outcome of a few lanes, by a program of their own."""
    programs.compiled.cache_clear()
    programs.jitted.cache_clear()
    (cell,) = jaxnet.load(
        {"engine": engine, "vehicles": vehicles, "horizon": 3.0, "tail": 1.0}
    ).cells
    return batch.simulate(job(cell.scenario, Keyed(0), range(4)))


def test_a_default_device_may_be_told_by_its_platform():
    with jax.default_device("cpu"):
        assert xla.on_cpus(lambda: 1, lambda: 2) == 1


@pytest.mark.parametrize("done", [0, 3, 40])
def test_accelerators_number_flagged_lanes_alike(monkeypatch, done):
    """Also beyond the last flagged lane; and a pass takes an eighth of all lanes or more."""
    up_to = jnp.cumsum(jnp.arange(200) % 7 == 3)
    found = subset.numbered(up_to, done, 16), subset.side_by_side(16, 256)
    monkeypatch.setattr(xla, "on_cpus", lambda work, elsewhere: elsewhere())
    np.testing.assert_array_equal(found[0], subset.numbered(up_to, done, 16))
    assert (found[1], subset.side_by_side(16, 256), subset.side_by_side(16, 4)) == (16, 32, 4)
