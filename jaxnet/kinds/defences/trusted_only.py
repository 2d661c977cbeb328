"""Hearing none but trusted sources: the baseline of every comparison."""

from typing import Any

from jaxnet.kinds.defences import Defence, Neighbourhood
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.retained import AnySubset


class TrustedOnly(Defence):
    """Retain the trusted sources alone; who hears none retains everybody.

    Under any attack a vehicle ends exactly on the navigator that is joined to it by trusted, honest links
    alone.
    """

    kind = "trusted_only"
    guarantee = "by trust: exact for whom no attack reaches over what is retained, whatever it is"

    def needs_ticks(self) -> bool:
        """Nothing is remembered."""
        return False

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """The same at all times."""
        trusts = (around.weights > 0) & around.trusted[:, :, None]
        return trusts | ~trusts.any(axis=0, keepdims=True), memory

    def retained(self, graph: Digraph, trusted: Links) -> AnySubset:
        """All untrusted sources are dropped for good, where there is a trusted one."""
        links = graph.heard & ~trusted & trusted.any(axis=1, keepdims=True)
        return AnySubset(graph, links, links.sum(axis=1))

    def describe(self, graph: Digraph, attacked: Links, trusted: Links) -> dict[str, str]:
        """Whom it makes exact."""
        return {"defence": "trusted sources only, everybody where there is none"}
