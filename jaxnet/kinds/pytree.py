"""Kinds as pytrees of JAX: the drawn numbers are leaves, all other keys belong to the tree's structure.

Lanes share one compiled program if the classes and structures of their kinds are equal.
"""

from collections.abc import Iterable
from typing import NamedTuple, TypeVar

import jax
import numpy as np

from jaxnet.kinds.kind import Kind

AnyDrawn = TypeVar("AnyDrawn")


class Settings:
    """The keys of a kind that are not numbers, as a hashable part of the tree's structure."""

    def __init__(self, values: dict[str, object]):
        self.values, self.words = values, repr(sorted(values.items()))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Settings) and self.words == other.words

    def __hash__(self) -> int:
        return hash(self.words)


class Shape(NamedTuple):
    """The structure of a kind: names of its leaves, and its settings."""

    leaves: tuple[str, ...]
    settings: Settings


REGISTERED_CLASSES: set[type] = set()


def as_pytree(drawn: AnyDrawn) -> AnyDrawn:
    """A drawn kind as a registered pytree without its untraced keys, also inside tuples; else the
    argument.
    """
    if isinstance(drawn, tuple):
        return type(drawn)(*map(as_pytree, drawn))
    if not isinstance(drawn, Kind) or "_leaves" in vars(drawn):
        return drawn
    cls = type(drawn)
    values = {
        key: as_pytree(each) for key, each in vars(drawn).items() if key not in drawn.untraced
    }
    if cls not in REGISTERED_CLASSES:
        REGISTERED_CLASSES.add(cls)
        jax.tree_util.register_pytree_node(
            cls, flatten_kind, lambda shape, leaves: unflatten_kind(cls, shape, leaves)
        )
    leaves = tuple(key for key, each in values.items() if isinstance(each, np.ndarray | Kind))
    return cls.filled({**values, "_leaves": leaves})


def flatten_kind(kind: Kind) -> tuple[tuple[object, ...], Shape]:
    values = dict(vars(kind))
    leaves = values.pop("_leaves")
    settings = {key: each for key, each in values.items() if key not in leaves}
    return tuple(values[key] for key in leaves), Shape(leaves, Settings(settings))


def unflatten_kind(cls: type[Kind], shape: Shape, leaves: Iterable[object]) -> Kind:
    numbers = dict(zip(shape.leaves, leaves, strict=True))
    return cls.filled({**shape.settings.values, **numbers, "_leaves": shape.leaves})
