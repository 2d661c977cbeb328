"""A few lanes, simulated four side by side, for most of a wide chunk would be filling."""

import jax
import numpy as np

from jaxnet.engine import batch

FEW = batch.Machine(devices=1, chunk=4)


def simulate(one):
    """Outcomes of lanes, as `systems.simulate` has them."""
    outcomes = [batch.simulate(each, FEW) for each in getattr(one, "jobs", [one])]
    return jax.tree.map(lambda *parts: np.concatenate(parts), *outcomes)
