"""W-MSR, the weighted mean-subsequence-reduced rule, axis by axis."""

from typing import Any

from pydantic import Field

from jaxnet.kinds.defences import Defence, Neighbourhood
from jaxnet.model.graph import Links, Weights
from jaxnet.model.retained import AnySubset, any_untrusted


class WMSR(Defence):
    """Drop, axis by axis, up to F values above one's own and up to F below, the most extreme first.

    Trusted sources, the navigator, are never dropped. Source: LeBlanc, Zhang, Koutsoukos and Sundaram,
    Resilient asymptotic consensus in robust networks, 2013.
    """

    kind = "w_msr"

    F: int = Field(default=1, ge=0, description="most attacked sources that a vehicle reckons with")

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """By counting, of those who are farther out on the same side, whether they are less than F.

        Of equal values the one in the lower slot is dropped first.
        """
        xp = own[0].__array_namespace__()
        above = received[0] - own[0][:, None]
        candidate = ((around.weights > 0) & ~around.trusted[:, :, None])[None]
        order = xp.arange(above.shape[1])
        first = (order[:, None] < order[None])[None, :, :, None, None]  # the other slot before this one
        other, this = above[:, :, None], above[:, None]
        same = candidate[:, :, None] & (xp.sign(other) == xp.sign(this)) & (this != 0)
        beyond = (xp.abs(other) > xp.abs(this)) | ((other == this) & first)
        dropped = candidate & (above != 0) & ((same & beyond).sum(axis=1) < self.F)
        return ~dropped, memory

    def may_drop(self, weights: Weights, trusted: Links) -> AnySubset:
        """F on either side."""
        return any_untrusted(weights, trusted, 2 * self.F)

    def describe(self, weights: Weights, attacked: Links, trusted: Links) -> dict[str, str]:
        """What is known of it."""
        return {
            "defence": f"W-MSR, F = {self.F}, navigator exempt; whom it retains is not bounded here, so no"
            " bound is told"
        }
