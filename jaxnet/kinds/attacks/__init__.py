"""Attacks: signals that falsify what links carry, as fixed vectors times scalar functions
(`model.signal`).

`‖a_j^(k)(t)‖ ≤ ā` for k = 0..3 holds by construction. An attack gives unit signals, and bounds on
them and their derivatives by `sizes`; the vectors are scaled by ā over the greatest bound. A file
of this folder is a signal alone. Who is attacked, when, and on which links stands here, once for
all signals.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from annotated_types import Len
from pydantic import Field

from jaxnet.kinds.announcements import Announcement
from jaxnet.kinds.announcements.consistent import Consistent
from jaxnet.kinds.fields import (
    EachOrder,
    Listed,
    Magnitude,
    NotNegative,
    NotNegativeByOrder,
    Number,
    OneOf,
    PerVehicle,
    PositivePerVehicle,
    Record,
    Table,
    Uniform,
    differs,
    setting,
    value_range,
)
from jaxnet.kinds.kind import Fault, Kind, KindError, broken, unknown_vehicles
from jaxnet.kinds.protocols import LaneDraw, NavigatorPath, ScenarioView, Signal, TickView
from jaxnet.kinds.registry import KindOf
from jaxnet.kinds.shapes import (
    AnyNumbers,
    AnyTimes,
    Memory,
    PlaneVectors,
    SignalBasis,
    SignalSizes,
    SignalVectors,
)
from jaxnet.kinds.ticks import TICK_ROUNDING
from jaxnet.model.graph import Digraph, Links, hears_vehicles
from jaxnet.model.signal import ORDERS, Harmonic
from jaxnet.model.wording import count, ranges, sets_in_words

USUAL_TARGETS = [2, 5, 8, 11]
MOMENTS = 1_001  # times at which a signal without bound is sampled
FINENESS = 32  # points of the grid in a period of the highest harmonic
SIGNALS = 1_024  # signals in one batch of Fourier transforms


def usual_targets(vehicles: int) -> list[int]:
    """Vehicles that are attacked by default in a fleet: those of 2, 5, 8, 11 that exist, or 1."""
    return [one for one in USUAL_TARGETS if one <= vehicles] or [1]


class DrawnVehicles(Record):
    """A number of vehicles that are drawn for each lane."""

    random: int = Field(ge=1, title="attacked vehicles", description="how many")


class ChangingVehicles(Record):
    """Sets of vehicles, each attacked from its time until the next."""

    at: Annotated[list[Annotated[float, Field(ge=0.0)]], Len(1)] = Field(
        description="[s], the time from which each set is attacked; before the first, nobody is"
    )
    sets: Annotated[list[list[int]], Len(1)] = Field(
        description="the vehicles attacked from each time on, from 1; [] for nobody"
    )


class AnyAttack(Kind):
    """Base class of all attacks: who is attacked, when, on which links, and how much.

    The keys are those of `Attack`. An attack that has other keys has these as class attributes.

    Examples
    --------
    >>> import jaxnet
    >>> from jaxnet.kinds.attacks import AnyAttack
    >>> attack = jaxnet.load({"attack": "none"}).config.attack
    >>> isinstance(attack, AnyAttack), attack.targets()
    (True, [])
    """

    if TYPE_CHECKING:
        magnitude: Any
        vehicles: Any
        links: Any
        threat: Any
        moves: Any
        orders: Any
        listeners: Any
        sybils: Any
        announces: Any

    present: ClassVar[bool] = False
    strategic: ClassVar[bool] = False  # whether it chooses new vectors at every tick
    constant: ClassVar[bool] = False  # whether its derivatives are 0 from tick to tick
    highest: ClassVar[int] = 3  # order of the highest derivative that `sizes` bounds
    told_order: ClassVar[int] = 3  # of the highest derivative that vehicles hear, three at least
    derived: ClassVar[bool] = True  # whether the signal's derivatives are true derivatives
    bounded: ClassVar[bool] = True  # whether ā bounds the signal and its derivatives

    # --- Who is attacked, and when ----------------------------------------------------------------

    def targets(self) -> list[int]:
        """The listed vehicles, in the order of attack; none if vehicles are drawn."""
        if isinstance(self.vehicles, ChangingVehicles):
            return [*dict.fromkeys(vehicle for each in self.vehicles.sets for vehicle in each)]
        return self.vehicles if isinstance(self.vehicles, list) else []

    def number(self) -> int:
        """The number of vehicles that are attacked at any time."""
        if isinstance(self.vehicles, DrawnVehicles):
            return self.vehicles.random
        return len(self.targets())

    def periods(self) -> list[tuple[float, list[int]]]:
        """Times [s], from 0, from which others are attacked, with these; none if none change."""
        if not isinstance(self.vehicles, ChangingVehicles):
            return []
        found = [*zip(self.vehicles.at, self.vehicles.sets, strict=False)]
        return found if found[0][0] == 0 else [(0.0, []), *found]

    def chosen(self, draw: LaneDraw) -> np.ndarray:
        """Vehicles that the config lists, or those with the least random numbers: (m, lanes)."""
        if isinstance(self.vehicles, DrawnVehicles):
            lots = draw.each(Uniform(uniform=[0.0, 1.0]), "attack.vehicles")[..., 0].T
            return lots.argsort(axis=0, kind="stable").argsort(axis=0) < self.vehicles.random
        attacked = np.isin(draw.everyone, self.targets())
        return np.broadcast_to(attacked[:, None], (len(attacked), len(draw.samples)))

    def on(self, vehicles: list[int]) -> Self:
        """The attack on other vehicles."""
        return self.model_copy(update={"vehicles": vehicles})

    def whom(self) -> str:
        """A short description of the attacked vehicles."""
        if periods := self.periods():
            return sets_in_words(*zip(*periods, strict=True))
        drawn = f"{count(self.number(), 'vehicle')} drawn for each lane"
        return ranges(sorted(self.targets())) or (drawn if self.number() else "nobody")

    # --- On which links, and what they carry ------------------------------------------------------

    def attacked_links(self, graph: Digraph) -> Links:
        """The links from attacked vehicles (`neighbour`), or those from 0 to attacked vehicles.

        If vehicles are drawn, these are all links that may carry the attack.
        """
        links, everyone = self.links, np.arange(1, graph.vehicles + 1)
        if links == "auto":
            links = "neighbour" if hears_vehicles(graph) else "navigator"
        drawn = isinstance(self.vehicles, DrawnVehicles)
        listed = everyone > 0 if drawn else np.isin(everyone, self.targets())
        if links == "neighbour":
            return graph.heard & np.append(False, listed)[graph.sources]
        return graph.heard & (graph.sources == 0) & listed[:, None]

    def by_link(self) -> bool:
        """Whether each listener receives a different signal."""
        return self.listeners == "each"

    def identities(self) -> int:
        """As how many sources each attacked source appears."""
        return 1 + self.sybils

    def apart(self) -> bool:
        """Whether numbers of single vehicles change the functions: each vehicle has its own."""
        return any(shapes for _, _, shapes in own_numbers(self))

    def splits(self) -> bool:
        """Whether links are replaced in some lanes only, or at some times only.

        Such a link takes two slots, one for the source's message and one for the attack's. Each
        lane hears one slot at a time.
        """
        return self.replaces() and not isinstance(self.vehicles, list)

    def replaces(self) -> bool:
        """Whether an attacked link carries the navigator's path plus the signal.

        Otherwise the link carries its source's message plus the signal.
        """
        return self.threat == "replaces"

    def as_told(self) -> bool:
        """Whether attacked vehicles move as they tell, and not by the law."""
        return self.moves == "as_told"

    def misuses(self) -> bool:
        """Whether attacked vehicles tell the truth, and take the signal as their input."""
        return self.moves == "input"

    def falsified(self) -> tuple[int, ...]:
        """Orders, of 0 to 3, of the derivatives that carry the signal; the others are true."""
        return () if self.misuses() else tuple(sorted(set(self.orders)))

    def announcement(self) -> Announcement:
        """How attacked links announce, if the defence makes vehicles announce."""
        return self.announces

    # --- How much, and by which signal ------------------------------------------------------------

    def amplitude(self) -> Magnitude:
        """ā [m, m/s, m/s², m/s³], a number or distribution; the greatest of several magnitudes."""
        return self.magnitude if self.by_order() is None else max(self.magnitude.root)

    def by_order(self) -> list[float] | None:
        """Magnitude of each order from 0, None where one bounds all. Orders beyond are true."""
        return self.magnitude.root if isinstance(self.magnitude, EachOrder) else None

    def fastest(self) -> float:
        """The highest angular frequency between ticks [rad/s], infinite if it is not known."""
        return 0.0 if self.constant else np.inf

    def consistent(self) -> bool:
        """Whether a listener receives a path together with the path's own derivatives."""
        return self.derived and self.falsified() == ORDERS

    def harmonic(self) -> bool:
        """Whether each vehicle's signal has at most one frequency."""
        told = type(self).told is not AnyAttack.told
        return not (self.strategic or told) and isinstance(self.signal(), Harmonic)

    def of_order(self, order: int) -> Self:
        """The drawn attack for vehicles of an order, which hear derivatives up to this order."""
        return self if order <= self.told_order else self.with_values(told_order=order)

    def signal(self) -> Signal:
        """The object with the scalar functions: `basis(time)` is (4, B, lanes) for (lanes,) [s]."""
        raise NotImplementedError

    def vectors(self) -> np.ndarray:
        """The vectors that multiply the scalar functions.

        Returns
        -------
            Vectors (2, m, B, lanes) of spectral norm 1 for each vehicle; m = 1 if all are alike.
        """
        raise KindError(f"{self.kind}: an attack gives vectors(self)")

    def sizes(self, horizon: float) -> np.ndarray:
        """A bound on `max over t of ‖β^(k)(t)‖` for k = 0..3.

        Parameters
        ----------
        horizon
            End of the interval that begins at 0 [s].

        Returns
        -------
            Bounds (4, lanes), or 5 rows if `highest` is 4; none if `bounded` is False.
        """
        raise KindError(f"{self.kind}: an attack gives sizes(self, horizon)")

    def told(self, navigator: NavigatorPath, start: np.ndarray) -> tuple[Signal, np.ndarray | None]:
        """The signal and the unit vectors; a strategic attack has no vectors yet.

        They may depend on the navigator and on positions at t = 0, `start` (2, m, lanes) [m]: those
        of vehicles, or the navigator's where the attack is on what they hear of it.
        """
        return self.signal(), None if self.strategic else np.asarray(self.vectors())

    def reach(self, navigator: NavigatorPath, signal: Signal, horizon: float) -> np.ndarray:
        """`sizes` of the signal of `told`, (4, lanes); without a bound the maximum at MOMENTS."""
        if self.bounded:
            return np.asarray(self.sizes(horizon))
        times = np.linspace(0.0, horizon, MOMENTS)
        basis = [np.asarray(signal.basis(np.full(1, time))) for time in times]
        return np.linalg.norm(basis, axis=2).max(axis=0)

    def breaks(self):
        return broken(
            bounded=not self.bounded,
            one_identity=self.identities() > 1,
            by_law=self.moves != "by_law",
        )

    def describe(self) -> str:
        """A short description of the attack."""
        return self.words or self.kind

    def caveat(self) -> str:
        """How it differs from the paper's, a path with its derivatives within ā; "" if not."""
        if self.misuses():
            return "a misused input, no false message"
        if not self.bounded:
            return "not bounded by ā"
        return "" if self.consistent() else "derivatives falsified each on its own"


