"""`jaxnet.field`: one lane for whoever integrates; tests/engine/test_stacked.py has the engines."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from experiments import one_lane

RING = {"vehicles": 4, "attack": {"vehicles": [2]}}


def test_the_example_ends_where_the_exact_solution_does():
    """Diffrax's own stepping of the twelve vehicles, to a micrometre."""
    assert one_lane.distance() < 1e-6


def test_the_field_is_of_the_lane_and_moves_as_its_vehicles_do():
    """`ẋ = v cos θ`, `ẏ = v sin θ`, `θ̇ = ω`, `v̇ = F`."""
    study = jaxnet.load({**RING, "sweep": {"initial.speed": [0.3, 0.4]}})
    field, start = jaxnet.field(study, sample=2, cell=1)
    assert (start.shape, start.dtype) == ((6, 4), jnp.float64)
    np.testing.assert_array_equal(start[3], 0.4)
    state = start.at[4].set(0.1).at[5].set(-0.2)
    rate = field(0, state, None)
    heading = np.asarray(start[2])
    known = [0.4 * np.cos(heading), 0.4 * np.sin(heading), np.full(4, 0.1), np.full(4, -0.2)]
    np.testing.assert_allclose(rate[:4], known, rtol=1e-14)
    other = jaxnet.field(study, sample=3, cell=1)[1]
    assert (other[:3] != start[:3]).all()


def test_what_has_no_field_is_refused():
    """No such cell, rules that need ticks, single precision: each in words that say what to do."""
    with pytest.raises(ValueError, match="cells 0 to 0"):
        jaxnet.field(RING, cell=1)
    with pytest.raises(ValueError, match="sample is a whole number"):
        jaxnet.field(RING, sample=-1)
    with pytest.raises(ValueError, match="w_msr decides at ticks only"):
        jaxnet.field({**RING, "defence": "w_msr"})
    with pytest.raises(ValueError, match="trusted_trim has isolated: coast"):
        jaxnet.field({**RING, "defence": {"isolated": "coast"}})
    with pytest.raises(ValueError, match=r"solved at every instant \(got rounds\)"):
        jaxnet.field({**RING, "law": "rounds"})
    with jax.enable_x64(False), pytest.raises(RuntimeError, match="'jax_enable_x64', True"):
        jaxnet.field(RING)
