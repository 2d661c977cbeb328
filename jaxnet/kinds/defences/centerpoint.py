"""A point in the middle of what is received."""

from typing import Any

from jaxnet.kinds.defences import Neighbourhood, Sparing


class Centerpoint(Sparing):
    """Weigh sources so that their mean is an interior centerpoint of their positions.

    A centerpoint has a third of the n positions received, or more, in each closed half-plane that it lies in.
    So it lies among the honest ones where fewer than a third are attacked, which takes four sources for one.
    Of all centerpoints, a convex polygon, it is the mean of the boundary; of three positions or fewer it is
    their weighted mean. Of the weights that make it those nearest to the graph's, `Σ λ²/w` least, to 1e-8 m
    (where points nearly lie on a line a millionth of their distance). Trusted sources keep no less than their
    weight, without which the navigator would soon reach nobody. Source: Abbas, Shabbir, Li and Koutsoukos,
    Resilient distributed vector consensus using centerpoint, 2022; which interior point is taken is ours.
    """

    kind = "centerpoint"
    guarantee = (
        "none of the motion: with fewer than a third attacked the mean of the positions lies among the honest"
        " ones, but their derivatives are weighed unseen"
    )

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """Weights, which are normalised afterwards."""
        from jaxnet.model import centerpoint

        xp, found = own[0].__array_namespace__(), centerpoint.weights(received[0], around.weights)
        return xp.maximum(found, xp.where(self.spared(around), around.weights, 0.0)), memory
