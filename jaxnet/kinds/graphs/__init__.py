"""Graphs: which sources a vehicle hears, and with what weights.

A graph of m vehicles is an array (m, m + 1), dense or sparse (SciPy), or a `model.graph.Digraph`.
Row i - 1 of the array holds the weights of vehicle i; column j belongs to source j, and column 0 to
the navigator.
"""

import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int
from pydantic import AfterValidator, Field

from jaxnet.kinds.fields import (
    Number,
    OneOf,
    Record,
    Within,
    is_drawn,
    median,
    setting,
    value_range,
)
from jaxnet.kinds.kind import Fault, Kind, KindError, broken, unknown_vehicles
from jaxnet.kinds.protocols import LaneDraw, ScenarioView
from jaxnet.lazy import sparse
from jaxnet.model import graph, hearing
from jaxnet.model.graph import Digraph
from jaxnet.model.patterns import Neighbours
from jaxnet.model.retained import RowStrength, WeightsAsTheyAre, WithOwnWeight
from jaxnet.networks import GREATEST_EDGE_WEIGHT

# Least relative weight of a link: below it 1 - w rounds to 1, and L is singular
LEAST_WEIGHT = 1e-15
TRIES = 1000  # draws of a graph, until the navigator reaches every vehicle

Asked = TypeVar("Asked", bound=Callable[..., Any])
GivenGraph = Any  # a Digraph, or weights (m, m + 1) as an array of NumPy or a sparse array of SciPy
SlotSourceTable = Int[np.ndarray, "slots m"]
LaneWeights = Float[np.ndarray, "samples slots m"]


