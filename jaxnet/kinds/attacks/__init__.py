"""What an attack puts on the links it holds: signals of fixed vectors times scalar functions
(`model.signal`).

`‖a_j^(k)(t)‖ ≤ ā` for k = 0..3 holds by construction: an attack gives unit signals and, by `sizes`, how great
they and their derivatives become; the vectors are scaled by ā over the greatest.
"""

from collections.abc import Iterator
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from jaxnet.kinds.fields import Each, NotNegative, is_drawn
from jaxnet.kinds.kind import Fault, Kind, KindError, unknown_vehicles
from jaxnet.model import graph
from jaxnet.model.graph import Links, Weights
from jaxnet.model.signal import Harmonic

Channel = Literal["auto", "neighbour", "navigator"]
Threat = Literal["adds", "replaces"]


class AnyAttack(Kind):
    """What is asked of an attack; this one attacks nobody."""

    present: ClassVar[bool] = False
    strategic: ClassVar[bool] = False  # whether it chooses its vectors anew at every tick

    def targets(self) -> list[int]:
        """Vehicles that are attacked, from 1."""
        return []

    def amplitude(self) -> Any:
        """ā [m, m/s, m/s², m/s³], a number or a distribution."""
        return 0.0

    def links(self, weights: Weights) -> Links:
        """Links that carry the attack, of those of a graph."""
        return np.zeros(weights.shape, bool)

    def replaces(self) -> bool:
        """Whether an attacked link carries the navigator's path plus the signal, in place of its source's
        word.

        Otherwise it carries what its source says, plus the signal.
        """
        return False

    def signal(self) -> Any:
        """What gives the scalar functions: `basis(time)` → (4, B, lanes), for times (lanes,) [s]."""
        return Harmonic(0.0)

    def vectors(self) -> np.ndarray:
        """Vectors of every vehicle's unit signal: (2, m, B, lanes), `m = 1` if all have the same."""
        return np.zeros((2, 1, 2, 1))

    def sizes(self, horizon: float) -> np.ndarray:
        """Greatest norm of the functions together, and of each derivative of them, in [0, horizon]: (4,
        lanes).
        """
        return np.ones((4, 1))

    def describe(self) -> str:
        """The attack in a few words."""
        return self.kind


class Attack(AnyAttack):
    """A signal of bounded size on what attacked vehicles transmit, or on what they hear of the navigator.

    An attack of one's own gives `basis`, `vectors` and `sizes`, or, if it is strategic, `basis`, `sizes` and
    `aim`, and `begin` if it has a memory.
    """

    present: ClassVar[bool] = True
    untraced: ClassVar[frozenset[str]] = frozenset({"label", "magnitude", "vehicles", "channel", "threat"})

    magnitude: NotNegative = Field(
        default=5.0, description="[m, m/s, m/s², m/s³], ā, the bound on the signal and its three derivatives"
    )
    vehicles: list[int] = Field(default=[2, 5, 8, 11], description="attacked vehicles, from 1")
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

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        """Numbers that every vehicle has make its vectors, and are not asked for while lanes run."""
        fields = cls.model_fields.items()
        each = {key for key, field in fields if any(isinstance(mark, Each) for mark in field.metadata)}
        cls.untraced = cls.untraced | each

    def targets(self) -> list[int]:
        """The vehicles named."""
        return self.vehicles

    def amplitude(self) -> Any:
        """The magnitude given."""
        return self.magnitude

    def links(self, weights: Weights) -> Links:
        """`neighbour`: everything that they transmit, `navigator`: what they hear from 0."""
        channel = self.channel
        if channel == "auto":
            channel = "neighbour" if graph.hears_vehicles(weights) else "navigator"
        listed = np.array(sorted(self.vehicles), dtype=int)
        links = np.zeros(weights.shape, dtype=bool)
        if channel == "neighbour":
            links[:, listed] = True
        else:
            links[listed - 1, 0] = True
        return links & (weights > 0)

    def replaces(self) -> bool:
        """As `threat` says."""
        return self.threat == "replaces"

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
        """`max over t of ‖β^(k)(t)‖` for k = 0..3 within [0, horizon], or more: (4, lanes)."""
        raise KindError(f"{self.kind}: an attack gives sizes(self, horizon)")

    def begin(self, seen: Any) -> Any:
        """The memory of a strategic attack before the first tick, when nothing was decided and no error seen.

        Any pytree of arrays whose last axis is over lanes.
        """
        return ()

    def aim(self, seen: Any, memory: Any) -> tuple[Any, Any]:
        """At a tick, vectors (2, m, B, lanes) until the next and the memory; asked of strategic attacks.

        They are unit vectors: scaled to ā, and down where their norm is over 1. `seen` is what there is to
        see (`engine.tick.Seen`).
        """
        raise KindError(f"{self.kind}: a strategic attack gives aim(self, seen, memory)")

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """Whoever is named must exist, and be named once."""
        yield from unknown_vehicles("attack.vehicles", self.vehicles, scenario.vehicles, first=1)
        if len(set(self.vehicles)) < len(self.vehicles):
            yield Fault(("attack.vehicles",), f"named twice (got {self.vehicles})")
        if self.strategic and scenario.tick == 0:
            yield Fault(("attack", "tick"), f"{self.kind} decides at ticks: give a tick")
        if self.strategic and is_drawn(self.magnitude):
            yield Fault(("attack.magnitude",), f"{self.kind} takes a number")


def scaled(attack: AnyAttack, sizes: Any) -> np.ndarray:
    """What unit vectors are multiplied with (lanes,) [m]: ā over the greatest of the four sizes."""
    return np.asarray(attack.amplitude() / np.max(np.asarray(sizes), axis=0))


def along(direction: np.ndarray) -> np.ndarray:
    """Unit vectors (2, m, lanes) of directions [rad]."""
    return np.stack([np.cos(direction), np.sin(direction)])


def powers(frequency: np.ndarray) -> np.ndarray:
    """Sizes of a harmonic, `|ω|^k`: (4, lanes)."""
    return np.abs(frequency)[None] ** np.arange(4.0)[:, None]
