"""Vehicles that are flat with order three: three integrators for each axis of the position (theorems.md O4).

A vehicle's state (n, m, lanes) begins with position x, y [m], heading [rad] and speed [m/s]. At nonzero speed
the state and the output's jets (y, ẏ, ÿ) determine each other, and `y‴ = σ + ψ u` for an input u with two
components. All formulas use the array API, for NumPy and JAX.
"""

from typing import ClassVar

from jaxnet.kinds.kind import Kind, KindError
from jaxnet.kinds.shapes import (
    AxisMatrices,
    StackedJets,
    VehicleInput,
    VehicleJets,
    VehicleNumbers,
    VehicleState,
    VehicleVectors,
)
from jaxnet.model.circle import circle

HEADING, SPEED = 2, 3


class Vehicle(Kind):
    """A vehicle model, singular at speed 0. A subclass gives every method except `start`.

    Examples
    --------
    >>> import jaxnet
    >>> vehicle = jaxnet.load({"vehicle": "two_wheeled"}).config.vehicle
    >>> dict(zip(vehicle.states, vehicle.units))
    {'x': 'm', 'y': 'm', 'heading': 'rad', 'speed': 'm/s', 'turn_rate': 'rad/s', 'force': 'm/s²'}
    """

    states: ClassVar[tuple[str, ...]]  # names; the first four are x, y, heading, speed
    units: ClassVar[tuple[str, ...]]
    inputs: ClassVar[tuple[str, str]] = ("u1", "u2")  # names
    input_units: ClassVar[tuple[str, str]] = ("", "")

    def start(self, position: VehicleVectors, heading: VehicleNumbers, speed: VehicleNumbers) -> VehicleState:
        """Return the state (n, m, lanes) at t = 0 with this pose and speed; all other components are 0."""
        xp = position.__array_namespace__()
        rest = [xp.zeros_like(speed)] * (len(self.states) - 4)
        return xp.stack([position[0], position[1], heading, speed, *rest])

    def output_jets(self, state: VehicleState) -> VehicleJets:
        """Return position [m], velocity [m/s] and acceleration [m/s²], each (2, m, lanes), of a state."""
        raise KindError(f"{self.kind}: a vehicle gives output_jets(self, state)")

    def drift(self, state: VehicleState) -> VehicleVectors:
        """Return σ (2, m, lanes), the jerk without input [m/s³]."""
        raise KindError(f"{self.kind}: a vehicle gives drift(self, state)")

    def decoupling(self, state: VehicleState) -> AxisMatrices:
        """Return ψ (2, 2, m, lanes) by axis and column, the matrix from the input to the jerk."""
        raise KindError(f"{self.kind}: a vehicle gives decoupling(self, state)")

    def inputs_for(self, state: VehicleState, jerk: VehicleVectors) -> VehicleInput:
        """Return the input `u = ψ⁻¹ (jerk - σ)` (2, m, lanes) that gives the output this jerk [m/s³]."""
        raise KindError(f"{self.kind}: a vehicle gives inputs_for(self, state, jerk)")

    def motion(self, state: VehicleState, inputs: VehicleInput) -> VehicleState:
        """Return the time derivative of the state, `ẋ = f(x, u)` (n, m, lanes)."""
        raise KindError(f"{self.kind}: a vehicle gives motion(self, state, inputs)")

    def state_of(self, jets: VehicleJets | StackedJets) -> VehicleState:
        """Return the state of a vehicle that moves forwards with these output jets; undefined at zero
        velocity.
        """
        raise KindError(f"{self.kind}: a vehicle gives state_of(self, jets)")

    def pace(self, state: VehicleState) -> tuple[VehicleNumbers, VehicleNumbers]:
        """Return the speed [m/s] and the turn rate [rad/s], each (m, lanes)."""
        raise KindError(f"{self.kind}: a vehicle gives pace(self, state)")


def directions(state: VehicleState) -> tuple[VehicleVectors, VehicleVectors]:
    """Return the unit vectors along the heading, `h = [cosθ, sinθ]`, and to its left, `n = [-sinθ, cosθ]`."""
    xp = state.__array_namespace__()
    cosine, sine = circle(state[HEADING])
    return xp.stack([cosine, sine]), xp.stack([-sine, cosine])