class Attack(AnyAttack):
    """A signal on what attacked vehicles transmit, or on what they hear of the navigator.

    A subclass gives `basis`, `vectors` and `sizes`. A strategic subclass gives `basis`, `sizes` and
    `aim`, and `begin` if it has a memory.

    Examples
    --------
    >>> import jaxnet, numpy as np
    >>> from jaxnet.kinds.attacks import Attack
    >>> class Northward(Attack):
    ...     '''A constant offset along the second axis.'''
    ...
    ...     def basis(self, time):
    ...         xp = time.__array_namespace__()
    ...         one, zero = xp.ones_like(time)[None], xp.zeros_like(time)[None]
    ...         return xp.stack([one, zero, zero, zero])
    ...
    ...     def vectors(self):
    ...         return np.array([0.0, 1.0])[:, None, None, None]
    ...
    ...     def sizes(self, horizon):
    ...         return np.array([1.0, 0.0, 0.0, 0.0])[:, None]
    >>> keys = {"engine": "exact", "horizon": 1.0, "tail": 0.5, "attack": Northward()}
    >>> jaxnet.simulate(keys, samples=2, progress=False).lanes["status"].to_list()
    ['ok', 'ok']
    """

    claims = frozenset({"fastest", "constant"})
    present = True

    magnitude: NotNegativeByOrder = setting(
        5.0,
        "[m, m/s, m/s², m/s³], ā, bound on the signal and its derivatives up to the vehicle's "
        "order",
    )
    vehicles: Annotated[list[int] | DrawnVehicles | ChangingVehicles, OneOf()] = setting(
        USUAL_TARGETS,
        "attacked vehicles; {random: n}: n drawn for each lane; {at: [...], sets: [...]}: others "
        "from these times on; by default those of these that exist, or 1",
        title="attacked vehicles",
    )
    links: Literal["auto", "neighbour", "navigator"] = setting(
        "auto",
        "attacked links: neighbour, what attacked vehicles send; navigator, what "
        "they hear from it; auto, navigator if no vehicle hears another",
    )
    threat: Literal["adds", "replaces"] = setting(
        "adds",
        "adds: an attacked link carries its source's message plus the signal; replaces: the "
        "navigator's path plus the signal, whatever the message",
    )
    moves: Literal["by_law", "as_told", "input"] = setting(
        "by_law",
        "by_law: an attacked vehicle obeys the law, whatever it transmits; as_told: it is where it "
        "says it is, which needs threat: replaces; input: it tells the truth, and its r-th "
        "derivative is the signal in m/s^r",
    )
    orders: Annotated[list[Literal[0, 1, 2, 3]], Len(1)] = setting(
        [*ORDERS], "derivatives that carry the signal, 0 is the position; the others are true"
    )
    listeners: Literal["same", "each"] = setting(
        "same", "same: an attacked vehicle sends the same signal to all; each: another one to each"
    )
    sybils: int = setting(
        0, "additional sources that each attacked vehicle pretends to be", ge=0, le=100
    )
    announces: Annotated[Announcement, KindOf("announcement")] = setting(
        Consistent(), "what attacked links announce, if the defence judges announcements"
    )

    @classmethod
    def __pydantic_init_subclass__(cls, **options: object) -> None:
        """Mark keys that no method reads in lanes: those above, and numbers that make vectors.

        A strategic attack reads its numbers of each vehicle at ticks. A subclass with its own
        `basis` is its own signal, whatever class it derives from.
        """
        super().__pydantic_init_subclass__(**options)
        cls.untraced = cls.untraced.union(Attack.model_fields)
        if not cls.strategic:
            cls.untraced |= {key for key in cls.model_fields if cls.drawn_by_vehicle(key)}
        if "basis" in vars(cls) and "signal" not in vars(cls):
            cls.signal = Attack.signal

    def signal(self) -> Signal:
        return self

    def basis(self, time: AnyTimes) -> SignalBasis:
        """The scalar functions with three derivatives.

        Parameters
        ----------
        time
            Times [s], (lanes,).

        Returns
        -------
            β and its first three derivatives, (4, B, lanes).
        """
        raise KindError(f"{self.kind}: an attack gives basis(self, time)")

    def begin(self, seen: TickView) -> Memory:
        """The memory of a strategic attack before the first tick, before any decision or error.

        The memory is any pytree of arrays with lanes last; by default None.
        """
        return None

    def aim(self, seen: TickView, memory: Memory) -> tuple[SignalVectors, Memory]:
        """The vectors of a strategic attack until the next tick, and its memory.

        Parameters
        ----------
        seen
            Errors, decisions, weights and the clock at this tick (`engine.tick.Seen`).
        memory
            The memory from the last tick, or from `begin`.

        Returns
        -------
            Unit vectors (2, m, B, lanes) and the memory. The vectors are scaled to ā, and down to
            norm 1.
        """
        raise KindError(f"{self.kind}: a strategic attack gives aim(self, seen, memory)")

    # --- Keys that exclude each other -------------------------------------------------------------

    def faults(self, scenario):
        targets, vehicle, orders = self.targets(), scenario.vehicle, tuple(sorted({*self.orders}))
        yield from unknown_vehicles("attack.vehicles", targets, scenario.vehicles, first=1)
        sets = self.vehicles.sets if isinstance(self.vehicles, ChangingVehicles) else [targets]
        if twice := [each for each in sets if len(set(each)) < len(each)]:
            yield Fault(("attack.vehicles",), f"named twice (got {twice[0]})")
        if isinstance(self.vehicles, DrawnVehicles) and self.number() > scenario.vehicles:
            message = f"there are {scenario.vehicles} vehicles (got {self.number()})"
            yield Fault(("attack.vehicles", "vehicles"), message)
        if isinstance(self.vehicles, ChangingVehicles):
            yield from self.changing_faults(self.vehicles, scenario)
        if not isinstance(self.vehicles, list) and (self.sybils or self.strategic):
            message = "vehicles that change or are drawn are neither sybils nor strategic"
            yield Fault(("attack.vehicles", "attack"), message)
        if self.by_link() and (self.strategic or not self.bounded):
            yield Fault(("attack.listeners",), f"{self.kind} tells all listeners the same")
        if self.strategic and scenario.tick == 0:
            yield Fault(("attack", "tick"), f"{self.kind} decides at ticks: give a tick")
        got = f"(got {self.orders})"
        if self.replaces() and orders != ORDERS:
            message = f"a link that is replaced carries no true derivative: give [0, 1, 2, 3] {got}"
            yield Fault(("attack.orders", "attack.threat"), message)
        if self.constant and 0 not in orders:
            message = f"{self.kind} has no derivatives: give orders with 0 {got}"
            yield Fault(("attack.orders",), message)
        if orders != ORDERS and vehicle.order != 3:
            message = f"a choice of orders needs a vehicle of order 3 (got {vehicle.kind})"
            yield Fault(("attack.orders", "vehicle"), message)
        if vehicle.order > self.highest:
            message = f"{self.kind} has derivatives up to {self.highest}, {vehicle.kind} has order"
            yield Fault(("attack", "vehicle"), f"{message} {vehicle.order}")
        if self.as_told():
            yield from self.moving_faults(scenario)
        if self.misuses():
            yield from self.input_faults(scenario)
        if self.by_order() is not None:
            yield from self.magnitude_faults(self.magnitude.root, vehicle.order)
        yield from self.number_faults()

    def changing_faults(self, given: ChangingVehicles, scenario: ScenarioView) -> Iterator[Fault]:
        at, tick = given.at, scenario.tick
        keys = ("attack.vehicles.at", "attack.vehicles", "attack")
        if len(at) != len(given.sets):
            yield Fault(keys, f"a time for each of {len(given.sets)} sets (got {len(at)})")
        if sorted(set(at)) != at:
            yield Fault(keys, f"must rise (got {at})")
        if self.splits() and len(scenario.topology.turns()) > 1:
            message = "where networks take turns, split links carry the attack of the same vehicles"
            yield Fault((*keys, "topology"), message)
        if tick == 0:
            yield Fault((*keys, "tick"), "attacked vehicles change at ticks: give a tick")
        elif odd := [time for time in at if abs(time - round(time / tick) * tick) > TICK_ROUNDING]:
            yield Fault((*keys, "tick"), f"must be multiples of tick = {tick:g} (got {odd[0]:g})")

    def moving_faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Faults of vehicles that move as they tell."""
        vehicle, key = scenario.vehicle, "attack.moves"
        if not self.replaces():
            message = "as_told needs false messages: give threat: replaces"
            yield Fault((key, "attack.threat"), message)
        if self.by_link() or self.strategic or self.periods():
            one = "one path for the whole lane, the same for all listeners"
            yield Fault((key, "attack"), f"a vehicle that moves as told tells {one}")
        graph = scenario.topology.linked(scenario.vehicles)
        if (self.attacked_links(graph) & (graph.sources == 0)).any():
            message = "attacked links from the navigator tell nothing of a vehicle"
            yield Fault((key, "attack.links"), message)
        if vehicle.singular or vehicle.internal:
            message = f"a path does not always tell the state of {vehicle.kind}"
            yield Fault((key, "vehicle"), f"{message}, only that of integrators")

    def input_faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Faults of vehicles that misuse their inputs."""
        key, law, late = "attack.moves", scenario.law, scenario.channel.late
        graph = scenario.topology.linked(scenario.vehicles)
        of_navigator = (self.attacked_links(graph) & (graph.sources == 0)).any()
        if of_navigator or self.by_link() or self.sybils or self.strategic or self.replaces():
            told = "input needs links: neighbour, threat: adds, listeners: same, no sybils, and a"
            yield Fault((key, "attack"), f"{told} signal that is known beforehand")
        if self.orders != [*ORDERS] or self.by_order() is not None:
            yield Fault((key, "attack"), "an input is one signal: give one magnitude, all orders")
        if law.couples():
            told = f"under {law.kind} neighbours need the q of one another: give law: local"
            yield Fault((key, "law"), told)
        elif late and law.tells_motion(scenario.channel.extrapolate != "none"):
            told = "delayed messages are of motions by the law: give law.hold: true, or no delay"
            yield Fault((key, "law", "channel.delay"), told)

    def magnitude_faults(self, sizes: list[float], order: int) -> Iterator[Fault]:
        """Faults of a list of magnitudes, for vehicles of an order."""
        keys = ("attack.magnitude", "attack")
        if self.consistent():
            message = f"must be one number: the derivatives of {self.kind} follow from its signal"
            yield Fault(keys, f"{message} (a list needs kind spoof, or some attack.orders only)")
            return
        if len(sizes) > order + 1:
            most = f"at most {order + 1} numbers, of the orders 0 to {order}"
            yield Fault(keys, f"a list has {most} (got {len(sizes)})")
        true = [
            each for each in ORDERS[: len(sizes)] if sizes[each] and each not in self.falsified()
        ]
        if true:
            got = f"give 0 for it (got {sizes[true[0]]:g})"
            yield Fault(keys, f"attack.orders leaves order {true[0]} true: {got}")

    def number_faults(self) -> Iterator[Fault]:
        """Faults of numbers that each vehicle has for itself."""
        random, listed = isinstance(self.vehicles, DrawnVehicles), len(self.targets())
        for key, number, shapes in own_numbers(self):
            if isinstance(number, Listed) and (random or len(number.root) != listed):
                got = "drawn ones" if random else f"{len(number.root)} numbers"
                message = f"a list has a number for each vehicle, {listed} in attack.vehicles"
                yield Fault((key, "attack"), f"{message} (got {got})")
            if shapes and (self.strategic or (random and self.by_link())):
                yield Fault((key, "attack"), "must be one number for all vehicles here")


