"""The base class of all kinds: its name in a config, the draw of its numbers, its faults."""

import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, NamedTuple, TypeVar, Unpack

import numpy as np
from pydantic import ConfigDict, Field, ValidationError, model_serializer
from upath import UPath

from jaxnet.kinds import contract
from jaxnet.kinds.fields import Apiece, Each, Listed, Record, Shared, is_drawn
from jaxnet.kinds.protocols import LaneDraw, ScenarioView
from jaxnet.kinds.refusals import refusal_of
from jaxnet.outside import modules, provenance
from jaxnet.outside.modules import KindError as KindError


class Fault(NamedTuple):
    """An error in a scenario: the dotted keys that cause it, the most important first, and a message."""

    keys: tuple[str, ...]
    message: str


AnyKind = TypeVar("AnyKind", bound="Kind")


if TYPE_CHECKING:  # a type checker knows the arguments of pydantic's own models alone
    from pydantic._internal._model_construction import ModelMetaclass as KindType
else:

    class KindType(type(Record)):
        """Class of kinds: a kind that is called with wrong arguments raises KindError."""

        def __call__(cls, *args: object, **keys: object) -> object:
            """Return a kind with these keys; raise KindError."""
            try:
                return super().__call__(*args, **keys)
            except ValidationError as error:
                raise KindError(refusal_of(cls.__name__, list(cls.model_fields), error)) from None


class Kind(Record, metaclass=KindType):
    """One of several alternatives under one key of a config.

    A subclass declares its keys as pydantic fields. The class attribute `kind` is the name of a kind of
    jaxnet; without it the name is that of the class. `untraced` holds the keys that no method reads while
    lanes run.
    """

    kind: ClassVar[str]
    words: ClassVar[str] = ""  # name in figures and tables; "" is `kind` without underscores
    untraced: ClassVar[frozenset[str]] = frozenset(
        {"label"}
    )  # fields that no method reads while lanes run
    claims: ClassVar[frozenset[str]] = frozenset()  # names of what theory takes on trust
    neutral: ClassVar[frozenset[str]] = frozenset(
        {"kind", "words", "untraced", "model_config", "faults", "breaks"}
    )

    label: str | None = Field(default=None, description="what tables call it where it is swept")

    def __init_subclass__(cls, **options: Unpack[ConfigDict]) -> None:
        """Set `kind` to the name of a class that defines none; hold a class from outside to its contract."""
        super().__init_subclass__(**options)
        if "kind" not in vars(cls):
            cls.kind = cls.__name__
        if not cls.__module__.startswith("jaxnet."):
            contract.hold(cls)

    @classmethod
    def __pydantic_init_subclass__(cls, **options: object) -> None:
        """Forget the inherited `claims` of a class from outside that behaves in its own way.

        A claim holds of the methods that stand beside it or above it. A class that overrides anything but
        claims and `neutral` names has the claims that it makes itself. Its other claims are the family's.
        """
        super().__pydantic_init_subclass__(**options)
        own = {name for name in vars(cls) if not name.startswith("_")} - cls.neutral
        parents = {name for base in cls.__mro__[1:] for name in vars(base)}
        if not cls.__module__.startswith("jaxnet.") and own & parents - cls.claims:
            family = next((base for base in cls.__mro__ if vars(base).get("claims")), cls)
            for claim in cls.claims - own:
                setattr(cls, claim, inspect.getattr_static(family, claim))

    @model_serializer(mode="wrap")
    def _plain(self, handler: Callable[["Kind"], dict[str, object]]) -> dict[str, object]:
        return {"kind": self.reference(), **handler(self)}

    @classmethod
    def reference(cls) -> str:
        """Return the name of the class in a config: `kind` for a kind of jaxnet, else the name by which it
        was found.
        """
        if cls.__module__.startswith("jaxnet."):
            return cls.kind
        return REFERENCES.get(cls, f"{modules.public_name(cls.__module__)}:{cls.__qualname__}")

    def __reduce__(self) -> tuple[Callable[..., "Kind"], tuple[object, ...]]:
        """Pickle the file of the class with its hash, so that another process loads the same class."""
        cls = type(self)
        return restore_kind, (provenance.origin_of(cls), cls.__qualname__, self.__dict__)

    @classmethod
    def completed(cls, given: dict[object, object], folder: UPath) -> dict[object, object]:
        """Return a config's mapping of this kind, completed by the file at its key `path` in a folder.

        By default the mapping is returned as it is. Raises KindError if the file cannot be read.
        """
        return given

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """Yield the faults of a scenario with this kind that no single key shows."""
        yield from ()

    def breaks(self) -> frozenset[str]:
        """Premises of theorems that fail with this kind and its keys; by default none.

        A navigator may break "leader", a graph "one network" and "alike", an attack "bounded", "one
        identity" and "by law", an announcement "consistent", a law "not held" and "solved", a vehicle
        "flat", a sensor "exact sensors", a loss "every message", a noise "exact messages".
        """
        return frozenset()

    def drawn_keys(self) -> list[str]:
        """Return the keys whose values are drawn lane by lane."""
        return [key for key in type(self).model_fields if holds_drawn(getattr(self, key))]

    def drawn(self: AnyKind, draw: LaneDraw, name: str) -> AnyKind:
        """Return a copy whose numbers are arrays with lanes last; `name` is the dotted key of this kind."""
        values: dict[str, object] = {}
        for key, field in type(self).model_fields.items():
            value, dotted = getattr(self, key), f"{name}.{key}"
            if isinstance(value, Kind):
                values[key] = value.drawn(draw, dotted)
            elif is_number(value):
                each = any(isinstance(mark, Each) for mark in field.metadata)
                values[key] = (
                    draw.each(value, dotted)[..., 0].T if each else draw.one(value, dotted)
                )
            elif isinstance(value, list) and value and all(map(is_number, value)):
                values[key] = draw.several(value, dotted).T
            else:
                values[key] = value
        return self.filled(values)

    @classmethod
    def filled(cls: type[AnyKind], values: Mapping[str, object]) -> AnyKind:
        """Return an object with these values without validation; a key that is left out is missing."""
        made = cls.__new__(cls)
        object.__setattr__(made, "__dict__", dict(values))
        for name in ("__pydantic_fields_set__", "__pydantic_extra__", "__pydantic_private__"):
            object.__setattr__(
                made, name, set(values) if name == "__pydantic_fields_set__" else None
            )
        return made


