"""Types of keys: numbers with limits, and the distributions from which numbers are drawn."""

import operator
import statistics
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from annotated_types import Len
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    RootModel,
    Tag,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import core_schema

PI = 3.141592653589793

# First character of the tags that identify members of a union. No key of a user has it. pydantic puts tags
# into the location of an error, and `config.cells.keys_of` removes them.
MARK = "\0"


def union_member(name: str) -> Tag:
    return Tag(MARK + name)


class Record(BaseModel):
    """A mapping with known keys. It converts no types, and it is frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


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


DISTRIBUTIONS = ("uniform", "normal", "choice")


def names_distribution(value: object) -> bool:
    return isinstance(value, dict) and any(name in value for name in DISTRIBUTIONS)


def number_tag(value: object) -> str | None:
    if isinstance(value, BaseModel):
        return MARK + next(iter(type(value).model_fields))
    if not isinstance(value, dict):
        return MARK + "number"
    names = list(value)
    return MARK + names[0] if len(names) == 1 and names[0] in DISTRIBUTIONS else None


A_NUMBER = "must be a number, {uniform: [a, b]}, {normal: [mean, sd]} or {choice: [...]}"

if TYPE_CHECKING:
    Number = Any  # a number or a distribution in a config; arrays while lanes are simulated
else:
    Members = (
        Annotated[float, union_member("number")]
        | Annotated[Uniform, union_member("uniform")]
        | Annotated[Normal, union_member("normal")]
        | Annotated[DiscreteChoice, union_member("choice")]
    )
    Number = Annotated[
        Members,
        Discriminator(number_tag, custom_error_type="distribution", custom_error_message=A_NUMBER),
    ]


if TYPE_CHECKING:
    Magnitude = (
        Any  # ā: a number or a distribution in a config; numbers of lanes while they are simulated
    )
else:
    Magnitude = Number | np.ndarray


class Apiece(Record):
    """One draw for each attacked vehicle."""

    each: Number = Field(description="drawn for each attacked vehicle")


class Shared(Record):
    """One draw for all attacked vehicles."""

    shared: Number = Field(description="drawn once, for all attacked vehicles")


class Listed(RootModel[Annotated[list[Number], Len(1)]]):
    """One number for each attacked vehicle, in the order of `attack.vehicles`."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)


class EachOrder(RootModel[Annotated[list[float], Len(1)]]):
    """One magnitude for each order of the received derivatives, lowest first."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)


def magnitudes_tag(value: object) -> str | None:
    return MARK + "root" if isinstance(value, list | EachOrder) else number_tag(value)


if TYPE_CHECKING:
    Magnitudes = Any  # one magnitude for all orders of the received derivatives, or one for each
else:
    Magnitudes = Annotated[
        Members | Annotated[EachOrder, union_member("root")],
        Discriminator(
            magnitudes_tag,
            custom_error_type="distribution",
            custom_error_message=f"{A_NUMBER}, or a list with one number for each order",
        ),
    ]


def as_rows(given: list[object]) -> list[object]:
    return [[each] if isinstance(each, float | int) else each for each in given]


Rows = Annotated[list[Annotated[list[float], Len(1)]], Len(1), BeforeValidator(as_rows)]


class Table(RootModel[Rows]):
    """Several numbers for each attacked vehicle, one list for each in the order of `attack.vehicles`."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)


def table_tag(value: object) -> str | None:
    return MARK + "table" if isinstance(value, list | Table) else number_tag(value)


if TYPE_CHECKING:
    Several = Any  # several numbers for each attacked vehicle
else:
    Several = Annotated[
        Members | Annotated[Table, union_member("table")],
        Discriminator(
            table_tag,
            custom_error_type="distribution",
            custom_error_message=f"{A_NUMBER}, or a list of lists, one for each attacked vehicle",
        ),
    ]


def as_places(given: list[object]) -> list[object]:
    return [each if isinstance(each, list | tuple) else [each, 0.0] for each in given]


def positions_tag(value: object) -> str | None:
    return MARK + "root" if isinstance(value, list | EachPosition) else number_tag(value)


PlacePairs = Annotated[list[Annotated[list[Number], Len(2, 2)]], Len(1), BeforeValidator(as_places)]


class EachPosition(RootModel[PlacePairs]):
    """The position of each vehicle, in the order of their numbers: [x, y], or x alone on a line."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)


if TYPE_CHECKING:
    Positions = Any  # a number for all coordinates of all vehicles, or a position of each
else:
    Positions = Annotated[
        Members | Annotated[EachPosition, union_member("root")],
        Discriminator(
            positions_tag,
            custom_error_type="distribution",
            custom_error_message=f"{A_NUMBER}, or a list with x or [x, y] of each vehicle",
        ),
    ]


class AxisGains(
    RootModel[
        Annotated[list[Annotated[list[float], Len(1, 4)]], Len(2, 2), AfterValidator(equally_long)]
    ]
):
    """Gains of each axis: two lists with a number for each order."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)

    def matrices(self) -> np.ndarray:
        """The diagonal matrix of each order, (r, 2, 2)."""
        return np.array(self.root).T[:, :, None] * np.eye(2)


