"""What each vehicle must fulfil: its output is r integrators for each axis (theorems.md O4)."""

import jax
import jax.numpy as jnp
import numpy as np


def assert_flat(vehicle, state, inputs, tolerance=1e-9):
    """Each jet's rate along `motion` is the next jet, the last `σ + ψ u`; `inputs_for` inverts."""
    assert len(vehicle.states) == len(vehicle.units) == len(state)
    jets, rates = jax.jvp(vehicle.output_jets, (state,), (vehicle.motion(state, inputs),))
    assert len(jets) == vehicle.order
    highest = vehicle.drift(state) + jnp.einsum(
        "xu...,u...->x...", vehicle.decoupling(state), inputs
    )
    np.testing.assert_allclose(
        np.stack(rates), [*jets[1:], highest], rtol=tolerance, atol=tolerance
    )
    np.testing.assert_allclose(
        vehicle.inputs_for(state, highest), inputs, rtol=tolerance, atol=tolerance
    )


def assert_margin(vehicle, state):
    """The margin is det ψ up to its sign, and its norm is that of the lead."""
    margin = np.asarray(vehicle.margin(state))
    determinant = np.linalg.det(
        np.moveaxis(np.asarray(vehicle.decoupling(state)), (0, 1), (-2, -1))
    )
    np.testing.assert_allclose(abs(determinant), abs(margin), rtol=1e-9)
    lead = vehicle.lead(vehicle.output_jets(state)[vehicle.singular])
    np.testing.assert_allclose(np.linalg.norm(lead, axis=0), abs(margin), rtol=1e-9)
