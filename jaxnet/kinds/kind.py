"""The base class of all kinds: its name and keys in a config, its faults, and its form in lanes.

A kind is one class at three times. A config's keys make an object of it, which pydantic checks.
`drawn` binds the object to lanes: a copy with arrays in place of numbers, on which nothing is
checked any more. `as_pytree` shows the copy to JAX. Nothing else makes such copies.
"""

import functools
import inspect
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeGuard, TypeVar, Unpack

import numpy as np
from pydantic import ConfigDict, Field, ValidationError, model_serializer
from upath import UPath

from jaxnet.kinds import contract
from jaxnet.kinds.fields import Apiece, Each, Listed, Record, Shared, is_drawn
from jaxnet.kinds.protocols import LaneDraw, ScenarioView
from jaxnet.kinds.refusals import refusal_of
from jaxnet.lazy import jax
from jaxnet.outside import modules, provenance
from jaxnet.outside.modules import KindError as KindError

# Tests that check shapes hold jaxnet's own classes to the contract too.
HOLDS_ALL = "JAXNET_CHECK_SHAPES" in os.environ


class Fault(NamedTuple):
    """An error in a scenario: the dotted keys that cause it, the main one first, and a message."""

    keys: tuple[str, ...]
    message: str


AnyKind = TypeVar("AnyKind", bound="Kind")
AnyDrawn = TypeVar("AnyDrawn")


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

    A subclass declares its keys as pydantic fields. A kind of jaxnet has the name of its file, one
    from outside that of its class, if it gives no other as `kind`.
    """

    kind: ClassVar[str]
    words: ClassVar[str] = ""  # name in figures and tables; "" is `kind` without underscores
    untraced: ClassVar[frozenset[str]] = frozenset({"label"})  # that no method reads in lanes
    off_at_zero: ClassVar[frozenset[str]] = frozenset()  # numbers that are None in lanes where 0
    claims: ClassVar[frozenset[str]] = frozenset()  # names of what theory takes on trust
    neutral: ClassVar[frozenset[str]] = frozenset(
        {"kind", "words", "untraced", "model_config", "faults", "breaks"}
    )

    label: str | None = Field(default=None, description="its name in the tables of a sweep")

    def __init_subclass__(cls, **options: Unpack[ConfigDict]) -> None:
        """Name the class, and hold one from outside to its contract."""
        super().__init_subclass__(**options)
        if "kind" not in vars(cls):
            in_file = re.fullmatch(r"jaxnet\.\w+\.\w+\.(\w+)", cls.__module__)
            cls.kind = in_file[1] if in_file else cls.__name__
        if HOLDS_ALL or not cls.__module__.startswith("jaxnet."):
            contract.hold(cls)

    @classmethod
    def __pydantic_init_subclass__(cls, **options: object) -> None:
        """Reset inherited `claims` of a class from outside that behaves in its own way.

        A class that overrides anything but claims and `neutral` names has the claims that it makes
        itself. Its other claims are the family's.
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
        """Its name in a config: `kind` for a kind of jaxnet, else that by which it was found."""
        if cls.__module__.startswith("jaxnet."):
            return cls.kind
        return REFERENCES.get(cls, f"{modules.public_name(cls.__module__)}:{cls.__qualname__}")

    def __reduce__(self) -> tuple[Callable[..., "Kind"], tuple[object, ...]]:
        """Pickle the file of the class with its hash: another process loads the same class."""
        cls = type(self)
        return restore_kind, (provenance.origin_of(cls), cls.__qualname__, self.__dict__)

    @classmethod
    def completed(cls, given: dict[object, object], folder: UPath) -> dict[object, object]:
        """A config's mapping of this kind, completed by the file at its key `path` in a folder.

        By default the mapping is returned as it is. Raises KindError if the file cannot be read.
        """
        return given

    def faults(self, scenario: ScenarioView) -> Iterator[Fault]:
        """The faults of a scenario with this kind that no single key shows."""
        yield from ()

    def breaks(self) -> frozenset[str]:
        """Premises of theorems that fail with this kind and its keys, by name; by default none."""
        return frozenset()

    def config_keys(self) -> dict[str, object]:
        """The keys of a config with their values."""
        return {key: getattr(self, key) for key in type(self).model_fields}

    @classmethod
    def drawn_by_vehicle(cls, key: str) -> bool:
        """Whether every vehicle has a number of its own at a key."""
        return any(isinstance(mark, Each) for mark in cls.model_fields[key].metadata)

    def drawn_keys(self) -> list[str]:
        return [key for key, value in self.config_keys().items() if holds_drawn(value)]

    def drawn(self: AnyKind, draw: LaneDraw, name: str) -> AnyKind:
        """A copy whose numbers are arrays, lanes last; `name` is the dotted key of this kind."""
        values: dict[str, object] = {}
        for key, value in self.config_keys().items():
            dotted, number = f"{name}.{key}", is_number(value)
            if isinstance(value, Kind):
                values[key] = value.drawn(draw, dotted)
            elif key in self.off_at_zero and value == 0:
                values[key] = None
            elif number and self.drawn_by_vehicle(key):
                values[key] = draw.each(value, dotted)[..., 0].T
            elif number:
                values[key] = draw.one(value, dotted)
            elif isinstance(value, list) and value and all(map(is_number, value)):
                values[key] = draw.several(value, dotted).T
            elif is_mapping_of(value, is_number):
                values[key] = {k: draw.one(each, f"{dotted}.{k}") for k, each in value.items()}
            else:
                values[key] = value
        return self.filled(values)

    @classmethod
    def filled(cls: type[AnyKind], values: Mapping[str, object]) -> AnyKind:
        """The run-time kind with these values, as they are; a key that is left out is missing."""
        made = cls.__new__(cls)
        object.__setattr__(made, "__dict__", dict(values))
        object.__setattr__(made, "__pydantic_fields_set__", set(values))
        for name in ("__pydantic_extra__", "__pydantic_private__"):
            object.__setattr__(made, name, None)
        return made


