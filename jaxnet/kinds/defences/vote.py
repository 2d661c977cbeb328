"""A vote on what drives vehicles (docs/guarantees.md, theorem 7)."""

import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jaxnet.kinds.defences import BearsTheta
from jaxnet.kinds.defences.trusted_trim import OF_ROUNDING
from jaxnet.kinds.kind import Fault, vehicle_numbers
from jaxnet.kinds.shapes import (
    AnyCounts,
    AnyMask,
    AnyNumbers,
    SlotMask,
    SlotSources,
    SlotVectors,
    VehicleVectors,
)
from jaxnet.lazy import jax
from jaxnet.model import safety, ties
from jaxnet.model.graph import Digraph, Links
from jaxnet.model.plane import length
from jaxnet.model.retained import DropPolicy
from jaxnet.model.safety import Safe
from jaxnet.model.wording import ranges

# Within one, honest values less than c from R(y_0) leave a believed one less than GROWTH c from it,
# until the next tick (theorem 7).
GROWTH = 3 + 2 * 2**0.5


class Order(NamedTuple):
    """An order in which vehicles follow earlier ones; (m,) or (slots, m), and lanes."""

    reached: AnyMask  # vehicles that have a place in it
    earlier: AnyMask  # slots whose source has an earlier place; all, for a vehicle without one


class Vote(BearsTheta):
    """Believe the trusted sources alone; without one, the ϑ + 1 sources nearest to the median.

    A vehicle that trusts no source compares R of the messages. It believes the ϑ + 1 nearest to
    their median by coordinate, of at least 2ϑ + 1. Vehicles have an order: each trusts earlier ones
    or hears 2ϑ + 1 earlier ones, and votes on earlier ones alone. A vehicle without a place in the
    order votes on all sources that it hears. A vehicle with fewer than 2ϑ + 1 links retains every
    source; where messages are lost and fewer than 2ϑ + 1 are left, or no trusted one, it believes
    nobody and keeps its drive, or has q = 0 under a local law.

    A message that stands in for a lost one counts as one. R is `y‴ + P(y)`. Under a local law
    vehicles tell P alone, the navigator both. docs/guarantees.md has the proof (theorem 7), which
    asks nothing of announcements.
    """

    words = "vote"
    guarantee = (
        "by vote, where vehicles follow earlier ones and at most ϑ links of a vote are attacked "
        "(theorem 7 of docs/guarantees.md), whatever liars announce"
    )

    def hears_messages(self):
        return True

    def shared(self, graph, trusted, sources):
        return self.thetas(graph)

    def start(self, around):
        """The slots of earlier sources."""
        trusted = around.trusted[:, :, None] & (around.weights >= 0)
        given = around.sources, around.weights > 0, trusted, around.shared[:, None]
        return order(*given, jax.lax.while_loop).earlier

    def decide(self, own, received, last, memory, around):
        xp, theta, heard = own[0].__array_namespace__(), around.shared, around.linked
        trusts, panel = heard & around.trusted[:, :, None], heard & memory
        messages = around.messages
        if self.noise is not None:
            (messages,) = self.noisy((messages,), self.noise, around.time, first=3)
        there, least = panel & ~xp.isnan(messages[0]), 2 * theta[None, :, None] + 1
        apart = length(messages - median_of(messages, there)[:, None])
        apart = xp.maximum(xp.where(there, apart, xp.inf), OF_ROUNDING)
        voted = there & (slot_ranks(apart, ties.over) <= theta[None, :, None])
        enough = there.sum(axis=0, keepdims=True) >= least
        voted = xp.where(enough, voted, panel & ~there)
        voted = voted | (panel.sum(axis=0, keepdims=True) < least)
        return xp.where(trusts.any(axis=0, keepdims=True), trusts, voted), memory

    def order(self, graph: Digraph, trusted: Links) -> Order:
        """The order of the vehicles of a graph, (m,), and the links from earlier ones."""
        heard, trusts = graph.heard.T[:, :, None], trusted.T[:, :, None]
        theta = self.thetas(graph)[:, None]
        found = order(graph.sources.T, heard, trusts, theta, while_loop)
        return Order(found.reached[:, 0], found.earlier[:, :, 0].T)

    def votes(self, graph: Digraph, trusted: Links) -> tuple[Links, AnyCounts]:
        """The links on which each vehicle votes, none if it does not, and the number it drops."""
        panel = graph.heard & self.order(graph, trusted).earlier
        theta = self.thetas(graph)
        votes = (panel.sum(axis=1) > 2 * theta) & ~trusted.any(axis=1)
        panel = panel & votes[:, None]
        return panel, np.where(votes, panel.sum(axis=1) - theta - 1, 0)

    def retained(self, graph, trusted):
        """All but ϑ + 1 of the links of a vote are dropped, and links beside it always."""
        panel, number = self.votes(graph, trusted)
        kept = np.where(trusted.any(axis=1, keepdims=True), trusted, panel)
        kept = kept | ~kept.any(axis=1, keepdims=True)
        return DropPolicy(graph.only(graph.heard & kept), panel, number)

    def safe(self, graph, attacked, trusted):
        """The default reasons, and "by vote" of theorem 7."""
        drops, place = self.retained(graph, trusted), self.order(graph, trusted).reached
        bears = np.where(place, self.thetas(graph), 0)
        inside = safety.greatest(drops, attacked, bears)
        most = self.depths(graph, trusted)[inside].max(initial=0)
        factor = (GROWTH**most - 1) / (GROWTH - 1)
        told = f"by vote, ‖R(E)‖ ≤ {factor:.4g} Λ h"
        return [*super().safe(graph, attacked, trusted), Safe(told, inside)]

    def depths(self, graph: Digraph, trusted: Links) -> AnyCounts:
        """How many votes stand between the navigator and each vehicle of the order, at most."""
        drops, place = self.retained(graph, trusted), self.order(graph, trusted).reached
        heard, votes = drops.graph.heard & place[:, None], drops.links.any(axis=1) & place
        depth, before = np.zeros(graph.vehicles + 1, int), None
        while before is None or (depth != before).any():
            before = depth.copy()
            depth[1:] = np.where(heard, depth[graph.sources], 0).max(axis=1) + votes
        return depth[1:]

    def describe(self, graph, attacked, trusted):
        panel, place = self.votes(graph, trusted)[0], self.order(graph, trusted).reached
        theta, votes = self.thetas(graph), panel.any(axis=1)
        trusts = trusted.any(axis=1)
        outnumbered = (attacked & panel).sum(axis=1) > theta
        outnumbered |= (attacked & trusted).any(axis=1)
        each = {
            "believes whom it trusts": trusts & place,
            "votes on earlier ones": votes & place,
            "votes on all that it hears": votes & ~place,
            "has no place in the order": trusts & ~place,
            "retains all": ~trusts & ~votes,
            "may believe an attacked link": outnumbered,
        }
        words = (
            f"{told}: {ranges(vehicle_numbers(who))}" for told, who in each.items() if who.any()
        )
        return {"vote": "; ".join(words)}

    def faults(self, scenario):
        yield from super().faults(scenario)
        if scenario.own_gains is not None:
            yield Fault(("gain", "defence"), "sources are compared by R of one gain: give one gain")
        if scenario.attack.identities() > 1:
            told = "a vote counts sources, and knows nothing of several identities"
            yield Fault(("attack.sybils", "defence"), told)


