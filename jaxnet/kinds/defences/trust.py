from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from jaxnet.kinds.defences import Neighbourhood, Sparing
from jaxnet.kinds.fields import (
    DiscreteChoice,
    NotNegative,
    Number,
    OneNumber,
    OneOf,
    Positive,
    Probability,
    Record,
    Uniform,
    Within,
    is_drawn,
    mean,
    setting,
)
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.protocols import LaneDraw
from jaxnet.kinds.shapes import SlotNumbers, SlotVectors, VehicleVectors
from jaxnet.kinds.ticks import TICK_ROUNDING
from jaxnet.lazy import jnp
from jaxnet.model import safety
from jaxnet.model.plane import length
from jaxnet.model.retained import everybody
from jaxnet.model.safety import Safe

SUM_ROUNDING = 1e-9  # of a sum β, by which one of exactly 0 may miss 0
OF_RANDOM_TRUTHS = (
    "random: by earned trust, almost surely in the end, for any number of attacked vehicles, if no "
    "vehicle can be cut off before"
)

if TYPE_CHECKING:
    Observation = Any  # the probability that α = 1, or the distribution of α
else:
    Observation = Annotated[
        float | Uniform | DiscreteChoice,
        OneOf("must be a probability, {uniform: [a, b]} or {choice: [...]}"),
        Within(ge=0.0, le=1.0),
    ]


class Observed(Record):
    """What an observation of an honest source is, and of a liar."""

    honest: Observation = Field(description="of an honest source: its mean is over 1/2")
    liar: Observation = Field(description="of an attacked source: its mean is under 1/2")


class Anchoring(Record):
    """The share `λ = scale · exp(-rate · t)` by which vehicles are held to their starts."""

    scale: Probability = Field(description="share at t = 0")
    rate: NotNegative = Field(description="[1/s], of its decay")


