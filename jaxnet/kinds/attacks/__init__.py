"""What an attack puts on the links it holds: signals of fixed vectors times scalar functions
(`model.signal`).

`‖a_j^(k)(t)‖ ≤ ā` for k = 0..3 holds by construction: an attack gives unit signals and, by `sizes`, how great
they and their derivatives become; the vectors are scaled by ā over the greatest.
"""

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Len
from pydantic import Discriminator, Field

from jaxnet.kinds.announcements import Announcement
from jaxnet.kinds.announcements.consistent import Consistent
from jaxnet.kinds.family import KindOf
from jaxnet.kinds.fields import MARK, Each, Listed, NotNegative, Record, Uniform, differs, union_member
from jaxnet.kinds.kind import Fault, Kind, KindError, unknown_vehicles
from jaxnet.model.graph import Digraph, Links, hears_vehicles
from jaxnet.model.signal import ORDERS, Harmonic
from jaxnet.model.wording import ranges

MOMENTS = 1_001  # at which a signal of one's own that is not bounded is looked at

Channel = Literal["auto", "neighbour", "navigator"]
Threat = Literal["adds", "replaces"]
DerivativeOrder = Literal[0, 1, 2, 3]


class DrawnVehicles(Record):
    """So many vehicles, drawn for each lane."""

    random: int = Field(ge=1, description="how many")


def attacked_tag(value: Any) -> str:
    """Whether attacked vehicles are listed or drawn."""
    drawn = isinstance(value, DrawnVehicles) or (isinstance(value, dict) and "random" in value)
    return MARK + ("drawn" if drawn else "listed")


class AnyAttack(Kind):
    """What is asked of an attack; this one attacks nobody."""

    present: ClassVar[bool] = False
    strategic: ClassVar[bool] = False  # whether it chooses its vectors anew at every tick
    derived: ClassVar[bool] = True  # whether what its signal gives as derivatives are derivatives
    bounded: ClassVar[bool] = True  # whether no derivative of its signal is greater than ā

    def targets(self) -> list[int]:
        """Vehicles that are attacked, from 1."""
        return []

    def number(self) -> int:
        """How many vehicles are attacked."""
        return len(self.targets())

    def on(self, vehicles: list[int]) -> "AnyAttack":
        """The same on other vehicles."""
        return self.model_copy(update={"vehicles": vehicles})

    def amplitude(self) -> Any:
        """ā [m, m/s, m/s², m/s³], a number or a distribution."""
        return 0.0

    def links(self, graph: Digraph) -> Links:
        """Links that carry the attack, of those of a graph; where vehicles are drawn, that may carry it."""
        return graph.none

    def chosen(self, draw: Any) -> np.ndarray:
        """Which vehicles are attacked in each lane: (m, lanes)."""
        attacked = np.isin(draw.everyone, self.targets())
        return np.broadcast_to(attacked[:, None], (len(attacked), len(draw.samples)))

    def by_link(self) -> bool:
        """Whether every listener is told something of its own."""
        return False

    def identities(self) -> int:
        """Sources that each attacked one appears as."""
        return 1

    def apart(self) -> bool:
        """Whether attacked vehicles have scalar functions of their own, by numbers of their own."""
        return any(shapes for _, _, shapes in own_numbers(self))

    def splits(self) -> bool:
        """Whether links are replaced in some lanes only: they take two slots, one for their source's word and
        one for the attack's, of which each lane hears one.
        """
        return False

    def replaces(self) -> bool:
        """Whether an attacked link carries the navigator's path plus the signal, in place of its source's
        word.

        Otherwise it carries what its source says, plus the signal.
        """
        return False

    def falsified(self) -> tuple[int, ...]:
        """Orders of the received derivatives that carry the signal, of 0 to 3; the others are true."""
        return ORDERS

    def announcement(self) -> Announcement:
        """How attacked links announce to a defence whose vehicles announce what drives them."""
        return Consistent()

    def fastest(self) -> float:
        """Highest angular frequency of the signal between ticks [rad/s]; infinite where none is known."""
        return 0.0

    def consistent(self) -> bool:
        """Whether what is received of an attacked source are a path and its derivatives."""
        return self.derived and self.falsified() == ORDERS

    def harmonic(self) -> bool:
        """Whether each vehicle's signal has one frequency, or none."""
        return not self.strategic and isinstance(self.signal(), Harmonic)

    def signal(self) -> Any:
        """What gives the scalar functions: `basis(time)` → (4, B, lanes), for times (lanes,) [s]."""
        return Harmonic(0.0)

    def vectors(self) -> np.ndarray:
        """Vectors of every vehicle's unit signal: (2, m, B, lanes), `m = 1` if all have the same."""
        return np.zeros((2, 1, 2, 1))

    def told(self, navigator: Any, start: np.ndarray) -> tuple[Any, np.ndarray | None]:
        """The signal and the unit vectors, which may depend on the navigator and on where sources start.

        `start` are positions at t = 0 (2, m, lanes) [m]: a vehicle's own, or the navigator's where the attack
        is on what the vehicle hears of the navigator. A strategic attack has no vectors yet.
        """
        return self.signal(), None if self.strategic else np.asarray(self.vectors())

    def sizes(self, horizon: float) -> np.ndarray:
        """Greatest norm of the functions together, and of each derivative of them, in [0, horizon]: (4,
        lanes).
        """
        return np.ones((4, 1))

    def reach(self, navigator: Any, signal: Any, horizon: float) -> np.ndarray:
        """As `sizes`, of the signal that was told: (4, lanes). Of one that is not bounded, at MOMENTS."""
        if self.bounded:
            return np.asarray(self.sizes(horizon))
        basis = [np.asarray(signal.basis(np.full(1, t))) for t in np.linspace(0.0, horizon, MOMENTS)]
        return np.linalg.norm(basis, axis=2).max(axis=0)

    def describe(self) -> str:
        """The attack in a few words."""
        return self.kind

    def whom(self) -> str:
        """Who is attacked, in a few words."""
        drawn = f"{self.number()} drawn for each lane" if self.number() else "nobody"
        return ranges(sorted(self.targets())) or drawn

    def caveat(self) -> str:
        """What sets it apart from the paper's, a path with its derivatives within ā, in a few words."""
        if not self.bounded:
            return "not bounded by ā"
        return "" if self.consistent() else "derivatives falsified each on its own"


