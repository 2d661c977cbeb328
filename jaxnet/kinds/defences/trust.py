from typing import Annotated, Literal

import numpy as np

from jaxnet.kinds.defences import Neighbourhood, Sparing
from jaxnet.kinds.fields import Number, Positive, Within, setting
from jaxnet.kinds.shapes import SlotNumbers, SlotVectors, VehicleVectors
from jaxnet.model import safety
from jaxnet.model.plane import length
from jaxnet.model.retained import everybody
from jaxnet.model.safety import Safe

OF_RANDOM_TRUTHS = (
    "random: by earned trust, almost surely in the end, for any number of attacked vehicles, if no "
    "vehicle can be cut off before"
)


class Trust(Sparing):
    """Retain the sources whose sum β of `α - 1/2` over the ticks is ≥ 0, or else the greatest β.

    α is an observation of a source at a tick, in one of two ways:

    - `deviation`: `radius / (radius + Δ)`, where Δ is the distance from the position received from
      the first trusted source, or from the vehicle itself if it trusts no source.
    - `random`: 1 or 0, correct with probability `accuracy`, as from a measurement that does not
      depend on what is received. After t ticks the probability to misjudge a source is at most
      `exp(-2 t (accuracy - 1/2)²)`. So in the end every decision is almost surely right, however
      many sources are attacked, where no vehicle can be cut off before.

    Trusted sources are retained unless `drop_trusted` is true. Source: Yemini, Nedić, Goldsmith and
    Gil, Characterizing trust and resilience in distributed consensus for cyberphysical systems,
    2022. The α of `deviation` is ours.
    """

    guarantee = "none: whoever stays within the radius is believed"

    observation: Literal["deviation", "random"] = setting(
        "deviation", "what is observed of a source: its deviation, or at random the truth"
    )
    radius: Positive = setting(20.0, "[m], of deviations: the distance at which α = 1/2")
    accuracy: Annotated[Number, Within(gt=0.5, le=1.0)] = setting(
        0.8, "of random observations: the probability that one is right"
    )

    def promise(self):
        return OF_RANDOM_TRUTHS if self.observation == "random" else self.guarantee

    def draws(self):
        return super().draws() or self.observation == "random"

    def start(self, around):
        return around.weights.__array_namespace__().zeros(around.weights.shape)

    def decide(self, own, received, last, memory, around):
        xp, heard = own[0].__array_namespace__(), around.weights > 0
        observed = memory + self.alpha(own[0], received[0], around) - 0.5
        memory = observed if around.arrived is None else xp.where(around.arrived, observed, memory)
        greatest = xp.where(heard, memory, -xp.inf).max(axis=0, keepdims=True)
        return self.spared(around) | (memory >= xp.minimum(greatest, 0.0)), memory

    def alpha(
        self, own: VehicleVectors, position: SlotVectors, around: Neighbourhood
    ) -> SlotNumbers:
        if self.observation == "random":
            drawn = self.random(around.time, "observation", "uniform", around.weights.shape[:-1])
            right = drawn < self.accuracy[None, None]
            return (right != around.attacked).astype(float)
        xp, trusts = own.__array_namespace__(), (around.weights > 0) & around.trusted[:, :, None]
        first, radius = trusts & (xp.cumsum(trusts, axis=0) == 1), self.radius[None, None]
        trusted = xp.where(first[None], position, 0.0).sum(axis=1)
        there = xp.where(trusts.any(axis=0)[None], trusted, own)
        return radius / (radius + length(position - there[:, None]))

    def safe(self, graph, attacked, trusted):
        """The default reasons and "by earned trust".

        In the end no attacked source is believed, unless it is spared or its listener hears no
        honest source.
        """
        reasons, everyone = super().safe(graph, attacked, trusted), np.ones(graph.vehicles, bool)
        joined = safety.stay_joined(self.may_drop(graph, trusted), everyone).all()
        if self.observation == "random" and joined:
            alone = (attacked == graph.heard).all(axis=1, keepdims=True)
            believed = attacked & (self.spares(trusted) | alone)
            ends = safety.greatest(everybody(graph), believed, np.zeros(graph.vehicles, int))
            reasons.append(Safe("by earned trust", ends))
        return reasons
