"""Attacks: signals that falsify what links carry, as fixed vectors times scalar functions (`model.signal`).

`‖a_j^(k)(t)‖ ≤ ā` for k = 0..3 holds by construction. An attack gives unit signals, and bounds on them and
their derivatives by `sizes`; the vectors are scaled by ā over the greatest bound.
"""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, TypeVar

import numpy as np
from annotated_types import Len
from pydantic import Discriminator, Field

from jaxnet.kinds.announcements import Announcement
from jaxnet.kinds.announcements.consistent import Consistent
from jaxnet.kinds.family import KindOf
from jaxnet.kinds.fields import (
    MARK,
    Each,
    EachOrder,
    Listed,
    Magnitude,
    NotNegativeByOrder,
    Number,
    Record,
    Uniform,
    differs,
    union_member,
)
from jaxnet.kinds.kind import Fault, Kind, KindError, broken, unknown_vehicles
from jaxnet.kinds.protocols import LaneDraw, NavigatorPath, ScenarioView, Signal, TickView
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
from jaxnet.model.wording import ranges, sets_in_words

USUAL_TARGETS = [2, 5, 8, 11]
MOMENTS = 1_001  # times at which a signal without bound is sampled

AttackedLinks = Literal["auto", "neighbour", "navigator"]
Threat = Literal["adds", "replaces"]
DerivativeOrder = Literal[0, 1, 2, 3]


def usual_targets(vehicles: int) -> list[int]:
    """Return the vehicles that are attacked by default in a fleet: those of 2, 5, 8, 11 that exist, or 1."""
    return [one for one in USUAL_TARGETS if one <= vehicles] or [1]


AnyAttackKind = TypeVar("AnyAttackKind", bound="AnyAttack")


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


def attacked_tag(value: object) -> str:
    """Return the tag of attacked vehicles: listed, drawn, or changing at given times."""
    if isinstance(value, ChangingVehicles) or (
        isinstance(value, dict) and {"at", "sets"} & {*value}
    ):
        return MARK + "changing"
    drawn = isinstance(value, DrawnVehicles) or (isinstance(value, dict) and "random" in value)
    return MARK + ("drawn" if drawn else "listed")


