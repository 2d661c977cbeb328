"""Kinds as JAX sees them: a tree whose leaves are the numbers drawn, of a type that its other keys tell
apart.

Lanes whose kinds are alike in class and in all that is no number share a compiled program.
"""

from typing import Any, NamedTuple

import jax
import numpy as np

from jaxnet.kinds.kind import Kind


class Settings:
    """Keys of a kind that are no numbers, by which its compiled programs are told apart."""

    def __init__(self, values: dict[str, Any]):
        self.values, self.words = values, repr(sorted(values.items()))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Settings) and self.words == other.words

    def __hash__(self) -> int:
        return hash(self.words)


class Shape(NamedTuple):
    """What a kind is besides its numbers."""

    leaves: tuple[str, ...]
    settings: Settings


REGISTERED_CLASSES: set[type] = set()


def as_pytree(drawn: Any) -> Any:
    """A drawn kind with what lanes ask of it, its class known to JAX, in a tuple too; else as it is."""
    if isinstance(drawn, tuple):
        return type(drawn)(*map(as_pytree, drawn))
    if not isinstance(drawn, Kind) or "_leaves" in vars(drawn):
        return drawn
    cls = type(drawn)
    values = {key: as_pytree(each) for key, each in vars(drawn).items() if key not in drawn.untraced}
    if cls not in REGISTERED_CLASSES:
        REGISTERED_CLASSES.add(cls)
        jax.tree_util.register_pytree_node(
            cls, flatten_kind, lambda shape, leaves: unflatten_kind(cls, shape, leaves)
        )
    leaves = tuple(key for key, each in values.items() if isinstance(each, np.ndarray | Kind))
    return cls.filled({**values, "_leaves": leaves})


def flatten_kind(kind: Any) -> tuple[tuple[Any, ...], Shape]:
    """Its numbers, and its shape."""
    values = dict(vars(kind))
    leaves = values.pop("_leaves")
    settings = {key: each for key, each in values.items() if key not in leaves}
    return tuple(values[key] for key in leaves), Shape(leaves, Settings(settings))


def unflatten_kind(cls: type[Kind], shape: Shape, leaves: Any) -> Kind:
    """A kind of this shape."""
    numbers = dict(zip(shape.leaves, leaves, strict=True))
    return cls.filled({**shape.settings.values, **numbers, "_leaves": shape.leaves})
