"""The keys of a config, each with type, unit, range, default and meaning.

The lists of `docs/keys.md` are made from these models. A model checks one key at a time. The
kinds, and `faults`, check several keys together.
"""

import re
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Len
from pydantic import AfterValidator, Field, PrivateAttr

from jaxnet.config.sweep import keys_in
from jaxnet.engine.methods import Engine
from jaxnet.engine.methods.nonlinear import Nonlinear
from jaxnet.kinds import registry
from jaxnet.kinds.attacks import AnyAttack
from jaxnet.kinds.attacks.rotating import Rotating
from jaxnet.kinds.defences import AnyDefence
from jaxnet.kinds.defences.trusted_trim import TrustedTrim
from jaxnet.kinds.detectors import AnyDetector
from jaxnet.kinds.detectors.none import NoDetector
from jaxnet.kinds.fields import (
    PI,
    Gains,
    NotNegative,
    NotNegativeByOrder,
    NotNegativeOfEach,
    NumberOfEach,
    OneOf,
    Positions,
    Record,
    Rooted,
    Uniform,
    VehicleGains,
    is_drawn,
    ordered,
    value_range,
)
from jaxnet.kinds.filters import Filter
from jaxnet.kinds.filters.none import NoFilter
from jaxnet.kinds.formations import Formation
from jaxnet.kinds.formations.none import NoFormation
from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.graphs.cyclic import Cyclic
from jaxnet.kinds.laws import Law
from jaxnet.kinds.laws.exact import ExactLaw
from jaxnet.kinds.losses import Loss
from jaxnet.kinds.losses.none import NoLoss
from jaxnet.kinds.metrics import AGREEMENT, CONTRACT, Metric
from jaxnet.kinds.navigators import Navigator
from jaxnet.kinds.navigators.lissajous import Lissajous
from jaxnet.kinds.noises import ChannelNoise
from jaxnet.kinds.noises.gaussian import GaussianNoise
from jaxnet.kinds.registry import KindOf, MetricOf
from jaxnet.kinds.sensors import Sensor
from jaxnet.kinds.sensors.gaussian import Gaussian
from jaxnet.kinds.vehicles import Vehicle
from jaxnet.kinds.vehicles.two_wheeled import TwoWheeled

LARGEST_FLEET = 10_000
RANDOMISATIONS = 16  # independent scramblings of Sobol's sequence
KINDS = ("topology", "navigator", "vehicle", "attack", "defence")  # keys that take a kind
KINDS += ("law", "formation", "filter", "sensing", "detector", "engine")
INNER_KINDS = {  # families of deeper keys
    "attack.announces": "announcement",
    "channel.loss": "loss",
    "channel.noise": "noise",
    "detector.predicts": "observer",
}


class Initial(Record):
    """The initial position, heading and speed of the vehicles; turn rate and force are 0."""

    position: Positions = Field(
        default=Uniform(uniform=[-200.0, 200.0]),
        description="[m], of both axes, or a list of places: [x, y] of each vehicle, or x on a "
        "line",
    )
    heading: NumberOfEach = Field(
        default=Uniform(uniform=[-PI, PI]),
        description="[rad], from the first axis, or a list with the heading of each vehicle",
    )
    speed: NotNegativeOfEach = Field(
        default=Uniform(uniform=[0.2, 0.4]),
        description="[m/s], forwards, or a list with the speed of each vehicle",
    )