class AnyAttack(Kind):
    """Base class of all attacks. The base class itself attacks no vehicle.

    Examples
    --------
    >>> import jaxnet
    >>> from jaxnet.kinds.attacks import AnyAttack
    >>> attack = jaxnet.load({"attack": "none"}).config.attack
    >>> isinstance(attack, AnyAttack), attack.targets()
    (True, [])
    """

    present: ClassVar[bool] = False
    strategic: ClassVar[bool] = False  # whether it chooses new vectors at every tick
    constant: ClassVar[bool] = False  # whether its derivatives are 0 from tick to tick
    highest: ClassVar[int] = 3  # order of the highest derivative that `sizes` bounds
    told_order: ClassVar[int] = 3  # of the highest derivative that vehicles hear, three at least
    derived: ClassVar[bool] = True  # whether the signal's derivatives are true derivatives
    bounded: ClassVar[bool] = True  # whether ā bounds the signal and its derivatives

    def targets(self) -> list[int]:
        """Return the numbers of the vehicles that are attacked at any time, from 1."""
        return []

    def number(self) -> int:
        """Return the number of vehicles that are attacked at any time."""
        return len(self.targets())

    def periods(self) -> list[tuple[float, list[int]]]:
        """Return the times [s] from which other vehicles are attacked, from 0, with these vehicles; none if
        the same vehicles are attacked all along.
        """
        return []

    def on(self, vehicles: list[int]) -> "AnyAttack":
        """Return the attack on other vehicles."""
        return self.model_copy(update={"vehicles": vehicles})

    def amplitude(self) -> Magnitude:
        """Return ā [m, m/s, m/s², m/s³], a number or a distribution; the greatest of several magnitudes."""
        return 0.0

    def by_order(self) -> list[float] | None:
        """Return the magnitude of each order from 0, None where one bounds all. Orders beyond it are true."""
        return None

    def attacked_links(self, graph: Digraph) -> Links:
        """Return the links that carry the attack. If vehicles are drawn, these are the links that may carry
        it.
        """
        return graph.none

    def chosen(self, draw: LaneDraw) -> np.ndarray:
        """Return which vehicles are attacked in each lane: (m, lanes)."""
        attacked = np.isin(draw.everyone, self.targets())
        return np.broadcast_to(attacked[:, None], (len(attacked), len(draw.samples)))

    def by_link(self) -> bool:
        """Return whether each listener receives a different signal."""
        return False

    def identities(self) -> int:
        """Return as how many sources each attacked source appears."""
        return 1

    def apart(self) -> bool:
        """Return whether numbers of single vehicles change the scalar functions, so that each vehicle has its
        own.
        """
        return any(shapes for _, _, shapes in own_numbers(self))

    def splits(self) -> bool:
        """Return whether links are replaced in some lanes only, or at some times only.

        Such a link takes two slots, one for the source's message and one for the attack's. Each lane hears
        one slot at a time.
        """
        return False

    def replaces(self) -> bool:
        """Return whether an attacked link carries the navigator's path plus the signal.

        Otherwise the link carries its source's message plus the signal.
        """
        return False

    def as_told(self) -> bool:
        """Return whether attacked vehicles move as they tell, and not by the law."""
        return False

    def falsified(self) -> tuple[int, ...]:
        """Return the orders of the received derivatives that carry the signal, of 0 to 3. The other orders
        are true.
        """
        return ORDERS

    def announcement(self) -> Announcement:
        """Return how attacked links announce, if the defence makes vehicles announce."""
        return Consistent()

    def fastest(self) -> float:
        """Return the highest angular frequency of the signal between ticks [rad/s], infinite if it is not
        known.
        """
        return 0.0

    def consistent(self) -> bool:
        """Return whether a listener receives a path together with the path's own derivatives."""
        return self.derived and self.falsified() == ORDERS

    def harmonic(self) -> bool:
        """Return whether each vehicle's signal has at most one frequency."""
        told = type(self).told is not AnyAttack.told
        return not (self.strategic or told) and isinstance(self.signal(), Harmonic)

    def of_order(self: AnyAttackKind, order: int) -> AnyAttackKind:
        """Return the drawn attack for vehicles of an order, which hear derivatives up to this order."""
        return (
            self if order <= self.told_order else self.filled({**vars(self), "told_order": order})
        )

    def signal(self) -> Signal:
        """Return the object with the scalar functions: `basis(time)` gives (4, B, lanes) for times (lanes,)
        [s].
        """
        return Harmonic(0.0)

    def vectors(self) -> np.ndarray:
        """Return the vectors of every vehicle's unit signal: (2, m, B, lanes), m = 1 if all are equal."""
        return np.zeros((2, 1, 2, 1))

    def told(self, navigator: NavigatorPath, start: np.ndarray) -> tuple[Signal, np.ndarray | None]:
        """Return the signal and the unit vectors, which may depend on the navigator and on the sources'
        positions.

        `start` holds positions at t = 0, (2, m, lanes) [m]: the vehicle's own, or the navigator's where the
        attack is on what the vehicle hears of the navigator. A strategic attack has no vectors yet.
        """
        return self.signal(), None if self.strategic else np.asarray(self.vectors())

    def sizes(self, horizon: float) -> np.ndarray:
        """Return bounds on the norm of the functions and of their derivatives in [0, horizon]: (4, lanes), or
        (5, lanes) where `highest` is 4.
        """
        return np.ones((5, 1))

    def reach(self, navigator: NavigatorPath, signal: Signal, horizon: float) -> np.ndarray:
        """Return `sizes` of the signal that `told` gave: (4, lanes); for a signal without bound the maximum
        at MOMENTS.
        """
        if self.bounded:
            return np.asarray(self.sizes(horizon))
        basis = [
            np.asarray(signal.basis(np.full(1, t))) for t in np.linspace(0.0, horizon, MOMENTS)
        ]
        return np.linalg.norm(basis, axis=2).max(axis=0)

    def breaks(self) -> frozenset[str]:
        return broken(
            bounded=not self.bounded, one_identity=self.identities() > 1, by_law=self.as_told()
        )

    def describe(self) -> str:
        """Return a short description of the attack."""
        return self.kind

    def whom(self) -> str:
        """Return a short description of the attacked vehicles."""
        if periods := self.periods():
            return sets_in_words(*zip(*periods, strict=True))
        drawn = f"{self.number()} drawn for each lane" if self.number() else "nobody"
        return ranges(sorted(self.targets())) or drawn

    def caveat(self) -> str:
        """Return how the attack differs from the paper's, a path with its derivatives within ā; "" if it does
        not.
        """
        if not self.bounded:
            return "not bounded by ā"
        return "" if self.consistent() else "derivatives falsified each on its own"


