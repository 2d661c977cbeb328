"""Whom a vehicle believes: from what it receives and what it knows of itself, weights over its sources."""

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Discriminator, Field

from jaxnet.kinds.fields import MARK, NotNegative, Record, Uniform, union_member
from jaxnet.kinds.kind import Fault, Kind, KindError, unknown_vehicles
from jaxnet.model import safety
from jaxnet.model.graph import Digraph, Links, hops, least, trusted_links
from jaxnet.model.retained import AnySubset, any_untrusted
from jaxnet.model.safety import Safe


class Neighbourhood(NamedTuple):
    """What vehicles know of their surroundings when they decide, by slot.

    A vehicle has as many slots as the busiest listener has sources; one left over holds itself, of weight 0.

    - `sources` (slots, m): the number of the source, 0 the navigator
    - `weights` (slots, m, lanes): of the graph
    - `trusted` (slots, m): whether the listener trusts it
    - `gain` (3, lanes): on ε, ε̇, ε̈
    - `time` (lanes,): [s]
    - `shared`: what the defence's `shared` has made
    - `announced` (2, slots, m, lanes): what each slot's source announces, attacked or not
    - `attacked` (slots, m, lanes): the truth, for observations of it that may err
    """

    sources: Any
    weights: Any
    trusted: Any
    gain: Any
    time: Any
    shared: Any
    announced: Any = ()
    attacked: Any = ()


class AnyDefence(Kind):
    """What is asked of a defence."""

    decides: ClassVar[bool] = False
    guarantee: ClassVar[str] = "none is known"

    def needs_ticks(self) -> bool:
        """Whether it cannot be evaluated at any instant, without memory (`tick: 0`)."""
        return True

    def trusts(self, graph: Digraph) -> Links:
        """Links of a graph whose source the listener trusts: the navigator, wherever it is heard."""
        return trusted_links(graph, {})

    def shared(self, graph: Digraph, trusted: Links, sources: np.ndarray) -> Any:
        """Arrays that all lanes share, made once: any pytree. `sources` (slots, m) tells who is in each."""
        return ()

    def start(self, around: Neighbourhood) -> Any:
        """The memory before anything was received: any pytree of arrays whose last axis is over lanes."""
        return ()

    def announcement(self, memory: Any) -> Any:
        """What vehicles tell their listeners of the `R(y) - R(y_0)` that drives them: (2, m, lanes).

        An attacked link adds R of its signal, and carries that alone where the threat replaces. () where they
        tell nothing, the default.
        """
        return ()

    def announcing(self) -> bool:
        """Whether vehicles announce what drives them, and are judged by it."""
        return False

    def draws(self) -> bool:
        """Whether it draws random numbers at ticks."""
        return False

    def observed(self, received: Any, time: Any) -> Any:
        """What vehicles take the jets received for when they decide; the law uses them as they are."""
        return received

    def overheard(self, announced: Any, sources: Any, time: Any) -> Any:
        """Announcements (2, slots, m, lanes) [m/s³] as vehicles take them, when they decide and announce.

        `sources` (slots, m) are the numbers of the sources, 0 the navigator.
        """
        return announced

    def decide(
        self, own: Any, received: Any, last: Any, memory: Any, around: Neighbourhood
    ) -> tuple[Any, Any]:
        """The decision and the memory after one tick.

        `own` are a vehicle's jets, each (2, m, lanes), `received` those in each slot, each (2, slots, m,
        lanes). The decision is boolean, who is retained, or weights, not negative and normalised afterwards:
        (slots, m, lanes), or (2, slots, m, lanes) to decide by axis. `last` is that of the tick before, at
        first everybody.
        """
        raise KindError(f"{self.kind}: a defence gives decide(self, own, received, last, memory, around)")

    def retained(self, graph: Digraph, trusted: Links) -> AnySubset | None:
        """Whom it may retain, for theory; None, the default, if that is not known: no bound is told then."""
        return None

    def may_drop(self, graph: Digraph, trusted: Links) -> AnySubset:
        """How many it drops of whom, at most; by default every untrusted source, and never a trusted one."""
        return self.retained(graph, trusted) or any_untrusted(graph, trusted, len(trusted) + 1)

    def safe(self, graph: Digraph, attacked: Links, trusted: Links) -> list[Safe]:
        """Vehicles that end on the navigator whatever attackers say, by each reason, the strongest first.

        By default those upstream of whom nothing is attacked, and those who drop all upstream that is.
        """
        known, none = self.retained(graph, trusted), np.zeros(graph.vehicles, int)
        reasons = [Safe("untouched", safety.greatest(self.may_drop(graph, trusted), attacked, none))]
        if known is not None:
            reasons.append(Safe("by trust", safety.greatest(known.believed(), attacked, none)))
        return reasons

    def describe(self, graph: Digraph, attacked: Links, trusted: Links) -> dict[str, str]:
        """Lines of `jaxnet check`: what it promises on this graph under this attack."""
        return {"defence": f"{self.kind}: nothing is known of whom it retains, so no bound is told"}