class Harmonious(Attack):
    """A signal of one frequency, `frequency`, which a subclass has as its key."""

    if TYPE_CHECKING:
        frequency: PerVehicle
    highest = 4

    def fastest(self):
        return max(map(abs, value_range(self.frequency)))

    def signal(self):
        return Harmonic(self.frequency)

    def sizes(self, horizon):
        return harmonic_sizes(np.asarray(self.frequency))


class Harmonics(Attack):
    """A trigonometric polynomial for each attacker, scaled to the greatest size that ā allows.

    The polynomial is divided by its greatest norm, and its derivatives' norms, on a grid. Between
    the grid's points a trigonometric polynomial is at most 1/cos(Ωδ/2) times greater, with the
    highest frequency Ω and the grid's step δ (Ehlich and Zeller, 1964). The divisor contains this
    factor.
    """

    highest = 4
    numbers: ClassVar[tuple[tuple[str, int], ...]] = ()  # of each harmonic, by key

    frequency: PositivePerVehicle = setting(0.35, "[rad/s], the lowest")
    harmonics: int = setting(4, "how many", ge=1, le=100)

    def pairs(self) -> np.ndarray:
        """Vectors of cosine and sine of harmonics, of any size: (2, m, 2 · harmonics, lanes)."""
        raise KindError(f"{self.kind}: a sum of harmonics gives pairs(self)")

    def drawn(self, draw, name):
        """The attack with `numbers[key]` numbers of each harmonic in a key: (numbers, m, lanes)."""
        others = self.model_copy(update=dict.fromkeys(dict(self.numbers)))
        values = {
            key: draw.each(getattr(self, key), f"{name}.{key}", number * self.harmonics).T
            for key, number in self.numbers
        }
        return super(Harmonics, others).drawn(draw, name).with_values(**values)

    def faults(self, scenario):
        yield from super().faults(scenario)
        vehicles = len(self.targets())
        for key, number in self.numbers:
            table, wanted = getattr(self, key), number * self.harmonics
            rows = table.root if isinstance(table, Table) else None
            if rows and (len(rows) != vehicles or any(len(row) != wanted for row in rows)):
                each = f"{vehicles} lists, one for each of attack.vehicles"
                yield Fault((f"attack.{key}", "attack"), f"must be {each}, of {wanted} numbers")

    def fastest(self):
        return self.harmonics * value_range(self.frequency)[1]

    def basis(self, time):
        orders = range(1, self.harmonics + 1)
        each = [Harmonic(order * self.frequency).basis(time) for order in orders]
        return time.__array_namespace__().concatenate(each, axis=1)

    def vectors(self):
        """Vectors of cosine and sine of each harmonic, of size 1 together; 0 without attack."""
        pairs = self.pairs()
        greatest = self.greatest(pairs)
        return pairs / np.where(greatest > 0, greatest, 1.0)

    def greatest(self, vectors: np.ndarray) -> np.ndarray:
        """A bound (m, 1, lanes) on the norms of signals and heard derivatives, by vectors.

        A signal is `Re Σ_l z_l e^{ilθ}`, its k-th derivative has `(ilω)^k z_l`. A Fourier transform
        evaluates them on the grid.
        """
        m, lanes = vectors.shape[1], vectors.shape[3]
        rate = np.broadcast_to(self.frequency, (m, lanes)).ravel()
        each = vectors.transpose(1, 3, 0, 2).reshape(m * lanes, 2, -1)
        scale, found = np.abs(each).max(axis=(1, 2)), np.zeros(m * lanes)
        attacked, orders = np.flatnonzero(scale), range(self.told_order + 1)
        for start in range(0, len(attacked), SIGNALS):
            some = attacked[start : start + SIGNALS]
            unit = each[some] / scale[some, None, None]
            norms = [rate[some] ** order * self.peak(unit, order) for order in orders]
            found[some] = scale[some] * np.maximum.reduce(norms)
        return found.reshape(m, 1, lanes) / np.cos(np.pi / FINENESS)

    def peak(self, vectors: np.ndarray, order: int) -> np.ndarray:
        """Greatest norm on the grid of a derivative by the angle, for vectors (signals, 2, B)."""
        count, number = FINENESS * self.harmonics, np.arange(1, self.harmonics + 1)
        amplitudes = vectors[..., ::2] - 1j * vectors[..., 1::2]
        spectrum = amplitudes * (1j * number) ** order * (count / 2)
        x, y = np.moveaxis(np.fft.irfft(np.insert(spectrum, 0, 0.0, axis=-1), count), 1, 0)
        return np.sqrt((x**2 + y**2).max(axis=-1))

    def sizes(self, horizon):
        return np.ones((self.told_order + 1, 1))