class Trust(Sparing):
    """Retain the sources whose sum β of `α - 1/2` over the ticks is ≥ 0, or else the greatest β.

    α is an observation of a source at a tick, in one of two ways:

    - `deviation`: `radius / (radius + Δ)`, where Δ is the distance from the position received from
      the first trusted source, or from the vehicle itself if it trusts no source.
    - `random`: 1 or 0, correct with probability `accuracy`, as from a measurement that does not
      depend on what is received; or as `observed` says. After t ticks the probability to misjudge
      a source is at most `exp(-2 t (E α - 1/2)²)`. So in the end every decision is almost surely
      right, however many sources are attacked, where no vehicle can be cut off before.

    Trusted sources are retained unless `drop_trusted` is true. Under a local law `wait` and
    `anchor` hold vehicles to their starts by a share λ(t): `q = -λ P(y - y(0)) + (1 - λ) q_local`.

    Source: Yemini, Nedić, Goldsmith and Gil, Characterizing trust and resilience in distributed
    consensus for cyberphysical systems, 2022; of `anchor` Ballotta and Yemini, The role of
    confidence for trust-based resilient consensus, 2024. The α of `deviation` is ours.
    """

    guarantee = "none: whoever stays within the radius is believed"

    observation: Literal["deviation", "random"] = setting(
        "deviation", "what is observed of a source: its deviation, or at random the truth"
    )
    radius: Positive = setting(20.0, "[m], of deviations: the distance at which α = 1/2")
    accuracy: Annotated[Number, Within(gt=0.5, le=1.0)] = setting(
        0.8, "of random observations: the probability that one is right"
    )
    observed: Observed | None = setting(
        None,
        "of random observations, in place of `accuracy`: each α is the probability of 1, or "
        "{uniform: [a, b]} or {choice: […]}, drawn at each tick",
    )
    wait: NotNegative = setting(0.0, "[s], time until which nobody moves", title="time to wait")
    anchor: Anchoring | None = setting(
        None, "the share λ = c e^(-γ t) by which vehicles are held to their starts after the wait"
    )

    off_at_zero = Sparing.off_at_zero | {"wait"}

    def promise(self):
        return OF_RANDOM_TRUTHS if self.observation == "random" else self.guarantee

    def draws(self):
        return super().draws() or self.observation == "random"

    def observes(self):
        drawn = self.observed is None and is_drawn(self.accuracy)
        if self.observation != "random" or drawn:
            return None
        wait = 0.0 if is_drawn(self.wait) else self.wait
        if self.observed is None:
            return self.accuracy, 1.0 - self.accuracy, wait
        return self.observed.honest, self.observed.liar, wait

    def anchors(self):
        waits = self.wait is not None and not (isinstance(self.wait, float) and self.wait == 0)
        return waits or self.anchor is not None

    def faults(self, scenario):
        yield from super().faults(scenario)
        if self.observed is None:
            return
        if self.observation != "random":
            yield Fault(("defence.observed", "defence.observation"), "needs observation: random")
        honest, liar = map(mean, (self.observed.honest, self.observed.liar))
        if not honest > 0.5 > liar:
            told = "the mean of honest must be over 1/2, that of liar under 1/2"
            yield Fault(("defence.observed",), f"{told} (got {honest:g} and {liar:g})")

    def drawn(self, draw, name):
        """The rule with numbers of lanes; observations are drawn at ticks, not for a lane."""
        found = super().drawn(draw, name)
        if self.anchor is not None:
            share = {key: draw.one(number, f"{name}.anchor.{key}") for key, number in self.anchor}
            found = found.with_values(anchor=share)
        if self.observed is not None:
            numbers = {who: observation_numbers(each, draw) for who, each in self.observed}
            found = found.with_values(observed=numbers)
        return found

    def anchoring(self, time):
        if not self.anchors():
            return None
        share, given = jnp.zeros_like(time), vars(self)["anchor"]
        if given is not None:
            share = given["scale"] * jnp.exp(-given["rate"] * time)
        if self.wait is None:
            return share
        return jnp.where(time < self.wait - TICK_ROUNDING, 1.0, share)

    def start(self, around):
        return around.weights.__array_namespace__().zeros(around.weights.shape)

    def decide(self, own, received, last, memory, around):
        xp, heard = own[0].__array_namespace__(), around.weights > 0
        observed = memory + self.alpha(own[0], received[0], around) - 0.5
        memory = observed if around.arrived is None else xp.where(around.arrived, observed, memory)
        greatest = xp.where(heard, memory, -xp.inf).max(axis=0, keepdims=True)
        return self.spared(around) | (memory >= xp.minimum(greatest, -SUM_ROUNDING)), memory

    def alpha(
        self, own: VehicleVectors, position: SlotVectors, around: Neighbourhood
    ) -> SlotNumbers:
        if self.observation == "random":
            drawn = self.random(around.time, "observation", "uniform", around.weights.shape[:-1])
            if self.observed is not None:
                given = vars(self)["observed"]
                honest = observation(given["honest"], drawn)
                # `accuracy: p` is honest: p and liar: 1 - p also by draws.
                liar = observation(given["liar"], 1.0 - drawn)
                return jnp.where(around.attacked, liar, honest)
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


def observation_numbers(given: OneNumber, draw: LaneDraw) -> dict[str, Any]:
    """The numbers of an observation in lanes, (numbers, lanes), by its form."""
    ((form, numbers),) = given if isinstance(given, Record) else [("probability", [given])]
    return {form: draw.same(np.array(numbers)).T}


def observation(given: Mapping[str, Any], uniform: SlotNumbers) -> SlotNumbers:
    """Observations α from uniform numbers, 0 to 1."""
    ((form, numbers),) = given.items()
    numbers = numbers[:, None, None]
    if form == "uniform":
        return numbers[0] + (numbers[1] - numbers[0]) * uniform
    if form == "choice":
        place = jnp.minimum((uniform * len(numbers)).astype(int), len(numbers) - 1)
        return jnp.take_along_axis(numbers, place[None], axis=0)[0]
    return (uniform < numbers[0]).astype(float)
