"""What a config may hold: every key with its type, unit, range and default (DESIGN, section 3).

The models know one key at a time; what several keys must fulfil together is in `checks`.
"""

import difflib
import json
import re
from typing import Annotated, Any, Literal

from annotated_types import Len
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag

PI = 3.141592653589793


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


def distribution(value: Any) -> str | None:
    """Which kind of number a value means to be."""
    if isinstance(value, BaseModel):
        return next(iter(type(value).model_fields))
    if not isinstance(value, dict):
        return "number"
    return next(iter(value)) if len(value) == 1 and next(iter(value)) in DISTRIBUTIONS else None


Number = Annotated[
    Annotated[float, Tag("number")]
    | Annotated[Uniform, Tag("uniform")]
    | Annotated[Normal, Tag("normal")]
    | Annotated[Choice, Tag("choice")],
    Discriminator(
        distribution,
        custom_error_type="distribution",
        custom_error_message="must be a number, {uniform: [a, b]}, {normal: [mean, sd]} or {choice: [...]}",
    ),
]


def least(number: Any) -> float:
    """The least value that a number or distribution takes."""
    match number:
        case Uniform():
            return number.uniform[0]
        case Normal():
            return number.normal[0] if number.normal[1] == 0 else -float("inf")
        case Choice():
            return min(number.choice)
    return number


def positive(number: Any) -> Any:
    """The number, if it is above zero whatever is drawn."""
    if not least(number) > 0:
        raise ValueError("must be positive, whatever is drawn")
    return number


def not_negative(number: Any) -> Any:
    """The number, if it is not below zero whatever is drawn."""
    if least(number) < 0:
        raise ValueError("must not be negative, whatever is drawn")
    return number


Positive = Annotated[Number, AfterValidator(positive)]
NotNegative = Annotated[Number, AfterValidator(not_negative)]
Angle = Annotated[Number, Field(description="[rad]")]
Vector = Annotated[list[float], Len(2, 2)]
FULL_TURN = Uniform(uniform=[0.0, 2 * PI])


# --- what comes in kinds -----------------------------------------------------------------------------


class Kind(Record):
    """One of several ways; `label` names it in tables."""

    label: str | None = None


class Star(Kind):
    """Every vehicle hears the navigator alone."""

    kind: Literal["star"] = "star"


class Cyclic(Kind):
    """A ring; every vehicle hears both its neighbours and the navigator."""

    kind: Literal["cyclic"] = "cyclic"
    navigator_weight: float = Field(0.1, gt=0, le=1)


class Path(Kind):
    """Vehicle 1 hears the navigator, vehicle i hears i - 1."""

    kind: Literal["path"] = "path"


class Figure1(Kind):
    """The paper's Fig. 1, five vehicles."""

    kind: Literal["figure1"] = "figure1"


Edge = Annotated[
    tuple[int, int, Annotated[float, Field(gt=0)]],
    Field(strict=False, description="[i, j, w]: i hears j (0 is the navigator) with weight w"),
]


class Edges(Kind):
    """Any weighted digraph; the weights of each listener are normalised to sum 1."""

    kind: Literal["edges"] = "edges"
    edges: Annotated[list[Edge], Len(1)]


class Lissajous(Kind):
    """`amplitude · sin(frequency · t + phase)` per axis."""

    kind: Literal["lissajous"] = "lissajous"
    amplitude: Vector = Field([100.0, 50.0], description="[m]")
    frequency: Vector = Field([0.2, 0.4], description="[rad/s]")
    phase: Vector = Field([0.0, 0.0], description="[rad]")


class NoAttack(Kind):
    """Nobody lies."""

    kind: Literal["none"] = "none"


Channel = Literal["auto", "neighbour", "navigator"]


