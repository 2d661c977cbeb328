"""What all kinds share: how one is written in a config, drawn for lanes, and told what is wrong."""

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field, model_serializer

from jaxnet.kinds import modules, provenance
from jaxnet.kinds.fields import Apiece, Each, Listed, Record, Shared, is_drawn
from jaxnet.kinds.modules import KindError as KindError


class Fault(NamedTuple):
    """What is wrong with a scenario: the dotted keys that it stands on, the first the one to name."""

    keys: tuple[str, ...]
    message: str


class Kind(Record):
    """One of several ways. `label` names it in tables.

    A class of one's own may say what tables call it by `kind`; without it that is the class's name.
    """

    kind: ClassVar[str]
    untraced: ClassVar[frozenset[str]] = frozenset(
        {"label"}
    )  # fields that no method asks for while lanes run

    label: str | None = Field(default=None, description="what tables call it where it is swept")

    def __init_subclass__(cls, **options: Any) -> None:
        """Give a class its name, unless it has said one."""
        super().__init_subclass__(**options)
        if "kind" not in vars(cls):
            cls.kind = cls.__name__

    @model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> dict[str, Any]:
        return {"kind": self.reference(), **handler(self)}

    @classmethod
    def reference(cls) -> str:
        """How a config names the class: ours by its kind, others as they were found or by `module:Class`."""
        if cls.__module__.startswith("jaxnet."):
            return cls.kind
        return REFERENCES.get(cls, f"{modules.public_name(cls.__module__)}:{cls.__qualname__}")

    def __reduce__(self) -> Any:
        """Another process is told in which file the class is, and what that file must hold."""
        cls = type(self)
        return restore_kind, (provenance.origin_of(cls), cls.__qualname__, self.__dict__)

    @classmethod
    def completed(cls, given: dict[Any, Any], folder: Any) -> dict[Any, Any]:
        """What a config says of one, with what the file at its `path`, from this folder, says too.

        Raises KindError.
        """
        return given

    def faults(self, scenario: Any) -> Iterator[Fault]:
        """What is wrong with a scenario that has this kind, besides what single keys show."""
        yield from ()

    def drawn_keys(self) -> list[str]:
        """Keys of its own that are drawn lane by lane."""
        return [key for key in type(self).model_fields if holds_drawn(getattr(self, key))]

    def drawn(self, draw: Any, name: str) -> Any:
        """The same with its numbers drawn, lanes last; `name` is its dotted key."""
        values: dict[str, Any] = {}
        for key, field in type(self).model_fields.items():
            value, dotted = getattr(self, key), f"{name}.{key}"
            if isinstance(value, Kind):
                values[key] = value.drawn(draw, dotted)
            elif is_number(value):
                each = any(isinstance(mark, Each) for mark in field.metadata)
                values[key] = draw.each(value, dotted)[..., 0].T if each else draw.one(value, dotted)
            elif isinstance(value, list) and value and all(map(is_number, value)):
                values[key] = draw.several(value, dotted).T
            else:
                values[key] = value
        return self.filled(values)

    @classmethod
    def filled(cls, values: Mapping[str, Any]) -> Any:
        """An object with these values, which are not looked at; keys that are left out are missing."""
        made = cls.__new__(cls)
        object.__setattr__(made, "__dict__", dict(values))
        for name in ("__pydantic_fields_set__", "__pydantic_extra__", "__pydantic_private__"):
            object.__setattr__(made, name, set(values) if name == "__pydantic_fields_set__" else None)
        return made


def restore_kind(origin: modules.Origin, name: str, values: dict[str, Any]) -> Kind:
    """A kind that another process has sent; raises KindError if its module is not the same here."""
    return modules.attribute(modules.load_origin(origin), name).filled(values)


REFERENCES: dict[type[Kind], str] = {}  # of the classes that `registry` has found


def is_number(value: Any) -> bool:
    """Whether a value is a number with a decimal point, a distribution of such, or one of each vehicle."""
    return isinstance(value, float | Apiece | Shared | Listed) or is_drawn(value)


def holds_drawn(value: Any) -> bool:
    """Whether a value is a distribution, or has one in it."""
    if isinstance(value, list | tuple):
        return any(map(holds_drawn, value))
    if isinstance(value, Kind):
        return bool(value.drawn_keys())
    if isinstance(value, Apiece | Shared | Listed):
        return any(holds_drawn(each) for _, each in value)
    return is_drawn(value)


def unknown_vehicles(key: str, listed: list[int], vehicles: int, first: int) -> Iterator[Fault]:
    """Those of a list that do not exist; `first` is 1 for vehicles, 0 for sources."""
    beyond = sorted({one for one in listed if not first <= one <= vehicles})
    if beyond:
        noun = "vehicles are" if first else "sources are"
        got = ", ".join(map(str, beyond))
        yield Fault((key, "vehicles"), f"{noun} {first} to {vehicles} (got {got})")


def vehicle_numbers(mask: np.ndarray) -> list[int]:
    """Numbers of the vehicles in a mask, from 1."""
    return [int(i) for i in np.flatnonzero(mask) + 1]
