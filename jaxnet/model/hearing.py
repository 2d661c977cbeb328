"""Who hears whom, slot by slot, and what they receive.

JAX is imported where lanes are simulated, for a study is read without it.

A vehicle has as many slots as the busiest listener has sources, filled in the order of their numbers. One
left over holds the listener itself, with weight 0. So a graph's arrays are (slots, m), whatever m².
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from jaxnet.lazy import LazyModule
from jaxnet.model.graph import Digraph, of_matrix, slotted

if TYPE_CHECKING:
    import jax
    import jax.numpy as jnp

    from jaxnet.model import xla
else:
    jax = LazyModule("jax")
    jnp = LazyModule("jax.numpy")
    xla = LazyModule("jaxnet.model.xla")


MANY = 512  # signals; from there on few links are attacked, and it is quicker to pass by the others

SlotWeights = Float[Any, "slots m *lanes"]
AxisWeights = Float[Any, "axes slots m *lanes"]  # one axis where both are alike


class Hearing(NamedTuple):
    """The source in each slot of each listener, 0 the navigator, and which links are attacked.

    An attack that adds to what is sent and one that replaces it differ in whose word the link carries: that
    of its source, or the navigator's, with the attack's signal on top.
    """

    sources: Int[Any, "slots m"]
    carried_sources: Int[Any, "slots m"]
    attacked: Bool[Any, "slots m"]
    signals: Int[Any, "slots m"]  # the number of the signal that a link carries if it is attacked
    listeners: Int[Any, "slots m"]  # in each slot, those of attacked links first

    def sent(self, sources: Float[Any, "2 n *lanes"]) -> Float[Any, "2 slots m *lanes"]:
        """What each slot's source sends, of what the navigator and the vehicles send (n = m + 1)."""
        return sources.at[:, self.sources].get(mode="promise_in_bounds")

    def added(self, signal: Float[Any, "2 signals *lanes"]) -> Float[Any, "2 slots m *lanes"]:
        """What the attack adds on each link."""
        attacked = self.attacked.reshape(1, *self.attacked.shape, *[1] * (signal.ndim - 2))
        return jnp.where(attacked, signal.at[:, self.signals].get(mode="promise_in_bounds"), 0.0)

    def received(
        self, sources: Float[Any, "2 n *lanes"], signal: Float[Any, "2 signals *lanes"]
    ) -> Float[Any, "2 slots m *lanes"]:
        """What is received in each slot, attacked or not."""
        heard = sources.at[:, self.carried_sources].get(mode="promise_in_bounds")

        def falsified(heard: Any, slot: Any, listener: Any, lie: Any) -> Any:
            return xla.add_slice(heard, (0, slot, listener), lie[:, None, None])

        if signal.shape[1] < MANY:
            return heard + self.added(signal)
        return xla.on_cpus(
            lambda: self.on_attacked_links(falsified, heard, signal), lambda: heard + self.added(signal)
        )

    def mean_added(
        self, weights: AxisWeights, signal: Float[Any, "2 signals *lanes"]
    ) -> Float[Any, "2 m *lanes"]:
        """`Σ_j w_ij a_ij`, the weighted mean of what the attack adds."""

        def falsified(mean: Any, slot: Any, listener: Any, lie: Any) -> Any:
            return xla.add_slice(mean, (0, listener), (weights[:, slot, listener] * lie)[:, None])

        nothing = jnp.zeros((2, *weights.shape[2:]))
        return xla.on_cpus(
            lambda: self.on_attacked_links(falsified, nothing, signal),
            lambda: self.slot_by_slot(weights, lambda one: one.added(signal)),
        )

    def on_attacked_links(
        self, falsified: Callable[[Any, Any, Any, Any], Any], heard: Any, signal: Any
    ) -> Any:
        """What is heard after `falsified(heard, slot, listener, lie)` link by link, of lies (2, *lanes)."""
        signals, listeners = jnp.asarray(self.signals), jnp.asarray(self.listeners)
        numbers = self.attacked.sum(axis=1)  # of attacked links

        def in_slot(slot: Any, heard: Any) -> Any:
            def on_link(number: Any, heard: Any) -> Any:
                listener = listeners[slot, number]
                return falsified(heard, slot, listener, signal[:, signals[slot, listener]])

            return jax.lax.fori_loop(0, numbers[slot], on_link, heard)

        return jax.lax.fori_loop(0, len(signals), in_slot, heard)

    def mean(
        self,
        weights: AxisWeights,
        sources: Float[Any, "2 n *lanes"],
        signal: Float[Any, "2 signals *lanes"],
    ) -> Float[Any, "2 m *lanes"]:
        """`Σ_j w_ij (y_j + a_ij)`, the weighted mean of what is received."""
        return self.slot_by_slot(weights, lambda one: one.received(sources, signal))

    def mean_sent(self, weights: AxisWeights, sources: Float[Any, "2 n *lanes"]) -> Float[Any, "2 m *lanes"]:
        """`Σ_j w_ij y_j`, the weighted mean of what is sent."""
        return self.slot_by_slot(weights, lambda one: one.sent(sources))

    def slot_by_slot(self, weights: AxisWeights, heard: Callable[["Hearing"], Any]) -> Any:
        """The weighted sum over slots of what is heard in each, (2, 1, m, *lanes)."""

        def add(slot: Any, total: Any) -> Any:
            one = Hearing(*(jax.lax.dynamic_index_in_dim(each, slot) for each in self))
            weight = jax.lax.dynamic_index_in_dim(weights, slot, axis=1, keepdims=False)
            return total + weight * heard(one)[:, 0]

        nothing = jnp.zeros((2, *weights.shape[2:]))
        return jax.lax.fori_loop(0, len(self.sources), add, nothing)

    def all_reached(self, weights: AxisWeights) -> Bool[Any, "*lanes"]:
        """Whether the navigator's word reaches every vehicle over these weights, on every axis."""
        heard = weights > 0

        def spread(carry: Any) -> Any:
            reached, _ = carry
            word = jnp.concatenate([jnp.ones_like(reached[:, :1]), reached], axis=1)
            said = word.at[:, self.carried_sources].get(mode="promise_in_bounds")
            further = reached | (heard & said).any(axis=1)
            return further, (further != reached).any()

        nobody = jnp.zeros_like(heard[:, 0])
        reached, _ = jax.lax.while_loop(lambda carry: carry[1], spread, (nobody, jnp.asarray(True)))
        return reached.all(axis=(0, 1))

    def matrix(self, weights: SlotWeights) -> Float[Any, "m n *lanes"]:
        """`[a0 | A]` of whose word is carried, from weights by slot."""
        return self.spread_out(weights, self.carried_sources)

    def retained(self, weights: AxisWeights) -> Float[Any, "m n *lanes"]:
        """Weights in force by vehicle and source, the mean over the axes."""
        return self.spread_out(weights.mean(axis=0), self.sources)

    def spread_out(self, weights: SlotWeights, sources: Int[Any, "slots m"]) -> Float[Any, "m n *lanes"]:
        """Weights by vehicle and source, of weights by slot."""
        slots, m = sources.shape
        dense = jnp.zeros((m, m + 1, *weights.shape[2:]))
        listeners = jnp.broadcast_to(jnp.arange(m)[None], (slots, m))
        return dense.at[listeners, sources].add(weights)


