from jaxnet.kinds.defences import ExpectsF
from jaxnet.model import ties
from jaxnet.model.plane import length
from jaxnet.model.retained import any_untrusted
from jaxnet.model.wording import count


class MSNorm(ExpectsF):
    """Drop the F sources that are farthest from the vehicle's own position, but no trusted source.

    This is the rule of W-MSR with distances in the plane in place of numbers on a line.
    """

    words = "ms_norm"
    guarantee = (
        "none where anybody untrusted is retained, whose derivatives are believed unchecked; by "
        "trust where at most F untrusted sources are heard, who are all dropped"
    )

    def decide(self, own, received, last, memory, around):
        """Drop the F farthest sources; of equal ones (`ties`) the lower slot is dropped first."""
        xp = own[0].__array_namespace__()
        candidate = (around.weights > 0) & ~self.spared(around)
        distance = length(received[0] - own[0][:, None])
        order = xp.arange(len(distance))
        first = (order[:, None] < order[None])[:, :, None, None]  # the other slot before this one
        other, this = distance[:, None], distance[None]
        beyond = candidate[:, None] & (ties.over(other, this) | (~ties.over(this, other) & first))
        return ~(candidate & (beyond.sum(axis=0) < self.F)), memory

    def retained(self, graph, trusted):
        return any_untrusted(graph, self.spares(trusted), self.F)

    def describe(self, graph, attacked, trusted):
        many = count(self.F, "source")
        return {"defence": f"a vehicle drops the {many} farthest from its own position"}
