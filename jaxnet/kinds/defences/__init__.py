"""Defences: the weights that a vehicle gives to its sources, from what it receives and what it
knows of itself.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from jaxtyping import Int
from pydantic import Field

from jaxnet.kinds.fields import NotNegative, OneNumber, OneOf, Record, setting
from jaxnet.kinds.kind import Fault, KindError, unknown_vehicles
from jaxnet.kinds.protocols import ScenarioView
from jaxnet.kinds.shapes import (
    AnyMask,
    Decision,
    LaneNumbers,
    LaneTimes,
    Memory,
    SlotJets,
    SlotMask,
    SlotSources,
    SlotVectors,
    VehicleJets,
    VehicleVectors,
)
from jaxnet.kinds.ticks import DrawsAtTicks
from jaxnet.model import safety
from jaxnet.model.graph import Digraph, Links, hops, least, trusted_links
from jaxnet.model.retained import DropPolicy, any_untrusted, everybody
from jaxnet.model.safety import Safe, Vehicles

Theta = Annotated[int, Field(ge=0, le=10_000)]


class Neighbourhood(NamedTuple):
    """What vehicles know of their surroundings when they decide, by slot.

    A vehicle has as many slots as the busiest listener has sources. A slot without a source holds
    the vehicle itself, with weight 0.

    - `sources` (slots, m): number of the source, 0 is the navigator
    - `weights` (slots, m, lanes): weights of the graph
    - `trusted` (slots, m): whether the listener trusts the source
    - `gain` (r, lanes): gains of ε, ε̇, …; (r, 2, 2, lanes) where these are matrices; those of
      vehicle 1 where each vehicle has its own
    - `time` (lanes,): time [s]
    - `shared`: the result of the defence's `shared`
    - `announced` (2, slots, m, lanes): announcement of each slot's source, attacked or not
    - `attacked` (slots, m, lanes): the truth, for observations of it that may err
    - `arrived` (slots, m, lanes): the slots whose message arrived; None if every message arrives.
      `weights` are then those of the arrived messages, 0 in other slots
    - `linked` (slots, m, lanes): the slots with a source in the network in force, whether or not
      its message arrived
    - `messages` (2, slots, m, lanes): R of what each slot carries, minus R of the navigator's path
      [m/s³]; not-a-number where no message is there. None for a defence that does not ask by
      `hears_messages`

    Examples
    --------
    >>> import jaxnet
    >>> from jaxnet.kinds.defences import Defence
    >>> class NavigatorOnly(Defence):
    ...     '''Retain the navigator alone.'''
    ...
    ...     def decide(self, own, received, last, memory, around):
    ...         from_navigator = (around.sources == 0)[:, :, None]
    ...         return (around.weights > 0) & from_navigator, memory
    >>> keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5, "defence": NavigatorOnly()}
    >>> jaxnet.simulate(keys, samples=2, progress=False).lanes["status"].to_list()
    ['ok', 'ok']
    """

    sources: Any
    weights: Any
    trusted: Any
    gain: Any
    time: Any
    shared: Any
    announced: Any = None
    attacked: Any = None
    arrived: Any = None
    linked: Any = None
    messages: Any = None


class AnyDefence(DrawsAtTicks):
    """Base class of all defences. One that lacks the keys of `Defence` has class attributes."""

    if TYPE_CHECKING:
        trusted: Any
        noise: Any
        isolated: Any

    decides: ClassVar[bool] = False
    claims: ClassVar[frozenset[str]] = frozenset(
        {
            "guarantee",
            "promise",
            "retained",
            "may_drop",
            "safe",
            "describe",
            "outnumbered",
            "starved",
            "asks",
            "tolerates",
            "observes",
        }
    )
    guarantee: ClassVar[str] = "none is known"

    def promise(self) -> str:
        """The guarantee of the defence with its keys, in words; by default `guarantee`."""
        return self.guarantee

    def asks(self) -> str:
        """What the rule asks of the sources of a vehicle that may drop any; "" if nothing."""
        return ""

    def outnumbered(self, graph: Digraph, attacked: Links, trusted: Links) -> Vehicles:
        """Vehicles (m,) that hear more attacked sources than the defence is set for."""
        return np.zeros(graph.vehicles, bool)

    def starved(self, graph: Digraph, trusted: Links, share: float) -> float:
        """The greatest share of ticks in which a vehicle lacks messages that the rule asks for.

        Each message is lost with the probability `share`, apart from the others.
        """
        return 0.0

    def tolerates(self) -> int | None:
        """The F of W-MSR's theorems on agreement (theorems.md O9); None for other defences."""
        return None

    def needs_ticks(self) -> bool:
        """Whether the defence has a memory: it cannot decide at every instant (`tick: 0`)."""
        return True

    def coasts(self) -> bool:
        """Whether vehicles that decisions cut off from the navigator keep their last drive."""
        return self.isolated == "coast"

    def anchoring(self, time: LaneTimes) -> LaneNumbers | None:
        """The share λ, 0 to 1, by which vehicles are held to their own starts from a tick on.

        None, the default, means never. Only a local law knows it. `time` (lanes,) is in s.
        """
        return None

    def anchors(self) -> bool:
        """Whether `anchoring` gives a share."""
        return False

    def observes(self) -> tuple[OneNumber, OneNumber, float] | None:
        """What an observation α of an honest source is, that of a liar, and when motion begins [s].

        An observation is the probability of 1, else of 0, or a distribution of numbers from 0 to 1.
        None, the default, if vehicles do not sum independent observations.
        """
        return None

    def draws(self):
        return self.noise is not None and self.noise != 0

    def trusts(self, graph: Digraph) -> Links:
        """The trusted links of a graph."""
        if isinstance(self.trusted, ShareOfLinks | NearestSources):
            return self.trusted.links(graph)
        return graph.none if self.trusted == "none" else trusted_links(graph, self.trusted)

    def shared(self, graph: Digraph, trusted: Links, sources: np.ndarray) -> Memory:
        """Arrays that all lanes share, any pytree; by default None.

        `sources` (slots, m) are the numbers of the sources.
        """
        return None

    def start(self, around: Neighbourhood) -> Memory:
        """The memory before the first tick: any pytree of arrays, lanes last; by default None."""
        return None

    def announcement(self, memory: Memory) -> VehicleVectors | None:
        """The announcement `R(y) - R(y_0)` of each vehicle, (2, m, lanes); by default None.

        An attacked link adds R of its signal, or carries it alone if the threat is `replaces`.
        """
        return None

    def announcing(self) -> bool:
        """Whether vehicles announce `R(y) - R(y_0)`, and sources are judged by announcements."""
        return False

    def hears_messages(self) -> bool:
        """Whether it judges R of the messages at a tick. It then decides on missing ones too."""
        return False

    def judges_by(self, received: SlotJets, time: LaneTimes) -> SlotJets:
        """Received jets with the noise of the decision; the law uses the jets without it."""
        return received if self.noise is None else self.noisy(received, self.noise, time)

    def overheard(
        self, announced: SlotVectors, sources: SlotSources, time: LaneTimes
    ) -> SlotVectors:
        """Announcements (2, slots, m, lanes) [m/s³] as vehicles see them to decide and announce.

        `sources` (slots, m) are the numbers of the sources. The navigator, 0, announces 0 exactly.
        """
        if self.noise is None:
            return announced
        (noisy,) = self.noisy((announced,), self.noise, time, first=3)
        return noisy.__array_namespace__().where((sources > 0)[None, :, :, None], noisy, announced)

    def decide(
        self,
        own: VehicleJets,
        received: SlotJets,
        last: Decision,
        memory: Memory,
        around: Neighbourhood,
    ) -> tuple[Decision, Memory]:
        """The decision and the memory after one tick.

        Parameters
        ----------
        own
            A vehicle's position, velocity and acceleration [m, m/s, m/s²], each (2, m, lanes).
        received
            The jets received in each slot, each (2, slots, m, lanes).
        last
            The decision at the last tick; at the first tick every source is retained.
        memory
            The memory from the last tick, or from `start`.
        around
            Sources, weights, trust, gains and time.

        Returns
        -------
            Decision and memory. The decision is (slots, m, lanes), or (2, slots, m, lanes) by axis.
            It is boolean, whether a source is retained, or holds weights ≥ 0, which are normalised
            afterwards.
        """
        raise KindError(
            f"{self.kind}: a defence gives decide(self, own, received, last, memory, around)"
        )

    def retained(self, graph: Digraph, trusted: Links) -> DropPolicy | None:
        """The sets of sources that the defence may retain; None, the default, if not known."""
        return None

    def may_drop(self, graph: Digraph, trusted: Links) -> DropPolicy:
        """A bound on the sources that the defence drops; by default every source."""
        return self.retained(graph, trusted) or any_untrusted(graph, graph.none, len(trusted) + 1)

    def safe(self, graph: Digraph, attacked: Links, trusted: Links) -> list[Safe]:
        """Vehicles that end on the navigator whatever attackers send, by reason, strongest first.

        By default a vehicle is safe if nothing upstream of it is attacked, or if all attacked
        sources upstream are dropped.
        """
        known, none = self.retained(graph, trusted), np.zeros(graph.vehicles, int)
        dropped = self.may_drop(graph, trusted)
        reasons = [Safe("untouched", safety.greatest(dropped, attacked, none))]
        if known is not None:
            reasons.append(Safe("by trust", safety.greatest(known.believed(), attacked, none)))
        return reasons

    def describe(self, graph: Digraph, attacked: Links, trusted: Links) -> dict[str, str]:
        """Lines of `jaxnet check`: what the defence promises on this graph under this attack."""
        dropped, known = self.may_drop(graph, trusted).links, self.retained(graph, trusted)
        told = "may drop any source" if dropped.any() else "drops no source but changes weights"
        told += " that is not trusted" * bool(dropped.any() and (graph.heard & ~dropped).any())
        told += ", so there is no bound"
        if known is not None and not dropped.any():
            told = "changes no weight in this network, so bounds are as without a defence"
        return {"defence": f"{self.words or self.kind.replace('_', ' ')} {told}"}


