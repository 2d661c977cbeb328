"""Values that keys of a config take: numbers with their limits, and the distributions they may be drawn
from.
"""

import operator
import statistics
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Len
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    RootModel,
    Tag,
)

PI = 3.141592653589793

# A union's members are told apart by a word that no key of a user can be: pydantic puts it into the
# location of an error, from where `sweep.written` takes it out again.
MARK = "\0"


def union_member(name: str) -> Tag:
    """The mark of one member of a union."""
    return Tag(MARK + name)


class Record(BaseModel):
    """A mapping with known keys, that takes what it is given literally and is never changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def ordered(bounds: list[float]) -> list[float]:
    """The bounds, if the first is not above the second."""
    if bounds[0] > bounds[1]:
        raise ValueError("the lower bound stands first")
    return bounds


def not_negative(moments: list[float]) -> list[float]:
    """Mean and standard deviation, if the latter is not negative."""
    if moments[1] < 0:
        raise ValueError("a standard deviation is not negative")
    return moments


class Uniform(Record):
    """Uniform between two bounds."""

    uniform: Annotated[list[float], Len(2, 2), AfterValidator(ordered)]


class Normal(Record):
    """Normal with a mean and a standard deviation."""

    normal: Annotated[list[float], Len(2, 2), AfterValidator(not_negative)]


class DiscreteChoice(Record):
    """One of a list, all as likely."""

    choice: Annotated[list[float], Len(1)]


DISTRIBUTIONS = ("uniform", "normal", "choice")


def names_distribution(value: Any) -> bool:
    """Whether a value means to be a distribution."""
    return isinstance(value, dict) and any(name in value for name in DISTRIBUTIONS)


def number_tag(value: Any) -> str | None:
    """Which kind of number a value means to be."""
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


class Apiece(Record):
    """Drawn for each attacked vehicle."""

    each: Number = Field(description="drawn for each attacked vehicle")


class Shared(Record):
    """Drawn once, for all attacked vehicles."""

    shared: Number = Field(description="drawn once, for all attacked vehicles")


class Listed(RootModel[Annotated[list[Number], Len(1)]]):
    """A number for each attacked vehicle, in the order in which they are listed."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)


def as_rows(given: Any) -> Any:
    """Lists of lists; of numbers alone, each is a list."""
    return [[each] if isinstance(each, float | int) else each for each in given]


Rows = Annotated[list[Annotated[list[float], Len(1)]], Len(1), BeforeValidator(as_rows)]


class Table(RootModel[Rows]):
    """Several numbers for each attacked vehicle, in the order in which they are listed."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)


def table_tag(value: Any) -> str | None:
    """Whether numbers of vehicles are drawn, all from one distribution, or given in a table."""
    return MARK + "table" if isinstance(value, list | Table) else number_tag(value)


if TYPE_CHECKING:
    Several = Any  # numbers that each attacked vehicle has several of
else:
    Several = Annotated[
        Members | Annotated[Table, union_member("table")],
        Discriminator(
            table_tag,
            custom_error_type="distribution",
            custom_error_message=f"{A_NUMBER}, or a list of lists, one for each attacked vehicle",
        ),
    ]


def vehicle_number_tag(value: Any) -> str | None:
    """Which kind of number of vehicles a value means to be."""
    if isinstance(value, list):
        return MARK + "root"
    if isinstance(value, dict) and tuple(value) in (("each",), ("shared",)):
        return MARK + next(iter(value))
    return number_tag(value)


if TYPE_CHECKING:
    PerVehicle = Any  # a number that attacked vehicles share, or that each has for itself
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


def is_drawn(number: Any) -> bool:
    """Whether it is a distribution."""
    return isinstance(number, Uniform | Normal | DiscreteChoice)


def differs(number: Any) -> bool:
    """Whether vehicles have it each for itself, as the config says."""
    return isinstance(number, Apiece | Listed)


def zip_by_vehicle(*numbers: Any) -> Iterator[tuple[Any, ...]]:
    """Several numbers vehicle by vehicle: of lists one after the other, the others beside each."""
    longest = max((len(number.root) for number in numbers if isinstance(number, Listed)), default=1)
    return zip(*(n.root if isinstance(n, Listed) else [n] * longest for n in numbers), strict=False)


def value_range(number: Any) -> tuple[float, float]:
    """The least and the greatest value that a number or distribution takes."""
    match number:
        case Uniform(uniform=[low, high]):
            return low, high
        case Normal(normal=[mean, deviation]):
            return (mean, mean) if deviation == 0 else (-float("inf"), float("inf"))
        case DiscreteChoice(choice=values):
            return min(values), max(values)
        case Apiece(each=inner) | Shared(shared=inner):
            return value_range(inner)
        case Listed(root=numbers):
            low, high = zip(*map(value_range, numbers), strict=True)
            return min(low), max(high)
    return number, number


def median(number: Any) -> float:
    """The median of a distribution; a number itself."""
    match number:
        case Uniform(uniform=[low, high]):
            return (low + high) / 2
        case Normal(normal=[mean, _]):
            return mean
        case DiscreteChoice(choice=values):
            return statistics.median(values)
    return number


# Which of the bounds is compared, how, in what words, and the schema's keyword for it.
LIMITS = {
    "gt": (0, operator.gt, "greater than", "exclusiveMinimum"),
    "ge": (0, operator.ge, "at least", "minimum"),
    "lt": (1, operator.lt, "less than", "exclusiveMaximum"),
    "le": (1, operator.le, "at most", "maximum"),
}


class Within:
    """Limits on a number, or on whatever a distribution may draw, by the names that `Field` has."""

    def __init__(self, **limits: float):
        self.limits = limits

    def check(self, number: Any) -> Any:
        """The number, if it keeps the limits."""
        for name, limit in self.limits.items():
            bound, holds, words, _ = LIMITS[name]
            if not holds(value_range(number)[bound], limit):
                drawn = ", whatever is drawn" if is_drawn(number) else ""
                raise ValueError(f"must be {words} {limit:g}{drawn}")
        return number

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Validate by `check`."""
        return AfterValidator(self.check).__get_pydantic_core_schema__(source, handler)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> Any:
        """Tell editors the limits; JSON's apply to numbers alone."""
        return handler(schema) | {LIMITS[name][3]: limit for name, limit in self.limits.items()}


class Each:
    """The mark of a number that every vehicle has for itself: drawn for each, if it is drawn."""


Positive = Annotated[Number, Within(gt=0.0)]
NotNegative = Annotated[Number, Within(ge=0.0)]
PositivePerVehicle = Annotated[PerVehicle, Within(gt=0.0)]
Angle = Annotated[PerVehicle, Each(), Field(description="[rad]")]
Vector = Annotated[list[float], Len(2, 2)]
Amplitude = Annotated[list[Annotated[float, Field(ge=-1e6, le=1e6)]], Len(2, 2)]
Frequency = Annotated[list[Annotated[float, Field(ge=-100, le=100)]], Len(2, 2)]
FULL_TURN = Uniform(uniform=[0.0, 2 * PI])
