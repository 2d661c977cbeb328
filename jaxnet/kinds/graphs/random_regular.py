"""Random regular graphs."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Bool
from pydantic import Field

from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.kind import Fault
from jaxnet.model import hearing
from jaxnet.model.graph import Links, Weights


class RandomRegular(Graph):
    """Everybody hears the navigator and `degree` others, who hear them too; drawn at random.

    One graph is drawn for the study, by `seed`; with `redraw` every lane has its own, by the study's seed.
    """

    kind = "random_regular"

    degree: int = Field(default=4, ge=1, description="vehicles that each one hears")
    navigator_weight: float = Field(
        default=0.1, gt=0, lt=1, description="of the navigator's word, the neighbours share the rest"
    )
    seed: int = Field(default=0, ge=0, description="of the graph")
    redraw: bool = Field(default=False, description="whether each lane has a graph of its own")

    def weights(self, vehicles: int) -> Weights:
        """The study's graph; where lanes have their own, one like theirs."""
        return self.weighted(drawn_regular(vehicles, self.degree, np.random.default_rng(self.seed)))

    def weighted(self, heard: Bool[np.ndarray, "m m"]) -> Weights:
        """Equal weights of those that are heard beside the navigator's."""
        share = (1.0 - self.navigator_weight) / self.degree
        return np.hstack([np.full((len(heard), 1), self.navigator_weight), heard * share])

    def links(self, vehicles: int) -> Links:
        """Where lanes have their own graph, anybody may hear anybody."""
        if not self.redraw:
            return super().links(vehicles)
        return np.hstack([np.ones((vehicles, 1), bool), ~np.eye(vehicles, dtype=bool)])

    def differs(self) -> bool:
        """As `redraw` says."""
        return self.redraw

    def lane_weights(self, draw: Any, vehicles: int, sources: Any) -> Any:
        """The graph of each lane."""
        graphs = (drawn_regular(vehicles, self.degree, random) for random in draw.generators("topology"))
        return np.stack([hearing.by_slot(self.weighted(each), sources) for each in graphs])

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """There must be such a graph."""
        m, keys = scenario.vehicles, ("topology.degree", "topology", "vehicles")
        if self.degree >= m:
            yield Fault(keys, f"must be less than the {m} vehicles (got {self.degree})")
        elif self.degree * m % 2:
            yield Fault(keys, f"times {m} vehicles must be even, for links are mutual (got {self.degree})")


def drawn_regular(vehicles: int, degree: int, random: np.random.Generator) -> Bool[np.ndarray, "m m"]:
    """Who hears whom in a random regular graph, by pairing free ends until all are paired.

    Source: Steger and Wormald, Generating random regular graphs quickly, 1999; nearly uniform.
    """
    while True:
        heard = np.zeros((vehicles, vehicles), bool)
        ends = np.repeat(np.arange(vehicles), degree)
        while len(ends):
            ends = random.permutation(ends)
            left = []
            for i, j in ends.reshape(-1, 2):
                if i == j or heard[i, j]:
                    left += [i, j]
                else:
                    heard[i, j] = heard[j, i] = True
            if len(left) == len(ends) and not any_pair(heard, left):
                break
            ends = np.array(left, int)
        else:
            return heard


def any_pair(heard: Bool[np.ndarray, "m m"], ends: list[Any]) -> bool:
    """Whether two of these free ends may still be joined."""
    free = np.unique(ends)
    return bool((~heard[np.ix_(free, free)] & ~np.eye(len(free), dtype=bool)).any())
