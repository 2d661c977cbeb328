"""Trust that is earned."""

from typing import Any

from pydantic import Field

from jaxnet.kinds.defences import Defence, Neighbourhood
from jaxnet.kinds.fields import Positive
from jaxnet.model.plane import length


class Trust(Defence):
    """Retain the sources whose sum of `α - 1/2` over the ticks is not negative.

    `α = radius / (radius + Δ)` of the distance Δ to what is received of the first trusted source, or to
    oneself where there is none: over 1/2 within the radius, else under it. Trusted sources are always
    retained. The sums are those of Yemini, Nedić, Goldsmith and Gil, Characterizing trust and resilience in
    distributed consensus for cyberphysical systems, 2022; this α is ours, and nothing is proved of it.
    """

    kind = "trust"

    radius: Positive = Field(default=20.0, description="[m]")

    def start(self, around: Neighbourhood) -> Any:
        """Nobody has earned anything."""
        return around.weights.__array_namespace__().zeros(around.weights.shape)

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """By the sums so far."""
        xp = own[0].__array_namespace__()
        trusts = (around.weights > 0) & around.trusted[:, :, None]
        first, radius = trusts & (xp.cumsum(trusts, axis=0) == 1), self.radius[None, None]
        word = xp.where(first[None], received[0], 0.0).sum(axis=1)
        there = xp.where(trusts.any(axis=0)[None], word, own[0])
        distance = length(received[0] - there[:, None])
        memory = memory + radius / (radius + distance) - 0.5
        return trusts | (memory >= 0), memory