class ShareOfLinks(Record):
    """The navigator, and this share of the vehicles that each one hears, drawn, and rounded at random."""

    share: float = Field(ge=0, le=1, description="of each listener's links to vehicles")
    seed: int = Field(default=0, ge=0, description="of the draw, which all lanes share")

    def links(self, graph: Digraph) -> Links:
        """With the same seed more of them where the share is greater."""
        heard, random = graph.heard & (graph.sources > 0), np.random.default_rng(self.seed)
        lots = np.array([random.random(graph.vehicles + 1)[each] for each in graph.sources])
        number = np.floor(self.share * heard.sum(axis=1) + random.random(len(heard)))
        return trusted_links(graph, {}) | least(heard, lots, number)


class NearestSources(Record):
    """So many sources of each vehicle, those fewest links from the navigator, which is one itself."""

    nearest: int = Field(ge=1, le=10_000, description="sources, of those equally far the lowest numbers")

    def links(self, graph: Digraph) -> Links:
        """By the graph alone."""
        far = np.append(0.0, hops(graph))
        return least(graph.heard, far[graph.sources], self.nearest)


def trusted_tag(value: Any) -> str | None:
    """How it is said who is trusted."""
    if isinstance(value, Record):
        return MARK + next(iter(type(value).model_fields))
    if not isinstance(value, dict):
        return MARK + "word" if value == "none" else None
    listed = MARK + "listed" if all(isinstance(key, int) for key in value) else None
    return next((MARK + key for key in ("share", "nearest") if key in value), listed)


