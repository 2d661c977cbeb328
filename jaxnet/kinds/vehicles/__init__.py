"""Vehicles that are flat with order r: r integrators per axis of the position (theorems.md O4).

The state (n, m, lanes) begins with the position x, y [m]. The state and the output's r jets (y, ẏ,
…) determine each other, and `y^(r) = σ + ψ u` for an input u with two components. A wheeled robot
has heading [rad] and speed [m/s] as next states, and is singular at speed 0. All formulas use the
array API, for NumPy and JAX.
"""

import math
from collections.abc import Sequence
from typing import ClassVar, Literal

from jaxnet.kinds.fields import Positive, setting
from jaxnet.kinds.kind import Fault, Kind, KindError, broken
from jaxnet.kinds.protocols import ScenarioView
from jaxnet.kinds.shapes import (
    AnyNumbers,
    AxisMatrices,
    InnerState,
    LaneNumbers,
    StackedJets,
    VehicleInput,
    VehicleJets,
    VehicleNumbers,
    VehicleState,
    VehicleVectors,
)
from jaxnet.model.circle import circle
from jaxnet.model.plane import dot

HEADING, SPEED = 2, 3
MOST_ORDER = 4  # of vehicles

# Distance of the outer of three Gauss–Legendre nodes on [0, 1] from the middle
GAUSS = math.sqrt(0.15)
# Shares of a step at which outputs are known
OUTPUT_PLACES = (0.0, 0.5 - GAUSS, 0.5, 0.5 + GAUSS, 1.0)


