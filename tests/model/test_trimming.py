"""The score of a message, in plain loops."""

import jax.numpy as jnp
import numpy as np

from jaxnet.model import trimming


def test_a_score_is_the_mean_distance_to_the_trusted_messages():
    """Two, one and no trusted references; an untrusted slot among the references does not count."""
    random = np.random.default_rng(0)
    received = random.normal(size=(2, 4, 3, 5))  # axes, slots, vehicles, lanes
    trusted = np.zeros((4, 3, 5), bool)
    trusted[[0, 2], 0], trusted[1, 1] = True, True
    references = np.array([[0, 1, 0], [2, 3, 1]])
    given = jnp.asarray(references)
    shares = trimming.trusted_shares(jnp.asarray(trusted), given)
    found = trimming.deviation(jnp.asarray(received), shares, given)
    for slot, vehicle, lane in np.ndindex(4, 3, 5):
        mine = received[:, :, vehicle, lane]
        apart = [
            np.linalg.norm(mine[:, slot] - mine[:, other])
            for other in references[:, vehicle]
            if trusted[other, vehicle, lane]
        ]
        known = np.mean(apart) if apart else 0.0
        np.testing.assert_allclose(found[slot, vehicle, lane], known, rtol=1e-13)