class Attack(AnyAttack):
    """A signal of bounded size on what attacked vehicles transmit, or on what they hear of the navigator.

    An attack of one's own gives `basis`, `vectors` and `sizes`, or, if it is strategic, `basis`, `sizes` and
    `aim`, and `begin` if it has a memory.
    """

    present: ClassVar[bool] = True
    untraced: ClassVar[frozenset[str]] = frozenset(
        {"label", "magnitude", "vehicles", "channel", "threat", "orders", "listeners", "sybils", "announces"}
    )

    magnitude: NotNegative = Field(
        default=5.0, description="[m, m/s, m/s², m/s³], ā, the bound on the signal and its three derivatives"
    )
    vehicles: Annotated[
        Annotated[list[int], union_member("listed")] | Annotated[DrawnVehicles, union_member("drawn")],
        Discriminator(attacked_tag),
    ] = Field(
        default=[2, 5, 8, 11],
        description="attacked vehicles, from 1, or {random: n}, n of them drawn for each lane",
    )
    channel: Channel = Field(
        default="auto",
        description="neighbour: what they transmit; navigator: what they hear from 0; "
        "auto: navigator where no vehicle hears another",
    )
    threat: Threat = Field(
        default="adds",
        description="adds: an attacked link carries what its source says plus the signal; "
        "replaces: the navigator's path plus the signal, whatever its source says",
    )
    orders: Annotated[list[DerivativeOrder], Len(1)] = Field(
        default=[*ORDERS],
        description="which of the received derivatives carry the signal: 0 position, 1 velocity,"
        " 2 acceleration, 3 jerk; the others are true",
    )
    listeners: Literal["same", "each"] = Field(
        default="same", description="same: an attacked vehicle tells all the same; each: each its own"
    )
    sybils: int = Field(
        default=0, ge=0, le=100, description="further sources as which each attacked one appears"
    )
    announces: Annotated[Announcement, KindOf("announcement")] = Field(
        default=Consistent(),
        description="what attacked links announce, where the defence has vehicles announce what drives them",
    )

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        """Numbers that every vehicle has make its vectors, and are asked for by strategic attacks alone.

        Who gives a `basis` is a signal of its own, whatever attack it is made from.
        """
        fields = cls.model_fields.items()
        each = {key for key, field in fields if any(isinstance(mark, Each) for mark in field.metadata)}
        cls.untraced = cls.untraced if cls.strategic else cls.untraced | each
        if "basis" in vars(cls) and "signal" not in vars(cls):
            cls.signal = Attack.signal

    def targets(self) -> list[int]:
        """The vehicles named; none where they are drawn."""
        return self.vehicles if isinstance(self.vehicles, list) else []

    def number(self) -> int:
        """Of those named, or drawn."""
        return len(self.vehicles) if isinstance(self.vehicles, list) else self.vehicles.random

    def chosen(self, draw: Any) -> np.ndarray:
        """Those named, or those with the least of a number each."""
        if isinstance(self.vehicles, list):
            return super().chosen(draw)
        lots = draw.each(Uniform(uniform=[0.0, 1.0]), "attack.vehicles")[..., 0].T
        return lots.argsort(axis=0, kind="stable").argsort(axis=0) < self.vehicles.random

    def by_link(self) -> bool:
        """As `listeners` says."""
        return self.listeners == "each"

    def identities(self) -> int:
        """Itself and its sybils."""
        return 1 + self.sybils

    def splits(self) -> bool:
        """Where vehicles are drawn and replaced."""
        return self.replaces() and isinstance(self.vehicles, DrawnVehicles)

    def amplitude(self) -> Any:
        """The magnitude given."""
        return self.magnitude

    def links(self, graph: Digraph) -> Links:
        """`neighbour`: everything that they transmit, `navigator`: what they hear from 0."""
        channel = self.channel
        if channel == "auto":
            channel = "neighbour" if hears_vehicles(graph) else "navigator"
        everyone = np.arange(1, graph.vehicles + 1)
        listed = np.isin(everyone, self.targets()) if isinstance(self.vehicles, list) else everyone > 0
        if channel == "neighbour":
            return graph.heard & np.append(False, listed)[graph.sources]
        return graph.heard & (graph.sources == 0) & listed[:, None]

    def replaces(self) -> bool:
        """As `threat` says."""
        return self.threat == "replaces"

    def falsified(self) -> tuple[int, ...]:
        """As `orders` says."""
        return tuple(sorted(set(self.orders)))

    def announcement(self) -> Announcement:
        """As `announces` says."""
        return self.announces

    def fastest(self) -> float:
        """Vectors of strategic attacks are constant between ticks; of other signals nothing is known."""
        return 0.0 if self.strategic else np.inf

    def signal(self) -> Any:
        """The attack itself, for `basis` is its own."""
        return self

    def basis(self, time: Any) -> Any:
        """Scalar functions of time with their first three derivatives: (4, B, lanes), for times (lanes,)
        [s].
        """
        raise KindError(f"{self.kind}: an attack gives basis(self, time)")

    def vectors(self) -> np.ndarray:
        """What every vehicle multiplies them with: (2, m or 1, B, lanes), of spectral norm 1."""
        raise KindError(f"{self.kind}: an attack gives vectors(self)")

    def sizes(self, horizon: float) -> np.ndarray:
        """`max over t of ‖β^(k)(t)‖` for k = 0..3 within [0, horizon], or more: (4, lanes).

        Not asked of what is not bounded by ā.
        """
        raise KindError(f"{self.kind}: an attack gives sizes(self, horizon)")

    def begin(self, seen: Any) -> Any:
        """The memory of a strategic attack before the first tick, when nothing was decided and no error seen.

        Any pytree of arrays whose last axis is over lanes.
        """
        return ()

    def drawn_faults(self, number: int, scenario: Any) -> Iterator[Fault]:
        """What vehicles drawn for each lane cannot be."""
        keys = ("attack.vehicles", "vehicles")
        if number > scenario.vehicles:
            yield Fault(keys, f"there are {scenario.vehicles} vehicles (got {number})")
        if self.sybils or self.strategic:
            yield Fault(("attack.vehicles", "attack"), "drawn vehicles are neither sybils nor strategic")

    def aim(self, seen: Any, memory: Any) -> tuple[Any, Any]:
        """At a tick, vectors (2, m, B, lanes) until the next and the memory; asked of strategic attacks.

        They are unit vectors: scaled to ā, and down where their norm is over 1. `seen` is what there is to
        see (`engine.tick.Seen`).
        """
        raise KindError(f"{self.kind}: a strategic attack gives aim(self, seen, memory)")

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """Whoever is named must exist, and be named once."""
        targets = self.targets()
        yield from unknown_vehicles("attack.vehicles", targets, scenario.vehicles, first=1)
        if len(set(targets)) < len(targets):
            yield Fault(("attack.vehicles",), f"named twice (got {targets})")
        if isinstance(self.vehicles, DrawnVehicles):
            yield from self.drawn_faults(self.vehicles.random, scenario)
        if self.by_link() and (self.strategic or not self.bounded):
            yield Fault(("attack.listeners",), f"{self.kind} tells all listeners the same")
        if self.strategic and scenario.tick == 0:
            yield Fault(("attack", "tick"), f"{self.kind} decides at ticks: give a tick")
        if self.replaces() and self.falsified() != ORDERS:
            yield Fault(
                ("attack.orders", "attack.threat"),
                f"a link that is replaced carries no true derivative: give [0, 1, 2, 3] (got {self.orders})",
            )
        yield from self.number_faults()

    def number_faults(self) -> Iterator[Fault]:
        """What numbers of each vehicle's own cannot be."""
        random = isinstance(self.vehicles, DrawnVehicles)
        for key, number, shapes in own_numbers(self):
            if isinstance(number, Listed) and (random or len(number.root) != len(self.targets())):
                wanted = f"{len(self.targets())} listed in attack.vehicles"
                got = "drawn ones" if random else f"{len(number.root)} numbers"
                yield Fault((key, "attack"), f"a list has a number for each vehicle, {wanted} (got {got})")
            if shapes and (self.strategic or (random and self.by_link())):
                yield Fault((key, "attack"), "must be one number for all vehicles here")