class Channel(Record):
    """What happens to messages on their way. Attacks act before the channel."""

    label: str | None = Field(default=None, description="its name in the tables of a sweep")
    loss: Annotated[Loss, KindOf("loss")] = Field(
        default=NoLoss(), title="lost messages", description="which messages are lost"
    )
    missing: Literal["drop", "hold", "extrapolate"] = Field(
        default="drop",
        title="in place of lost messages",
        description="what replaces a lost message: drop, nothing, and the other weights grow; "
        "hold, the last message; extrapolate, its motion, continued",
    )
    noise: Annotated[ChannelNoise, KindOf("noise", "gaussian")] = Field(
        default=GaussianNoise(),
        title="errors of messages",
        description="errors of the messages that arrive",
    )
    quantisation: NotNegativeByOrder = Field(
        default=0.0,
        title="rounding of messages",
        description="[m, m/s, …], step to which messages are rounded; 0: not rounded",
    )
    delay: NotNegative = Field(
        default=0.0,
        title="delay of messages",
        description="[s], delay of messages, a multiple of tick; drawn delays are rounded to ticks",
    )
    delay_of: Literal["link", "message"] = Field(
        default="link",
        title="a delay for each",
        description="whether a delay is drawn for each link of a lane, or for each message; the "
        "newest message counts",
    )
    own_delay: bool = Field(
        default=False,
        title="delay of one's own motion",
        description="whether a vehicle compares a delayed message with its own motion when it was "
        "sent, not with that of now",
    )
    extrapolate: Literal["none", "jets", "jerk"] = Field(
        default="none",
        title="correction of delayed messages",
        description="how a listener corrects a delayed message: none, not at all; jets, it "
        "continues the derivatives below the order; jerk, also the highest one",
    )

    @property
    def rounded(self) -> bool:
        return value_range(self.quantisation)[1] > 0

    @property
    def late(self) -> bool:
        return value_range(self.delay)[1] > 0


Count = Annotated[int, Field(ge=1, le=100_000)]
Above = Annotated[float, Field(gt=0)]


class Linspace(Record):
    """n evenly spaced values from a to b."""

    linspace: Annotated[tuple[float, float, Count], Field(strict=False)]


class Geomspace(Record):
    """n values from a to b with a constant ratio."""

    geomspace: Annotated[tuple[Above, Above, Count], Field(strict=False)]


class Samples(Record):
    """The lanes of the listed samples."""

    samples: list[Annotated[int, Field(ge=0)]]


class WorstLanes(Record):
    """The K lanes of each cell with the greatest final errors."""

    worst: int = Field(ge=1)


class ChosenVehicles(Record):
    """A number of vehicles, which a search chooses."""

    choose: int = Field(ge=1, description="how many")


Bounds = Annotated[list[float], Len(2, 2), AfterValidator(ordered)]


class BoundsByOrder(Rooted[list[Bounds]]):
    """Bounds of the gain of each order."""

    depth = 2


class EachIn(Record):
    """A number for each attacked vehicle."""

    each: Bounds = Field(description="the bounds, the same for all attacked vehicles")


class Criterion(Record):
    """The criterion that ends the sampling of a cell."""

    half_width: float = Field(gt=0, lt=0.5, description="half width of the interval of each cell")
    of: Literal["unrecovered"] = Field(
        default="unrecovered", description="the share whose interval it is"
    )
    confidence: float = Field(
        default=0.95, gt=0, lt=1, description="of all intervals of a cell together"
    )
    at_most: int = Field(default=100_000, ge=1, lt=2**32, description="most samples of a cell")


class Sequential(Record):
    """Samples until a criterion holds."""

    until: Criterion


SweptValues = Annotated[
    Annotated[list[Any], Len(1)] | Linspace | Geomspace,
    OneOf("must be a list, {linspace: [a, b, n]} or {geomspace: [a, b, n]}"),
]
SavedLanes = Annotated[
    Literal["none", "all"] | Samples | WorstLanes,
    OneOf("must be none, all, {samples: [...]} or {worst: K}"),
]
SearchRange = Annotated[
    Literal["each"] | Bounds | BoundsByOrder | EachIn | ChosenVehicles,
    OneOf("must be [a, b], each, {each: [a, b]}, a list of [a, b], or {choose: n}"),
]
SampleCount = Annotated[
    Annotated[int, Field(ge=1, lt=2**32)] | Sequential,
    OneOf("must be a whole number, or {until: {half_width: h}}"),
]


