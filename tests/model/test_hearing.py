"""What is received, slot by slot, against the sums of the definition, link by link."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxnet.model import hearing
from jaxnet.model.graph import of_matrix
from tests.matrices import slotwise

FLEET = 12

added_by_slot = jax.jit(hearing.Hearing.added)
received_by_slot = jax.jit(hearing.Hearing.received)
mean = jax.jit(hearing.Hearing.mean)
mean_added = jax.jit(hearing.Hearing.mean_added)
matrix = jax.jit(hearing.Hearing.matrix)


@pytest.mark.parametrize("replaces", [False, True])
@given(st.integers(0, 2**32 - 1))
def test_attacks_add_up_over_the_links_that_carry_them(replaces, seed):
    """`Σ_j w_ij (z_ij + a_ij)`: a_ij is added on j or, if j is the navigator, on i's own receiver.

    z_ij is what j sends or, on an attacked link that replaces it, what the navigator sends.
    """
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.0, 1.0, (FLEET, FLEET + 1)) * (rng.random((FLEET, FLEET + 1)) < 0.5)
    weights[range(FLEET), range(1, FLEET + 1)] = 0.0
    links = (rng.random((FLEET, FLEET + 1)) < 0.4) & (weights > 0)
    graph = of_matrix(weights)
    slots = hearing.slots(graph, np.ones(graph.sources.shape, int))
    by_slot = [hearing.by_slot(graph, slotwise(graph, each), slots) for each in (weights, links)]
    carried_sources = np.where(by_slot[1] & replaces, 0, slots)
    heard = hearing.Hearing(slots, carried_sources, by_slot[1], hearing.of_transmitters(slots))
    network = jax.tree.map(jnp.asarray, heard)
    sent, signal = rng.normal(size=(2, FLEET + 1)), rng.normal(size=(2, FLEET))
    arrays = jnp.asarray(sent), jnp.asarray(signal)
    added = np.asarray(added_by_slot(network, arrays[1]))
    received = np.asarray(received_by_slot(network, *arrays))
    (expected, lies), carried = np.zeros((2, 2, FLEET)), np.zeros((FLEET, FLEET + 1))
    for i in range(1, FLEET + 1):
        slot_of = {j: slot for slot, j in enumerate(slots[:, i - 1])}
        for j in np.flatnonzero(weights[i - 1]):
            attack = signal[:, (j or i) - 1] if links[i - 1, j] else np.zeros(2)
            speaker = 0 if replaces and links[i - 1, j] else j
            np.testing.assert_array_equal(added[:, slot_of[j], i - 1], attack)
            np.testing.assert_array_equal(received[:, slot_of[j], i - 1], sent[:, speaker] + attack)
            expected[:, i - 1] += weights[i - 1, j] * (sent[:, speaker] + attack)
            carried[i - 1, speaker] += weights[i - 1, j]
            lies[:, i - 1] += weights[i - 1, j] * attack
    in_slots = jnp.asarray(by_slot[0])
    np.testing.assert_allclose(
        mean(network, in_slots[None], *arrays), expected, rtol=0, atol=1e-14 * FLEET
    )
    found = mean_added(network, in_slots[None], arrays[1])
    np.testing.assert_allclose(found, lies, rtol=0, atol=1e-14 * FLEET)
    np.testing.assert_allclose(matrix(network, in_slots), carried, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(network.retained(in_slots[None]), weights)


def test_what_slots_have_is_told_link_by_link():
    """Sums over a source's identities, none of a slot that a listener leaves or a cell lacks."""
    graph = of_matrix(np.array([[1, 0, 1, 0], [0, 1, 0, 1], [0, 0, 1, 0]]))
    slots = hearing.slots(graph, np.where(graph.sources == 2, 2, 1))
    assert slots.tolist() == [
        [0, 1, 2],
        [2, 3, 2],
        [2, 2, 3],
    ]  # the last but one left over, and the last
    slots = np.concatenate([slots, np.full((1, 3), -1)])
    values = np.array([[1, 2, 3], [4, 5, 6], [7, 0, 0], [9, 9, 9]])
    assert hearing.by_link(graph, values, slots).tolist() == [1, 11, 2, 5, 9]
    several = np.stack([values, 10 * values])
    assert hearing.by_link(graph, several, slots)[1].tolist() == [10, 110, 20, 50, 90]


def test_axes_may_have_weights_of_their_own():
    """Each axis has the mean by its own weights; who is retained is the mean of both."""
    rng = np.random.default_rng(0)
    whole = rng.random((FLEET, FLEET + 1)) * (1 - np.eye(FLEET, FLEET + 1, 1))
    slots = of_matrix(whole).sources.T
    none = np.zeros(slots.shape, bool)
    heard = hearing.Hearing(slots, slots, none, hearing.of_transmitters(slots))
    network = jax.tree.map(jnp.asarray, heard)
    sent, silence = jnp.asarray(rng.normal(size=(2, FLEET + 1))), jnp.zeros((2, FLEET))
    by_axis = jnp.asarray(rng.random((2, *slots.shape)))
    both = mean(network, by_axis, sent, silence)
    for axis in range(2):
        alone = mean(network, by_axis[axis][None], sent, silence)
        np.testing.assert_allclose(both[axis], alone[axis], rtol=1e-14)
    known = matrix(network, by_axis.mean(axis=0))
    np.testing.assert_allclose(network.retained(by_axis), known, rtol=1e-14)
