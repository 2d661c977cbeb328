import functools
import math
from typing import Annotated, Any

import numpy as np
from annotated_types import Len
from jaxtyping import Float

from jaxnet.kinds.fields import Vector, setting
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.navigators import Navigator
from jaxnet.kinds.shapes import AnyTimes, PathJets
from jaxnet.model.circle import circle
from jaxnet.model.shapes import Numbers

GAUSS_LEGENDRE = np.polynomial.legendre.leggauss(8)
NODES, SHARES = (GAUSS_LEGENDRE[0] + 1) / 2, GAUSS_LEGENDRE[1] / 2
MOST_TURN = 0.5  # [rad] within a piece, over which the quadrature is exact to rounding
SPEED, TURN_RATE = slice(0, 4), slice(4, 8)  # coefficients; then heading, x, y

Pieces = tuple[Float[Any, "11 pieces *lanes"], Float[Any, "*lanes"] | float]


class Driven(Navigator):
    """A two-wheeled robot with given speed v(t) and turn rate ω(t): `ẏ_0 = v [cos θ, sin θ]`, `θ̇ =
    ω`.

    v and ω are cubic splines through values at equal distances in time, so that the inputs `Ḟ = v̈`
    and `T = ω̇` of the paper's robot are continuous, and the path has three continuous derivatives.
    The position is integrated by Gauss–Legendre quadrature, to rounding.
    """

    words = "driven robot"

    speed: Annotated[list[float], Len(2)] = setting(
        [20.0, 20.0], "[m/s], at the times 0, `every`, 2 `every`, …; below 0 backwards"
    )
    turn_rate: Annotated[list[float], Len(2)] = setting(
        [0.4, 0.4], "[rad/s], at the same times; above 0 to the left"
    )
    every: float = setting(60.0, "[s], from one value to the next", gt=0)
    position: Vector = setting([0.0, 0.0], "[m], at t = 0")
    heading: float = setting(0.0, "[rad], at t = 0, from the first axis")

    def pieces(self) -> Pieces:
        """The numbers of each piece of the path, and the duration of a piece [s]."""
        drawn = vars(self)
        if "table" in drawn:
            return drawn["table"], drawn["duration"]
        speed, turn_rate = tuple(self.speed), tuple(self.turn_rate)
        return pieces_of(speed, turn_rate, self.every, *self.position, self.heading)

    def drawn(self, draw, name):
        table, duration = map(draw.same, self.pieces())
        return self.filled({"table": np.moveaxis(table, 0, -1), "duration": duration})

    def jets(self, time):
        """The position by quadrature, and its derivatives from v, ω and their derivatives."""
        return jets_in(*self.pieces(), time)

    def faults(self, scenario):
        """A fault of lists of unequal lengths, or that end before the horizon."""
        speeds, turns = len(self.speed), len(self.turn_rate)
        end = self.every * (speeds - 1)
        if speeds != turns:
            message = f"must have as many values as speed, {speeds} (got {turns})"
            yield Fault(("navigator.turn_rate",), message)
        elif end < scenario.horizon:
            message = f"ends at {end:g} s, before the horizon of {scenario.horizon:g} s"
            yield Fault(("navigator.speed", "horizon"), f"{message}: give more values")
        else:
            yield from super().faults(scenario)


@functools.lru_cache
def pieces_of(
    speed: tuple[float, ...],
    turn_rate: tuple[float, ...],
    every: float,
    x: float,
    y: float,
    heading: float,
) -> Pieces:
    """The numbers of each piece, and the duration of a piece [s].

    The numbers are the coefficients of v and ω, and heading and position where the piece begins. A
    piece is a part of an interval between values, in which the robot turns by at most MOST_TURN.
    """
    from scipy.interpolate import CubicSpline

    intervals = len(speed) - 1
    splines = CubicSpline(every * np.arange(intervals + 1), np.stack([speed, turn_rate], axis=1))
    fastest = np.abs(splines(np.linspace(0.0, every * intervals, 16 * intervals + 1))[:, 1]).max()
    parts = max(1, math.ceil(every * fastest / MOST_TURN))
    duration = every / parts
    starts = duration * np.arange(parts * intervals)
    rows = [splines(starts, k) / math.factorial(k) for k in range(3)]
    rows.append(splines(starts + duration / 2, 3) / 6)  # which jumps from value to value
    table = np.zeros((11, len(starts)))
    table[:8] = np.stack(rows).transpose(2, 0, 1).reshape(8, -1)

    def accumulated(first: float, changes: np.ndarray) -> np.ndarray:
        return first + np.concatenate([[0.0], np.cumsum(changes[:-1])])

    table[8] = accumulated(heading, polynomial_jets(table[TURN_RATE], duration)[0])
    _, east, north = after(table, np.full(len(starts), duration))
    table[9:] = accumulated(x, east), accumulated(y, north)
    return table, duration


def polynomial_jets(coefficients: Any, time: Any) -> tuple[Any, Any, Any, Any]:
    """The integral from 0, the value and two derivatives of a cubic polynomial."""
    c0, c1, c2, c3 = coefficients
    value = c0 + time * (c1 + time * (c2 + time * c3))
    integral = time * (c0 + time * (c1 / 2 + time * (c2 / 3 + time * (c3 / 4))))
    return integral, value, c1 + time * (2 * c2 + time * (3 * c3)), 2 * c2 + 6 * c3 * time


def after(piece: Any, time: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """Heading, x and y a time [s] after the beginning of a piece."""
    x, y = piece[9], piece[10]
    for node, share in zip(NODES.tolist(), SHARES.tolist(), strict=True):
        turn, *_ = polynomial_jets(piece[TURN_RATE], node * time)
        _, speed, *_ = polynomial_jets(piece[SPEED], node * time)
        cosine, sine = circle(piece[8] + turn)
        x, y = x + share * time * speed * cosine, y + share * time * speed * sine
    return piece[8] + polynomial_jets(piece[TURN_RATE], time)[0], x, y


def jets_in(table: Any, duration: Any, time: AnyTimes) -> PathJets:
    """The jets at times within the pieces of a table (11, pieces, *lanes)."""
    xp = time.__array_namespace__()
    table, lanes = xp.asarray(table), table.shape[2:]
    duration = xp.asarray(duration).reshape(*[1] * (time.ndim - len(lanes)), *lanes)
    number = xp.clip(xp.floor(time / duration), 0, table.shape[1] - 1).astype(int)
    every = [xp.broadcast_to(xp.arange(lanes[0]), number.shape)] if lanes else []
    piece = table[(slice(None), number, *every)]
    since = time - number.astype(float) * duration
    heading, x, y = after(piece, since)
    _, v, acceleration, force_rate = polynomial_jets(piece[SPEED], since)
    _, turn, torque, _ = polynomial_jets(piece[TURN_RATE], since)
    cosine, sine = circle(heading)
    along, left = xp.stack([cosine, sine]), xp.stack([-sine, cosine])
    ahead, across = force_rate - v * turn**2, 2 * acceleration * turn + v * torque
    second = acceleration[None] * along + (v * turn)[None] * left
    third = ahead[None] * along + across[None] * left
    return xp.stack([xp.stack([x, y]), v[None] * along, second, third])