class Attack(AnyAttack):
    """A signal on what attacked vehicles transmit, or on what they hear of the navigator.

    A subclass gives `basis`, `vectors` and `sizes`. A strategic subclass gives `basis`, `sizes` and `aim`,
    and `begin` if it has a memory.

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

    claims: ClassVar[frozenset[str]] = frozenset({"fastest", "constant"})
    constant: ClassVar[bool] = False
    present: ClassVar[bool] = True
    untraced: ClassVar[frozenset[str]] = frozenset(
        {
            "label",
            "magnitude",
            "vehicles",
            "links",
            "threat",
            "moves",
            "orders",
            "listeners",
            "sybils",
            "announces",
        }
    )

    magnitude: NotNegativeByOrder = Field(
        default=5.0,
        description="[m, m/s, m/s², m/s³], ā, the bound on the signal and its three derivatives; where orders"
        " are falsified each on its own also a list, one for each order from 0; orders beyond it are true",
    )
    vehicles: Annotated[
        Annotated[list[int], union_member("listed")]
        | Annotated[DrawnVehicles, union_member("drawn")]
        | Annotated[ChangingVehicles, union_member("changing")],
        Discriminator(attacked_tag),
    ] = Field(
        default=USUAL_TARGETS,
        title="attacked vehicles",
        description="attacked vehicles, from 1, or {random: n}, n of them drawn for each lane, or"
        " {at: [...], sets: [...]}, other vehicles from given times on; by default those listed that exist,"
        " or 1",
    )
    links: AttackedLinks = Field(
        default="auto",
        description="neighbour: what they transmit; navigator: what they hear from 0; "
        "auto: navigator where no vehicle hears another",
    )
    threat: Threat = Field(
        default="adds",
        description="adds: an attacked link carries what its source says plus the signal; "
        "replaces: the navigator's path plus the signal, whatever its source says",
    )
    moves: Literal["by_law", "as_told"] = Field(
        default="by_law",
        description="by_law: an attacked vehicle obeys the law, whatever it tells; as_told: it is where it"
        " tells to be, which needs threat: replaces",
    )
    orders: Annotated[list[DerivativeOrder], Len(1)] = Field(
        default=[*ORDERS],
        description="which of the received derivatives carry the signal: 0 position, 1 velocity,"
        " 2 acceleration, 3 jerk; the others are true",
    )
    listeners: Literal["same", "each"] = Field(
        default="same",
        description="same: an attacked vehicle tells all the same; each: each its own",
    )
    sybils: int = Field(
        default=0, ge=0, le=100, description="further sources as which each attacked one appears"
    )
    announces: Annotated[Announcement, KindOf("announcement")] = Field(
        default=Consistent(),
        description="what attacked links announce, where the defence has vehicles announce what drives them",
    )

    @classmethod
    def __pydantic_init_subclass__(cls, **options: object) -> None:
        """Mark the numbers of each vehicle as untraced unless the attack is strategic: they are part of its
        vectors.

        A subclass with its own `basis` is its own signal, whatever class it derives from.
        """
        super().__pydantic_init_subclass__(**options)
        fields = cls.model_fields.items()
        each = {
            key for key, field in fields if any(isinstance(mark, Each) for mark in field.metadata)
        }
        cls.untraced = cls.untraced if cls.strategic else cls.untraced | each
        if "basis" in vars(cls) and "signal" not in vars(cls):
            cls.signal = Attack.signal

    def targets(self) -> list[int]:
        """Return the listed vehicles, in the order in which they are attacked; none if vehicles are drawn."""
        if isinstance(self.vehicles, ChangingVehicles):
            return [*dict.fromkeys(vehicle for each in self.vehicles.sets for vehicle in each)]
        return self.vehicles if isinstance(self.vehicles, list) else []

    def number(self) -> int:
        """Return the number of listed or drawn vehicles."""
        return (
            self.vehicles.random
            if isinstance(self.vehicles, DrawnVehicles)
            else len(self.targets())
        )

    def periods(self) -> list[tuple[float, list[int]]]:
        """Return the key `vehicles` if vehicles change; nobody is attacked before the first time."""
        if not isinstance(self.vehicles, ChangingVehicles):
            return []
        found = [*zip(self.vehicles.at, self.vehicles.sets, strict=False)]
        return found if found[0][0] == 0 else [(0.0, []), *found]

    def chosen(self, draw: LaneDraw) -> np.ndarray:
        """Return which vehicles are attacked in each lane at any time: those listed, or those with the least
        random numbers.
        """
        if not isinstance(self.vehicles, DrawnVehicles):
            return super().chosen(draw)
        lots = draw.each(Uniform(uniform=[0.0, 1.0]), "attack.vehicles")[..., 0].T
        return lots.argsort(axis=0, kind="stable").argsort(axis=0) < self.vehicles.random

    def by_link(self) -> bool:
        """Return whether `listeners` is `each`."""
        return self.listeners == "each"

    def identities(self) -> int:
        """Return 1 plus the number of sybils."""
        return 1 + self.sybils

    def splits(self) -> bool:
        """Return whether vehicles are drawn, or change, and their links are replaced."""
        return self.replaces() and not isinstance(self.vehicles, list)

    def amplitude(self) -> Magnitude:
        """Return the key `magnitude`, or its greatest number."""
        sizes = self.by_order()
        return self.magnitude if sizes is None else max(sizes)

    def by_order(self) -> list[float] | None:
        """Return the key `magnitude` if it is a list."""
        return self.magnitude.root if isinstance(self.magnitude, EachOrder) else None

    def attacked_links(self, graph: Digraph) -> Links:
        """Return the links from attacked vehicles (`neighbour`), or those from 0 to attacked vehicles
        (`navigator`).
        """
        links = self.links
        if links == "auto":
            links = "neighbour" if hears_vehicles(graph) else "navigator"
        everyone = np.arange(1, graph.vehicles + 1)
        drawn = isinstance(self.vehicles, DrawnVehicles)
        listed = everyone > 0 if drawn else np.isin(everyone, self.targets())
        if links == "neighbour":
            return graph.heard & np.append(False, listed)[graph.sources]
        return graph.heard & (graph.sources == 0) & listed[:, None]

    def replaces(self) -> bool:
        """Return whether `threat` is `replaces`."""
        return self.threat == "replaces"

    def as_told(self) -> bool:
        """Return whether `moves` is `as_told`."""
        return self.moves == "as_told"

    def falsified(self) -> tuple[int, ...]:
        """Return the sorted `orders`."""
        return tuple(sorted(set(self.orders)))

    def announcement(self) -> Announcement:
        """Return the key `announces`."""
        return self.announces

    def fastest(self) -> float:
        """Return 0 for an attack that is constant between ticks, else infinity."""
        return 0.0 if self.constant else np.inf

    def signal(self) -> Signal:
        """Return the attack itself, which has a `basis`."""
        return self

    def basis(self, time: AnyTimes) -> SignalBasis:
        """Return the scalar functions with three derivatives.

        Parameters
        ----------
        time
            Times [s], (lanes,).

        Returns
        -------
            β and its first three derivatives, (4, B, lanes).
        """
        raise KindError(f"{self.kind}: an attack gives basis(self, time)")

    def vectors(self) -> np.ndarray:
        """Return the vectors that multiply the scalar functions.

        Returns
        -------
            Vectors (2, m, B, lanes) of spectral norm 1 for each vehicle; m = 1 if all vehicles have the same.
        """
        raise KindError(f"{self.kind}: an attack gives vectors(self)")

    def sizes(self, horizon: float) -> np.ndarray:
        """Return a bound on `max over t of ‖β^(k)(t)‖` for k = 0..3.

        Parameters
        ----------
        horizon
            End of the interval that begins at 0 [s].

        Returns
        -------
            Bounds (4, lanes). An attack with `bounded = False` needs none.
        """
        raise KindError(f"{self.kind}: an attack gives sizes(self, horizon)")

    def begin(self, seen: TickView) -> Memory:
        """Return the memory of a strategic attack before the first tick, before any decision or error.

        The memory is any pytree of arrays with lanes last; by default None.
        """
        return None

    def drawn_faults(self, number: int, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield the faults of vehicles that are drawn for each lane."""
        keys = ("attack.vehicles", "vehicles")
        if number > scenario.vehicles:
            yield Fault(keys, f"there are {scenario.vehicles} vehicles (got {number})")
        if self.sybils or self.strategic:
            yield Fault(
                ("attack.vehicles", "attack"), "drawn vehicles are neither sybils nor strategic"
            )

    def changing_faults(
        self, changing: ChangingVehicles, scenario: ScenarioView
    ) -> Iterator[Fault]:
        """Yield the faults of vehicles that change at given times."""
        at, keys = changing.at, ("attack.vehicles.at", "attack.vehicles", "attack")
        if len(at) != len(changing.sets):
            yield Fault(keys, f"a time for each of {len(changing.sets)} sets (got {len(at)})")
        if sorted(set(at)) != at:
            yield Fault(keys, f"must rise (got {at})")
        if self.splits() and len(scenario.topology.turns()) > 1:
            told = "split links carry the attack of the same vehicles all along where networks take turns"
            yield Fault((*keys, "topology"), told)
        tick = scenario.tick
        if tick == 0:
            yield Fault((*keys, "tick"), "attacked vehicles change at ticks: give a tick")
        elif odd := [time for time in at if abs(time - round(time / tick) * tick) > TICK_ROUNDING]:
            yield Fault((*keys, "tick"), f"must be multiples of tick = {tick:g} (got {odd[0]:g})")
        if self.sybils or self.strategic:
            yield Fault(
                ("attack.vehicles", "attack"),
                "vehicles that change are neither sybils nor strategic",
            )

    def aim(self, seen: TickView, memory: Memory) -> tuple[SignalVectors, Memory]:
        """Return the vectors of a strategic attack until the next tick, and its memory.

        Parameters
        ----------
        seen
            Errors, decisions, weights and the clock at this tick (`engine.tick.Seen`).
        memory
            The memory from the last tick, or from `begin`.

        Returns
        -------
            Unit vectors (2, m, B, lanes) and the memory. The vectors are scaled to ā, and down to norm 1.
        """
        raise KindError(f"{self.kind}: a strategic attack gives aim(self, seen, memory)")

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield faults of unknown or repeated vehicles, and of keys that exclude each other."""
        targets = self.targets()
        yield from unknown_vehicles("attack.vehicles", targets, scenario.vehicles, first=1)
        sets = self.vehicles.sets if isinstance(self.vehicles, ChangingVehicles) else [targets]
        twice = [each for each in sets if len(set(each)) < len(each)]
        if twice:
            yield Fault(("attack.vehicles",), f"named twice (got {twice[0]})")
        if isinstance(self.vehicles, DrawnVehicles):
            yield from self.drawn_faults(self.vehicles.random, scenario)
        if isinstance(self.vehicles, ChangingVehicles):
            yield from self.changing_faults(self.vehicles, scenario)
        if self.by_link() and (self.strategic or not self.bounded):
            yield Fault(("attack.listeners",), f"{self.kind} tells all listeners the same")
        if self.strategic and scenario.tick == 0:
            yield Fault(("attack", "tick"), f"{self.kind} decides at ticks: give a tick")
        if self.replaces() and self.falsified() != ORDERS:
            yield Fault(
                ("attack.orders", "attack.threat"),
                f"a link that is replaced carries no true derivative: give [0, 1, 2, 3] (got {self.orders})",
            )
        vehicle = scenario.vehicle
        if self.constant and 0 not in self.falsified():
            message = f"{self.kind} has no derivatives: give orders with 0 (got {self.orders})"
            yield Fault(("attack.orders",), message)
        if self.falsified() != ORDERS and vehicle.order != 3:
            yield Fault(
                ("attack.orders", "vehicle"),
                f"a choice of orders needs a vehicle of order 3 (got {vehicle.kind})",
            )
        if vehicle.order > self.highest:
            yield Fault(
                ("attack", "vehicle"),
                f"{self.kind} has derivatives up to {self.highest}, {vehicle.kind} has order {vehicle.order}",
            )
        if self.as_told():
            yield from self.moving_faults(scenario)
        yield from self.magnitude_faults(vehicle.order)
        yield from self.number_faults()

    def moving_faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield the faults of vehicles that move as they tell."""
        vehicle, key = scenario.vehicle, "attack.moves"
        if not self.replaces():
            yield Fault(
                (key, "attack.threat"), "as_told needs false messages: give threat: replaces"
            )
        if self.by_link() or self.strategic or self.periods():
            one = "one path for the whole lane, the same for all listeners"
            yield Fault((key, "attack"), f"a vehicle that moves as told tells {one}")
        graph = scenario.topology.linked(scenario.vehicles)
        if (self.attacked_links(graph) & (graph.sources == 0)).any():
            yield Fault(
                (key, "attack.links"), "attacked links from the navigator tell nothing of a vehicle"
            )
        if vehicle.singular or vehicle.internal:
            why = (
                f"a path does not always tell the state of {vehicle.kind}, only that of integrators"
            )
            yield Fault((key, "vehicle"), why)

    def magnitude_faults(self, order: int) -> Iterator[Fault]:
        """Yield the faults of a list of magnitudes, for vehicles of an order."""
        sizes, keys = self.by_order(), ("attack.magnitude", "attack")
        if sizes is None:
            return
        if self.consistent():
            message = (
                f"must be one number: the derivatives of {self.kind} follow from its signal (a list needs"
                " kind spoof, or some attack.orders only)"
            )
            yield Fault(keys, message)
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
        """Yield the faults of numbers that each vehicle has for itself."""
        random = isinstance(self.vehicles, DrawnVehicles)
        for key, number, shapes in own_numbers(self):
            if isinstance(number, Listed) and (random or len(number.root) != len(self.targets())):
                wanted = f"{len(self.targets())} listed in attack.vehicles"
                got = "drawn ones" if random else f"{len(number.root)} numbers"
                yield Fault(
                    (key, "attack"), f"a list has a number for each vehicle, {wanted} (got {got})"
                )
            if shapes and (self.strategic or (random and self.by_link())):
                yield Fault((key, "attack"), "must be one number for all vehicles here")


