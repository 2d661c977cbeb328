"""Trimming by trusted redundancy, the paper's defence (section 5.1)."""

from functools import reduce
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from jaxnet.kinds.defences import BearsTheta, Neighbourhood, Sparing
from jaxnet.kinds.fields import NotNegative, Positive, setting, value_range
from jaxnet.kinds.kind import vehicle_numbers
from jaxnet.kinds.shapes import (
    AnyCounts,
    AnyMask,
    AxisSlotNumbers,
    LaneGains,
    LaneTimes,
    SlotJets,
    SlotMask,
    SlotNumbers,
    VehicleVectors,
)
from jaxnet.lazy import LazyModule
from jaxnet.model import hearing, retained, safety
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.plane import length
from jaxnet.model.retained import DropPolicy
from jaxnet.model.safety import Safe
from jaxnet.model.wording import count, plural_s, ranges

if TYPE_CHECKING:
    from jaxnet.model import control, trimming
else:
    trimming = LazyModule("jaxnet.model.trimming")
    control = LazyModule("jaxnet.model.control")

Score = Literal["position", "jets", "feedback", "announced"]

# [m, or as a score]; a greater tolerance leaves an error that is none of rounding
OF_ROUNDING = 1e-9
OF_ANNOUNCEMENTS = (
    "announced: by majority, where A1 to A3 of docs/guarantees.md hold, if liars announce what "
    "they carry (B1), no vehicle stands still and nobody is cut off; none against a liar that "
    "announces 0, or what it would announce unattacked"
)
OF_BLURRED = (
    "announced: none where scores are filtered, or have noise or a tolerance above 1e-9: "
    "announcements shrink to what these leave (docs/guarantees.md)"
)


class Trimming(NamedTuple):
    """ϑ and the slots of trusted sources, which all lanes share.

    `references` has as many rows as the listener with the most trusted sources needs.
    """

    theta: Int[np.ndarray, " m"]
    references: Int[np.ndarray, "most m"]


class Recollection(NamedTuple):
    """The memory of trimming; None for a part that the score does not need.

    `candidates` and `shares` are those of all sources. They serve where every message arrives.
    """

    candidates: SlotMask  # who may be dropped
    shares: Any  # (most, m, lanes), of trusted sources in a score
    score: SlotNumbers | None  # low-pass filtered
    time: LaneTimes | None  # [s] of the last tick
    announced: VehicleVectors | None  # ρ, which it announces itself


