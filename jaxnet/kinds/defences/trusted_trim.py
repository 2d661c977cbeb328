"""Trimming by trusted redundancy, the paper's defence (section 5.1)."""

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Bool, Int
from pydantic import Discriminator, Field

from jaxnet.kinds.defences import Defence, Neighbourhood, by_listener
from jaxnet.kinds.fields import MARK, NotNegative, member, names_distribution
from jaxnet.kinds.kind import Fault, numbered, unknown_vehicles
from jaxnet.model import graph, hearing
from jaxnet.model.graph import Links, Weights
from jaxnet.model.retained import AnySubset
from jaxnet.model.wording import ranges

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


class TrustedTrim(Defence):
    """Drop the ϑ_i untrusted neighbours that are farthest, on average, from the trusted ones.

    A vehicle trims if it hears at least 2ϑ_i + 1 sources, ϑ_i of them trusted; the others retain everybody.
    """

    kind = "trusted_trim"
    ticks_only: ClassVar[bool] = False
    untraced: ClassVar[frozenset[str]] = frozenset({"label", "theta", "trusted"})

    theta: Annotated[
        Annotated[Theta, member("all")] | Annotated[dict[int, Theta], member("each")],
        Discriminator(whole_or_each),
    ] = Field(default=1, description="ϑ for all vehicles, or {vehicle: ϑ}, 0 for those not named")
    trusted: dict[int, list[int]] = Field(
        default={}, description="{vehicle: [sources]} trusted besides the navigator"
    )
    tolerance: NotNegative = Field(
        default=1e-9, description="[m], by which who was dropped last counts as farther (SCIENCE O8)"
    )

    def trusts(self, weights: Weights) -> Links:
        """The navigator wherever it is heard, and those listed."""
        return graph.trusted_links(weights, self.trusted)

    def shared(self, weights: Weights, trusted: Links, sources: np.ndarray) -> Trimming:
        """ϑ, and where the trusted sources are heard."""
        slots = hearing.by_slot(trusted, sources)
        most = max(1, int(slots.sum(axis=0).max()))
        references = np.argsort(~slots, axis=0, kind="stable")[:most]
        return Trimming(by_listener(self.theta, len(weights)), references)

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """Drop the greatest scores, ties to the lower number.

        `tolerance` [m] is added to the score of those dropped last, so that rounding alone changes nobody's
        mind (SCIENCE O8).
        """
        from jaxnet.model import trimming

        heard = around.weights > 0
        trusts = heard & around.trusted[:, :, None]
        candidates = heard & ~trusts & trimming.condition(heard, trusts, around.shared.theta)[None]
        score = trimming.deviation(received[0], trusts, around.shared.references)
        score = trimming.stiffened(score, last, self.tolerance)
        return ~trimming.farthest(score, candidates, around.shared.theta), memory

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