def restore_kind(origin: modules.Origin, name: str, values: dict[str, object]) -> Kind:
    """A kind that another process has sent; raise KindError if its module differs here."""
    return modules.attribute(modules.load_origin(origin), name).filled(values)


def as_pytree(drawn: AnyDrawn) -> AnyDrawn:
    """A drawn kind as a pytree of JAX without untraced keys, also inside tuples; else the argument.

    Numbers are leaves, all other keys structure. Equal classes and structures share a program.
    """
    if isinstance(drawn, tuple):
        return type(drawn)(*map(as_pytree, drawn))
    if not isinstance(drawn, Kind) or "_leaves" in vars(drawn):
        return drawn
    cls, values = type(drawn), vars(drawn)
    values = {key: as_pytree(each) for key, each in values.items() if key not in drawn.untraced}
    if cls not in REGISTERED:
        REGISTERED.add(cls)
        unflatten = functools.partial(unflatten_kind, cls)
        jax.tree_util.register_pytree_node(cls, flatten_kind, unflatten)
    leaves = tuple(key for key, each in values.items() if is_leaf(each))
    return cls.filled({**values, "_leaves": leaves})


class Structure:
    """What a kind is besides its numbers: the names of its leaves, and its other keys."""

    def __init__(self, leaves: tuple[str, ...], settings: dict[str, object]):
        self.leaves, self.settings = leaves, settings
        self.words = leaves, repr(sorted(settings.items()))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Structure) and self.words == other.words

    def __hash__(self) -> int:
        return hash(self.words)


def flatten_kind(kind: Kind) -> tuple[tuple[object, ...], Structure]:
    values = dict(vars(kind))
    leaves = values.pop("_leaves")
    return tuple(values.pop(key) for key in leaves), Structure(leaves, values)


def unflatten_kind(cls: type[Kind], structure: Structure, numbers: Iterable[object]) -> Kind:
    values = dict(zip(structure.leaves, numbers, strict=True))
    return cls.filled({**structure.settings, **values, "_leaves": structure.leaves})


REGISTERED: set[type] = set()  # classes that JAX knows as pytrees
REFERENCES: dict[type[Kind], str] = {}  # names of the classes that `registry` has found


def is_number(value: object) -> bool:
    """Whether a value is a float, a distribution, or a number of each vehicle."""
    return isinstance(value, float | Apiece | Shared | Listed) or is_drawn(value)


def is_mapping_of(value: object, kind: Callable[[object], bool]) -> TypeGuard[dict[str, Any]]:
    """Whether a value is a mapping, not an empty one, to such values alone."""
    return isinstance(value, dict) and bool(value) and all(map(kind, value.values()))


def is_leaf(value: object) -> bool:
    """Whether a value of a drawn kind consists of numbers."""
    return isinstance(value, np.ndarray | Kind) or is_mapping_of(value, is_leaf)


def holds_drawn(value: object) -> bool:
    """Whether a value is or contains a distribution."""
    if isinstance(value, dict):
        return any(map(holds_drawn, value.values()))
    if isinstance(value, list | tuple):
        return any(map(holds_drawn, value))
    if isinstance(value, Kind):
        return bool(value.drawn_keys())
    if isinstance(value, Apiece | Shared | Listed):
        return any(holds_drawn(each) for _, each in value)
    return is_drawn(value)


def broken(**premises: bool) -> frozenset[str]:
    """The names of the premises that are broken; an underscore stands for a blank."""
    return frozenset(name.replace("_", " ") for name, fails in premises.items() if fails)


def unknown_vehicles(key: str, listed: list[int], vehicles: int, first: int) -> Iterator[Fault]:
    """A fault for numbers outside `first` … `vehicles`; first is 1 for vehicles, 0 for sources."""
    if beyond := sorted({one for one in listed if not first <= one <= vehicles}):
        noun, got = "vehicles" if first else "sources", ", ".join(map(str, beyond))
        yield Fault((key, "vehicles"), f"{noun} are {first} to {vehicles} (got {got})")


def vehicle_numbers(mask: np.ndarray) -> list[int]:
    """The numbers, from 1, of the vehicles in a mask."""
    return [int(i) for i in np.flatnonzero(mask) + 1]
