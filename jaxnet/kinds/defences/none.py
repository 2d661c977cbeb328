"""No defence."""

from typing import Any

from jaxnet.kinds.defences import AnyDefence, Neighbourhood
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.retained import AnySubset, everybody


class NoDefence(AnyDefence):
    """Everybody is believed."""

    kind = "none"
    guarantee = "none: everybody is believed"

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """Nobody is dropped, ever."""
        return last, memory

    def retained(self, graph: Digraph, trusted: Links) -> AnySubset | None:
        """Everybody."""
        return everybody(graph)

    def describe(self, graph: Digraph, attacked: Links, trusted: Links) -> dict[str, str]:
        """There is none."""
        return {"defence": "none"}
