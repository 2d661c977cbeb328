"""Lanes in which two vehicles start nearer than a safety filter's distance D: no filter helps."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxnet.config.keys import Config, Scenario

MOST_GAPS = 2**21  # between vehicles, over the lanes of a cell that are looked at


def start_separations(
    study: Config, scenario: Scenario, samples: Sequence[int]
) -> Float[np.ndarray, " lanes"]:
    """Least distance [m] of two steered points at t = 0, in each lane of a cell."""
    from jaxnet.lanes.draws import Draw  # imports jax, which `check` needs for nothing else
    from jaxnet.lanes.jobs import source_of, start_of

    vehicles, formation = scenario.vehicles, scenario.formation
    draw = Draw(source_of(study, scenario), samples, vehicles)
    own = scenario.vehicle.drawn(draw, "vehicle")
    places = np.asarray(own.output_jets(start_of(scenario, own, draw))[0])
    if formation.present:
        offsets = formation.drawn(draw, "formation").jets(np.zeros(len(samples)), vehicles)
        places = places + np.asarray(offsets)[0]
    gaps = np.hypot(*(places[:, :, None] - places[:, None]))
    gaps[np.diag_indices(vehicles)] = np.inf
    return gaps.min(axis=(0, 1))


def near_starts_words(study: Config, scenario: Scenario) -> str:
    """How many lanes of a cell start nearer than its filter's D; "" for none."""
    limit = scenario.filter.asks()
    if limit is None:
        return ""
    samples = range(min(study.most_samples, MOST_GAPS // scenario.vehicles**2 + 1))
    near = int((start_separations(study, scenario, samples) < limit).sum())
    told = f"in {near:,} of {len(samples):,} lanes two vehicles start nearer than D = {limit:g} m"
    return f"{told}, so no filter can keep them D apart" if near else ""
