"""Types of keys: numbers with limits, and the distributions from which numbers are drawn."""

import operator
import statistics
import typing
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Generic, Literal, Self, TypeVar

import numpy as np
from annotated_types import Len
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    RootModel,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import core_schema

PI = 3.141592653589793

# First character of the tags that identify members of a union. No key of a user has it. pydantic
# puts tags into the location of an error, and `config.known` removes them.
MARK = "\0"

Root = TypeVar("Root")


def setting(default: object, description: str, **limits: Any) -> Any:
    """A key of a config with its default and its meaning; `limits` are those of `Field`."""
    return Field(default=default, description=description, **limits)


class Record(BaseModel):
    """A mapping with known keys. It converts no types, and it is frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def with_values(self, **values: object) -> Self:
        """A copy with other or further values, which are not checked; pydantic's takes longer."""
        made = type(self).__new__(type(self))
        object.__setattr__(made, "__dict__", vars(self) | values)
        for name in ("__pydantic_fields_set__", "__pydantic_extra__", "__pydantic_private__"):
            object.__setattr__(made, name, getattr(self, name))
        return made


class Rooted(RootModel[Root], Generic[Root]):
    """A list in place of a mapping. It converts no types, and it is frozen."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)
    depth: typing.ClassVar[int] = 0  # of lists in lists; 0: any


class OneOf:
    """Mark of a union: a value is checked as the last member that it looks like.

    A value that looks like none gets the message; without a message it is checked as the first.
    """

    def __init__(self, message: str | None = None):
        self.message = message

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        members = {MARK + getattr(each, "__name__", "0"): each for each in typing.get_args(source)}
        first = next(iter(members))

        def form(value: object) -> str | None:
            strict = self.message is not None
            alike = [name for name, each in members.items() if looks_like(value, each, strict)]
            ambiguous = isinstance(value, dict) and len(alike) > 1
            if alike and not (strict and ambiguous):
                return alike[-1]
            return None if strict else first

        numbers: dict[type, str | None] = {kind: form(kind()) for kind in (int, float)}  # for speed

        def tag(value: object) -> str | None:
            return numbers[type(value)] if type(value) in numbers else form(value)

        return core_schema.tagged_union_schema(
            {name: handler(member) for name, member in members.items()},
            tag,
            custom_error_type="form" if self.message else None,
            custom_error_message=self.message,
        )


def looks_like(value: object, member: Any, strict: bool) -> bool:
    """Whether a value has the form of a member of a union; its parts may be wrong.

    A mapping by number has no text among its keys if `strict`; else it may be any but a draw.
    """
    if typing.get_origin(member) is Annotated:
        return looks_like(value, typing.get_args(member)[0], strict)
    if typing.get_origin(member) is Literal:
        return value in typing.get_args(member) if isinstance(value, str) else False
    if member is float:
        return not isinstance(value, dict | list | BaseModel)
    if typing.get_origin(member) is dict:
        if not isinstance(value, dict):
            return False
        named = any(isinstance(each, str) for each in value)
        return not named or not (strict or names_distribution(value))
    if not issubclass(member, BaseModel):
        return isinstance(value, typing.get_origin(member) or member)
    if isinstance(value, BaseModel):
        return isinstance(value, member)
    if issubclass(member, Rooted):
        return isinstance(value, list) and member.depth in (0, list_depth(value))
    required = [name for name, field in member.model_fields.items() if field.is_required()]
    return isinstance(value, dict) and not value.keys().isdisjoint(required)


def list_depth(value: object) -> int:
    return 1 + list_depth(value[0] if value else None) if isinstance(value, list) else 0


def ordered(bounds: list[float]) -> list[float]:
    if bounds[0] > bounds[1]:
        raise ValueError("the lower bound stands first")
    return bounds


def equally_long(lists: list[list[float]]) -> list[list[float]]:
    if len({len(each) for each in lists}) > 1:
        raise ValueError("each list must have as many numbers as the other lists")
    return lists


def not_negative(moments: list[float]) -> list[float]:
    if moments[1] < 0:
        raise ValueError("a standard deviation is not negative")
    return moments


class Uniform(Record):
    """Uniform distribution between two bounds."""

    uniform: Annotated[list[float], Len(2, 2), AfterValidator(ordered)]


class Normal(Record):
    """Normal distribution with a mean and a standard deviation."""

    normal: Annotated[list[float], Len(2, 2), AfterValidator(not_negative)]


class DiscreteChoice(Record):
    """One number of a list, all equally likely."""

    choice: Annotated[list[float], Len(1)]


def names_distribution(value: object) -> bool:
    return isinstance(value, dict) and not {"uniform", "normal", "choice"}.isdisjoint(value)


A_NUMBER = "must be a number, {uniform: [a, b]}, {normal: [mean, sd]} or {choice: [...]}"
OneNumber = float | Uniform | Normal | DiscreteChoice

AnyNumber = Annotated[OneNumber, OneOf(A_NUMBER)]


class Apiece(Record):
    """One draw for each attacked vehicle."""

    each: AnyNumber = Field(description="drawn for each attacked vehicle")


class Shared(Record):
    """One draw for all attacked vehicles."""

    shared: AnyNumber = Field(description="drawn once, for all attacked vehicles")


class Listed(Rooted[Annotated[list[AnyNumber], Len(1)]]):
    """One number for each attacked vehicle, in the order of `attack.vehicles`."""


class EachOrder(Rooted[Annotated[list[float], Len(1)]]):
    """One magnitude for each order of the received derivatives, lowest first."""


def as_rows(given: list[object]) -> list[object]:
    return [[each] if isinstance(each, float | int) else each for each in given]


Rows = Annotated[list[Annotated[list[float], Len(1)]], Len(1), BeforeValidator(as_rows)]


class Table(Rooted[Rows]):
    """Several numbers for each attacked vehicle, in the order of `attack.vehicles`."""


def as_places(given: list[object]) -> list[object]:
    """Pairs of coordinates; a number or distribution is a first coordinate, beside 0."""
    return [each if isinstance(each, list | tuple) else [each, 0.0] for each in given]


PlacePair = Annotated[list[AnyNumber], Len(2, 2)]
PlacePairs = Annotated[list[PlacePair], Len(1), BeforeValidator(as_places)]


class EachPosition(Rooted[PlacePairs]):
    """The position of each vehicle, in the order of their numbers: [x, y], or x alone on a line."""


class EachVehicle(Rooted[Annotated[list[AnyNumber], Len(1)]]):
    """The number of each vehicle, in the order of their numbers."""


GainLists = Annotated[list[Annotated[list[float], Len(1, 4)]], AfterValidator(equally_long)]
AxisPairs = Annotated[list[Annotated[list[float], Len(2, 2)]], Len(2, 2)]


class AxisGains(Rooted[Annotated[GainLists, Len(2, 2)]]):
    """Gains of each axis: two lists with a number for each order."""

    depth = 2

    def matrices(self) -> np.ndarray:
        """The diagonal matrix of each order, (r, 2, 2)."""
        return np.array(self.root).T[:, :, None] * np.eye(2)


class MatrixGains(Rooted[Annotated[list[AxisPairs], Len(1, 4)]]):
    """Gains that couple the axes: a 2 × 2 matrix for each order."""

    depth = 3

    def matrices(self) -> np.ndarray:
        """The matrix of each order, (r, 2, 2)."""
        return np.array(self.root)


class VehicleGains(Record):
    """Gains of each vehicle: a list for each, in the order of their numbers."""

    vehicles: Annotated[GainLists, Len(1)] = Field(
        description="k0, k1, … of each vehicle, with which it judges and follows what it hears"
    )

    def matrices(self) -> np.ndarray:
        """The diagonal matrix of each vehicle and order, (m, r, 2, 2)."""
        return np.array(self.vehicles)[:, :, None, None] * np.eye(2)


# Arrays while lanes are simulated, which a type checker cannot tell from what a config gives.
if TYPE_CHECKING:
    Number = Any  # a number or a distribution
    Magnitude = Any  # ā
    Magnitudes = Any  # one magnitude for all orders of the received derivatives, or one for each
    Several = Any  # several numbers for each attacked vehicle
    Positions = Any  # a number for all coordinates of all vehicles, or a position of each
    NumberOfEach = Any  # one number for all vehicles, or one of each
    PerVehicle = Any  # one number for all attacked vehicles, or one for each
    Gains = Any  # k0, k1, …: a list of numbers, or gains by axis, as matrices, or by vehicle
else:
    Number = AnyNumber
    Magnitude = Number | np.ndarray
    Magnitudes = Annotated[
        OneNumber | EachOrder, OneOf(f"{A_NUMBER}, or a list with one number for each order")
    ]
    Several = Annotated[
        OneNumber | Table, OneOf(f"{A_NUMBER}, or a list of lists, one for each attacked vehicle")
    ]
    Positions = Annotated[
        OneNumber | EachPosition, OneOf(f"{A_NUMBER}, or a list with x or [x, y] of each vehicle")
    ]
    NumberOfEach = Annotated[
        OneNumber | EachVehicle, OneOf(f"{A_NUMBER}, or a list with one of them for each vehicle")
    ]
    PerVehicle = Annotated[
        OneNumber | Apiece | Shared | Listed,
        OneOf(f"{A_NUMBER}, one of them in {{each: ...}} or {{shared: ...}}, or a list of them"),
    ]
    Gains = Annotated[
        Annotated[list[Number], Len(1, 4)] | AxisGains | MatrixGains | VehicleGains, OneOf()
    ]


Ranged = PerVehicle | NumberOfEach | EachOrder  # what has a least and a greatest value


def is_drawn(number: object) -> bool:
    return type(number) in (Uniform, Normal, DiscreteChoice)  # pydantic's isinstance is slow


def differs(number: object) -> bool:
    """Whether each vehicle has a number of its own."""
    return type(number) in (Apiece, Listed)


def zip_by_vehicle(*numbers: object) -> Iterator[tuple[Number, ...]]:
    """Several numbers vehicle by vehicle; a number that is not listed repeats."""
    longest = max((len(number.root) for number in numbers if isinstance(number, Listed)), default=1)
    return zip(*(n.root if isinstance(n, Listed) else [n] * longest for n in numbers), strict=False)


def value_range(number: Ranged) -> tuple[float, float]:
    """The least and the greatest value of a number or distribution."""
    match number:
        case Uniform(uniform=[low, high]):
            return low, high
        case Normal(normal=[mean, deviation]):
            return (mean, mean) if deviation == 0 else (-float("inf"), float("inf"))
        case DiscreteChoice(choice=values) | EachOrder(root=values):
            return min(values), max(values)
        case Apiece(each=inner) | Shared(shared=inner):
            return value_range(inner)
        case Listed(root=numbers) | EachVehicle(root=numbers):
            low, high = zip(*map(value_range, numbers), strict=True)
            return min(low), max(high)
    return number, number


def median(number: Number) -> float:
    match number:
        case Uniform(uniform=[low, high]):
            return (low + high) / 2
        case Normal(normal=[mean, _]):
            return mean
        case DiscreteChoice(choice=values):
            return statistics.median(values)
    return number


def mean(number: Number) -> float:
    match number:
        case DiscreteChoice(choice=values):
            return statistics.fmean(values)
    return median(number)


# For each limit: index of the bound to compare, comparison, words, keyword of the JSON schema.
LIMITS = {
    "gt": (0, operator.gt, "greater than", "exclusiveMinimum"),
    "ge": (0, operator.ge, "at least", "minimum"),
    "lt": (1, operator.lt, "less than", "exclusiveMaximum"),
    "le": (1, operator.le, "at most", "maximum"),
}


class Within:
    """Limits on a number and on all that a distribution can draw; keywords are those of `Field`."""

    def __init__(self, **limits: float):
        self.limits = limits

    def check(self, number: Ranged) -> Ranged:
        for name, limit in self.limits.items():
            bound, holds, words, _ = LIMITS[name]
            if not holds(value_range(number)[bound], limit):
                drawn = ", whatever is drawn" if is_drawn(number) else ""
                raise ValueError(f"must be {words} {limit:g}{drawn}")
        return number

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        return AfterValidator(self.check).__get_pydantic_core_schema__(source, handler)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Add the limits to the JSON schema, where they apply to numbers, not to distributions."""
        return handler(schema) | {LIMITS[name][3]: limit for name, limit in self.limits.items()}


class Each:
    """Mark of a number that each vehicle has for itself; a distribution is drawn for each."""


Positive = Annotated[Number, Within(gt=0.0)]
NotNegative = Annotated[Number, Within(ge=0.0)]
NotNegativeByOrder = Annotated[Magnitudes, Within(ge=0.0)]
NotNegativeOfEach = Annotated[NumberOfEach, Within(ge=0.0)]
PositivePerVehicle = Annotated[PerVehicle, Within(gt=0.0)]
Probability = Annotated[Number, Within(ge=0.0, le=1.0)]
Angle = Annotated[PerVehicle, Each(), Field(description="[rad]")]
Vector = Annotated[list[float], Len(2, 2)]
Amplitude = Annotated[list[Annotated[float, Field(ge=-1e6, le=1e6)]], Len(2, 2)]
Frequency = Annotated[list[Annotated[float, Field(ge=-100, le=100)]], Len(2, 2)]
FULL_TURN = Uniform(uniform=[0.0, 2 * PI])
