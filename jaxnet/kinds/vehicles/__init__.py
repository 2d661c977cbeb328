"""Vehicles that are flat with order three: three integrators for each axis of their position (SCIENCE O4).

A vehicle's state (n, m, lanes) begins with position x, y [m], heading [rad] and speed [m/s]. Off speed 0 the
output's jets (y, ẏ, ÿ) and the state are two descriptions of the same, and `y‴ = σ + ψ u` for an input u of
two. Everything is written against the array API.
"""

from typing import Any, ClassVar

from jaxnet.kinds.kind import Kind, KindError
from jaxnet.model.circle import circle

HEADING, SPEED = 2, 3


class Vehicle(Kind):
    """A vehicle of six states or so. One of one's own gives all but `start`; singular at speed 0."""

    states: ClassVar[tuple[str, ...]]  # names; the first four are x, y, heading, speed
    units: ClassVar[tuple[str, ...]]

    def start(self, position: Any, heading: Any, speed: Any) -> Any:
        """State (n, m, lanes) at t = 0 of vehicles that begin with this pose and speed and all else 0."""
        xp = position.__array_namespace__()
        rest = [xp.zeros_like(speed)] * (len(self.states) - 4)
        return xp.stack([position[0], position[1], heading, speed, *rest])

    def output_jets(self, state: Any) -> tuple[Any, Any, Any]:
        """Position, velocity and acceleration, each (2, m, lanes)."""
        raise KindError(f"{self.kind}: a vehicle gives output_jets(self, state)")

    def drift(self, state: Any) -> Any:
        """σ (2, m, lanes), the jerk that is there without input [m/s³]."""
        raise KindError(f"{self.kind}: a vehicle gives drift(self, state)")

    def decoupling(self, state: Any) -> Any:
        """ψ (2, 2, m, lanes) by axis and column, by which the input enters the jerk."""
        raise KindError(f"{self.kind}: a vehicle gives decoupling(self, state)")

    def inputs_for(self, state: Any, jerk: Any) -> Any:
        """`u = ψ⁻¹ (jerk - σ)` (2, m, lanes), the input that makes the output's jerk what is asked."""
        raise KindError(f"{self.kind}: a vehicle gives inputs_for(self, state, jerk)")

    def motion(self, state: Any, inputs: Any) -> Any:
        """`ẋ = f(x, u)` (n, m, lanes)."""
        raise KindError(f"{self.kind}: a vehicle gives motion(self, state, inputs)")

    def state_of(self, jets: Any) -> Any:
        """State with these output jets that moves forwards; undefined where the velocity is zero."""
        raise KindError(f"{self.kind}: a vehicle gives state_of(self, jets)")

    def pace(self, state: Any) -> tuple[Any, Any]:
        """Speed [m/s] and turn rate [rad/s], each (m, lanes)."""
        raise KindError(f"{self.kind}: a vehicle gives pace(self, state)")


def directions(state: Any) -> tuple[Any, Any]:
    """Unit vectors along the heading, `h = [cosθ, sinθ]`, and to its left, `n = [-sinθ, cosθ]`."""
    xp = state.__array_namespace__()
    cosine, sine = circle(state[HEADING])
    return xp.stack([cosine, sine]), xp.stack([-sine, cosine])
