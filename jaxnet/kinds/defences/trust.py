"""Trust that is earned."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from jaxnet.kinds.defences import Neighbourhood, Sparing
from jaxnet.kinds.fields import Number, Positive, Within
from jaxnet.model import safety
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.plane import length
from jaxnet.model.retained import everybody
from jaxnet.model.safety import Safe


class Trust(Sparing):
    """Retain the sources whose sum β of `α - 1/2` over the ticks is not negative, of none the greatest.

    α is what is observed of a source at a tick. From its deviation: `radius / (radius + Δ)`, Δ the distance
    to what is received of the first trusted source, or to oneself where there is none. At random: 1 or 0,
    right with probability `accuracy`, as of a measurement that has nothing to do with what is received; after
    t ticks a source is misjudged with a probability of at most `exp(-2 t (accuracy - 1/2)²)`. Trusted sources
    are retained, unless they may be dropped. Source: Yemini, Nedić, Goldsmith and Gil, Characterizing trust
    and resilience in distributed consensus for cyberphysical systems, 2022; the α of deviations is ours.
    """

    kind = "trust"
    guarantee = (
        "random: by earned trust, almost surely in the end, however many are attacked, where nobody can be"
        " cut off meanwhile; deviation: none, who stays within the radius is believed"
    )

    observation: Literal["deviation", "random"] = Field(
        default="deviation", description="what is observed of a source: its deviation, or at random the truth"
    )
    radius: Positive = Field(default=20.0, description="[m], of deviations: the distance at which α = 1/2")
    accuracy: Annotated[Number, Within(gt=0.5, le=1.0)] = Field(
        default=0.8, description="of random observations: the probability that one is right"
    )

    def draws(self) -> bool:
        """Random observations too."""
        return super().draws() or self.observation == "random"

    def start(self, around: Neighbourhood) -> Any:
        """Nobody has earned anything."""
        return around.weights.__array_namespace__().zeros(around.weights.shape)

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """By the sums so far."""
        xp, heard = own[0].__array_namespace__(), around.weights > 0
        if self.observation == "random":
            alpha = self.random_alpha(around)
        else:
            alpha = self.alpha(own[0], received[0], around)
        memory = memory + alpha - 0.5
        greatest = xp.where(heard, memory, -xp.inf).max(axis=0, keepdims=True)
        return self.spared(around) | (memory >= xp.minimum(greatest, 0.0)), memory

    def random_alpha(self, around: Neighbourhood) -> Any:
        """1 or 0, the truth with probability `accuracy`."""
        from jax.random import uniform

        drawn = self.random(around.time, "observation", uniform, around.weights.shape[:-1])
        right = drawn < self.accuracy[None, None]
        return (right != around.attacked).astype(float)

    def alpha(self, own: Any, position: Any, around: Neighbourhood) -> Any:
        """`radius / (radius + Δ)`."""
        xp, trusts = own.__array_namespace__(), (around.weights > 0) & around.trusted[:, :, None]
        first, radius = trusts & (xp.cumsum(trusts, axis=0) == 1), self.radius[None, None]
        word = xp.where(first[None], position, 0.0).sum(axis=1)
        there = xp.where(trusts.any(axis=0)[None], word, own)
        return radius / (radius + length(position - there[:, None]))

    def safe(self, graph: Digraph, attacked: Links, trusted: Links) -> list[Safe]:
        """In the end nobody attacked is believed but who is spared, or heard with nobody else."""
        reasons, heard, spared = super().safe(graph, attacked, trusted), graph.heard, self.spares(trusted)
        drops, everyone = self.may_drop(graph, trusted), np.ones(graph.vehicles, bool)
        if self.observation == "random" and safety.stay_joined(drops, everyone).all():
            believed = attacked & (spared | (attacked == heard).all(axis=1, keepdims=True))
            ends = safety.greatest(everybody(graph), believed, np.zeros(graph.vehicles, int))
            reasons.append(Safe("by earned trust", ends))
        return reasons
