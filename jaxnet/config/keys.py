"""What a config may hold: every key with its type, unit, range and default (DESIGN, section 3).

The models know one key at a time; what several keys must fulfil together is in `checks`.
"""

import operator
import re
import statistics
from typing import Annotated, Any, Literal

from annotated_types import Len
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag

PI = 3.141592653589793

# A union's members are told apart by a word that no key of a user can be: pydantic puts it into the
# location of an error, from where `sweep.written` takes it out again.
MARK = "\0"


def member(name: str) -> Tag:
    """The mark of one member of a union."""
    return Tag(MARK + name)


class Record(BaseModel):
    """A mapping with known keys, that takes what it is given literally and is never changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


# --- numbers, or what they are drawn from ------------------------------------------------------------


def ordered(bounds: list[float]) -> list[float]:
    """The bounds, if the first is not above the second."""
    if bounds[0] > bounds[1]:
        raise ValueError("the lower bound stands first")
    return bounds


def spread(moments: list[float]) -> list[float]:
    """Mean and standard deviation, if the latter is not negative."""
    if moments[1] < 0:
        raise ValueError("a standard deviation is not negative")
    return moments


class Uniform(Record):
    """Uniform between two bounds."""

    uniform: Annotated[list[float], Len(2, 2), AfterValidator(ordered)]


class Normal(Record):
    """Normal with a mean and a standard deviation."""

    normal: Annotated[list[float], Len(2, 2), AfterValidator(spread)]


class Choice(Record):
    """One of a list, all as likely."""

    choice: Annotated[list[float], Len(1)]


DISTRIBUTIONS = ("uniform", "normal", "choice")


def names_distribution(value: Any) -> bool:
    """Whether a value means to be a distribution."""
    return isinstance(value, dict) and any(name in value for name in DISTRIBUTIONS)


def distribution(value: Any) -> str | None:
    """Which kind of number a value means to be."""
    if isinstance(value, BaseModel):
        return MARK + next(iter(type(value).model_fields))
    if not isinstance(value, dict):
        return MARK + "number"
    names = list(value)
    return MARK + names[0] if len(names) == 1 and names[0] in DISTRIBUTIONS else None


Number = Annotated[
    Annotated[float, member("number")]
    | Annotated[Uniform, member("uniform")]
    | Annotated[Normal, member("normal")]
    | Annotated[Choice, member("choice")],
    Discriminator(
        distribution,
        custom_error_type="distribution",
        custom_error_message="must be a number, {uniform: [a, b]}, {normal: [mean, sd]} or {choice: [...]}",
    ),
]


def is_drawn(number: Any) -> bool:
    """Whether it is a distribution."""
    return isinstance(number, Uniform | Normal | Choice)


def bounds(number: Any) -> tuple[float, float]:
    """The least and the greatest value that a number or distribution takes."""
    match number:
        case Uniform(uniform=[low, high]):
            return low, high
        case Normal(normal=[mean, deviation]):
            return (mean, mean) if deviation == 0 else (-float("inf"), float("inf"))
        case Choice(choice=values):
            return min(values), max(values)
    return number, number


def median(number: Any) -> float:
    """The median of a distribution; a number itself."""
    match number:
        case Uniform(uniform=[low, high]):
            return (low + high) / 2
        case Normal(normal=[mean, _]):
            return mean
        case Choice(choice=values):
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
            if not holds(bounds(number)[bound], limit):
                drawn = ", whatever is drawn" if is_drawn(number) else ""
                raise ValueError(f"must be {words} {limit:g}{drawn}")
        return number

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Validate by `check`."""
        return AfterValidator(self.check).__get_pydantic_core_schema__(source, handler)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> Any:
        """Tell editors the limits; JSON's apply to numbers alone."""
        return handler(schema) | {LIMITS[name][3]: limit for name, limit in self.limits.items()}


