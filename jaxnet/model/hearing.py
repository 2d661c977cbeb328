"""Messages that listeners receive, slot by slot, and their weighted means `Σ_j w_ij (y_j + a_ij)`.

A listener has one slot for each source, in the order of their numbers. The number of slots is the
greatest number of sources of any listener. An unused slot has weight 0 and contains the listener
itself. The arrays of a graph therefore have the shape (slots, m) and do not grow with m².

The module imports JAX only when lanes run, because reading a study does not need JAX.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxnet.lazy import jax, jnp, sparse
from jaxnet.model.graph import Digraph, of_matrix, slotted
from jaxnet.model.shapes import Flags, LoopIndex, Numbers

SlotWeights = Float[Any, "slots m *lanes"]
AxisWeights = Float[Any, "axes slots m *lanes"]  # one axis if both axes have equal weights
SentMessages = Float[Any, "2 n *lanes"]  # of the navigator and the vehicles, n = m + 1
LinkMessages = Float[Any, "2 slots m *lanes"]
SignalValues = Float[Any, "2 signals *lanes"]
VehicleMeans = Float[Any, "2 m *lanes"]
DenseWeights = Float[Any, "m n *lanes"]
HeardLinks = Bool[Any, "axes slots m *lanes"]
ReachedVehicles = Bool[Any, "axes m *lanes"]
SlotNumbering = Int[Any, "slots m"]


class Hearing(NamedTuple):
    """The source in each slot of each listener, 0 for the navigator, and the attacked links.

    `carried_sources` distinguishes two threats. If an attack adds to a message, the link carries
    the message of its source plus the signal. If an attack replaces a message, the link carries the
    path of the navigator plus the signal.
    """

    sources: Int[Any, "slots m"]
    carried_sources: Int[Any, "slots m"]
    attacked: Bool[Any, "slots m"]
    signals: Int[Any, "slots m"]  # number of the signal that an attacked link carries

    def sent(self, sources: SentMessages) -> LinkMessages:
        """The message of each slot's source, among those of navigator and vehicles, n = m + 1."""
        return sources.at[:, self.sources].get(mode="promise_in_bounds")

    def added(self, signal: SignalValues) -> LinkMessages:
        """The attack signal on each link, 0 on links without attack."""
        attacked = self.attacked.reshape(1, *self.attacked.shape, *[1] * (signal.ndim - 2))
        return jnp.where(attacked, signal.at[:, self.signals].get(mode="promise_in_bounds"), 0.0)

    def received(self, sources: SentMessages, signal: SignalValues) -> LinkMessages:
        """The received message in each slot: the carried message plus the attack signal."""
        heard = sources.at[:, self.carried_sources].get(mode="promise_in_bounds")
        return heard + self.added(signal)

    def mean_added(self, weights: AxisWeights, signal: SignalValues) -> VehicleMeans:
        """`Σ_j w_ij a_ij`, the weighted mean of the attack signals."""
        return self.slot_by_slot(weights, lambda one: one.added(signal))

    def mean(
        self, weights: AxisWeights, sources: SentMessages, signal: SignalValues
    ) -> VehicleMeans:
        """`Σ_j w_ij (y_j + a_ij)`, the weighted mean of the received messages."""
        return self.slot_by_slot(weights, lambda one: one.received(sources, signal))

    def mean_sent(self, weights: AxisWeights, sources: SentMessages) -> VehicleMeans:
        """`Σ_j w_ij y_j`, the weighted mean of the sent messages."""
        return self.slot_by_slot(weights, lambda one: one.sent(sources))

    def slot_by_slot(
        self, weights: AxisWeights, heard: Callable[["Hearing"], Numbers]
    ) -> VehicleMeans:
        """Sum by weight of what `heard` gives, (2, 1, m, *lanes), for a Hearing with one slot."""

        def of_slot(slot: LoopIndex) -> VehicleMeans:
            return heard(self.at(slot))[:, 0]

        return plus_slots(jnp.zeros((2, *weights.shape[2:])), weights, of_slot)

    def at(self, slot: LoopIndex) -> "Hearing":
        return Hearing(*(jax.lax.dynamic_index_in_dim(each, slot) for each in self))

    def reached(self, heard: HeardLinks, reached: ReachedVehicles) -> ReachedVehicles:
        """The vehicles that the navigator or a vehicle in `reached` reaches over links `heard`."""

        def spread(carry: tuple[ReachedVehicles, Flags]) -> tuple[ReachedVehicles, Flags]:
            reached, _ = carry
            word = jnp.concatenate([jnp.ones_like(reached[:, :1]), reached], axis=1)
            said = word.at[:, self.carried_sources].get(mode="promise_in_bounds")
            further = reached | (heard & said).any(axis=1)
            return further, (further != reached).any() & ~further.all()

        return jax.lax.while_loop(lambda carry: carry[1], spread, (reached, jnp.asarray(True)))[0]

    def matrix(self, weights: SlotWeights) -> DenseWeights:
        """`[a0 | A]` by the sources of the carried messages, from weights by slot."""
        return spread_out(weights, self.carried_sources)

    def retained(self, weights: AxisWeights) -> DenseWeights:
        """The weights in force by vehicle and source, averaged over the axes."""
        return spread_out(weights.mean(axis=0), self.sources)


