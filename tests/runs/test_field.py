"""`jaxnet.field`: one lane for whoever integrates; tests/engine/test_stacked.py has the engines."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnet
from experiments import one_lane

RING = {"vehicles": 4, "attack": {"vehicles": [2]}}


@pytest.mark.long  # a field integrated by Diffrax: tests/engine/test_stacked.py
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


@pytest.mark.parametrize(
    ("keys", "given", "words"),
    [
        ({}, {"cell": 1}, "cells 0 to 0"),
        ({}, {"sample": -1}, "sample is a whole number"),
        ({"defence": "w_msr"}, {}, "w_msr decides at ticks only"),
        ({"defence": {"isolated": "coast"}}, {}, "trusted_trim has isolated: coast"),
        ({"defence": "none", "vehicle": {"kind": "car", "standstill": "stop"}}, {}, "standstill"),
        ({"law": "rounds"}, {}, "rounds is not the law solved at every instant"),
        ({"sensing": {"position": 0.1}}, {}, "vehicles sense, and messages are lost, at ticks"),
    ],
)
def test_what_has_no_field_is_refused(keys, given, words):
    """No such cell, rules that need ticks: each in words."""
    with pytest.raises(ValueError, match=words):
        jaxnet.field({**RING, **keys}, **given)


def test_single_precision_is_refused():
    """In words that say what to do."""
    with jax.enable_x64(False), pytest.raises(RuntimeError, match="'jax_enable_x64', True"):
        jaxnet.field(RING)