Positive = Annotated[Number, Within(gt=0.0)]
NotNegative = Annotated[Number, Within(ge=0.0)]
Angle = Annotated[Number, Field(description="[rad]")]
Vector = Annotated[list[float], Len(2, 2)]
Amplitude = Annotated[list[Annotated[float, Field(ge=-1e6, le=1e6)]], Len(2, 2)]
Frequency = Annotated[list[Annotated[float, Field(ge=-100, le=100)]], Len(2, 2)]
FULL_TURN = Uniform(uniform=[0.0, 2 * PI])


# --- what comes in kinds -----------------------------------------------------------------------------


class Kind(Record):
    """One of several ways; `label` names it in tables."""

    label: str | None = None


class Star(Kind):
    """Every vehicle hears the navigator alone."""

    kind: Literal["star"] = "star"


def leaves_neighbours(weight: Any) -> Any:
    """The navigator's weight, if everybody hears the same sources whatever is drawn."""
    if is_drawn(weight) and bounds(weight)[1] >= 1:
        raise ValueError("must be less than 1 where it is drawn: at 1 nobody hears a neighbour")
    return weight


class Cyclic(Kind):
    """A ring; every vehicle hears both its neighbours and the navigator."""

    kind: Literal["cyclic"] = "cyclic"
    navigator_weight: Annotated[Number, Within(gt=0.0, le=1.0), AfterValidator(leaves_neighbours)] = 0.1


class Path(Kind):
    """Vehicle 1 hears the navigator, vehicle i hears i - 1."""

    kind: Literal["path"] = "path"


class Figure1(Kind):
    """The paper's Fig. 1, five vehicles."""

    kind: Literal["figure1"] = "figure1"


Edge = Annotated[
    tuple[int, int, Annotated[Number, Within(gt=0.0, le=1e9)]],
    Field(strict=False, description="[i, j, w]: i hears j (0 is the navigator) with weight w"),
]


class Edges(Kind):
    """Any weighted digraph; the weights of each listener are normalised to sum 1."""

    kind: Literal["edges"] = "edges"
    edges: Annotated[list[Edge], Len(1)]


class Lissajous(Kind):
    """`amplitude · sin(frequency · t + phase)` per axis."""

    kind: Literal["lissajous"] = "lissajous"
    amplitude: Amplitude = Field(default=[100.0, 50.0], description="[m]")
    frequency: Frequency = Field(default=[0.2, 0.4], description="[rad/s]")
    phase: Vector = Field(default=[0.0, 0.0], description="[rad]")


class NoAttack(Kind):
    """Nobody lies."""

    kind: Literal["none"] = "none"


Channel = Literal["auto", "neighbour", "navigator"]


class Attacked(Kind):
    """What the attacks share."""

    magnitude: NotNegative = Field(
        default=5.0, description="ā [m, m/s, m/s², m/s³], the bound on the signal and its three derivatives"
    )
    vehicles: list[int] = Field(default=[2, 5, 8, 11], description="attacked vehicles, from 1")
    channel: Channel = Field(
        default="auto",
        description="neighbour: what they transmit; navigator: what they hear from 0; "
        "auto: navigator where no vehicle hears another",
    )


class Bias(Attacked):
    """A constant offset."""

    kind: Literal["bias"] = "bias"
    direction: Angle = 0.0


class Sinusoid(Attacked):
    """`sin(frequency · t + phase)` along a direction."""

    kind: Literal["sinusoid"] = "sinusoid"
    direction: Angle = 0.0
    frequency: Number = Field(default=0.7, description="[rad/s]")
    phase: Angle = FULL_TURN


class Rotating(Attacked):
    """`[cos, sin](frequency · t + phase)`."""

    kind: Literal["rotating"] = "rotating"
    frequency: Number = Field(default=0.7, description="[rad/s]")
    phase: Angle = FULL_TURN


class NoDefence(Kind):
    """Everybody is believed."""

    kind: Literal["none"] = "none"


Theta = Annotated[int, Field(ge=0, le=10_000)]


def whole_or_each(value: Any) -> str:
    """Whether ϑ means to be one number or one for each vehicle."""
    each = isinstance(value, dict) and not names_distribution(value)
    return MARK + ("each" if each else "all")


