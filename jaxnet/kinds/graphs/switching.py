from collections.abc import Iterator
from typing import Annotated, Literal

from annotated_types import Len
from pydantic import Field

from jaxnet.kinds import registry
from jaxnet.kinds.fields import NotNegative, is_drawn, setting, value_range
from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.navigators.none import NoNavigator
from jaxnet.kinds.protocols import ScenarioView
from jaxnet.kinds.registry import KindOf
from jaxnet.kinds.shapes import AnyCounts, LaneTimes
from jaxnet.kinds.ticks import TICK_ROUNDING, DrawsAtTicks
from jaxnet.lazy import jnp, sparse
from jaxnet.model import graph


class Switching(DrawsAtTicks, Graph):
    """Several networks that take turns: one is in force at a tick, with its own weights.

    A vehicle that the navigator does not reach in the network in force keeps its last drive, as
    where messages are lost. What `check` says of the graph holds for the union of the networks.
    """

    untraced = frozenset({"label", "own_weight", "networks"})

    networks: Annotated[list[Annotated[Graph, KindOf("topology")]], Len(2)] = Field(
        description="the networks, each with its kind and keys"
    )
    every: NotNegative = setting(0.0, "[s], from one change to the next; or give `at`")
    at: list[float] = setting([], "[s], times of the changes, ascending")
    order: Literal["cyclic", "random"] = setting(
        "cyclic", "cyclic: as listed, again and again; random: drawn at each change"
    )

    @classmethod
    def completed(cls, given, folder):
        networks = given.get("networks")
        if not isinstance(networks, list):
            return given

        def complete(network: object) -> object:
            if isinstance(network, dict) and isinstance(name := network.get("kind"), str):
                return registry.find("topology", name).completed(network, folder)
            return network

        return {**given, "networks": [complete(each) for each in networks]}

    def draws(self):
        return self.order == "random"

    def size(self):
        """The number of vehicles of the first network that has a number."""
        return next(filter(None, (each.size() for each in self.networks)), None)

    def normalises(self):
        return self.networks[0].normalises()

    def weights(self, vehicles):
        """The union of the networks, with the mean of their normalised weights."""
        total = sparse.csr_array((vehicles, vehicles + 1))
        for found in (network.normalised_rows(vehicles) for network in self.networks):
            rows, slots = found.edges()
            links = found.weights[rows, slots], (rows, found.sources[rows, slots])
            total = total + sparse.coo_array(links, shape=total.shape).tocsr()
        return graph.of_matrix(total / len(self.networks))

    def leaderless(self):
        return self.model_copy(update={"networks": [each.leaderless() for each in self.networks]})

    def differs(self):
        """False: lanes may draw when networks change, but have the same networks."""
        return False

    def turns(self):
        return self.networks

    def number(self, time: LaneTimes, networks: int) -> AnyCounts:
        """The number, from 0, of the network that is in force at each of these times."""
        if len(self.at):
            passed = (time[None] >= jnp.asarray(self.at) - TICK_ROUNDING).sum(axis=0)
        else:
            passed = jnp.floor((time + TICK_ROUNDING) / self.every).astype(int)
        if self.order == "cyclic":
            return passed % networks
        drawn = self.random(passed.astype(float), "network", "uniform", ())
        return (drawn * networks).astype(int)

    def faults(self, scenario):
        alone = scenario.model_copy(update={"navigator": NoNavigator()})
        found = list(self.time_faults(scenario))
        for number, network in enumerate(self.networks):
            key = f"topology.networks.{number}"
            if len(network.turns()) > 1 or network.differs():
                found.append(Fault((key,), "must be one network, without draws"))
            elif network.normalises() != self.normalises():
                found.append(Fault((key,), "must be normalised as the first network is"))
            elif network.size() not in (None, scenario.vehicles):
                message = f"has {network.size()} vehicles (got {scenario.vehicles})"
                found.append(Fault((key, "vehicles"), message))
            else:
                inner = network.faults(alone)
                found += [Fault((key, *fault.keys), fault.message) for fault in inner]
        yield from found or super().faults(scenario)

    def time_faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        if (self.every == 0) == (not self.at):
            yield Fault(("topology.every", "topology"), "give either every or at")
        if is_drawn(self.every) and value_range(self.every)[0] <= 0:
            yield Fault(("topology.every",), "must be greater than 0, whatever is drawn")
        if self.at != sorted(set(self.at)) or min(self.at, default=1.0) <= 0:
            yield Fault(("topology.at",), "must be positive times in ascending order")
        if scenario.tick == 0:
            yield Fault(("topology", "tick"), "networks change at ticks: give a tick")
        if self.own_weight:
            yield Fault(("topology.own_weight",), "give own_weight to each of the networks")