class ByIdentity:
    """A cache key that equals only keys of the same objects: the argument, unless others are given.

    The key keeps the argument, and so the objects in it, alive.
    """

    def __init__(self, one: Any, *objects: object):
        self.one, self.objects = one, tuple(map(id, objects or (one,)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ByIdentity) and self.objects == other.objects

    def __hash__(self) -> int:
        return hash(self.objects)


def shared_by_cells(found: Asked, key: Callable[[Any], ByIdentity] = ByIdentity) -> Asked:
    """Cache the last results of a function, by a key of its first argument and by the others."""
    cached = functools.lru_cache(maxsize=16)(lambda itself, *rest: found(itself.one, *rest))
    shared: Any = lambda one, *rest: cached(key(one), *rest)  # noqa: E731
    functools.update_wrapper(shared, found)
    return shared


class Graph(Kind):
    """A weighted digraph with a navigator. A subclass gives `weights`.

    Examples
    --------
    >>> import jaxnet, numpy as np
    >>> from jaxnet.kinds.graphs import Graph
    >>> class Ladder(Graph):
    ...     '''Every vehicle hears the navigator and the two vehicles before it.'''
    ...
    ...     def weights(self, vehicles):
    ...         before = np.eye(vehicles, k=-1) + np.eye(vehicles, k=-2)
    ...         return np.hstack([np.ones((vehicles, 1)), before])
    >>> study = jaxnet.load({"vehicles": 3, "topology": Ladder(), "attack": "none"})
    >>> study.config.topology.weights(3).astype(int).tolist()
    [[1, 0, 0, 0], [1, 1, 0, 0], [1, 1, 1, 0]]
    """

    linked_by: ClassVar[str] = "topology"  # the key by which the navigator reaches everybody

    own_weight: float = setting(
        0.0,
        "weight of a vehicle on itself, relative to the mean weight of its sources; only law: "
        "local uses it",
        title="weight on oneself",
        ge=0.0,
        le=GREATEST_EDGE_WEIGHT,
    )

    def weights(self, vehicles: int) -> GivenGraph:
        """The weights of the graph; drawn numbers count with their medians.

        Parameters
        ----------
        vehicles
            Number m of vehicles.

        Returns
        -------
            Weights w_ij ≥ 0, (m, m + 1), as an array of NumPy, a sparse array of SciPy, or a
            `Digraph`. The rows are normalised to sum 1 afterwards. An entry w_ii is the weight of a
            vehicle on itself.
        """
        raise NotImplementedError

    def links(self, vehicles: int) -> GivenGraph:
        """Links that a lane may have, in the form of `weights`; others have weight 0."""
        return self.weights(vehicles)

    def size(self) -> int | None:
        """The number of vehicles, None if the graph takes any number."""
        return None

    def leaderless(self) -> "Graph":
        """The graph without a navigator. Override it if its nodes then have other numbers."""
        return self

    def vehicle_names(self) -> Sequence[str]:
        """The names of the vehicles 1 … m; empty if vehicles have numbers only."""
        return ()

    def turns(self) -> Sequence["Graph"]:
        """The networks that take turns; by default this graph alone."""
        return [self]

    @shared_by_cells
    def linked(self, vehicles: int) -> Digraph:
        """The graph of the possible links, each with weight 1; raise KindError."""
        given = self.digraph(self.links(vehicles), vehicles)
        return unwritable(given._replace(weights=given.heard.astype(float)))

    def differs(self) -> bool:
        """Whether lanes have graphs or weights of their own."""
        return bool(self.drawn_keys())

    def breaks(self):
        several = len(self.turns()) > 1
        return broken(one_network=several, same_links=self.redrawn(), alike=self.differs())

    def redrawn(self) -> bool:
        """Whether lanes have links of their own, not only weights."""
        return self.differs() and not self.drawn_keys()

    def lane_weights(self, draw: LaneDraw, vehicles: int, sources: SlotSourceTable) -> LaneWeights:
        """The weights of each lane by slot. Only a graph that differs by lane needs this method."""
        raise NotImplementedError

    def weights_by_slot(
        self, draw: LaneDraw, vehicles: int, sources: SlotSourceTable
    ) -> LaneWeights:
        """The normalised weights of each lane by slot."""
        if self.differs():
            return self.lane_weights(draw, vehicles, sources)
        given = self.normalised_rows(vehicles)
        return draw.same(hearing.by_slot(given, given.weights, sources))

    @shared_by_cells
    def normalised_rows(self, vehicles: int) -> Digraph:
        """The graph with rows of sum 1, or 0 where a vehicle hears nobody; raises KindError."""
        return unwritable(graph.normalised(self.digraph(self.weights(vehicles), vehicles)))

    def normalises(self) -> bool:
        """Whether only relative weights count."""
        return True

    def rows_with_loops(self, vehicles: int) -> Digraph:
        """The given weights, with the weights of vehicles on themselves; raise KindError."""
        return self.checked(self.weights(vehicles), vehicles)

    def strength(self, weights: LaneWeights, navigator: bool) -> RowStrength | None:
        """The strength of the rows of each lane, None if it is 1: leaves (samples, m).

        `weights` are those of the lanes, and `navigator` says whether the fleet has one.
        """
        samples, _, m = weights.shape
        own, others = graph.row_sums(self.rows_with_loops(m), navigator)
        if not self.normalises():
            return WeightsAsTheyAre(np.broadcast_to(others, (samples, m)))
        heard = np.maximum(1, (weights > 0).sum(axis=1))
        share = np.divide(own, others, out=np.zeros(m), where=others > 0) + self.own_weight / heard
        return WithOwnWeight(share) if share.any() else None

    def digraph(self, given: GivenGraph, vehicles: int) -> Digraph:
        """The graph of `weights` or `links` without loops; raise KindError."""
        found = self.checked(given, vehicles)
        return found.only(found.sources != np.arange(1, vehicles + 1)[:, None])

    def checked(self, given: GivenGraph, vehicles: int) -> Digraph:
        """The graph of `weights` or `links`; raise KindError."""
        if not isinstance(given, Digraph):
            try:
                given = given if sparse.issparse(given) else np.asarray(given, float)
            except (TypeError, ValueError):  # text, or rows of unlike lengths
                given = np.empty(())
            given = graph.of_matrix(given) if given.shape == (vehicles, vehicles + 1) else None
        if given is None or given.vehicles != vehicles or not (given.weights >= 0).all():
            shape = f"({vehicles}, {vehicles + 1})"
            raise KindError(f"{self.kind}: weights must be {shape} numbers, none of them negative")
        if not np.isfinite(given.weights).all():
            raise KindError(f"{self.kind}: weights must be finite")
        return given

    def faults(self, scenario):
        """A fault if there is a navigator that does not reach every vehicle: L is singular then."""
        if scenario.law.couples() and (self.own_weight or not self.normalises()):
            name = "own_weight" if self.own_weight else "normalised"
            yield Fault((f"topology.{name}", "law"), f"{name} acts under law: local alone")
        if not scenario.navigator.present:
            return
        lost, least = check_reach(self, scenario.vehicles)
        if lost:
            message = f"the navigator does not reach {', '.join(map(str, lost))}"
            if len(lost) == scenario.vehicles:
                message += "; `navigator: none` makes a fleet without one"
            yield Fault((self.linked_by, "topology"), message)
        elif least < LEAST_WEIGHT:
            message = f"a link has less than {LEAST_WEIGHT:g} of the weights of its listener"
            yield Fault((self.linked_by, "topology"), message)


def unwritable(shared: Digraph) -> Digraph:
    views = Digraph(*(array.view() for array in shared))
    for view in views:
        view.flags.writeable = False
    return views


@shared_by_cells
def check_reach(given: Graph, vehicles: int) -> tuple[list[int], float]:
    """The vehicles that the navigator does not reach, and the least weight of a link."""
    found = given.normalised_rows(vehicles)
    return graph.unreachable(found), float(found.weights[found.heard].min(initial=1.0))


class ShareOfVehicles(Record):
    """A share of the vehicles, drawn at random and rounded."""

    share: float = Field(gt=0, le=1, description="of the vehicles")


def check_navigator_weight(weight: Number) -> Number:
    if is_drawn(weight) and value_range(weight)[1] >= 1:
        raise ValueError("must be less than 1 where it is drawn: at 1 nobody hears a neighbour")
    return weight


class Unweighted(Graph):
    """Links between vehicles, links from the navigator, and a rule for the weights. A subclass
    gives `heard`.

    A random graph is drawn until the navigator reaches every vehicle, so each such graph is equally
    likely.
    """

    linked_by: ClassVar[str] = "topology.navigator"

    navigator: Annotated[
        Literal["all"] | list[int] | ShareOfVehicles,
        OneOf("must be all, a list of vehicles or {share: s}"),
    ] = setting("all", "who hears the navigator: all, those listed, or a {share} drawn")
    navigator_weight: Annotated[
        Number, Within(gt=0.0, le=1.0), AfterValidator(check_navigator_weight)
    ] = setting(0.1, "weight of the navigator where it is heard; the neighbours share the rest")
    weighting: Literal["uniform", "metropolis"] = setting(
        "uniform",
        "weights of neighbours: uniform, all the same; metropolis, 1/(1 + d), where "
        "d is the number of vehicles that the listener hears, or the source if it hears more",
    )
    seed: int = setting(0, "seed of a draw for all lanes", ge=0)

    def heard(self, vehicles: int, random: np.random.Generator) -> Neighbours:
        """Which vehicles each vehicle hears, (m, m) booleans, dense or sparse."""
        raise NotImplementedError

    def impossible(self, vehicles: int) -> Iterator[Fault]:
        """The reasons why no such graph of this number of vehicles exists."""
        yield from ()

    def is_random(self) -> bool:
        return isinstance(self.navigator, ShareOfVehicles)

    def informed(self, vehicles: int, random: np.random.Generator) -> Bool[np.ndarray, " m"]:
        """Vehicles that hear the navigator. With one generator greater shares contain smaller."""
        everyone = np.arange(1, vehicles + 1)
        if isinstance(self.navigator, ShareOfVehicles):
            number = round(self.navigator.share * vehicles)
            return np.isin(everyone, random.permutation(everyone)[:number])
        return np.isin(everyone, everyone if self.navigator == "all" else self.navigator)

    def connected(self, vehicles: int, random: np.random.Generator) -> Digraph:
        """Draw links until the navigator reaches every vehicle; raise KindError if no draw does."""
        for _ in range(TRIES):
            informed = np.flatnonzero(self.informed(vehicles, random))
            listeners, heard, _ = graph.entries(self.heard(vehicles, random))
            sources = np.concatenate([np.zeros_like(informed), heard + 1])
            links = graph.of_links(vehicles, np.concatenate([informed, listeners]), sources)
            if not (self.is_random() and graph.unreachable(links)):
                return links
        raise KindError(f"{self.kind}: the navigator reaches everybody in none of {TRIES} draws")

    def weights(self, vehicles):
        """The weights by the rule. If each lane draws its graph, these are of one such graph."""
        links = self.connected(vehicles, np.random.default_rng(self.seed))
        weights = self.weighted(links, median(self.navigator_weight), links.sources.T)
        return links._replace(weights=np.ascontiguousarray(weights.T))

    def weighted(
        self, links: Digraph, number: float | np.ndarray, sources: Int[np.ndarray, "table m"]
    ) -> Float[np.ndarray, "*samples table m"]:
        """The weights by slot of a table, for a navigator's weight () or (samples, 1).

        A vehicle that hears no neighbour hears the navigator alone.
        """
        if self.weighting == "uniform":
            parts = (links.heard & (links.sources > 0)).astype(float)
        else:
            parts = graph.metropolis(links)
        total = parts.sum(axis=1)
        informed = (links.heard & (links.sources == 0)).any(axis=1)
        navigator = informed * np.where(total > 0, number, 1.0)
        rest = (1.0 - navigator) / np.where(total > 0, total, 1.0)
        by_slot = hearing.by_slot(links, parts, sources)
        return np.where(sources == 0, navigator[..., None, :], by_slot * rest[..., None, :])

    def lane_weights(self, draw, vehicles, sources):
        links = self.connected(vehicles, np.random.default_rng(self.seed))
        numbers = draw.one(self.navigator_weight, "topology.navigator_weight")
        return self.weighted(links, numbers[:, None], sources)

    def faults(self, scenario):
        listed = self.navigator if isinstance(self.navigator, list) else []
        found = [
            *unknown_vehicles("topology.navigator", listed, scenario.vehicles, first=1),
            *self.impossible(scenario.vehicles),
        ]
        yield from found or super().faults(scenario)


class Random(Unweighted):
    """Random links: one graph from `seed`, or with `redraw` one graph for each lane."""

    redraw: bool = setting(False, "whether each lane has a graph of its own")

    def is_random(self):
        return True

    def links(self, vehicles):
        if not self.redraw:
            return super().links(vehicles)
        informed = np.ones(vehicles, bool)
        if not isinstance(self.navigator, ShareOfVehicles):
            informed = self.informed(vehicles, np.random.default_rng())
        return np.column_stack([informed, ~np.eye(vehicles, dtype=bool)])

    def differs(self):
        return self.redraw or super().differs()

    def redrawn(self):
        return self.redraw

    def lane_weights(self, draw, vehicles, sources):
        if not self.redraw:
            return super().lane_weights(draw, vehicles, sources)
        numbers = draw.one(self.navigator_weight, "topology.navigator_weight")
        graphs = (self.connected(vehicles, random) for random in draw.generators("topology"))
        pairs = zip(graphs, numbers, strict=True)
        return np.stack([self.weighted(links, number, sources) for links, number in pairs])


class EdgeGraph(Graph):
    """A graph by its edges (i, j, w), "i hears j with weight w". A subclass gives `listed`."""

    normalised: bool = setting(
        True, "whether rows are divided by their sum; false: law: local takes weights as they are"
    )

    def listed(self) -> Sequence[tuple[int, int, Number]]:
        """The edges; raise KindError if there are none to read."""
        raise NotImplementedError

    def weights(self, vehicles):
        edges = [(i, j, median(weight)) for i, j, weight in self.listed() if i != j]
        return graph.weighted(vehicles, edges)

    def normalises(self):
        return self.normalised

    def rows_with_loops(self, vehicles):
        edges = [(i, j, median(weight)) for i, j, weight in self.listed()]
        listeners, sources, weights = np.array(edges, float).reshape(-1, 3).T
        return graph.of_links(vehicles, listeners - 1, sources, weights)

    def size(self) -> int | None:
        return max(max(listener, source) for listener, source, _ in self.listed())

    def edge_faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        vehicles, seen = scenario.vehicles, set[tuple[int, int]]()
        for number, (listener, source, _) in enumerate(self.listed()):
            keys, pair = (f"topology.edges.{number}", "topology.edges"), f"[{listener}, {source}]"
            if not (1 <= listener <= vehicles and 0 <= source <= vehicles):
                message = f"i is 1 to {vehicles} and j 0 to {vehicles} (got {pair})"
                yield Fault((*keys, "vehicles"), message)
            elif listener == source and scenario.law.couples():
                yield Fault(keys, f"{listener} hears itself, which law: local alone allows")
            elif (listener, source) in seen:
                yield Fault(keys, f"{pair} is given twice")
            seen.add((listener, source))

    def faults(self, scenario):
        last = self.size()
        if last is not None and last < scenario.vehicles:
            noun = "vehicle" if last == 1 else "vehicles"
            message = f"the graph has {last} {noun} (got {scenario.vehicles})"
            yield Fault(("vehicles", "topology"), message)
            return
        yield from super().faults(scenario)


def too_many(key: str, number: int, vehicles: int) -> Iterator[Fault]:
    if number >= vehicles:
        message = f"must be less than the {vehicles} vehicles (got {number})"
        yield Fault((key, "topology", "vehicles"), message)