class TrustedTrim(Kind):
    """Drop the ϑ untrusted neighbours farthest from the trusted ones."""

    kind: Literal["trusted_trim"] = "trusted_trim"
    theta: Annotated[
        Annotated[Theta, member("all")] | Annotated[dict[int, Theta], member("each")],
        Discriminator(whole_or_each),
    ] = Field(default=1, description="ϑ for all vehicles, or {vehicle: ϑ}, 0 for those not named")
    trusted: dict[int, list[int]] = Field(
        default={}, description="{vehicle: [sources]} trusted besides the navigator"
    )
    tolerance: NotNegative = Field(default=1e-9, description="[m], SCIENCE O8")


class Chassis(Kind):
    """The nonlinear robot, integrated adaptively."""

    kind: Literal["chassis"] = "chassis"
    solver: Literal["dopri5", "tsit5", "dopri8"] = "dopri5"
    rtol: Annotated[Number, Within(gt=0.0, lt=1.0)] = 1e-7
    atol: Positive = 1e-9
    max_steps: int = Field(default=100_000, ge=1, le=10**15)


class Flat(Kind):
    """The closed loop solved exactly from tick to tick."""

    kind: Literal["flat"] = "flat"


KINDS: dict[str, tuple[type[Kind], ...]] = {
    "topology": (Star, Cyclic, Path, Figure1, Edges),
    "navigator": (Lissajous,),
    "attack": (NoAttack, Bias, Sinusoid, Rotating),
    "defence": (NoDefence, TrustedTrim),
    "engine": (Chassis, Flat),
}


def kind_name(kind: type[Kind]) -> str:
    """What a kind is called in a config."""
    return kind.model_fields["kind"].default


# --- the whole ---------------------------------------------------------------------------------------


class Initial(Record):
    """Where the vehicles start; they start with ω = F = 0."""

    position: Number = Field(default=Uniform(uniform=[-200.0, 200.0]), description="[m], both axes")
    heading: Angle = Uniform(uniform=[-PI, PI])
    speed: Positive = Field(default=Uniform(uniform=[0.2, 0.4]), description="[m/s]")


def kind_of(value: Any) -> str | None:
    """The kind that a mapping names."""
    name = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    return MARK + name if isinstance(name, str) else None


BY_KIND = Discriminator(kind_of, custom_error_type="kind", custom_error_message="must name a kind")
Topology = Annotated[
    Annotated[Star, member("star")]
    | Annotated[Cyclic, member("cyclic")]
    | Annotated[Path, member("path")]
    | Annotated[Figure1, member("figure1")]
    | Annotated[Edges, member("edges")],
    BY_KIND,
]
Attack = Annotated[
    Annotated[NoAttack, member("none")]
    | Annotated[Bias, member("bias")]
    | Annotated[Sinusoid, member("sinusoid")]
    | Annotated[Rotating, member("rotating")],
    BY_KIND,
]
Defence = Annotated[
    Annotated[NoDefence, member("none")] | Annotated[TrustedTrim, member("trusted_trim")], BY_KIND
]

Engine = Annotated[Annotated[Chassis, member("chassis")] | Annotated[Flat, member("flat")], BY_KIND]


class Scenario(Record):
    """What one cell is: everything that a lane depends on but its random draw."""

    vehicles: int = Field(default=12, ge=1, le=10_000)
    horizon: float = Field(default=30.0, gt=0, le=1e5, description="[s]")
    tick: float = Field(default=0.05, ge=0, description="[s]; 0: trimming in the vector field")
    output_step: float = Field(default=0.1, gt=0, description="[s]")
    tail: float = Field(default=5.0, ge=0, description="[s]; the last output times, that stand for t → ∞")
    topology: Topology = Cyclic()
    navigator: Lissajous = Lissajous()
    initial: Initial = Initial()
    gain: Annotated[list[Number], Len(3, 3)] = Field(default=[1.0, 3.0, 3.0], description="on ε, ε̇, ε̈")
    attack: Attack = Rotating()
    defence: Defence = TrustedTrim()
    engine: Engine = Chassis()


class Linspace(Record):
    """n evenly spaced values."""

    linspace: Annotated[tuple[float, float, Annotated[int, Field(ge=1, le=100_000)]], Field(strict=False)]


