"""The closed loop of a lane on the arena, in NumPy alone: `store.arena` copies it into scripts.

Robots are the columns of `lane.start`, links the entries of `lane.listener`, `lane.source`, ….
Functions here use NumPy, `lane` and each other alone.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np

Array = np.ndarray


def drive_robots(robots: Any, lane: SimpleNamespace) -> Array:
    """Drive the robots by the poses that are measured; return these, (steps + 1, 3, robots)."""
    poses, number = [], lane.start.shape[1]
    believed = np.ones((2, len(lane.source)), bool)  # links that a listener retains, by axis
    for tick in range(lane.steps):
        poses.append(robots.get_poses().copy())
        robots.set_velocities(np.arange(number), commands(lane, poses[-1], tick, believed))
        robots.step()
    return np.array([*poses, robots.get_poses()])


def commands(lane: SimpleNamespace, poses: Array, tick: int, believed: Array) -> Array:
    """Speed [m/s] and turn rate [rad/s] of each robot; `believed` is updated."""
    time, heading = tick * lane.step, poses[2]
    place, place_rate = waves(lane.places, time)
    path, path_rate = waves(lane.navigator, time)
    lie, lie_rate = waves(lane.lies, time)
    nothing = np.zeros((2, 1))
    own = poses[:2] + lane.ahead * np.array([np.cos(heading), np.sin(heading)]) - place
    message = np.hstack([path, own, nothing])[:, lane.carried] + lie[:, lane.lie]
    rate = np.hstack([path_rate, 0 * own, nothing])[:, lane.carried] + lie_rate[:, lane.lie]
    rate = np.where(lane.source == 0, rate, 0.0)  # a robot does not tell its velocity
    velocity = place_rate + 0 * own
    for robot in range(own.shape[1]):
        links = np.flatnonzero((lane.listener == robot + 1) & ~lane.lost[tick])
        mine, heard = own[:, [robot]], message[:, links]
        believed[:, links] = lane.defence(lane, links, mine, heard, believed[0, links])
        weight = lane.weight[links] * believed[:, links]
        whole = lane.normalised * weight.sum(axis=1) + lane.own_weight[robot]
        demand = (weight * (lane.gain * (heard - mine) + rate[:, links])).sum(axis=1)
        velocity[:, robot] += demand / np.where(whole > 0, whole, 1.0)
    velocity = lane.filter(lane, velocity, own + place, time)
    cosine, sine = np.cos(heading), np.sin(heading)
    speed = cosine * velocity[0] + sine * velocity[1]
    return np.array([speed, (cosine * velocity[1] - sine * velocity[0]) / lane.ahead])


def waves(parts: Array, time: float) -> tuple[Array, Array]:
    """`centre + cosine · cos(rate · time) + sine · sin(rate · time)`, and the rate of change."""
    centre, cosine, sine, rate = parts
    along, across = np.cos(rate * time), np.sin(rate * time)
    return centre + cosine * along + sine * across, rate * (sine * along - cosine * across)


def believe_all(
    lane: SimpleNamespace, links: Array, own: Array, heard: Array, last: Array
) -> Array:
    """Believe every message."""
    return np.ones(len(links), bool)


def believe_trusted(
    lane: SimpleNamespace, links: Array, own: Array, heard: Array, last: Array
) -> Array:
    """Believe trusted sources alone; without a trusted source, all."""
    return lane.trusted[links] | lane.trusts_nobody[links]


def trim_by_trust(
    lane: SimpleNamespace, links: Array, own: Array, heard: Array, last: Array
) -> Array:
    """Drop the θ messages that are farthest, on average, from the trusted ones.

    A robot that hears fewer than 2θ + 1 sources, or fewer than θ trusted ones, drops none. Of
    scores that are equal to rounding the first is dropped.
    """
    kept, trusted = np.ones(len(links), bool), lane.trusted[links]
    theta = lane.theta[links[0]] if len(links) else 0
    if theta == 0 or len(links) < 2 * theta + 1 or trusted.sum() < theta:
        return kept
    apart = heard[:, :, None] - heard[:, None, trusted]
    score = np.hypot(*apart).mean(axis=1) + np.where(last, 0.0, lane.tolerance)
    score[lane.spared[links]] = -np.inf
    for _ in range(theta):
        worst = -1
        for each in np.flatnonzero(kept & (score >= 0)):
            if worst < 0 or score[each] > score[worst] * (1 + 1e-12):
                worst = each
        if worst >= 0:
            kept[worst] = False
    return kept


def w_msr(lane: SimpleNamespace, links: Array, own: Array, heard: Array, last: Array) -> Array:
    """On each axis drop the F values farthest above the robot's own, and the F farthest below."""
    size, larger = np.abs(heard - own), np.maximum(np.abs(heard), np.abs(own))
    beside = size > 1e-12 * np.maximum(1.0, larger)
    side = np.where(beside & ~lane.spared[links], np.sign(heard - own), 0)
    first = np.arange(len(links))
    farther = size[:, None] > size[:, :, None] * (1 + 1e-12)  # [axis, this, other]
    equal = ~farther & ~farther.swapaxes(1, 2) & (first[None] < first[:, None])
    beyond = (side[:, None] == side[:, :, None]) & (farther | equal)
    return (side == 0) | (beyond.sum(axis=2) >= lane.F)


def unfiltered(lane: SimpleNamespace, velocity: Array, own: Array, time: float) -> Array:
    """No safety filter."""
    return velocity


def keep_apart(lane: SimpleNamespace, velocity: Array, own: Array, time: float) -> Array:
    """The nearest velocity within each robot's half of the barriers; without one it stands.

    With Δ from what another robot tells of its place to the robot's own, and h = ‖Δ‖² - distance²:
    `-2Δ · u ≤ barrier_gain · h^power / 2` for each other robot, and ‖u‖ ≤ speed.
    """
    told, safe = own + waves(lane.told, time)[0], np.zeros_like(velocity)
    for robot in range(own.shape[1]):
        gap = own[:, [robot]] - np.delete(told, robot, axis=1)
        length = np.hypot(*gap)
        beyond = length**2 - lane.distance**2
        room = lane.barrier_gain * beyond * np.abs(beyond) ** (lane.power - 1)
        point = nearest_within(velocity[:, robot], -gap / length, room / (4 * length), lane.speed)
        safe[:, robot] = 0.0 if point is None else point
    return safe


def nearest_within(wanted: Array, normal: Array, limit: Array, most: float) -> Array | None:
    """The nearest u with `normal · u ≤ limit` (2, lines) and ‖u‖ ≤ most, or None.

    It is the wanted one cut to the disc, or its foot on a line, or where a line meets the circle or
    another line.
    """
    foot, along = limit * normal, np.array([-normal[1], normal[0]])
    half = np.sqrt(np.maximum(most**2 - limit**2, 0.0))
    slope = normal.T @ along  # [other, this]: how steeply this line crosses the other
    crossing = (limit[:, None] - normal.T @ foot) / np.where(np.abs(slope) > 1e-9, slope, np.inf)
    places = np.vstack([wanted @ along, half, -half, crossing])
    points = (foot[:, None] + along[:, None] * places).reshape(2, -1)
    points = np.hstack([(wanted * min(1.0, most / max(np.hypot(*wanted), most)))[:, None], points])
    within = (normal.T @ points <= limit[:, None] + 1e-12).all(axis=0)
    within &= np.hypot(*points) <= most + 1e-12
    if not within.any():
        return None
    return points[:, within][:, np.hypot(*(points[:, within] - wanted[:, None])).argmin()]