def slot_ranks(values: AnyNumbers, over: Callable[[Any, Any], Any]) -> AnyCounts:
    """Ranks of the slots, (…, slots, m, lanes), by counting: a sort takes 20 times as long.

    Of equal values the lower slot comes first.
    """
    xp, rank = values.__array_namespace__(), 0
    slots = xp.arange(values.shape[-3]).reshape(*[1] * (values.ndim - 3), -1, 1, 1)
    for k in range(values.shape[-3]):
        other = values[..., k : k + 1, :, :]
        first = over(values, other) | (~over(other, values) & (k < slots))
        rank = rank + xp.where(first, 1, 0)
    return rank


def median_of(values: SlotVectors, there: SlotMask) -> VehicleVectors:
    """Median by coordinate of the slots that are there."""
    xp, number = values.__array_namespace__(), there.sum(axis=0)[None, None]
    values = xp.where(there, values, xp.inf)
    rank, middles = slot_ranks(values, operator.gt), ((number - 1) // 2, number // 2)
    return sum(xp.where(rank == each, values, 0.0).sum(axis=1) for each in middles) / 2


def order(
    sources: SlotSources,
    heard: AnyMask,
    trusted: AnyMask,
    theta: AnyCounts,
    loop: Callable[..., Any],
) -> Order:
    """The order of vehicles in which each trusts earlier ones, or hears 2ϑ + 1 earlier ones.

    Arrays are (slots, m, lanes), `theta` (m, 1); `loop` is like `jax.lax.while_loop`.
    """
    xp, trusts = heard.__array_namespace__(), heard & trusted
    nobody = xp.zeros_like(heard[0])

    def further(state: Any) -> Any:
        reached, earlier, _ = state
        there = xp.concatenate([~nobody[:1], reached])[sources]
        enough = (there & heard).sum(axis=0) > 2 * theta
        enough = xp.where(trusts.any(axis=0), (there | ~trusts).all(axis=0), enough)
        new = enough & ~reached
        return reached | new, xp.where(new[None], there, earlier), new.any()

    first = nobody, xp.ones_like(heard), xp.asarray(True)
    return Order(*loop(lambda state: state[2], further, first)[:2])


def while_loop(goes_on: Callable[[Any], Any], step: Callable[[Any], Any], state: Any) -> Any:
    """`jax.lax.while_loop` in Python, for NumPy arrays."""
    while goes_on(state):
        state = step(state)
    return state
