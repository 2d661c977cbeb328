"""Check what methods of kinds from outside return, by the annotations of overridden methods.

The annotations name the axes of arrays (`kinds.shapes`). Arguments tell the sizes of the axes. JAX
traces a program before it compiles it, so a wrong shape or type is found before anything compiles.
"""

import functools
import inspect
import types
import typing
from collections.abc import Callable
from typing import Any

import numpy as np

from jaxnet.kinds.shapes import Memory
from jaxnet.lazy import jax
from jaxnet.outside.modules import KindError

NUMBERS = {"bool": "booleans", "int64": "whole numbers", "float64": "double precision"}
MOST_SHOWN = 200  # characters of a value in a message

AxisSizes = dict[str, Any]  # of axes by name: a number, or a tuple for several axes
Misfit = tuple[Any, str]  # a value and what is expected in its place

hints_of = functools.cache(functools.partial(typing.get_type_hints, include_extras=True))


def hold(cls: type) -> None:
    """Make methods of a class from outside raise KindError where they break jaxnet's contract."""
    ours = [vars(each) for each in reversed(cls.__mro__) if each.__module__.startswith("jaxnet.")]
    for name, given in list(vars(cls).items()):
        base = next((each[name] for each in ours if name in each), None)
        if inspect.isfunction(given) and inspect.isfunction(base) and not name.startswith("_"):
            setattr(cls, name, held(name, given, base))


def held(name: str, given: Callable[..., Any], base: Callable[..., Any]) -> Callable[..., Any]:
    """A method that checks its arguments' number and its result; `base` has the annotations."""
    taken, asked = inspect.signature(given), inspect.signature(base)

    @functools.wraps(given)
    def method(self: Any, *args: Any, **keys: Any) -> Any:
        where = f"{type(self).__name__}.{name}"
        try:
            taken.bind(self, *args, **keys)
        except TypeError as error:
            asks = ", ".join(asked.parameters)
            raise KindError(f"{where}: {error}; it is called with ({asks})") from None
        found, hints, sizes = given(self, *args, **keys), hints_of(base), AxisSizes()
        try:
            known = asked.bind(self, *args, **keys).arguments
        except TypeError:  # a call of the class's own, with arguments of its own
            return found
        for argument, value in known.items():
            learn(hints.get(argument), value, sizes)
        if wrong := misfit(hints.get("return"), found, sizes, known, hints):
            value, wanted = wrong
            raise KindError(f"{where} gives {described(value)}; expected: {wanted}")
        return found

    return method


def learn(hint: Any, value: Any, sizes: AxisSizes) -> None:
    """Add the sizes of the axes of an argument, and of the arrays inside it."""
    if hasattr(hint, "dim_str") and hasattr(value, "shape"):
        match(hint.dim_str.split(), value.shape, sizes)
    elif hasattr(value, "_fields") and type(value).__module__.startswith("jaxnet."):
        for name, each in hints_of(type(value)).items():
            learn(each, getattr(value, name), sizes)
    elif isinstance(value, tuple) and typing.get_origin(hint) is tuple:
        learn(typing.get_args(hint)[0], value[0] if value else None, sizes)


def match(axes: list[str], shape: tuple[int, ...], sizes: AxisSizes) -> bool:
    """Whether a shape has these axes; add the sizes of axes that are not known."""
    many = next((place for place, axis in enumerate(axes) if axis.startswith(("*", "..."))), None)
    if many is not None:
        end = len(shape) - len(axes) + 1 + many
        if end < many or not agrees(axes[many], shape[many:end], sizes):
            return False
        axes, shape = axes[:many] + axes[many + 1 :], shape[:many] + shape[end:]
    return len(axes) == len(shape) and all(map(agrees, axes, shape, [sizes] * len(axes)))


def agrees(axis: str, size: Any, sizes: AxisSizes) -> bool:
    """Whether an axis has the size that its name stands for; add the size if it is not known."""
    if axis.isdigit():
        return size == int(axis)
    return axis in ("_", "...") or sizes.setdefault(axis.strip("*"), size) == size