class HeldOffset(Attack):
    """An offset that a strategic attack chooses at a tick and holds until the next."""

    highest = 4
    constant = True
    strategic = True

    def basis(self, time):
        return constant_basis(time)

    def sizes(self, horizon):
        return np.eye(5, 1)


class PathInstead(Attack):
    """A path in place of a message. It depends on the navigator, and ā does not bound it."""

    highest = 4
    bounded = False

    magnitude: NotNegative = setting(
        5.0, "[m], used by recovery alone; it does not scale the signal"
    )
    threat: Literal["replaces"] = setting(  # pyright: ignore[reportIncompatibleVariableOverride]
        "replaces", "what is sent is replaced"
    )


def own_numbers(kind: Kind, name: str = "attack") -> Iterator[tuple[str, Number, bool]]:
    """The numbers that each vehicle has for itself, also of kinds inside this one.

    Each item is the dotted key, the number, and whether the scalar functions depend on it.
    """
    for key, value in vars(kind).items():
        if differs(value):
            yield f"{name}.{key}", value, not kind.drawn_by_vehicle(key)
        elif isinstance(value, Kind):
            yield from own_numbers(value, f"{name}.{key}")


def signal_scale(attack: AnyAttack, sizes: SignalSizes, order: int) -> np.ndarray:
    """The factor of unit vectors (lanes,) [m]: ā over the greatest size among the falsified orders.

    Where each order has its magnitude, `order_factors` divide by the sizes, and the scale is the
    greatest magnitude. It is 0 where all falsified orders are 0.
    """
    if attack.by_order() is not None:
        return np.asarray(attack.amplitude())
    greatest = np.max(np.asarray(sizes)[heard_orders(attack, order)], axis=0)
    return np.asarray(attack.amplitude() / np.where(greatest > 0, greatest, np.inf))