def own_numbers(kind: Kind, name: str = "attack") -> Iterator[tuple[str, Any, bool]]:
    """Numbers that vehicles have each for itself, of kinds inside too: dotted key, number, and whether the
    signal's functions depend on it.
    """
    for key, field in type(kind).model_fields.items():
        value, dotted = getattr(kind, key), f"{name}.{key}"
        if isinstance(value, Kind):
            yield from own_numbers(value, dotted)
        elif differs(value):
            yield dotted, value, not any(isinstance(mark, Each) for mark in field.metadata)


def signal_scale(attack: AnyAttack, sizes: Any) -> np.ndarray:
    """What unit vectors are multiplied with (lanes,) [m]: ā over the greatest size of what is falsified."""
    return np.asarray(attack.amplitude() / np.max(np.asarray(sizes)[list(attack.falsified())], axis=0))


def unit_vectors(direction: Any) -> Any:
    """Unit vectors (2, m, lanes) of directions [rad]."""
    xp = direction.__array_namespace__()
    return xp.stack([xp.cos(direction), xp.sin(direction)])


def constant_basis(time: Any) -> Any:
    """The one function of what is constant from tick to tick: (4, 1, lanes)."""
    xp = time.__array_namespace__()
    return xp.concatenate([xp.ones((1, 1, *time.shape)), xp.zeros((3, 1, *time.shape))])


def harmonic_sizes(frequency: np.ndarray) -> np.ndarray:
    """Sizes of a harmonic, `|ω|^k`: (4, lanes)."""
    return np.abs(frequency)[None] ** np.arange(4.0)[:, None]