def own_numbers(kind: Kind, name: str = "attack") -> Iterator[tuple[str, Number, bool]]:
    """Yield the numbers that each vehicle has for itself, also of kinds inside this one.

    Each item is the dotted key, the number, and whether the scalar functions depend on it.
    """
    for key, field in type(kind).model_fields.items():
        value, dotted = getattr(kind, key), f"{name}.{key}"
        if isinstance(value, Kind):
            yield from own_numbers(value, dotted)
        elif differs(value):
            yield dotted, value, not any(isinstance(mark, Each) for mark in field.metadata)


def signal_scale(attack: AnyAttack, sizes: SignalSizes, order: int) -> np.ndarray:
    """Return the factor of unit vectors (lanes,) [m]: ā over the greatest size among the falsified orders.

    A vehicle of an order r hears derivatives up to r. Where each order has its magnitude, `order_factors`
    divide by the sizes, and the scale is the greatest magnitude. It is 0 where the falsified orders are 0, as
    those of a frequency 0 without the position.
    """
    if attack.by_order() is not None:
        return np.asarray(attack.amplitude())
    greatest = np.max(np.asarray(sizes)[heard_orders(attack, order)], axis=0)
    return np.asarray(attack.amplitude() / np.where(greatest > 0, greatest, np.inf))


