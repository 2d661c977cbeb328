"""Trimming by trusted redundancy, the paper's defence (section 5.1)."""

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Int
from pydantic import Discriminator, Field

from jaxnet.kinds.defences import Defence, Neighbourhood, by_listener
from jaxnet.kinds.fields import MARK, NotNegative, Positive, member, names_distribution
from jaxnet.kinds.kind import Fault, numbered, unknown_vehicles
from jaxnet.model import graph, hearing
from jaxnet.model.graph import Links, Weights
from jaxnet.model.retained import AnySubset
from jaxnet.model.wording import ranges

Score = Literal["position", "jets", "feedback", "announced"]
Theta = Annotated[int, Field(ge=0, le=10_000)]


def whole_or_each(value: Any) -> str:
    """Whether ϑ means to be one number or one for each vehicle."""
    each = isinstance(value, dict) and not names_distribution(value)
    return MARK + ("each" if each else "all")


class Trimming(NamedTuple):
    """What lanes share: ϑ, and the slots of trusted sources, as many as the listener with most of them
    has.
    """

    theta: Int[np.ndarray, " m"]
    references: Int[np.ndarray, "most m"]


class Recollection(NamedTuple):
    """What a vehicle remembers from tick to tick; () for what its score does not need."""

    score: Any  # (slots, m, lanes), low-pass filtered
    time: Any  # (lanes,) [s] of the last tick
    announced: Any  # (2, m, lanes), ρ, which it announces itself