class Attacked(Kind):
    """What the attacks share."""

    magnitude: NotNegative = Field(
        5.0, description="ā [m, m/s, m/s², m/s³], the bound on the signal and its three derivatives"
    )
    vehicles: list[int] = Field([2, 5, 8, 11], description="attacked vehicles, from 1")
    channel: Channel = Field(
        "auto",
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
    frequency: Number = Field(0.7, description="[rad/s]")
    phase: Angle = FULL_TURN


class Rotating(Attacked):
    """`[cos, sin](frequency · t + phase)`."""

    kind: Literal["rotating"] = "rotating"
    frequency: Number = Field(0.7, description="[rad/s]")
    phase: Angle = FULL_TURN


class NoDefence(Kind):
    """Everybody is believed."""

    kind: Literal["none"] = "none"


Theta = Annotated[int, Field(ge=0)]


def whole_or_each(value: Any) -> str:
    """Whether ϑ is one number or one for each vehicle."""
    return "each" if isinstance(value, dict) else "all"


class TrustedTrim(Kind):
    """Drop the ϑ untrusted neighbours farthest from the trusted ones."""

    kind: Literal["trusted_trim"] = "trusted_trim"
    theta: Annotated[
        Annotated[Theta, Tag("all")] | Annotated[dict[int, Theta], Tag("each")],
        Discriminator(whole_or_each),
    ] = Field(1, description="ϑ for all vehicles, or {vehicle: ϑ}, 0 for those not named")
    trusted: dict[int, list[int]] = Field(
        {}, description="{vehicle: [sources]} trusted besides the navigator"
    )
    tolerance: float = Field(1e-9, ge=0, description="[m], SCIENCE O8")


class Chassis(Kind):
    """The nonlinear robot, integrated adaptively."""

    kind: Literal["chassis"] = "chassis"
    solver: Literal["dopri5", "tsit5", "dopri8"] = "dopri5"
    rtol: float = Field(1e-7, gt=0, lt=1)
    atol: float = Field(1e-9, gt=0)
    max_steps: int = Field(100_000, ge=1)


KINDS: dict[str, tuple[type[Kind], ...]] = {
    "topology": (Star, Cyclic, Path, Figure1, Edges),
    "navigator": (Lissajous,),
    "attack": (NoAttack, Bias, Sinusoid, Rotating),
    "defence": (NoDefence, TrustedTrim),
    "engine": (Chassis,),
}


def kind_name(kind: type[Kind]) -> str:
    """What a kind is called in a config."""
    return kind.model_fields["kind"].default


# --- the whole ---------------------------------------------------------------------------------------


class Initial(Record):
    """Where the vehicles start; they start with ω = F = 0."""

    position: Number = Field(Uniform(uniform=[-200.0, 200.0]), description="[m], both axes")
    heading: Angle = Uniform(uniform=[-PI, PI])
    speed: Positive = Field(Uniform(uniform=[0.2, 0.4]), description="[m/s]")


class Scenario(Record):
    """What one cell is: everything that a lane depends on but its random draw."""

    vehicles: int = Field(12, ge=1)
    horizon: float = Field(30.0, gt=0, description="[s]")
    tick: float = Field(0.05, ge=0, description="[s]; 0: trimming in the vector field")
    output_step: float = Field(0.1, gt=0, description="[s]")
    tail: float = Field(5.0, ge=0, description="[s]; the last output times, that stand for t → ∞")
    topology: Annotated[Star | Cyclic | Path | Figure1 | Edges, Field(discriminator="kind")] = Cyclic()
    navigator: Lissajous = Lissajous()
    initial: Initial = Initial()
    gain: Annotated[list[float], Len(3, 3)] = Field([1.0, 3.0, 3.0], description="on ε, ε̇, ε̈")
    attack: Annotated[NoAttack | Bias | Sinusoid | Rotating, Field(discriminator="kind")] = Rotating()
    defence: Annotated[NoDefence | TrustedTrim, Field(discriminator="kind")] = TrustedTrim()
    engine: Chassis = Chassis()


class Linspace(Record):
    """n evenly spaced values."""

    linspace: Annotated[tuple[float, float, Annotated[int, Field(ge=1)]], Field(strict=False)]


class Geomspace(Record):
    """n values in constant ratio."""

    geomspace: Annotated[
        tuple[
            Annotated[float, Field(gt=0)],
            Annotated[float, Field(gt=0)],
            Annotated[int, Field(ge=1)],
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
        return next(iter(type(value).model_fields))
    if isinstance(value, dict):
        return next((key for key in ("samples", "worst") if key in value), None)
    return "word"


class Save(Record):
    """What is stored besides the rows."""

    errors: bool = False
    trajectories: Annotated[
        Annotated[Literal["none", "all"], Tag("word")]
        | Annotated[Samples, Tag("samples")]
        | Annotated[Worst, Tag("worst")],
        Discriminator(
            chosen_lanes,
            custom_error_type="lanes",
            custom_error_message="must be none, all, {samples: [...]} or {worst: K}",
        ),
    ] = "none"


def spacing(value: Any) -> str | None:
    """Which way swept values are given."""
    if isinstance(value, BaseModel):
        return next(iter(type(value).model_fields))
    if isinstance(value, dict):
        return next((key for key in ("linspace", "geomspace") if key in value), None)
    return "list" if isinstance(value, list) else None


Values = Annotated[
    Annotated[list[Any], Len(1), Tag("list")]
    | Annotated[Linspace, Tag("linspace")]
    | Annotated[Geomspace, Tag("geomspace")],
    Discriminator(
        spacing,
        custom_error_type="values",
        custom_error_message="must be a list, {linspace: [a, b, n]} or {geomspace: [a, b, n]}",
    ),
]


def plain_file_name(name: str) -> str:
    """The name, if it can name a folder anywhere."""
    if not re.fullmatch(r"\w[\w.-]{0,99}", name) or name.endswith("."):
        raise ValueError("must be a plain file name: letters, digits, '_', '-' and '.' inside")
    return name


Sweep = Annotated[
    dict[str, Values], Field(description="dotted key: values; cells are the product")
]


class Config(Scenario):
    """A whole study."""

    name: Annotated[str, AfterValidator(plain_file_name)]
    seed: int = Field(0, ge=0, lt=2**63)
    samples: int = Field(1, ge=1, description="lanes per cell")
    sweep: Sweep = {}
    save: Save = Save()


# --- what is said of a value that does not fit -------------------------------------------------------

WORDS = {
    "missing": "required",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be text",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "dict_type": "must be a mapping",
    "model_type": "must be a mapping",
    "model_attributes_type": "must be a mapping",
    "finite_number": "must be finite",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "too_short": "must have at least {min_length} entries",
    "too_long": "must have at most {max_length} entries",
    "value_error": "{error}",
    "literal_error": "must be {expected}",
}


def explain(error: Any) -> str:
    """What is wrong, in a user's words, from one of pydantic's errors."""
    kind, context = error["type"], error.get("ctx", {})
    if kind == "missing" and isinstance(error["loc"][-1], int):
        return "an entry is missing"
    if kind == "extra_forbidden":
        return "unknown key" + suggestion(str(error["loc"][-1]), known_keys(error["loc"]))
    message = WORDS[kind].format(**context) if kind in WORDS else error["msg"]
    if kind == "missing":
        return message
    if kind == "union_tag_invalid":
        allowed = [word.strip("'") for word in context["expected_tags"].split(", ")]
        hint = suggestion(str(context["tag"]), allowed, fallback=False)
        return f"must be one of {', '.join(allowed)} (got {shown(context['tag'])}){hint}"
    return f"{message} (got {shown(error['input'])})"


def shown(value: Any) -> str:
    """A value as a user may have written it, cut short if it is long."""
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."


def suggestion(word: str, known: list[str], fallback: bool = True) -> str:
    """The known word that was probably meant, or all that are known."""
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if near:
        return f"; did you mean '{near[0]}'?"
    return f"; known here: {', '.join(known)}" if fallback else ""


def known_keys(location: tuple[Any, ...]) -> list[str]:
    """Keys allowed in the mapping in which pydantic met an unknown one."""
    inside = [part for part in location[:-1] if isinstance(part, str)]
    if not inside:
        return list(Config.model_fields)
    models: dict[str, type[Record]] = {
        "initial": Initial,
        "save": Save,
        "samples": Samples,
        "worst": Worst,
        "linspace": Linspace,
        "geomspace": Geomspace,
    }
    models |= {field: kinds[0] for field, kinds in KINDS.items()}
    models |= {kind_name(kind): kind for kind in KINDS.get(inside[0], ())}
    return list(models[inside[-1]].model_fields)