def order_factors(attack: AnyAttack, sizes: SignalSizes, order: int) -> np.ndarray:
    """Return the factors of the orders of a signal with these sizes: (orders, lanes or 1).

    Orders that the attack leaves true have the factor 0. Where each order has its magnitude, the factor
    scales the order to the magnitude's share of the greatest.
    """
    heard, sizes = heard_orders(attack, order), np.asarray(sizes)
    factors = np.zeros_like(sizes)
    factors[heard] = 1.0
    if (shares := magnitude_shares(attack, order)) is not None:
        some = sizes[heard]
        factors[heard] = np.where(
            some > 0, np.array(shares)[:, None] / np.where(some > 0, some, 1.0), 0.0
        )
    return factors


def magnitude_shares(attack: AnyAttack, order: int) -> tuple[float, ...] | None:
    """Return the magnitude of each of `heard_orders` as a share of the greatest; None where all are ā."""
    if (sizes := attack.by_order()) is None:
        return None
    return tuple(sizes[each] / (max(sizes) or 1.0) for each in heard_orders(attack, order))


def heard_orders(attack: AnyAttack, order: int) -> list[int]:
    """Return the falsified orders that vehicles of an order hear. A list of magnitudes may end earlier."""
    falsified, sizes = attack.falsified(), attack.by_order()
    heard = (
        [*range(order + 1)]
        if falsified == ORDERS
        else [each for each in falsified if each <= order]
    )
    return heard if sizes is None else [each for each in heard if each < len(sizes)]


def unit_vectors(direction: AnyNumbers) -> PlaneVectors:
    """Return the unit vectors (2, m, lanes) of directions [rad]."""
    xp = direction.__array_namespace__()
    return xp.stack([xp.cos(direction), xp.sin(direction)])


def constant_basis(time: AnyTimes) -> SignalBasis:
    """Return the scalar function 1 of a signal that is constant from tick to tick: (4, 1, lanes)."""
    xp = time.__array_namespace__()
    return xp.concatenate([xp.ones((1, 1, *time.shape)), xp.zeros((3, 1, *time.shape))])


def harmonic_sizes(frequency: np.ndarray) -> np.ndarray:
    """Return the sizes of a harmonic, `|ω|^k` up to k = 4: (5, lanes)."""
    return np.abs(frequency)[None] ** np.arange(5.0)[:, None]