class TrustedTrim(Defence):
    """Drop the ϑ_i untrusted neighbours that are farthest, on average, from the trusted ones.

    How far is a matter of `score`: of positions, as the paper has it, of positions, velocities and
    accelerations together, of what the law makes of them, or of what sources announce (SCIENCE, section 3). A
    vehicle trims if it hears at least 2ϑ_i + 1 sources, ϑ_i of them trusted; the others retain everybody.
    """

    kind = "trusted_trim"
    untraced: ClassVar[frozenset[str]] = frozenset({"label", "theta", "trusted"})

    theta: Annotated[
        Annotated[Theta, member("all")] | Annotated[dict[int, Theta], member("each")],
        Discriminator(whole_or_each),
    ] = Field(default=1, description="ϑ for all vehicles, or {vehicle: ϑ}, 0 for those not named")
    trusted: dict[int, list[int]] = Field(
        default={}, description="{vehicle: [sources]} trusted besides the navigator"
    )
    tolerance: NotNegative = Field(default=1e-9, description="[m], SCIENCE O8")
    score: Score = Field(
        default="position",
        description="what is compared: position, the paper's; jets, position, velocity and acceleration;"
        " feedback, what the law makes of them; announced, what sources say drives them",
    )
    filter: Positive | None = Field(
        default=None, description="[s], time constant of a low-pass filter on scores"
    )

    def needs_ticks(self) -> bool:
        """What is remembered is remembered from tick to tick."""
        return self.filter is not None or self.score == "announced"

    def trusts(self, weights: Weights) -> Links:
        """The navigator wherever it is heard, and those listed."""
        return graph.trusted_links(weights, self.trusted)

    def shared(self, weights: Weights, trusted: Links, sources: np.ndarray) -> Trimming:
        """ϑ, and where the trusted sources are heard."""
        slots = hearing.by_slot(trusted, sources)
        most = max(1, int(slots.sum(axis=0).max()))
        references = np.argsort(~slots, axis=0, kind="stable")[:most]
        return Trimming(by_listener(self.theta, len(weights)), references)

    def start(self, around: Neighbourhood) -> Any:
        """Nothing was scored yet, and nothing is announced but that nothing drives one."""
        lanes = around.weights.shape[1:]
        xp = around.weights.__array_namespace__()
        score, time = (), ()
        if self.filter is not None:
            score, time = xp.zeros(around.weights.shape), xp.full(lanes[1:], -xp.inf)
        return Recollection(score, time, xp.zeros((2, *lanes)) if self.score == "announced" else ())

    def announcement(self, memory: Any) -> Any:
        """ρ of the last tick."""
        return memory.announced if memory else ()

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """Drop the greatest scores, ties to the lower number.

        `tolerance` [m] is added to the score of those dropped last, so that rounding alone changes nobody's
        mind (SCIENCE O8). Announced is `ρ_i = Σ w̃_ij ρ_j` over the retained, of what they announced.
        """
        from jaxnet.model import retained, trimming

        heard = around.weights > 0
        trusts = heard & around.trusted[:, :, None]
        candidates = heard & ~trusts & trimming.condition(heard, trusts, around.shared.theta)[None]
        score = trimming.deviation(self.compared(received, around), trusts, around.shared.references)
        if self.filter is not None:
            score = trimming.filtered(score, memory.score, around.time - memory.time, self.filter)
            memory = memory._replace(score=score, time=around.time)
        score = trimming.stiffened(score, last, self.tolerance)
        decision = ~trimming.farthest(score, candidates, around.shared.theta)
        if self.score == "announced":
            weights = retained.in_force(around.weights, decision)
            memory = memory._replace(announced=(weights * around.announced).sum(axis=1))
        return decision, memory

    def compared(self, received: Any, around: Neighbourhood) -> Any:
        """What scores compare: (axes, slots, m, lanes)."""
        from jaxnet.model import control

        match self.score:
            case "jets":
                return received[0].__array_namespace__().concatenate(received)
            case "feedback":
                return control.feedback(around.gain, received)
            case "announced":
                return around.announced
        return received[0]

    def retained(self, weights: Weights, trusted: Links) -> AnySubset:
        """A vehicle that trims drops exactly ϑ_i untrusted sources, or all where it hears fewer."""
        theta = by_listener(self.theta, len(weights))
        trims = protected(weights, trusted, theta) & (theta > 0)
        links = (weights > 0) & ~trusted & trims[:, None]
        return AnySubset(weights, links, np.minimum(theta, links.sum(axis=1)))

    def describe(self, weights: Weights, attacked: Links, trusted: Links) -> dict[str, str]:
        """For whom |N_i| ≥ 2ϑ_i + 1 holds with ϑ_i trusted sources, and where more than ϑ_i are attacked."""
        theta = by_listener(self.theta, len(weights))
        meets = protected(weights, trusted, theta) & (theta > 0)
        outnumbered = meets & ((attacked.sum(axis=1) > theta) | (attacked & trusted).any(axis=1))
        values = ", ".join(str(value) for value in sorted(set(theta.tolist())))
        line = f"ϑ = {values}, |N_i| ≥ 2ϑ + 1 with ϑ trusted: "
        if not meets.any():
            return {"trimming": line + "nobody is protected, so everybody keeps whom they hear"}
        line += "holds for every vehicle"
        if not meets.all():
            line = line.removesuffix("every vehicle") + f"{ranges(numbered(meets))} only"
            line += f"; {ranges(numbered(~meets))} unprotected"
        if outnumbered.any():
            line += f"; more than ϑ attacked sources, or a trusted one, at {ranges(numbered(outnumbered))}"
        return {"trimming": line}

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """Whoever is named must exist."""
        m, listed = scenario.vehicles, self.trusted
        yield from unknown_vehicles("defence.trusted", list(listed), m, first=1)
        sources = [source for trusted in listed.values() for source in trusted]
        yield from unknown_vehicles("defence.trusted", sources, m, first=0)
        if isinstance(self.theta, dict):
            yield from unknown_vehicles("defence.theta", list(self.theta), m, first=1)


def protected(weights: Weights, trusted: Links, theta: Int[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Vehicles that meet the trimming condition: at least 2ϑ + 1 heard and ϑ trusted sources."""
    heard = (weights > 0).sum(axis=1)
    return (heard >= 2 * theta + 1) & (trusted.sum(axis=1) >= theta)