class Scenario(Record):
    """The keys of one cell: everything that determines a lane, except its random draw."""

    vehicles: int = Field(
        default=12,
        ge=1,
        le=LARGEST_FLEET,
        description="number of vehicles without the navigator; a network may set it",
    )
    horizon: float = Field(default=30.0, gt=0, le=1e5, description="[s], length of a lane")
    tick: float = Field(
        default=0.05,
        ge=0,
        description="[s], the communication period; 0: vehicles decide at every instant",
    )
    output_step: float = Field(
        default=0.1, gt=0, description="[s], time between outputs, a multiple of tick"
    )
    tail: float = Field(
        default=5.0,
        ge=0,
        description="[s], the last part of a lane, in which ultimate errors are measured",
    )
    topology: Annotated[Graph, KindOf("topology")] = Field(
        default=Cyclic(), description="who hears whom"
    )
    navigator: Annotated[Navigator, KindOf("navigator")] = Field(
        default=Lissajous(), description="the path to track"
    )
    vehicle: Annotated[Vehicle, KindOf("vehicle")] = Field(
        default=TwoWheeled(), description="the robot"
    )
    initial: Initial = Field(
        default=Initial(), description="where the vehicles start, before a formation moves them"
    )
    gain: Gains = Field(
        default=[1.0, 3.0, 3.0],
        description="k0, k1, … of the law for ε, ε̇, …, as many as the vehicle's order, by default "
        "[1], [1, 2], [1, 3, 3] or [1, 4, 6, 4]; or one of the other forms in model.md",
    )
    law: Annotated[Law, KindOf("law")] = Field(
        default=ExactLaw(), description="how the law is solved"
    )
    formation: Annotated[Formation, KindOf("formation")] = Field(
        default=NoFormation(), description="where each vehicle goes, relative to the others"
    )
    filter: Annotated[Filter, KindOf("filter")] = Field(
        default=NoFilter(), description="what keeps vehicles apart"
    )
    attack: Annotated[AnyAttack, KindOf("attack")] = Field(
        default=Rotating(), description="the false signal in messages"
    )
    defence: Annotated[AnyDefence, KindOf("defence")] = Field(
        default=TrustedTrim(),
        description="the rule by which a vehicle chooses the sources that it believes",
    )
    sensing: Annotated[Sensor, KindOf("sensing")] = Field(
        default=Gaussian(),
        title="sensor errors",
        description="errors of a vehicle that measures its own motion",
    )
    channel: Channel = Field(default=Channel(), description="loss, noise and delay of messages")
    detector: Annotated[AnyDetector, KindOf("detector")] = Field(
        default=NoDetector(), description="which messages raise an alarm, and what an alarm does"
    )
    engine: Annotated[Engine, KindOf("engine")] = Field(
        default=Nonlinear(), description="how lanes are computed"
    )
    metrics: list[Annotated[Metric, MetricOf("metrics")]] = Field(
        default=[],
        description="what rows measure besides what all do; without a navigator also spread and"
        " outside",
    )

    @property
    def gain_matrices(self) -> np.ndarray | None:
        """The gain as matrices, (r, 2, 2) or (m, r, 2, 2); None for a number for each order."""
        return None if isinstance(self.gain, list) else self.gain.matrices()

    @property
    def own_gains(self) -> np.ndarray | None:
        """The gains of each vehicle (m, r); None where all vehicles have the same."""
        return np.array(self.gain.vehicles) if isinstance(self.gain, VehicleGains) else None

    @property
    def order_of_gain(self) -> int:
        return len(self.gain) if self.gain_matrices is None else self.gain_matrices.shape[-3]

    @property
    def draws_gain(self) -> bool:
        return self.gain_matrices is None and any(map(is_drawn, self.gain))

    def measured(self) -> tuple[Metric, ...]:
        return (*CONTRACT, *self.metrics)

    @property
    def leaderless(self) -> bool:
        """Whether vehicles agree with one another alone, so that rows measure their agreement."""
        return not self.navigator.present and {*AGREEMENT} <= {
            metric.name for metric in self.metrics
        }

    @property
    def judged(self) -> str:
        """Name of the metric by which `recovery` judges a lane."""
        return "spread" if self.leaderless else "tail_mean"


class Save(Record):
    """Arrays that are stored beside the rows."""

    errors: bool = Field(
        default=False, description="ẽ and ε̃ of every lane over time, in errors.zarr"
    )
    vehicles: bool = Field(
        default=False,
        description="errors of every vehicle of every lane over the tail, in vehicles.zarr",
    )
    trajectories: SavedLanes = Field(
        default="none", description="lanes whose states are stored over time, in trajectories.zarr"
    )