class ShareOfLinks(Record):
    """The navigator, and a random share of the vehicles that each hears, rounded at random."""

    share: float = Field(ge=0, le=1, description="of each listener's links to vehicles")
    seed: int = setting(0, "of the draw, which all lanes share", ge=0)

    def links(self, graph: Digraph) -> Links:
        """The trusted links; with one seed, a greater share contains a smaller one."""
        heard, random = graph.heard & (graph.sources > 0), np.random.default_rng(self.seed)
        lots = np.array([random.random(graph.vehicles + 1)[each] for each in graph.sources])
        number = np.floor(self.share * heard.sum(axis=1) + random.random(len(heard)))
        return trusted_links(graph, {}) | least(heard, lots, number)


class NearestSources(Record):
    """The n sources of each vehicle with the fewest links to the navigator, a source too."""

    nearest: int = setting(..., "sources, of those equally far the lowest numbers", ge=1, le=10_000)

    def links(self, graph: Digraph) -> Links:
        return least(graph.heard, np.append(0.0, hops(graph))[graph.sources], self.nearest)


class Defence(AnyDefence):
    """A rule by which vehicles weigh what they receive. A subclass gives `decide`.

    A jet is a position with its velocity and acceleration, relative to the navigator's. A rule that
    uses differences alone gives the same decision for relative and absolute jets.

    Examples
    --------
    >>> import jax.numpy as jnp, jaxnet
    >>> from jaxnet.kinds.defences import Defence
    >>> from jaxnet.kinds.fields import Positive
    >>> class Nearby(Defence):
    ...     '''Weigh a source by exp(-distance / radius). Trusted sources keep their weight.'''
    ...
    ...     radius: Positive = 10.0  # [m]
    ...
    ...     def decide(self, own, received, last, memory, around):
    ...         distance = jnp.hypot(*(received[0] - own[0][:, None]))
    ...         share = jnp.exp(-distance / self.radius[None, None])
    ...         return around.weights * jnp.where(around.trusted[:, :, None], 1.0, share), memory
    >>> keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5}
    >>> keys |= {"sweep": {"defence.radius": [1, 10]}}
    >>> results = jaxnet.simulate({**keys, "defence": Nearby}, samples=2, progress=False)
    >>> results.cells["ok"].to_list()
    [2, 2]
    """

    decides: ClassVar[bool] = True
    off_at_zero = frozenset({"noise"})
    untraced: ClassVar[frozenset[str]] = frozenset({"label", "trusted"})

    trusted: Annotated[
        Literal["none"] | dict[int, list[int]] | ShareOfLinks | NearestSources,
        OneOf("must be none, {vehicle: [sources]}, {share: s} or {nearest: n}"),
    ] = setting(
        {},
        "trusted sources: {vehicle: [sources]}, these and the navigator; {share: s, seed: n}, a "
        "drawn share and the navigator; {nearest: n}, the n sources with the fewest links from "
        "the navigator; none, no source",
    )
    noise: NotNegative = setting(
        0.0,
        "[m], standard deviation on each axis of an error in what the defence "
        "judges, drawn for each source and tick; the same number in m/s, m/s² and m/s³ for "
        "velocities, accelerations and announcements; the law has no such error",
    )
    isolated: Literal["fail", "coast"] = setting(
        "fail",
        "if a vehicle drops its last path to the navigator: fail, its lane fails; "
        "coast, it keeps its last drive until a believed path reaches it again, or stops where it "
        "comes to rest",
    )

    def faults(self, scenario):
        listed = self.trusted if isinstance(self.trusted, dict) else {}
        yield from unknown_vehicles("defence.trusted", [*listed], scenario.vehicles, first=1)
        sources = [source for trusted in listed.values() for source in trusted]
        yield from unknown_vehicles("defence.trusted", sources, scenario.vehicles, first=0)
        redrawn, turns = scenario.topology.redrawn(), len(scenario.topology.turns())
        if isinstance(self.trusted, NearestSources) and (redrawn or turns > 1):
            why = "every lane has links of its own" if redrawn else "networks take turns"
            message = f"who is nearest the navigator is not known where {why}"
            yield Fault(("defence.trusted", "topology"), message)
        if (self.needs_ticks() or self.draws()) and scenario.tick == 0:
            yield Fault(("defence", "tick"), f"{self.kind} decides at ticks: give a tick")
        elif self.coasts() and scenario.tick == 0:
            message = "coast: a vehicle keeps its drive from tick to tick: give a tick, or fail"
            yield Fault(("defence.isolated", "tick"), message)
        if self.anchors():
            yield from anchor_faults(scenario)