class Vehicle(Kind):
    """A vehicle model, of order three and singular at speed 0 unless a subclass says otherwise.

    A subclass gives every method except `start`, `margin` and `lead`. An `internal` one gives
    `inner`, `state_with` and `inner_after` instead of `state_of`.

    Examples
    --------
    >>> import jaxnet
    >>> vehicle = jaxnet.load({"vehicle": "two_wheeled"}).config.vehicle
    >>> dict(zip(vehicle.states, vehicle.units))
    {'x': 'm', 'y': 'm', 'heading': 'rad', 'speed': 'm/s', 'turn_rate': 'rad/s', 'force': 'm/s²'}
    """

    claims: ClassVar[frozenset[str]] = frozenset({"flat"})
    neutral: ClassVar[frozenset[str]] = Kind.neutral.union(
        ("order", "singular", "states", "units", "inputs", "input_units", "start", "drift", "pace")
    )
    # Whether `motion` with `inputs_for` gives the output any derivative asked
    flat: ClassVar[bool] = False
    order: ClassVar[int] = 3  # r, the number of integrators of an axis
    # k: ψ is singular where `lead` of y^(k) is 0, k = r - 1 or r - 2; 0: never
    singular: ClassVar[int] = 1
    internal: ClassVar[bool] = False  # whether the output's jets leave a part of the state open
    # Names; those of a wheeled robot begin with x, y, heading, speed
    states: ClassVar[tuple[str, ...]]
    units: ClassVar[tuple[str, ...]]
    inputs: ClassVar[tuple[str, str]] = ("u1", "u2")  # names
    input_units: ClassVar[tuple[str, str]] = ("", "")
    limitable: ClassVar[tuple[str, ...]] = ()  # names of limits; by default those of the inputs

    limits: dict[str, Positive] = setting(
        {}, "greatest absolute values of the vehicle's own inputs, by name: greater ones saturate"
    )

    standstill: Literal["fail", "stop"] = setting(
        "fail",
        "if a vehicle comes to rest and its law is singular there: fail, its lane fails; stop, it"
        " stands there for good, and the others go on",
    )

    def breaks(self):
        stops = self.standstill == "stop"
        return broken(flat=not self.flat or bool(self.limits) or stops)

    def faults(self, scenario):
        if lacking := [name for name in ("states", "units") if not hasattr(self, name)]:
            yield Fault(("vehicle",), f"{self.kind}: a vehicle gives {' and '.join(lacking)}")
        if not 1 <= self.order <= MOST_ORDER:
            message = f"an order of 1 to {MOST_ORDER} is possible (got {self.order})"
            yield Fault(("vehicle",), message)
        allowed = self.limitable or self.inputs
        if unknown := [name for name in self.limits if name not in allowed]:
            message = f"{self.kind} has limits of {', '.join(allowed)} (got {unknown[0]})"
            yield Fault(("vehicle.limits", "vehicle"), message)
        if self.standstill == "stop" and (why := self.never_stops(scenario)):
            yield Fault(("vehicle.standstill", "vehicle"), f"stop: {why}")

    def never_stops(self, scenario: ScenarioView) -> str:
        """Why vehicles cannot stop where they come to rest; "" if they can."""
        law, engine, formation = scenario.law, scenario.engine, scenario.formation
        if self.singular != 1 or self.internal or not law.singular_at_rest():
            return f"{self.kind} under law: {law.kind} is not singular at rest"
        if not engine.stops:
            return f"the {engine.kind} engine cannot: give engine: exact, nonlinear or sampled"
        if scenario.tick == 0:
            return "others learn at ticks that a vehicle stands: give a tick"
        if law.way() == "local" and not engine.samples:
            return f"others learn at ticks that a vehicle stands: give {law.kind} hold: true"
        if formation.moves:
            return "no vehicle stands in a formation that turns"
        return ""

    def start(
        self, position: VehicleVectors, heading: VehicleNumbers, speed: VehicleNumbers
    ) -> VehicleState:
        """The state (n, m, lanes) at t = 0 with this pose and speed; all other components are 0."""
        xp = position.__array_namespace__()
        rest = [xp.zeros_like(speed)] * (len(self.states) - 4)
        return xp.stack([position[0], position[1], heading, speed, *rest])

    def output_jets(self, state: VehicleState) -> VehicleJets:
        """Position [m], velocity [m/s], …, each (2, m, lanes), of a state: as many as the order."""
        raise KindError(f"{self.kind}: a vehicle gives output_jets(self, state)")

    def drift(self, state: VehicleState) -> VehicleVectors:
        """σ (2, m, lanes), the derivative of order r without input [m/s³ for r = 3]."""
        raise KindError(f"{self.kind}: a vehicle gives drift(self, state)")

    def decoupling(self, state: VehicleState) -> AxisMatrices:
        """ψ (2, 2, m, lanes) by axis and column, the matrix from the input to the jerk."""
        raise KindError(f"{self.kind}: a vehicle gives decoupling(self, state)")

    def inputs_for(self, state: VehicleState, jerk: VehicleVectors) -> VehicleInput:
        """The input `u = ψ⁻¹ (jerk - σ)` (2, m, lanes) for this derivative of order r."""
        raise KindError(f"{self.kind}: a vehicle gives inputs_for(self, state, jerk)")

    def within_limits(self, inputs: VehicleInput) -> VehicleInput:
        """The inputs (2, m, lanes), each saturated at its limit, if it has one."""
        xp = inputs.__array_namespace__()
        most = (self.limits.get(name) for name in self.inputs)
        each = zip(inputs, most, strict=True)
        return xp.stack([u if q is None else xp.clip(u, -q[None], q[None]) for u, q in each])

    def motion(self, state: VehicleState, inputs: VehicleInput) -> VehicleState:
        """The time derivative of the state, `ẋ = f(x, u)` (n, m, lanes)."""
        raise KindError(f"{self.kind}: a vehicle gives motion(self, state, inputs)")

    def state_of(self, jets: VehicleJets | StackedJets) -> VehicleState:
        """The state of a vehicle that moves forwards with these jets; undefined at rest."""
        raise KindError(f"{self.kind}: a vehicle gives state_of(self, jets)")

    def inner(self, state: VehicleState) -> InnerState:
        """The inner states (k, m, lanes), which the output's jets leave open."""
        raise KindError(f"{self.kind}: an internal vehicle gives inner(self, state)")

    def state_with(self, jets: VehicleJets, inner: InnerState) -> VehicleState:
        """The state of a vehicle with these output jets and inner states."""
        raise KindError(f"{self.kind}: an internal vehicle gives state_with(self, jets, inner)")

    def inner_after(
        self, inner: InnerState, jets: Sequence[VehicleJets], span: LaneNumbers
    ) -> tuple[InnerState, VehicleNumbers]:
        """The inner states a span [s] later, and an estimate (m, lanes) of their error.

        `jets` are those of the output at each of `OUTPUT_PLACES` in the span, up to the derivative
        of order r. The error shrinks with the fifth power of the span, at least.
        """
        gives = "inner_after(self, inner, jets, span)"
        raise KindError(f"{self.kind}: an internal vehicle gives {gives}")

    def pace(
        self, state: VehicleState, inputs: VehicleInput
    ) -> tuple[VehicleNumbers, VehicleNumbers]:
        """The speed [m/s] and the turn rate [rad/s], each (m, lanes), from state and inputs."""
        raise KindError(f"{self.kind}: a vehicle gives pace(self, state, inputs)")

    @property
    def jets_tell_pace(self) -> bool:
        """Whether the output's jets are enough for speed and turn rate, as of wheels at order 3."""
        return self.order > 2 and self.singular == 1

    @property
    def holds_drive(self) -> bool:
        """Whether `y^(r)` stays what the law asked for while the inputs are held."""
        return False

    @property
    def holds_velocity(self) -> bool:
        """Whether a held input holds the output's velocity."""
        return False

    def margin(self, state: VehicleState) -> VehicleNumbers:
        """The signed distance (m, lanes) from the singular set; ± the norm of `lead`."""
        return state[SPEED]

    def lead(self, derivative: VehicleVectors) -> VehicleVectors:
        """y^(k) plus a constant, for k = `singular`; ψ is singular where the sum is 0."""
        return derivative