def plain_file_name(name: str) -> str:
    """Return the name; raise ValueError if some file system cannot have a folder of this name."""
    if not re.fullmatch(r"\w[\w.-]{0,99}", name) or name.endswith("."):
        raise ValueError(
            "must be a plain file name: letters, digits, '_', '-' and '.' inside, at most 100"
        )
    return name


class Recovery(Record):
    """The criterion by which a lane has recovered from its attack."""

    tau: float = Field(
        default=0.01,
        gt=0,
        description="a lane with tail_mean > tau · ā has not recovered; without a navigator, one"
        " with spread > tau · ā",
    )
    of: Literal["magnitude", "amplitude"] = Field(
        default="magnitude",
        description="what tau multiplies: ā, or the amplitude in force, the greatest shift of a "
        "position",
    )
    worst: int = Field(default=3, ge=0, description="number of worst lanes that the report replays")


class SearchSettings(Record):
    """The keys that a search chooses, and how it searches for the worst choice."""

    over: Annotated[dict[str, SearchRange], Len(1)] = Field(
        description="dotted key: range of the search, in the forms of search.md; `jaxnet run` "
        "draws from these ranges"
    )
    maximise: str = Field(
        default="tail_max",
        description="a metric of rows, or unrecovered, the share of starts; without a navigator "
        "spread by default",
    )
    subject_to: dict[str, Annotated[float, Field(allow_inf_nan=False)]] = Field(
        default={},
        description="a metric of rows: its limit; a choice counts only if no start exceeds it",
    )
    may_exceed: float = Field(
        default=0.0,
        ge=0,
        lt=1,
        description="share of the starts that may exceed a limit; the mean is over the others",
    )
    budget: int = Field(
        default=20_000, ge=1, le=10**9, description="lanes of the search in each cell"
    )
    starts: int = Field(
        default=1,
        ge=1,
        le=10_000,
        description="number of starts from which each choice is tried; their mean counts",
    )
    until: float = Field(
        default=1000.0,
        gt=0,
        le=1e5,
        description="[s], time to which the best choices are run, at least the horizon; the "
        "worst of them then is the answer",
    )
    seed: int = Field(
        default=0,
        ge=0,
        lt=2**63,
        description="seed of the search; the study's seed draws the lanes",
    )


class Config(Scenario):
    """All keys of a study."""

    name: Annotated[str, AfterValidator(plain_file_name)] = Field(
        description="name of the study and of its results folder"
    )
    seed: int = Field(
        default=0,
        ge=0,
        lt=2**63,
        description="seed of all draws; a random graph that lanes share has its own",
    )
    samples: SampleCount = Field(default=1, description="lanes per cell")
    draws: Literal["random", "sobol"] = Field(
        default="random",
        description="random: independent draws; sobol: even samples, in 16 sequences that are "
        "scrambled independently",
    )
    recovery: Recovery | None = Field(default=None, description="when a lane counts as recovered")
    search: SearchSettings | None = Field(
        default=None, description="what jaxnet search chooses and maximises"
    )
    sweep: dict[str, SweptValues] = Field(
        default={}, description="dotted key, or keys with commas: values; cells are the product"
    )
    labels: dict[str, str] = Field(
        default={}, description="dotted key: the name of this key in figures, tables and pages"
    )
    save: Save = Field(default=Save(), description="what is stored besides the rows")

    _scope: registry.Scope = PrivateAttr(default_factory=registry.Scope)

    @property
    def swept(self) -> dict[str, str]:
        """The swept keys, and the key of the sweep that gives each its values."""
        return {key: written for written in self.sweep for key in keys_in(written)}

    @property
    def scope(self) -> registry.Scope:
        """What the names of kinds from outside mean in this study."""
        return self._scope

    def within(self, scope: registry.Scope) -> "Config":
        found = self.model_copy()
        found._scope = scope
        return found

    @property
    def most_samples(self) -> int:
        return self.samples.until.at_most if isinstance(self.samples, Sequential) else self.samples