def order_factors(attack: AnyAttack, sizes: SignalSizes, order: int) -> np.ndarray:
    """The factor of each order of a signal with these sizes, 0 if it is true: (orders, lanes or 1).

    Where each order has its magnitude, the factor scales the order to its share of the greatest.
    """
    heard, sizes = heard_orders(attack, order), np.asarray(sizes)
    factors = np.zeros_like(sizes)
    factors[heard] = 1.0
    if (shares := magnitude_shares(attack, order)) is not None:
        some = np.where(sizes[heard] > 0, sizes[heard], np.inf)
        factors[heard] = np.array(shares)[:, None] / some
    return factors


def magnitude_shares(attack: AnyAttack, order: int) -> tuple[float, ...] | None:
    """The magnitude of each of `heard_orders` as a share of the greatest; None where all are ā."""
    if (sizes := attack.by_order()) is None:
        return None
    return tuple(sizes[each] / (max(sizes) or 1.0) for each in heard_orders(attack, order))


def heard_orders(attack: AnyAttack, order: int) -> list[int]:
    """The falsified orders that vehicles of an order hear. A list of magnitudes may end earlier."""
    if attack.misuses():
        return [0]
    falsified, sizes = attack.falsified(), attack.by_order()
    most = order if sizes is None else min(order, len(sizes) - 1)
    return [each for each in range(most + 1) if each in falsified or falsified == ORDERS]


def unit_vectors(direction: AnyNumbers) -> PlaneVectors:
    """The unit vectors (2, m, lanes) of directions [rad]."""
    xp = direction.__array_namespace__()
    return xp.stack([xp.cos(direction), xp.sin(direction)])


def constant_basis(time: AnyTimes) -> SignalBasis:
    """The scalar function 1 of a signal that is constant from tick to tick: (4, 1, lanes)."""
    xp = time.__array_namespace__()
    return xp.concatenate([xp.ones((1, 1, *time.shape)), xp.zeros((3, 1, *time.shape))])


def harmonic_sizes(frequency: np.ndarray) -> np.ndarray:
    """The sizes of a harmonic, `|ω|^k` up to k = 4: (5, lanes)."""
    return np.abs(frequency)[None] ** np.arange(5.0)[:, None]