def anchor_faults(scenario: ScenarioView) -> Iterator[Fault]:
    """What cannot be held to its start."""
    law, vehicle, held = scenario.law, scenario.vehicle, "vehicles that are held to their starts"
    if law.couples() or law.by_link:
        yield Fault(("defence", "law"), f"{held} need law: local")
    elif vehicle.singular:
        message = f"{held} may come to rest, where {vehicle.kind} is singular"
        yield Fault(("defence", "vehicle"), message)
    elif scenario.formation.moves:
        yield Fault(("defence", "formation"), f"{held} need a formation that stands")


class Sparing(Defence):
    """A rule that never drops trusted sources, unless `drop_trusted` is true."""

    drop_trusted: bool = setting(
        False, "whether trusted sources are judged and dropped like others"
    )

    def spares(self, trusted: AnyMask) -> AnyMask:
        """The trusted links or slots whose weight the rule does not change."""
        return trusted & (not self.drop_trusted)

    def retained(self, graph, trusted):
        """Every source where the rule spares all that are heard; else not known."""
        return None if (graph.heard & ~self.spares(trusted)).any() else everybody(graph)

    def may_drop(self, graph, trusted):
        """A bound on the sources that the rule drops: every source that it does not spare."""
        known = self.retained(graph, trusted)
        return known or any_untrusted(graph, self.spares(trusted), len(trusted) + 1)

    def spared(self, around: Neighbourhood) -> SlotMask:
        """The slots (slots, m, lanes) whose weight the rule does not change."""
        return self.spares((around.weights > 0) & around.trusted[:, :, None])


class ExpectsF(Sparing):
    """A rule for up to F attacked sources of any vehicle."""

    F: int = setting(
        1, "greatest number of attacked sources that a vehicle expects", ge=0, le=10_000
    )

    def outnumbered(self, graph, attacked, trusted):
        return (attacked & ~self.spares(trusted)).sum(axis=1) > self.F


class BearsTheta(Defence):
    """A rule for up to ϑ attacked sources of a vehicle."""

    untraced = frozenset({"label", "theta", "trusted"})

    theta: Annotated[Theta | dict[int, Theta], OneOf()] = setting(
        1, "ϑ for all vehicles, or {vehicle: ϑ}, 0 for those not named"
    )

    def thetas(self, graph: Digraph) -> Int[np.ndarray, " m"]:
        """ϑ of each vehicle."""
        if not isinstance(self.theta, dict):
            return np.full(graph.vehicles, self.theta, dtype=np.int64)
        return np.array([self.theta.get(i, 0) for i in range(1, graph.vehicles + 1)], np.int64)

    def faults(self, scenario):
        yield from super().faults(scenario)
        listed = self.theta if isinstance(self.theta, dict) else {}
        yield from unknown_vehicles("defence.theta", [*listed], scenario.vehicles, first=1)