class Geomspace(Record):
    """n values in constant ratio."""

    geomspace: Annotated[
        tuple[
            Annotated[float, Field(gt=0)],
            Annotated[float, Field(gt=0)],
            Annotated[int, Field(ge=1, le=100_000)],
        ],
        Field(strict=False),
    ]


class Samples(Record):
    """Lanes of these samples."""

    samples: list[Annotated[int, Field(ge=0)]]


class Worst(Record):
    """The K lanes of each cell that end farthest off."""

    worst: int = Field(ge=1)


def chosen_lanes(value: Any) -> str | None:
    """Which way lanes are chosen for their trajectories."""
    if isinstance(value, BaseModel):
        return MARK + next(iter(type(value).model_fields))
    if isinstance(value, dict):
        return next((MARK + key for key in ("samples", "worst") if key in value), None)
    return MARK + "word" if value in ("none", "all") else None


class Save(Record):
    """What is stored besides the rows."""

    errors: bool = False
    trajectories: Annotated[
        Annotated[Literal["none", "all"], member("word")]
        | Annotated[Samples, member("samples")]
        | Annotated[Worst, member("worst")],
        Discriminator(
            chosen_lanes,
            custom_error_type="lanes",
            custom_error_message="must be none, all, {samples: [...]} or {worst: K}",
        ),
    ] = "none"


def spacing(value: Any) -> str | None:
    """Which way swept values are given."""
    if isinstance(value, BaseModel):
        return MARK + next(iter(type(value).model_fields))
    if isinstance(value, dict):
        return next((MARK + key for key in ("linspace", "geomspace") if key in value), None)
    return MARK + "list" if isinstance(value, list) else None


Values = Annotated[
    Annotated[list[Any], Len(1), member("list")]
    | Annotated[Linspace, member("linspace")]
    | Annotated[Geomspace, member("geomspace")],
    Discriminator(
        spacing,
        custom_error_type="values",
        custom_error_message="must be a list, {linspace: [a, b, n]} or {geomspace: [a, b, n]}",
    ),
]


def plain_file_name(name: str) -> str:
    """The name, if it can name a folder anywhere."""
    if not re.fullmatch(r"\w[\w.-]{0,99}", name) or name.endswith("."):
        raise ValueError("must be a plain file name: letters, digits, '_', '-' and '.' inside, at most 100")
    return name


class Recovery(Record):
    """When a lane counts as saved by its defence."""

    tau: float = Field(default=0.01, gt=0, description="a lane with tail_mean > tau · ā has not recovered")
    worst: int = Field(default=3, ge=0, description="lanes of the study that the report replays, the worst")


class Criterion(Record):
    """When enough lanes were simulated."""

    half_width: float = Field(gt=0, lt=0.5, description="of the widest interval over the cells")
    of: Literal["unrecovered"] = "unrecovered"
    confidence: float = Field(default=0.95, gt=0, lt=1)
    at_most: int = Field(default=100_000, ge=1, lt=2**32, description="samples")


class Sequential(Record):
    """As many lanes as it takes."""

    until: Criterion


def samples_given(value: Any) -> str:
    """Whether a number of samples or a criterion is given."""
    return MARK + ("sequential" if isinstance(value, dict | Sequential) else "number")


Sweep = Annotated[dict[str, Values], Field(description="dotted key: values; cells are the product")]


class Config(Scenario):
    """A whole study."""

    name: Annotated[str, AfterValidator(plain_file_name)]
    seed: int = Field(default=0, ge=0, lt=2**63)
    samples: Annotated[
        Annotated[int, Field(ge=1, lt=2**32), member("number")] | Annotated[Sequential, member("sequential")],
        Discriminator(samples_given),
    ] = Field(default=1, description="lanes per cell")
    recovery: Recovery | None = None
    sweep: Sweep = {}
    save: Save = Save()

    @property
    def most_samples(self) -> int:
        """How many samples it takes at most."""
        return self.samples.until.at_most if isinstance(self.samples, Sequential) else self.samples
