import math
from typing import Annotated

import numpy as np
from pydantic import Field

from jaxnet.kinds.attacks import AnyAttack, Attack
from jaxnet.kinds.fields import PerVehicle, PositivePerVehicle, setting, value_range, zip_by_vehicle
from jaxnet.kinds.kind import Fault
from jaxnet.kinds.registry import KindOf
from jaxnet.kinds.shapes import AnyNumbers, AnyTimes, NumberJets
from jaxnet.model.signal import up_to

TIME_ROUNDING = 1e-12  # relative rounding of sums of times
PIECES = 256  # pieces of the rise, each with its own bound on the envelope


class Envelope(Attack):
    """Another attack's signal times a smooth envelope.

    The envelope rises from 0 to 1 in `rise` seconds after `start`, and falls again after `stop` if
    that is given. It is three times continuously differentiable, and four times for vehicles of
    order 4. Magnitude, vehicles, links and threat are keys of the envelope, not of the other
    attack.
    """

    highest = 4

    of: Annotated[AnyAttack, KindOf("attack"), Field(description="the other attack")]
    start: PerVehicle = setting(0.0, "[s], when it begins to rise")
    rise: PositivePerVehicle = setting(5.0, "[s], how long it rises, and falls")
    stop: PerVehicle | None = setting(None, "[s], when it begins to fall")

    def of_order(self, order):
        found = super().of_order(order)
        return found if found is self else found.with_values(of=self.of.of_order(order))

    def consistent(self):
        """Whether the attack inside is consistent too, as Leibniz's rule presupposes."""
        return super().consistent() and self.of.consistent()

    def height(self, time: AnyTimes) -> NumberJets:
        """The envelope and its derivatives that vehicles hear: (derivatives, lanes)."""
        up = smooth_rise((time - self.start) / self.rise, self.rise, self.told_order)
        if self.stop is None:
            return up
        return up - smooth_rise((time - self.stop) / self.rise, self.rise, self.told_order)

    def basis(self, time):
        """The functions by Leibniz's rule: `(e β)^(k) = Σ_j C(k, j) e^(j) β^(k-j)`."""
        height = self.height(time)[:, None]
        inner, orders = up_to(self.told_order, self.of.signal().basis, time), len(height)
        return time.__array_namespace__().stack(
            [sum(c * height[j] * inner[k - j] for j, c in leibniz(k)) for k in range(orders)]
        )

    def vectors(self):
        return self.of.vectors()

    def sizes(self, horizon):
        """`Σ_j C(k, j) |e^(j)| ‖β^(k-j)‖`, the maximum over PIECES of the rise with bounds on e."""
        inner, orders = np.asarray(self.of.sizes(horizon)), np.arange(self.told_order + 1.0)
        rise = np.power.outer(np.asarray(self.rise), orders).T[:, None]
        height = RISE_BOUNDS[self.told_order][:, :, None] / rise
        terms = [[c * height[j] * inner[k - j] for j, c in leibniz(k)] for k in range(len(orders))]
        return np.stack([np.sum(each, axis=0).max(axis=0) for each in terms])

    def faults(self, scenario):
        yield from super().faults(scenario)
        inner, keys = self.of, ("attack.of", "attack")
        for key, field in Attack.model_fields.items() if inner.present else ():
            if key != "label" and getattr(inner, key, None) != field.default:
                yield Fault((f"attack.of.{key}", *keys), f"belongs outside: give attack.{key}")
        times = [] if self.stop is None else zip_by_vehicle(self.start, self.rise, self.stop)
        for start, rise, stop in times:
            top = value_range(start)[1] + value_range(rise)[1]
            if value_range(stop)[0] < top * (1 - TIME_ROUNDING):
                yield Fault(("attack.stop", "attack"), "must not be before start + rise")
                break
        if inner.strategic or not inner.bounded:
            yield Fault(keys, f"{inner.kind} has no signal of its own")
        if scenario.vehicle.order > inner.highest:
            most = f"{inner.kind} has derivatives up to {inner.highest}"
            yield Fault(keys, f"{most}, {scenario.vehicle.kind} needs more")


def smooth_rise(x: AnyNumbers, rise: float | AnyNumbers, order: int = 3) -> NumberJets:
    """A polynomial in x, 0 before x = 0 and 1 after x = 1, and time derivatives up to an order.

    The derivatives are continuous: `35x⁴ - 84x⁵ + 70x⁶ - 20x⁷` has three, `126x⁵ - 420x⁶ + 540x⁷ -
    315x⁸ + 70x⁹` has four. The shape is (order + 1, …).
    """
    xp = x.__array_namespace__()
    x = xp.clip(x, 0.0, 1.0)
    y = 1.0 - x
    u = x * y
    if order > 3:
        jets = [
            x**5 * (126.0 - 420.0 * x + 540.0 * x**2 - 315.0 * x**3 + 70.0 * x**4),
            630.0 * u**4 / rise,
            2520.0 * u**3 * (y - x) / rise**2,
            2520.0 * u**2 * (3.0 - 14.0 * u) / rise**3,
            15120.0 * u * (1.0 - 7.0 * u) * (y - x) / rise**4,
        ]
    else:
        jets = [
            x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3),
            140.0 * u**3 / rise,
            420.0 * u**2 * (y - x) / rise**2,
            840.0 * u * (1.0 - 5.0 * u) / rise**3,
        ]
    return xp.stack(jets)


def leibniz(order: int) -> list[tuple[int, float]]:
    """Orders of the first factor in a product's derivative, each with its binomial coefficient."""
    return [(j, float(math.comb(order, j))) for j in range(order + 1)]


def bound_rise(order: int) -> np.ndarray:
    """Bounds on `|S^(k)|` in each piece of [0, 1], k = 0..order: (order + 1, PIECES).

    Inside a piece, |S^(k)| exceeds the greater end by at most half the piece's length times the
    greatest slope. S itself is monotone, so its greater end is its bound.
    """
    ends = np.abs(smooth_rise(np.linspace(0.0, 1.0, PIECES + 1), 1.0, order))
    slopes = np.array([0.0, *ends[2:].max(axis=1), LAST_SLOPES[order]])
    return np.maximum(ends[:, 1:], ends[:, :-1]) + slopes[:, None] / (2 * PIECES)


LAST_SLOPES = {3: 840.0, 4: 15120.0}  # greatest |S^(order + 1)|, at x = 0
RISE_BOUNDS = {order: bound_rise(order) for order in LAST_SLOPES}
