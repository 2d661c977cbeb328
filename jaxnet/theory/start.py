"""When a start has died away: what it alone leaves of the errors (theorems.md O1).

With one gain `E(t) = Φ(t) E(0)` plus what attacks add, whatever is retained: Φ is the flow of the
companion system. So `‖E_i(t)‖ ≤ Σ_k ‖Φ_0k(t)‖ ‖E_i^(k)(0)‖`, for vehicles that start with equal
errors an equality. With gains of each vehicle the same holds of local errors ε, with the flow of
each vehicle: `|ε^(k)(0)| ≤ 2 max |E^(k)(0)|`, and `max |E| ≤ ‖L⁻¹‖_∞ max |ε|`.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm

from jaxnet.config.keys import Scenario
from jaxnet.kinds.fields import PI, EachPosition, median, value_range
from jaxnet.kinds.kind import is_number
from jaxnet.model import graph
from jaxnet.model.axis import PlaneGains, companion
from jaxnet.theory.case import Case
from jaxnet.theory.response import DECAYED, kept_by_gain

FLOW_TIMES = 2**13  # at which flows are known
HEADINGS = 64  # of a start that are tried
MOST_SLACK = 0.05  # by which a flow may exceed its values at FLOW_TIMES


class Start(NamedTuple):
    """The farthest start, and the error that it leaves at most from each time on."""

    distance: float  # [m]
    times: Float[np.ndarray, " times"]  # [s]
    left: Float[np.ndarray, " times"]  # [m]

    def after(self, length: float) -> float:
        """The time [s] after which no vehicle is farther off than a length [m]; infinite if never.

        It counts the start alone.
        """
        place = int(np.searchsorted(-self.left, -length))
        return float(self.times[place]) if place < len(self.times) else np.inf


def start_decay(case: Case) -> Start | None:
    """How starts die away; None for drawn gains, starts without bound, and weights that switch."""
    scenario, own, kept = case.scenario, case.scenario.own_gains, case.situation.retained
    sizes = start_sizes(scenario)
    if scenario.draws_gain or not np.isfinite(sizes).all():
        return None
    if own is None:
        matrices, factor = scenario.gain_matrices, 1.0
        gains = [case.gain if matrices is None else matrices]
    elif kept is None or kept.fixed is None:
        return None
    else:
        laplacian = graph.laplacian(graph.dense(kept.fixed))
        gains, factor = [*own], 2 * np.linalg.solve(laplacian, np.ones(len(laplacian))).max()
    slowest = max(np.linalg.eigvals(companion(gain)).real.max() for gain in gains)
    times = np.linspace(0.0, DECAYED / -slowest, FLOW_TIMES)
    now = factor * np.max([flow_norms(gain, times[1]) @ sizes for gain in gains], axis=0)
    return Start(float(sizes[0]), times, np.maximum.accumulate(now[::-1])[::-1])


def start_drive(case: Case) -> float | None:
    """Bound on `‖E^(r)(0)‖ = ‖Σ_k k_k E^(k)(0)‖` [m/s^r] of a solved law; None without a bound."""
    drive = float(np.abs(case.gain) @ start_sizes(case.scenario))
    return drive if np.isfinite(drive) and not case.scenario.draws_gain else None


class KeepsMoving(NamedTuple):
    """The condition on a start under which no vehicle comes to rest, without attack."""

    factors: Float[np.ndarray, " r"]  # max_t ‖Φ_1k(t)‖
    slowest: float  # [m/s] the navigator's least speed
    every_start: bool  # whether every start that may be drawn meets it


def keeps_moving(case: Case) -> KeepsMoving | None:
    """`Σ_k max_t ‖Φ_1k(t)‖ ‖E^(k)(0)‖ < min ‖ẏ_0‖`: then `‖ẏ‖ ≥ ‖ẏ_0‖ - ‖Ė‖ > 0`.

    None for vehicles that are never singular at rest, for limits, where offsets move, and for gains
    so unlike that FLOW_TIMES do not resolve the flow: between two times h apart it changes by
    `e^(‖A_c‖ h / 2) - 1` of itself at most.
    """
    scenario, vehicle = case.scenario, case.scenario.vehicle
    unknown = scenario.draws_gain or scenario.formation.moves or vehicle.limits
    if vehicle.singular != 1 or unknown or not vehicle.flat:
        return None
    matrix = companion(case.gain)
    step = DECAYED / -np.linalg.eigvals(matrix).real.max() / FLOW_TIMES
    slack = np.expm1(np.linalg.norm(matrix, 2) * step / 2)
    if slack > MOST_SLACK:
        return None
    factors = flow_norms(case.gain, step, 1).max(axis=0)
    # Headings of starts are tried in steps, within the slack.
    slowest, sizes = scenario.navigator.slowest(scenario.horizon)[0], start_sizes(scenario)
    most = factors @ sizes + slack * np.sqrt((factors**2).sum()) * sizes.sum()
    return KeepsMoving(factors, slowest, bool(most < slowest))


@kept_by_gain
def flow_norms(gain: PlaneGains, step: float, row: int = 0) -> Float[np.ndarray, "times r"]:
    """‖Φ_0k‖, from the k-th derivative at the start to the position, at multiples of a step [s].

    For another row: to that derivative. Each pass doubles the times.
    """
    matrix = companion(gain)
    flows, flow = np.eye(len(matrix))[None], expm(matrix * step)
    while len(flows) < FLOW_TIMES:
        flows, flow = np.concatenate([flows, flows @ flow]), flow @ flow
    axes = len(matrix) // len(gain)
    blocks = flows[:, row * axes : (row + 1) * axes].reshape(FLOW_TIMES, axes, len(gain), axes)
    return np.linalg.norm(blocks, 2, axis=(1, 3))


def start_sizes(scenario: Scenario) -> Float[np.ndarray, " r"]:
    """Greatest ‖E^(k)(0)‖ over all starts that may be drawn; infinite where they have no bound.

    Numbers of the vehicle count with their medians, headings in steps of 6°.
    """
    given, position = scenario.initial, scenario.initial.position
    places = position.root if isinstance(position, EachPosition) else [[position, position]]
    x, y = (np.array([value_range(place[axis]) for place in places]) for axis in (0, 1))
    low, high = np.clip(value_range(given.heading), -PI, PI)
    speeds = np.array(value_range(given.speed))
    if not all(np.isfinite(each).all() for each in (x, y, speeds)):
        return np.full(scenario.vehicle.order, np.inf)
    headings = np.linspace(low, high, HEADINGS)
    at = np.indices((2, 2, HEADINGS, 2)).reshape(4, -1)
    start = np.stack([x[:, at[0]], y[:, at[1]]])
    pose = (np.broadcast_to(each, start[0].shape) for each in (headings[at[2]], speeds[at[3]]))
    numbers = {key: each for key, each in scenario.vehicle.config_keys().items() if is_number(each)}
    medians = {key: np.array([median(number)]) for key, number in numbers.items()}
    vehicle: Any = scenario.vehicle.with_values(**medians)
    own = np.stack(vehicle.output_jets(vehicle.start(start, *pose)))
    path = np.asarray(scenario.navigator.jets(np.zeros(1)))[: len(own), :, None]
    return np.linalg.norm(own - path, axis=1).max(axis=(1, 2))