class MatrixGains(
    RootModel[
        Annotated[list[Annotated[list[Annotated[list[float], Len(2, 2)]], Len(2, 2)]], Len(1, 4)]
    ]
):
    """Gains that couple the axes: a 2 × 2 matrix for each order."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)

    def matrices(self) -> np.ndarray:
        """The matrix of each order, (r, 2, 2)."""
        return np.array(self.root)


class VehicleGains(Record):
    """Gains of each vehicle: a list for each, in the order of their numbers."""

    vehicles: Annotated[
        list[Annotated[list[float], Len(1, 4)]], Len(1), AfterValidator(equally_long)
    ] = Field(
        description="k0, k1, … of each vehicle, with which it judges and follows what it hears"
    )

    def matrices(self) -> np.ndarray:
        """The diagonal matrix of each vehicle and order, (m, r, 2, 2)."""
        return np.array(self.vehicles)[:, :, None, None] * np.eye(2)


def gain_tag(value: object) -> str:
    """The tag of gains, by how deep the lists are."""
    if isinstance(value, AxisGains | MatrixGains | VehicleGains):
        return MARK + type(value).__name__
    if isinstance(value, dict):
        return MARK + "VehicleGains"
    depth = 0
    while isinstance(value, list) and value:
        value, depth = value[0], depth + 1
    return MARK + {2: "AxisGains", 3: "MatrixGains"}.get(depth, "list")


if TYPE_CHECKING:
    Gains = Any  # k0, k1, …: a list of numbers, or gains by axis, as matrices, or by vehicle
else:
    Gains = Annotated[
        Annotated[Annotated[list[Number], Len(1, 4)], union_member("list")]
        | Annotated[AxisGains, union_member("AxisGains")]
        | Annotated[MatrixGains, union_member("MatrixGains")]
        | Annotated[VehicleGains, union_member("VehicleGains")],
        Discriminator(gain_tag),
    ]


def vehicle_number_tag(value: object) -> str | None:
    if isinstance(value, list):
        return MARK + "root"
    if isinstance(value, dict) and tuple(value) in (("each",), ("shared",)):
        return MARK + next(iter(value))
    return number_tag(value)


if TYPE_CHECKING:
    PerVehicle = Any  # one number for all attacked vehicles, or one for each
else:
    PerVehicle = Annotated[
        Members
        | Annotated[Apiece, union_member("each")]
        | Annotated[Shared, union_member("shared")]
        | Annotated[Listed, union_member("root")],
        Discriminator(
            vehicle_number_tag,
            custom_error_type="distribution",
            custom_error_message=f"{A_NUMBER}, one of them in {{each: ...}} or {{shared: ...}},"
            " or a list of them",
        ),
    ]


def is_drawn(number: object) -> bool:
    return isinstance(number, Uniform | Normal | DiscreteChoice)


def differs(number: object) -> bool:
    """Whether each vehicle has a number of its own."""
    return isinstance(number, Apiece | Listed)


def zip_by_vehicle(*numbers: object) -> Iterator[tuple[Number, ...]]:
    longest = max((len(number.root) for number in numbers if isinstance(number, Listed)), default=1)
    return zip(*(n.root if isinstance(n, Listed) else [n] * longest for n in numbers), strict=False)


def value_range(number: PerVehicle | EachOrder) -> tuple[float, float]:
    match number:
        case Uniform(uniform=[low, high]):
            return low, high
        case Normal(normal=[mean, deviation]):
            return (mean, mean) if deviation == 0 else (-float("inf"), float("inf"))
        case DiscreteChoice(choice=values):
            return min(values), max(values)
        case Apiece(each=inner) | Shared(shared=inner):
            return value_range(inner)
        case EachOrder(root=numbers):
            return min(numbers), max(numbers)
        case Listed(root=numbers):
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


# For each limit: index of the bound to compare, comparison, words, keyword of the JSON schema.
LIMITS = {
    "gt": (0, operator.gt, "greater than", "exclusiveMinimum"),
    "ge": (0, operator.ge, "at least", "minimum"),
    "lt": (1, operator.lt, "less than", "exclusiveMaximum"),
    "le": (1, operator.le, "at most", "maximum"),
}


class Within:
    """Limits on a number, and on each value that a distribution can draw. Keywords are those of `Field`."""

    def __init__(self, **limits: float):
        self.limits = limits

    def check(self, number: PerVehicle | EachOrder) -> PerVehicle | EachOrder:
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
    """Mark of a number that every vehicle has for itself; a distribution is drawn for each vehicle."""


Positive = Annotated[Number, Within(gt=0.0)]
NotNegative = Annotated[Number, Within(ge=0.0)]
NotNegativeByOrder = Annotated[Magnitudes, Within(ge=0.0)]
PositivePerVehicle = Annotated[PerVehicle, Within(gt=0.0)]
Angle = Annotated[PerVehicle, Each(), Field(description="[rad]")]
Vector = Annotated[list[float], Len(2, 2)]
Amplitude = Annotated[list[Annotated[float, Field(ge=-1e6, le=1e6)]], Len(2, 2)]
Frequency = Annotated[list[Annotated[float, Field(ge=-100, le=100)]], Len(2, 2)]
FULL_TURN = Uniform(uniform=[0.0, 2 * PI])