class TrustedTrim(BearsTheta, Sparing):
    """Drop the ϑ_i untrusted neighbours that are farthest, on average, from the trusted ones.

    `score` chooses the distance: of positions, as in the paper, of positions, velocities and
    accelerations together, or of what the law computes from them. A vehicle trims if it hears at
    least 2ϑ_i + 1 sources, ϑ_i of them trusted. All other vehicles retain every source.

    With `score: announced`, vehicles announce what disturbs them, `ρ_i = R(y_i) - R(y_0)`, computed
    from the announcements of their retained sources at the last tick. A vehicle drops the ϑ_i
    sources with the greatest announcements if it hears more than ϑ_i sources (theorems.md O11). The
    guarantee of this score is by majority, where A1 to A3, B1, B2 and C1 to C3 of guarantees.md
    hold: B1 is that liars announce what they carry. Noise, a filter, and a tolerance above 1e-9 end
    it; `jaxnet check` states it in full.
    """

    words = "trusted trimming"
    guarantee = "none: known attacks pass its scores of positions, of jets and of feedback"

    tolerance: NotNegative = setting(
        OF_ROUNDING,
        "[m], added to the score of a source that was dropped at the last tick (numerics.md O8)",
    )
    score: Score = setting(
        "position",
        "what is compared: position, the paper's; jets, position, velocity and "
        "acceleration; feedback, P of these; announced, the disturbance that sources announce",
    )
    first_announcement: NotNegative = setting(
        1.0,
        "[m/s³], standard deviation on each axis of the first announcements; with 0 "
        "and without noise the rule notices the smallest inconsistent message",
    )
    filter: Positive | None = setting(None, "[s], time constant of a low-pass filter on scores")

    def needs_ticks(self):
        return self.filter is not None or self.announcing()

    def promise(self):
        if not self.announcing():
            return self.guarantee
        return OF_BLURRED if self.blurs() else OF_ANNOUNCEMENTS

    def blurs(self) -> bool:
        """Whether decisions do not compare what sources announce now, but for rounding."""
        tolerance = value_range(self.tolerance)[1]
        return self.filter is not None or self.noise != 0 or tolerance > OF_ROUNDING

    def announcing(self):
        return self.score == "announced"

    def draws(self):
        return super().draws() or self.wakes()

    def wakes(self) -> bool:
        """Whether vehicles announce random vectors at first."""
        return self.announcing() and self.first_announcement != 0

    def drawn(self, draw, name):
        found = super().drawn(draw, name)
        return found if self.wakes() else found.with_values(first_announcement=None)

    def shared(self, graph, trusted, sources):
        slots = hearing.by_slot(graph, trusted, sources)
        most = max(1, int(slots.sum(axis=0).max()))
        references = np.argsort(~slots, axis=0, kind="stable")[:most]
        return Trimming(self.thetas(graph), references)

    def start(self, around):
        xp, lanes = around.weights.__array_namespace__(), around.weights.shape[1:]
        candidates, shares = self.candidates(around)
        score = time = announced = None
        if self.announcing():
            announced = xp.zeros((2, *lanes))
            if self.first_announcement is not None:
                normal = self.random(around.time, "first announcement", "normal", (2, lanes[0]))
                announced = self.first_announcement[None, None] * normal
        if self.filter is not None:
            score, time = xp.zeros(around.weights.shape), xp.full(lanes[1:], -xp.inf)
        return Recollection(candidates, shares, score, time, announced)

    def candidates(self, around: Neighbourhood) -> tuple[SlotMask, Any]:
        """The sources that may be dropped, and the shares of trusted sources in a score."""
        heard, theta = around.weights > 0, around.shared.theta
        trusts = heard & around.trusted[:, :, None]
        trims = self.trims(heard.sum(axis=0), trusts.sum(axis=0), theta[:, None])
        dropped = heard & ~self.spared(around) & trims[None]
        if self.announcing():
            return dropped, None
        return dropped, trimming.trusted_shares(trusts, around.shared.references)

    def announcement(self, memory):
        return memory.announced if self.announcing() else None

    def decide(self, own, received, last, memory, around):
        """Drop the sources with the greatest scores; of equal scores the lower number is dropped
        first.

        `tolerance` [m] is added to the score of the sources dropped last, so that rounding alone
        changes no decision (numerics.md O8). A vehicle announces `ρ_i = Σ w̃_ij ρ_j` over its
        retained sources.
        """
        candidates, shares = memory.candidates, memory.shares
        if around.arrived is not None:
            candidates, shares = self.candidates(around)
        if self.announcing():
            score = length(around.announced)
        else:
            vectors = self.compared(received, around.gain)
            score = trimming.deviation(vectors, shares, around.shared.references)
        if self.filter is not None:
            score = trimming.filtered(score, memory.score, around.time - memory.time, self.filter)
            if around.arrived is not None:
                score = score.__array_namespace__().where(around.arrived, score, memory.score)
            memory = memory._replace(score=score, time=around.time)
        score = trimming.stiffened(score, last, self.tolerance)
        decision = ~trimming.farthest(score, candidates, around.shared.theta)
        if self.announcing():
            weights = retained.in_force(around.weights, decision)
            memory = memory._replace(announced=(weights * around.announced).sum(axis=1))
        return decision, memory

    def trims(self, heard: AnyCounts, trusted: AnyCounts, theta: AnyCounts) -> AnyMask:
        """Vehicles that trim, by the numbers of sources and of trusted sources that they hear."""
        if self.announcing():
            return heard > theta
        return (heard >= 2 * theta + 1) & (trusted >= theta)

    def compared(self, received: SlotJets, gain: LaneGains) -> AxisSlotNumbers:
        """The vectors that scores compare: (axes, slots, m, lanes)."""
        if self.score == "jets":
            return received[0].__array_namespace__().concatenate(received)
        return control.feedback(gain, received) if self.score == "feedback" else received[0]

    def retained(self, graph, trusted):
        """A trimming vehicle drops ϑ_i sources, or all unspared ones if it hears fewer."""
        links = graph.heard & ~self.spares(trusted) & self.protected(graph, trusted)[:, None]
        return DropPolicy(graph, links, np.minimum(self.thetas(graph), links.sum(axis=1)))

    def asks(self):
        return "over ϑ sources" if self.announcing() else "2ϑ + 1 sources, of which ϑ are trusted"

    def protected(self, graph: Digraph, trusted: Links) -> Bool[np.ndarray, " m"]:
        theta = self.thetas(graph)
        return self.trims(graph.heard.sum(axis=1), trusted.sum(axis=1), theta) & (theta > 0)

    def starved(self, graph, trusted, share):
        """By the binomial distributions of the trusted and of the other messages that arrive."""
        theta, trusts = self.thetas(graph), trusted.sum(axis=1)
        numbers = np.stack([theta, trusts, graph.heard.sum(axis=1) - trusts], axis=1)
        found = [0.0]
        for most, *sources in np.unique(numbers[self.protected(graph, trusted)], axis=0):
            known, others = (np.arange(number + 1) for number in sources)
            arrive = [
                reduce(np.convolve, [[share, 1 - share]] * n, np.ones(1)) for n in sources
            ]  # the probability of each number of messages
            trims = self.trims(known[:, None] + others, known[:, None], most)
            found.append(float((arrive[0][:, None] * arrive[1])[~trims].sum()))
        return max(found)

    def safe(self, graph, attacked, trusted):
        """The default reasons, and "by majority" of theorem 3 for announcements without blur."""
        reasons = super().safe(graph, attacked, trusted)
        if not self.announcing() or self.blurs():
            return reasons
        drops = self.retained(graph, trusted).believed()
        inside = safety.greatest(drops, attacked, drops.number)
        shrinks = safety.contraction(drops, inside)
        delta, why = value_range(self.tolerance)[1], "by majority"
        if not shrinks:
            return [*reasons, Safe(why, inside, True, np.inf if delta else 0.0)]
        steps, factor = shrinks
        why += f", shrinking to {factor:.3g} in {count(steps, 'tick')}"
        # M over δ, by corollary 1 with the factor for 1 - ω^D
        most = steps / (1 - factor) + steps - 1
        return [*reasons, Safe(why, inside, True, (2 * most + 1) * delta)]

    def outnumbered(self, graph, attacked, trusted):
        """With more attacked sources than ϑ, 0 if unprotected, or an attacked trusted one."""
        protected, theta = self.protected(graph, trusted), self.thetas(graph)
        more = attacked.sum(axis=1) > np.where(protected, theta, 0)
        return more | (attacked & trusted).any(axis=1)

    def describe(self, graph, attacked, trusted):
        theta, meets = self.thetas(graph), self.protected(graph, trusted)
        outnumbered = meets & self.outnumbered(graph, attacked, trusted)
        values = ", ".join(str(value) for value in sorted(set(theta.tolist())))
        line = f"ϑ = {values}; the rule asks {self.asks()}"
        broken = []
        if not meets.any():
            broken.append("no vehicle is protected, each retains all its sources")
        elif not meets.all():
            applies, others = (ranges(vehicle_numbers(each)) for each in (meets, ~meets))
            broken.append(f"the rule applies at {applies} only ({others} unprotected)")
        if outnumbered.any():
            where = ranges(vehicle_numbers(outnumbered))
            s = plural_s(where)
            broken.append(f"{where} hear{s} more than ϑ attacked sources, or trust{s} one")
        told = f"broken: {', and '.join(broken)}" if broken else "holds"
        return {"trimming": f"{line}; Assumption 2 {told}"}