class Integrators(Vehicle):
    """An agent of order r, `y^(r) = σ + u`, never singular. A subclass may give a drift σ.

    The state has the position first, then its derivatives below r. A subclass gives `order`, names
    and units.
    """

    flat = True
    singular = 0
    limitable = ("input",)

    @property
    def holds_drive(self):
        return type(self).drift is Integrators.drift

    @property
    def holds_velocity(self):
        return self.order == 1 and self.holds_drive

    def within_limits(self, inputs):
        """The inputs, saturated on each axis."""
        most = self.limits["input"][None, None]
        return inputs.__array_namespace__().clip(inputs, -most, most)

    def output_jets(self, state):
        return tuple(state[2 * k : 2 * k + 2] for k in range(self.order))

    def drift(self, state):
        return 0.0 * state[:2]

    def decoupling(self, state):
        one, zero = 0.0 * state[0] + 1.0, 0.0 * state[0]
        xp = state.__array_namespace__()
        return xp.stack([xp.stack([one, zero]), xp.stack([zero, one])])

    def inputs_for(self, state, jerk):
        return jerk - self.drift(state)

    def motion(self, state, inputs):
        return state.__array_namespace__().concatenate([state[2:], self.drift(state) + inputs])

    def state_of(self, jets):
        return jets[0].__array_namespace__().concatenate([*jets])


class Framed(Vehicle):
    """A vehicle with `ψ = [e, s f]`, e and f orthogonal unit vectors; singular where s is 0."""

    flat = True

    def frame(self, state: VehicleState) -> tuple[VehicleVectors, VehicleVectors]:
        """The unit vectors e and f, each (2, m, lanes)."""
        raise KindError(f"{self.kind}: a vehicle with a frame gives frame(self, state)")

    def sideways(self, state: VehicleState) -> AnyNumbers:
        """The factor s from the second input to the derivative of order r along f."""
        raise KindError(f"{self.kind}: a vehicle with a frame gives sideways(self, state)")

    def decoupling(self, state):
        ahead, aside = self.frame(state)
        columns = [ahead, self.sideways(state)[None] * aside]
        return state.__array_namespace__().stack(columns, axis=1)

    def inputs_for(self, state, jerk):
        """`[e' (q - σ), f' (q - σ) / s]` for the derivative q of order r; infinite at s = 0."""
        ahead, aside = self.frame(state)
        demand, xp = jerk - self.drift(state), state.__array_namespace__()
        return xp.stack([dot(ahead, demand), dot(aside, demand) / self.sideways(state)])


class Wheeled(Framed):
    """A vehicle with a heading: e points along it, f to the left; s is the speed by default."""

    def frame(self, state):
        return directions(state)

    def sideways(self, state):
        return state[SPEED]

    def drift(self, state):
        return 0.0 * state[:2]

    def moving(
        self, state: VehicleState, speed: VehicleNumbers, *rates: VehicleNumbers
    ) -> VehicleState:
        """The time derivative of a state: the velocity along the heading, then these rates."""
        along, _ = directions(state)
        return state.__array_namespace__().stack([*(speed[None] * along), *rates])


def directions(state: VehicleState) -> tuple[VehicleVectors, VehicleVectors]:
    """Unit vectors along the heading, `h = [cosθ, sinθ]`, and left of it, `n = [-sinθ, cosθ]`."""
    xp = state.__array_namespace__()
    cosine, sine = circle(state[HEADING])
    return xp.stack([cosine, sine]), xp.stack([-sine, cosine])
