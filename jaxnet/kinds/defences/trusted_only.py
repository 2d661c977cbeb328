from jaxnet.kinds.defences import Defence
from jaxnet.model.retained import DropPolicy


class TrustedOnly(Defence):
    """Retain trusted sources alone; a vehicle without a trusted source retains every source.

    A baseline. The links of the network in force count, also where a message is lost. Under any
    attack a vehicle ends exactly on the navigator if only trusted, honest links join it to the
    navigator.
    """

    guarantee = "by trust: a vehicle that no attack reaches over retained links is exact"

    def needs_ticks(self):
        return False

    def decide(self, own, received, last, memory, around):
        """Retain trusted sources; a vehicle without one in the network in force retains all."""
        trusted = around.linked & around.trusted[:, :, None]
        return trusted | ~trusted.any(axis=0, keepdims=True), memory

    def retained(self, graph, trusted):
        links = graph.heard & ~trusted & trusted.any(axis=1, keepdims=True)
        return DropPolicy(graph, links, links.sum(axis=1))

    def describe(self, graph, attacked, trusted):
        told = "a vehicle without a trusted source retains all its sources"
        return {"defence": f"trusted sources only; {told}"}