def of_slots(
    sources: Int[np.ndarray, "slots m"],
    carried_sources: Int[np.ndarray, "slots m"],
    attacked: Bool[np.ndarray, "slots m"],
    signals: Int[np.ndarray, "slots m"],
) -> Hearing:
    """Who hears whom, of arrays by slot."""
    return Hearing(sources, carried_sources, attacked, signals, np.argsort(~attacked, axis=1, kind="stable"))


def slots(graph: Digraph, identities: Int[np.ndarray, "m n"]) -> Int[np.ndarray, "slots m"]:
    """Sources of a graph's listeners slot by slot, each as often as it has identities, of a graph's links."""
    listeners, each = graph.edges()
    number = identities[listeners, each]
    sources = graph.sources[listeners, each].repeat(number)
    return np.ascontiguousarray(slotted(graph.vehicles, listeners.repeat(number), sources)[2].T)


def again(sources: Int[np.ndarray, "slots m"]) -> Bool[np.ndarray, "slots m"]:
    """Slots that hold the same source as the slot before them."""
    return np.concatenate([np.zeros_like(sources[:1], bool), sources[1:] == sources[:-1]])


def of_transmitters(sources: Int[np.ndarray, "slots m"]) -> Int[np.ndarray, "slots m"]:
    """Each link's signal where a vehicle has one: the transmitter's, a listener's own for the navigator."""
    return np.where(sources > 0, sources - 1, np.arange(sources.shape[1]))


def link_signals(sources: Int[np.ndarray, "slots m"]) -> Int[np.ndarray, "slots m"]:
    """Each link's signal where every link has one, those of a listener after each other."""
    most, m = sources.shape
    return np.arange(m)[None] * most + np.arange(most)[:, None]


def graph_of(sources: Int[np.ndarray, "slots m"], weights: Float[np.ndarray, "slots m"]) -> Digraph:
    """The graph of weights by slot; those of a source's identities are added."""
    listeners = np.broadcast_to(np.arange(sources.shape[1]), sources.shape)
    links = (listeners.ravel(), sources.ravel())
    return of_matrix(sparse.coo_array((weights.ravel(), links), shape=(len(sources.T), len(sources.T) + 1)))


def by_link(graph: Digraph, values: np.ndarray, sources: Int[np.ndarray, "slots m"]) -> np.ndarray:
    """What slots have (…, slots, m) by link of a graph, (…, links), those of a source's identities added."""
    m = graph.vehicles
    listeners, each = graph.edges()
    links = listeners * (m + 1) + graph.sources[listeners, each]
    slots = np.arange(m)[None] * (m + 1) + sources
    place = np.searchsorted(links, slots).clip(max=len(links) - 1)
    heard = (links[place] == slots) & (sources >= 0)
    found = np.zeros((len(links), *values.shape[:-2]), values.dtype)
    np.add.at(found, place[heard], np.moveaxis(values[..., heard], -1, 0))
    return np.moveaxis(found, 0, -1)


def by_slot(graph: Digraph, values: np.ndarray, sources: Int[np.ndarray, "slots m"]) -> np.ndarray:
    """What a graph's links have, slot by slot of a wider table of sources; 0 where a listener does not hear.

    `sources` are each listener's in the order of their numbers, those of the graph and perhaps others.
    """
    m = graph.vehicles
    listeners, each = graph.edges()
    links = np.append(listeners * (m + 1) + graph.sources[listeners, each], (m + 1) ** 2)  # and a last one
    wanted = np.arange(m)[None] * (m + 1) + sources
    place = np.searchsorted(links, wanted)
    theirs = np.append(values[listeners, each], np.zeros_like(values, shape=1))
    return np.where(links[place] == wanted, theirs[place], theirs[-1])