class Defence(AnyDefence):
    """A rule by which vehicles weigh what they receive. One of one's own gives `decide`.

    Jets, a position with its velocity and acceleration, are told relative to the navigator's: what a rule
    makes of differences alone it makes of these.
    """

    decides: ClassVar[bool] = True
    untraced: ClassVar[frozenset[str]] = frozenset({"label", "trusted"})

    trusted: Annotated[
        Annotated[Literal["none"], union_member("word")]
        | Annotated[dict[int, list[int]], union_member("listed")]
        | Annotated[ShareOfLinks, union_member("share")]
        | Annotated[NearestSources, union_member("nearest")],
        Discriminator(
            trusted_tag,
            custom_error_type="trusted",
            custom_error_message="must be none, {vehicle: [sources]}, {share: s} or {nearest: n}",
        ),
    ] = Field(
        default={},
        description="{vehicle: [sources]}, these besides the navigator; {share: s, seed: n}, that share of"
        " what each hears of others, drawn, besides it; {nearest: n}, the n sources of each that are fewest"
        " links from it; none, nobody",
    )
    noise: NotNegative = Field(
        default=0.0,
        description="[m], standard deviation of the error in what is judged, on each axis, of each source and"
        " tick its own; as many m/s and m/s² of velocities and accelerations, and m/s³ of what vehicles"
        " announce; the law uses what is received without it",
    )

    def draws(self) -> bool:
        """Those of its noise."""
        return self.noise != 0

    def drawn(self, draw: Any, name: str) -> Any:
        """The same with its numbers drawn, and the key of those that it draws at ticks."""
        values = {**vars(super().drawn(draw, name))}
        if self.noise == 0:
            values["noise"] = None
        if self.draws():
            values["key"] = draw.one(Uniform(uniform=[0.0, 1.0]), f"{name}.key")
        return self.filled(values)

    def random(self, time: Any, purpose: str, sampler: Any, shape: tuple[int, ...]) -> Any:
        """`sampler(key, shape)`, one of `jax.random`, lanes last: each lane's own at each tick.

        What purposes of other names draw is independent. Only for a rule that says so by `draws`.
        """
        from jaxnet.model import chance

        return chance.drawn(vars(self)["key"], time, purpose, sampler, shape)

    def observed(self, received: Any, time: Any) -> Any:
        """With noise."""
        from jaxnet.model import chance

        return received if self.noise is None else chance.noisy(received, self.noise, vars(self)["key"], time)

    def overheard(self, announced: Any, sources: Any, time: Any) -> Any:
        """With noise; the navigator's announcement is 0 by agreement, so it has none."""
        from jaxnet.model import chance

        if self.noise is None:
            return announced
        (noisy,) = chance.noisy((announced,), self.noise, vars(self)["key"], time, first=3)
        return noisy.__array_namespace__().where((sources > 0)[None, :, :, None], noisy, announced)

    def trusts(self, graph: Digraph) -> Links:
        """The navigator wherever it is heard and those listed, or as another rule says."""
        if isinstance(self.trusted, Record):
            return self.trusted.links(graph)
        if self.trusted == "none":
            return graph.none
        return trusted_links(graph, self.trusted)

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """Whoever is named must exist, and a rule that has a memory needs ticks."""
        listed = self.trusted if isinstance(self.trusted, dict) else {}
        yield from unknown_vehicles("defence.trusted", list(listed), scenario.vehicles, first=1)
        sources = [source for trusted in listed.values() for source in trusted]
        yield from unknown_vehicles("defence.trusted", sources, scenario.vehicles, first=0)
        if isinstance(self.trusted, NearestSources) and scenario.topology.redrawn():
            message = "who is nearest the navigator is not known where every lane has links of its own"
            yield Fault(("defence.trusted", "topology"), message)
        if (self.needs_ticks() or self.draws()) and scenario.tick == 0:
            yield Fault(("defence", "tick"), f"{self.kind} decides at ticks: give a tick")


class Sparing(Defence):
    """A rule that spares trusted sources, unless they are to be judged as others are."""

    drop_trusted: bool = Field(
        default=False, description="whether trusted sources are judged, and dropped, as others are"
    )

    def spares(self, trusted: Any) -> Any:
        """Of trusted links, or slots, those whose weight is not touched."""
        return trusted & (not self.drop_trusted)

    def may_drop(self, graph: Digraph, trusted: Links) -> AnySubset:
        """Whom it does not spare."""
        known = self.retained(graph, trusted)
        return known or any_untrusted(graph, self.spares(trusted), len(trusted) + 1)

    def spared(self, around: Neighbourhood) -> Any:
        """Slots (slots, m, lanes) whose weight is not touched."""
        return self.spares((around.weights > 0) & around.trusted[:, :, None])


def by_listener(value: Any, vehicles: int) -> np.ndarray:
    """A whole number for all vehicles, or {vehicle: number} with 0 for the others: (m,)."""
    if not isinstance(value, dict):
        return np.full(vehicles, value, dtype=np.int64)
    return np.array([value.get(vehicle, 0) for vehicle in range(1, vehicles + 1)], dtype=np.int64)