def restore_kind(origin: modules.Origin, name: str, values: dict[str, object]) -> Kind:
    """Return a kind that another process has sent; raise KindError if its module differs in this process."""
    return modules.attribute(modules.load_origin(origin), name).filled(values)


REFERENCES: dict[type[Kind], str] = {}  # names of the classes that `registry` has found


def is_number(value: object) -> bool:
    """Return whether a value is a float, a distribution, or a number of each vehicle."""
    return isinstance(value, float | Apiece | Shared | Listed) or is_drawn(value)


def holds_drawn(value: object) -> bool:
    """Return whether a value is or contains a distribution."""
    if isinstance(value, list | tuple):
        return any(map(holds_drawn, value))
    if isinstance(value, Kind):
        return bool(value.drawn_keys())
    if isinstance(value, Apiece | Shared | Listed):
        return any(holds_drawn(each) for _, each in value)
    return is_drawn(value)


def broken(**premises: bool) -> frozenset[str]:
    """Return the names of the premises that are broken; an underscore stands for a blank."""
    return frozenset(name.replace("_", " ") for name, fails in premises.items() if fails)


def unknown_vehicles(key: str, listed: list[int], vehicles: int, first: int) -> Iterator[Fault]:
    """Yield a fault for numbers outside `first` … `vehicles`; `first` is 1 for vehicles, 0 for sources."""
    beyond = sorted({one for one in listed if not first <= one <= vehicles})
    if beyond:
        noun = "vehicles are" if first else "sources are"
        got = ", ".join(map(str, beyond))
        yield Fault((key, "vehicles"), f"{noun} {first} to {vehicles} (got {got})")


def vehicle_numbers(mask: np.ndarray) -> list[int]:
    """Return the numbers, from 1, of the vehicles in a mask."""
    return [int(i) for i in np.flatnonzero(mask) + 1]