def misfit(
    hint: Any, value: Any, sizes: AxisSizes, known: dict[str, Any], hints: dict[str, Any]
) -> Misfit | None:
    """Part of a result that does not fit its annotation, and what is expected.

    `known` are the arguments, with the annotations `hints`.
    """
    parts = typing.get_args(hint)
    if hint == Memory:
        return memory_misfit(value, sizes, known)
    if hasattr(hint, "dim_str"):
        return array_misfit(hint, value, sizes)
    if hint is bool:
        return None if isinstance(value, int | np.bool_) else (value, "True or False")
    if isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union:
        if value is None and type(None) in parts:
            return None
        some = [each for each in parts if each is not type(None)]
        found = [misfit(each, value, sizes, known, hints) for each in some]
        return None if None in found else found[0]
    any_length = parts[1:] == (...,)
    if typing.get_origin(hint) is not tuple or (any_length and not hasattr(parts[0], "dim_str")):
        return None
    if any_length:
        like = next((known[name] for name in known if hints.get(name) == hint), None)
        parts = parts[:1] * (getattr(known["self"], "order", 3) if like is None else len(like))
    if not hasattr(value, "__len__") or len(value) != len(parts):
        return value, f"a tuple of {len(parts)}"
    found = (misfit(*each, sizes, known, hints) for each in zip(parts, value, strict=True))
    return next(filter(None, found), None)


def array_misfit(hint: Any, value: Any, sizes: AxisSizes) -> Misfit | None:
    """An array of a wrong shape or type, and what is expected."""
    axes = hint.dim_str.split()
    wanted = next((each for each in NUMBERS if each in str(hint.dtypes)), "")
    before = dict(sizes)
    if hasattr(value, "dtype") and holds_numbers(value, wanted) and match(axes, value.shape, sizes):
        return None
    named = ", ".join(named_size(axis.strip("*"), before) for axis in axes)
    return value, f"{NUMBERS.get(wanted, 'an array')} ({named})"


def named_size(axis: str, sizes: AxisSizes) -> str:
    """An axis by its name and size, "slots = 3"; of a size not known, by its name."""
    size = sizes.get(axis, axis)
    size = " × ".join(map(str, size)) if isinstance(size, tuple) else size
    return axis if size == axis else f"{axis} = {size}"


def holds_numbers(value: Any, wanted: str) -> bool:
    """Whether an array holds numbers of a type; NumPy's whole numbers count as real ones."""
    if wanted == "float64" and not isinstance(value, np.ndarray | np.generic):
        return value.dtype == wanted
    kinds = {"bool": "b", "int64": "iu", "float64": "fiu"}
    return wanted not in kinds or value.dtype.kind in kinds[wanted]


def memory_misfit(value: Any, sizes: AxisSizes, known: dict[str, Any]) -> Misfit | None:
    """A memory that is not as the last one, or a first one without lanes, and what is expected."""
    leaves, structure = jax.tree.flatten(value)
    if "memory" in known:
        before, same = jax.tree.flatten(known["memory"])
        alike = structure == same and [*map(form_of, leaves)] == [*map(form_of, before)]
        return None if alike else (value, f"a memory as the last one, {described(known['memory'])}")
    lanes = sizes.get("lanes", ())
    apart = [leaf for leaf in leaves if np.shape(leaf)[len(np.shape(leaf)) - len(lanes) :] != lanes]
    return (apart[0], f"arrays whose last axis is {named_size('lanes', sizes)}") if apart else None


def form_of(value: Any) -> tuple[tuple[int, ...], np.dtype]:
    return np.shape(value), value.dtype if hasattr(value, "dtype") else np.result_type(value)


def described(value: Any) -> str:
    """Types and shapes of arrays, also inside tuples; anything else as Python shows it."""
    if hasattr(value, "dtype"):
        return f"{value.dtype} {value.shape}"
    if isinstance(value, tuple | list):
        return f"({', '.join(map(described, value))})"
    return repr(value)[:MOST_SHOWN]
