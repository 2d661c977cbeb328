from jaxnet.kinds.defences import Sparing


class Centerpoint(Sparing):
    """Weigh sources so that their mean is an interior centerpoint of their positions.

    Each closed half-plane that contains a centerpoint contains at least a third of the n received
    positions. So a centerpoint lies among the honest positions if fewer than a third are attacked;
    one attacked source needs three honest ones.

    All centerpoints form a convex polygon; the rule takes the mean of its boundary. With three
    positions or fewer it takes the weighted mean. Many weights have this mean; the rule takes
    those nearest to the graph's, with least `Σ λ²/w`. The mean is exact to 1e-8 m, or to a
    millionth of the distance where positions nearly lie on a line.

    Trusted sources keep at least their weight. Otherwise the navigator would soon reach no vehicle.

    Source: Abbas, Shabbir, Li and Koutsoukos, Resilient distributed vector consensus using
    centerpoint, 2022. The choice of the interior point is ours.
    """

    guarantee = (
        "none of the motion: with fewer than a third attacked the mean of the positions lies among "
        "the honest ones, but their derivatives are weighed unchecked"
    )

    def decide(self, own, received, last, memory, around):
        from jaxnet.model import centerpoint

        xp, found = own[0].__array_namespace__(), centerpoint.weights(received[0], around.weights)
        return xp.maximum(found, xp.where(self.spared(around), around.weights, 0.0)), memory