def spread_out(weights: SlotWeights, sources: SlotNumbering) -> DenseWeights:
    """Weights by vehicle and source, from weights by slot."""
    slots, m = sources.shape
    dense = jnp.zeros((m, m + 1, *weights.shape[2:]))
    listeners = jnp.broadcast_to(jnp.arange(m)[None], (slots, m))
    return dense.at[listeners, sources].add(weights)


def plus_slots(
    start: Numbers, weights: AxisWeights, of_slot: Callable[[LoopIndex], Numbers]
) -> Numbers:
    """`start` plus what all slots give by weight, where `of_slot` gives it for one slot."""

    def add(slot: LoopIndex, total: Numbers) -> Numbers:
        weight = jax.lax.dynamic_index_in_dim(weights, slot, axis=1, keepdims=False)
        return total + weight[(None,) * (total.ndim - weight.ndim)] * of_slot(slot)

    return jax.lax.fori_loop(0, weights.shape[1], add, start)


def slots(graph: Digraph, identities: Int[np.ndarray, "m n"]) -> Int[np.ndarray, "slots m"]:
    """The sources of each listener slot by slot, each source once for each of its identities.

    `identities` holds the number of identities of each link of the graph.
    """
    listeners, each = graph.edges()
    number = identities[listeners, each]
    sources = graph.sources[listeners, each].repeat(number)
    return np.ascontiguousarray(slotted(graph.vehicles, listeners.repeat(number), sources)[2].T)


def again(sources: Int[np.ndarray, "slots m"]) -> Bool[np.ndarray, "slots m"]:
    """The slots that contain the source of the previous slot again."""
    return np.concatenate([np.zeros_like(sources[:1], bool), sources[1:] == sources[:-1]])


def of_transmitters(sources: Int[np.ndarray, "slots m"]) -> Int[np.ndarray, "slots m"]:
    """The signal number of each link if each vehicle has one signal.

    A link from a vehicle carries the signal of that vehicle. A link from the navigator carries the
    signal of the listener.
    """
    return np.where(sources > 0, sources - 1, np.arange(sources.shape[1]))


def link_signals(sources: Int[np.ndarray, "slots m"]) -> Int[np.ndarray, "slots m"]:
    """The signal number of each link if each link has its own signal, sorted by listener."""
    most, m = sources.shape
    return np.arange(m)[None] * most + np.arange(most)[:, None]


def graph_of(sources: Int[np.ndarray, "slots m"], weights: Float[np.ndarray, "slots m"]) -> Digraph:
    """The graph of weights by slot, with the weights of all identities of a source added."""
    m = sources.shape[1]
    links = np.broadcast_to(np.arange(m), sources.shape).ravel(), sources.ravel()
    return of_matrix(sparse.coo_array((weights.ravel(), links), shape=(m, m + 1)))


def by_link(graph: Digraph, values: np.ndarray, sources: Int[np.ndarray, "slots m"]) -> np.ndarray:
    """Values by link, (…, links), from slots, (…, slots, m): the sum over a source's identities."""
    place, heard = link_places(graph, sources)
    found = np.zeros((len(graph.edges()[0]), *values.shape[:-2]), values.dtype)
    np.add.at(found, place[heard], np.moveaxis(values[..., heard], -1, 0))
    return np.moveaxis(found, 0, -1)


def by_slot(graph: Digraph, values: np.ndarray, sources: Int[np.ndarray, "slots m"]) -> np.ndarray:
    """Values of the links of a graph in the slots of a wider table of sources, 0 without a link.

    `sources` lists the sources of each listener in the order of their numbers. It contains the
    sources of the graph and may contain others.
    """
    place, heard = link_places(graph, sources)
    theirs = np.append(values[graph.edges()], np.zeros_like(values, shape=1))
    return np.where(heard, theirs[place], theirs[-1])


def link_places(
    graph: Digraph, sources: Int[np.ndarray, "slots m"]
) -> tuple[Int[np.ndarray, "slots m"], Bool[np.ndarray, "slots m"]]:
    """The number of each slot's link in the graph, and whether the graph has it."""
    m = graph.vehicles
    listeners, each = graph.edges()
    sentinel = (m + 1) ** 2
    links = np.append(listeners * (m + 1) + graph.sources[listeners, each], sentinel)
    wanted = np.arange(m)[None] * (m + 1) + sources
    place = np.searchsorted(links, wanted)
    return place, (links[place] == wanted) & (sources >= 0)
